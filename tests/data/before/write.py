"""Writes the files beside it: run with the version that they are to be of, commit 7524a92.

``python tests/data/before/write.py``
"""

from pathlib import Path

import plenoptic as pl

FOLDER = Path(__file__).parent


def camera():
    return pl.PlenopticCamera(
        lens=pl.load_lens("achromat-100mm-f4.4"),
        microlenses=pl.MicrolensArray(
            0.217, (2.0, 1.8), imperfections=pl.MicrolensImperfections(decentre=0.002, seed=3)
        ),
        sensor=pl.Sensor((12, 16), 0.02),
        stop_to_microlenses=123.3,
        microlenses_to_sensor=1.7,
    )


def scene():
    return pl.Scene([pl.sphere(3.0, center=(0.0, 0.0, -404.0), material=pl.Lambertian(0.5))], background=1.0)


if __name__ == "__main__":
    settings = {"samples": 16, "progress": False, "threads": 1}
    shot = pl.render(scene(), camera(), truth=pl.Truth.ALL, clamp=9.0, **settings)
    shot.save(FOLDER / "shot.exr")
    pl.render_white(camera(), checkpoint=FOLDER / "white.checkpoint", **settings)
    shot.develop(pl.SensorModel(photon_rate=1e6), seed=1).save(FOLDER / "raw.tif")

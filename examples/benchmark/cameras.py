"""The cameras: ``python examples/benchmark/cameras.py`` writes their files anew, from which the benchmark reads.

All look at surfaces some 330 to 450 mm away, at virtual depths of 12 to 2.3 of the focused ones.
"""

import dataclasses
from pathlib import Path

import plenoptic as pl

FILES = Path(__file__).parent / "cameras"
LENS = pl.load_lens("double-gauss-100mm-f2")
PIXEL = 0.009
TYPES = (3.0, 4.0, 6.5)  # virtual depths that the three types of microlenses see sharply: no gap between them


def designed(side, pixels, lens=LENS, **wishes):
    """A camera of so many pixels along each side, and microlenses so many pixels apart."""
    return pl.design_camera(lens, sensor=pl.Sensor((side, side), PIXEL), pitch=pixels * PIXEL, **wishes).camera


def views_camera(lens=LENS, focal_length=0.75):
    """Plenoptic 1.0: 60 x 60 microlenses focused at infinity over 10 x 10 pixels each; z = -385 mm is in focus."""
    kind, lattice = pl.CameraKind.PLENOPTIC_1, pl.Lattice.SQUARE
    return designed(600, 10, lens, kind=kind, lattice=lattice, z=-385.0, focal_length=focal_length, image_fill=0.95)


def tessar_camera():
    """The same through a tessar, whose spherical aberration makes disparities some percent less than Gaussian ones."""
    return views_camera(pl.load_lens("tessar-102mm-f4.5"))


def fast_camera():
    """The same through a fast double Gauss at f/2.7, whose microlenses are shorter for micro images as large."""
    return views_camera(pl.load_lens("double-gauss-105mm-f1.4"), focal_length=0.3)


def focused_camera():
    """Plenoptic 2.0: microlenses of one focal length over 20 x 20 pixels, which see z = -404 mm sharply, at v = 5."""
    kind = pl.CameraKind.GALILEAN
    return designed(400, 20, kind=kind, z=-404.0, focal_length=1.875, virtual_depth=5.0, image_fill=0.9)


def three_types_camera():
    """The same with three focal lengths side by side, which see different planes sharply."""
    camera = focused_camera()
    lengths = tuple(camera.microlenses_to_sensor / (1 - 1 / v) for v in TYPES)
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, focal_lengths=lengths))


MADE = {
    "views": views_camera,
    "tessar": tessar_camera,
    "fast": fast_camera,
    "focused": focused_camera,
    "three-types": three_types_camera,
}


def load(name, size=1.0):
    """A camera from its file, with a part of its sensor if wanted."""
    camera = pl.package.load_value(FILES / f"{name}.json")
    sensor = pl.Sensor(tuple(round(size * side) for side in camera.sensor.shape), PIXEL)
    return dataclasses.replace(camera, sensor=sensor)


if __name__ == "__main__":
    FILES.mkdir(exist_ok=True)
    for name, make in MADE.items():
        pl.package.save_value(make(), FILES / f"{name}.json", about={"about": make.__doc__})
        print(FILES / f"{name}.json")

"""Where bends that are drawn stand for waves, and where not: a table and docs/images/diffraction_model.png.

Run as `python docs/make_diffraction.py`; it takes some fifteen minutes.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

TARGET = Path(__file__).parent / "images" / "diffraction_model.png"
PITCH, FOCAL_LENGTH, PIXEL, SIDES = 0.217, 2.0, 0.01, (1, 2, 4)
"""Images are of pixels half as wide as those of the camera; of 1, 2 and 4 along a side one is made."""
CASES = {
    "2.0": {"stop_to_microlenses": 123.3, "microlenses_to_sensor": 1.7},
    "1.0": {"stop_to_microlenses": 134.6, "microlenses_to_sensor": 2.0},
}
DEPTHS = (-404.0, -398.0, -380.0, -440.0, -340.0)
SIDE = 5
"""Points of a texture along a side, some 10 um apart on the sensor."""


def camera(stop: float, **more: float) -> pl.PlenopticCamera:
    return pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(stop)),
        microlenses=pl.MicrolensArray(pitch=PITCH, focal_lengths=(FOCAL_LENGTH,)),
        sensor=pl.Sensor(shape=(1024, 1024), pixel_pitch=PIXEL / 2),
        diffraction=pl.Diffraction(),
        **more,
    )


def behind(made: pl.PlenopticCamera, z: float) -> float:
    """How far behind the array the main lens images a plane, in mm."""
    points = pl.paraxial.cardinal_points(made.lens, made.wavelength)
    return points.rear_principal + 1 / (1 / points.efl - 1 / (points.front_principal - z)) - made.stop_to_microlenses


def defocus(made: pl.PlenopticCamera, z: float) -> float:
    """At the edge of a microlens, in waves."""
    vergence = 1 / made.microlenses_to_sensor - 1 / FOCAL_LENGTH - 1 / behind(made, z)
    return PITCH**2 / 8 * vergence / (1e-6 * made.wavelength)


def images(made: pl.PlenopticCamera, point: tuple[float, float, float], rays: int = 1 << 22) -> np.ndarray:
    """(2, rows, columns): of a point as a wave, and by rays that bend."""
    wave = pl.wave.point_spread(made, point).whole()
    return np.stack([wave, pl.point_spread(made, point, rays=rays, progress=False).whole()])


def wholly_lit(made: pl.PlenopticCamera, point: tuple[float, float, float]) -> np.ndarray:
    """Pixels around the spots of microlenses that are lit all over: those with as many rays as most."""
    rays = pl.camera.landing_points(made, point, rays=1 << 18)
    lenses, counts = np.unique(rays.index, axis=0, return_counts=True)
    row, column = np.indices((512, 512)) - 255.5
    found = np.zeros((512, 512), dtype=bool)
    for lens in lenses[counts > 0.99 * np.percentile(counts, 90)]:
        x, y = rays.position[(rays.index == lens).all(axis=1)].mean(axis=0) / PIXEL
        found |= np.hypot(column + x, row - y) < 11
    return found


def texture(made: pl.PlenopticCamera, z: float) -> np.ndarray:
    """(2, rows, columns): of points that shine at random, each by itself."""
    # 10 um on the sensor: through a microlens, and through the main lens.
    apart = PIXEL * abs(behind(made, z)) / made.microlenses_to_sensor
    points = pl.paraxial.cardinal_points(made.lens, made.wavelength)
    apart *= (points.front_principal - z) / (made.stop_to_microlenses + behind(made, z) - points.rear_principal)
    bright = np.random.default_rng(1).uniform(size=(SIDE, SIDE))
    steps = apart * (np.arange(SIDE) - (SIDE - 1) / 2)
    places = [(bright[j, i], x, y) for j, y in enumerate(steps) for i, x in enumerate(steps)]
    return sum(light * images(made, (x, y, z), 1 << 20) for light, x, y in places)


def binned(both: np.ndarray, side: int) -> np.ndarray:
    """The same on pixels of some along a side."""
    n = both.shape[-1] // side
    return both.reshape(-1, n, side, n, side).sum(axis=(2, 4))


def off(both: np.ndarray, where: np.ndarray | None = None) -> float:
    """The largest difference, in % of the peak."""
    wave, bent = both
    return 100 * float(np.abs(bent - wave)[... if where is None else where].max() / wave.max())


def main() -> None:
    shown, finest = {}, [PIXEL / 2 * PITCH / (h["microlenses_to_sensor"] * 587.6e-6) for h in CASES.values()]
    print("largest difference from waves, % of the peak, for three pixels")
    print("pixel over lambda N:", *(", ".join(f"{side * least:.1f}" for side in SIDES) for least in finest))
    print("camera  field     z/mm   waves                point  wholly lit              texture")
    for name, numbers in CASES.items():
        made = camera(5.0, **numbers)
        for field in (0.0, 5.5):
            for z in DEPTHS:
                point = (field, 0.0, z)
                both = images(made, point)
                texts = [", ".join(f"{off(binned(both, side)):.1f}" for side in SIDES), "", ""]
                if abs(defocus(made, z)) < 5:
                    texts[1] = f"{off(binned(both, 2), wholly_lit(made, point)):.1f}"
                if field == 0.0 and abs(defocus(made, z)) < 5:
                    mixed = texture(camera(3.0, **numbers), z)
                    texts[2] = ", ".join(f"{off(binned(mixed, side)):.1f}" for side in SIDES)
                begin = f"{name:6} {field:6.1f} {z:8.0f} {defocus(made, z):8.3f} "
                print(begin + f"{texts[0]:>20}{texts[1]:>12}{texts[2]:>20}", flush=True)
                if field == 0.0 and (name, z) in (("2.0", -404.0), ("2.0", -440.0), ("1.0", -404.0)):
                    shown[f"camera {name}, {z:g} mm, {defocus(made, z):.1f} waves"] = binned(both, 2)
    draw(shown)


def draw(shown: dict[str, np.ndarray]) -> None:
    figure, axes = plt.subplots(len(shown), 3, figsize=(8.5, 2.6 * len(shown)), layout="constrained")
    for axes_of, (title, (wave, bent)) in zip(axes, shown.items(), strict=True):
        lit = np.argwhere(wave > 0.002 * wave.max())
        (top, left), (bottom, right) = lit.min(axis=0) - 2, lit.max(axis=0) + 3
        if bottom - top > 50:  # the image of the microlens that differs most
            row_at, column_at = np.unravel_index(np.abs(bent - wave).argmax(), wave.shape)
            (top, left), (bottom, right) = (row_at - 8, column_at - 8), (row_at + 9, column_at + 9)
        part, sides = np.s_[top:bottom, left:right], (left - 256, right - 256, bottom - 256, top - 256)
        extent = [1e3 * PIXEL * side for side in sides]
        for axis, image, name, limits in (
            (axes_of[0], wave, "waves", (0, 1)),
            (axes_of[1], bent, "rays that bend", (0, 1)),
            (axes_of[2], bent - wave, "difference", (-0.2, 0.2)),
        ):
            drawn = axis.imshow(
                (image / wave.max())[part], cmap="RdBu_r" if limits[0] else "gray", clim=limits, extent=extent
            )
            axis.set_title(name, fontsize=8)
            axis.set_xlabel("um", fontsize=7)
            axis.tick_params(labelsize=7)
        axes_of[0].set_ylabel(f"{title}\num", fontsize=7)
        bar = figure.colorbar(drawn, ax=axes_of, shrink=0.8)
        bar.set_label("difference, parts of the peak", fontsize=7)
        bar.ax.tick_params(labelsize=7)
    figure.savefig(TARGET, dpi=80)


if __name__ == "__main__":
    main()

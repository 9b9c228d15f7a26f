"""White images against areas: what each microlens gets, and the shape of the stop under it."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl

GAUSS = pl.load_lens("double-gauss-100mm-f2")
FOCAL = 2.0
SENSOR = pl.Sensor(shape=(600, 600), pixel_pitch=0.010)


def camera_of(lens: pl.LensStack, distance: float = 123.3, pitch: float = 0.217) -> pl.PlenopticCamera:
    """A plenoptic 1.0 camera."""
    return pl.PlenopticCamera(
        lens=lens,
        microlenses=pl.MicrolensArray(pitch=pitch, focal_lengths=(FOCAL,), lattice=pl.Lattice.SQUARE),
        sensor=SENSOR,
        stop_to_microlenses=distance,
        microlenses_to_sensor=FOCAL,
    )


def alone(camera: pl.PlenopticCamera, centre: np.ndarray) -> pl.PlenopticCamera:
    """The same camera with all microlenses but one made dark, so that no light of others reaches its image."""
    index = camera.microlenses.lenses((-6, -6), (6, 6)).index
    mine = np.round(centre / camera.microlenses.pitch).astype(int)
    others = index[(index != mine).any(axis=1)]
    dark = pl.optics.MicrolensDeviations(others, transmission=np.zeros(len(others)))
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, imperfections=dark))


def around(camera: pl.PlenopticCamera, centre, half: float):
    """The region of the pixels within `half` (mm) of a point of the sensor, and their places (rows, columns, 2)."""
    row, column = np.rint(camera.sensor.pixel_of(centre)).astype(int)
    n = round(half / camera.sensor.pixel_pitch)
    region = np.s_[row - n : row + n + 1, column - n : column + n + 1]
    return region, camera.sensor.centre_of(*np.mgrid[region])


def circles_overlap(a: float, b: float, d: float) -> float:
    """Area that two discs of radii a and b share, their centres d apart."""
    if d >= a + b:
        return 0.0
    if d <= abs(a - b):
        return math.pi * min(a, b) ** 2
    x, y = (d * d + a * a - b * b) / (2 * d), (d * d + b * b - a * a) / (2 * d)
    return (
        a * a * math.acos(x / a)
        - x * math.sqrt(a * a - x * x)
        + b * b * math.acos(y / b)
        - y * math.sqrt(b * b - y * y)
    )


# ---- two stops: the vignetting of a tube ----


@pytest.mark.parametrize("height", [0.0, 1.0, 1.6, 2.2])
def test_two_round_stops_pass_their_overlap(height: float) -> None:
    # No lens, a stop of radius 5 and one of radius 4, 40 mm nearer: from a microlens at c they are two discs.
    tube = pl.LensStack(
        [*(pl.CircularStop(5.0, thickness=40.0), pl.CircularStop(4.0, thickness=1.0)), *plane_plate()], iris=0
    ).with_model(pl.LensModel.NONE)
    distance, pitch = 70.0, 0.1
    camera = camera_of(tube, distance, pitch)
    centre = np.round(np.array([height / math.sqrt(2)] * 2) / pitch) * pitch
    camera = alone(camera, centre)
    # The image of stops as seen through the microlens, b = f: it lies around c (1 + b / D).
    region, _ = around(camera, centre * (1 + FOCAL / 50.0), 0.45)
    shot = pl.render_white(camera, samples=256, region=region, progress=False)
    pixel = camera.sensor.pixel_pitch**2
    total = float(shot.image.sum(dtype=float)) * pixel
    error = math.sqrt(np.square(shot.standard_error, dtype=float).sum()) * pixel
    # Both discs as seen from c on the plane of the far one; the near one is larger there by 70 / 30.
    scale = distance / (distance - 40.0)
    rho = float(np.hypot(*centre))
    area = circles_overlap(5.0, 4.0 * scale, rho * (scale - 1.0))
    # Ideal microlenses keep dx dy du dv: at the sensor, light comes in the slopes x / b with cos^4 of their angle.
    slope2 = (rho / distance) ** 2
    expected = pitch**2 * area / distance**2
    # cos^4 over the sensor's slopes (at most 0.1) is 1 to 1 %, the cell's width of 0.1 mm enters by its square.
    assert slope2 < 0.01
    assert total == pytest.approx(expected, rel=0.02, abs=4 * error)
    assert error < 0.01 * max(expected, 1e-9)


def plane_plate() -> tuple[pl.Surface, ...]:
    return (
        pl.Surface(radius=math.inf, thickness=1.0, medium=pl.ConstantMedium(1.5), semi_diameter=20.0),
        pl.Surface(radius=math.inf, semi_diameter=20.0),
    )


# ---- a real lens: the area that reverse rays find open ----


@pytest.mark.parametrize("height", [0.0, 1.5, 2.6])
@pytest.mark.parametrize("exit_stop", [None, 5.5])
def test_microlenses_get_what_stops_and_rims_leave_open(height: float, exit_stop: float | None) -> None:
    lens = GAUSS.with_stop(pl.CircularStop(5.0))
    if exit_stop is not None:
        lens = lens.inserted(pl.CircularStop(exit_stop), z=60.0)
    pitch = 0.08
    camera = camera_of(lens, pitch=pitch)
    centre = np.round(np.array([height * 0.8, height * 0.6]) / pitch) * pitch
    camera = alone(camera, centre)
    region, _ = around(camera, centre * (1 + FOCAL / 128.5), 0.25)
    shot = pl.render_white(camera, samples=512, region=region, progress=False)
    pixel = camera.sensor.pixel_pitch**2
    total = float(shot.image.sum(dtype=float)) * pixel
    error = math.sqrt(np.square(shot.standard_error, dtype=float).sum()) * pixel
    # Rays in reverse from the microlens through a fine grid of a plane behind the lens.
    z, step = 62.0, 0.04
    x, y = (g.ravel() for g in np.meshgrid(np.arange(-9, 9, step), np.arange(-9, 9, step)))
    start = np.array([*centre, 123.3])
    to = np.column_stack([x, y, np.full(x.size, z)]) - start
    out = lens.trace_reverse(pl.RayBundle(np.tile(start, (x.size, 1)), to))
    open_area = np.count_nonzero(out.status == 0) * step**2
    # Ideal microlenses keep dx dy du dv; at the sensor it is weighed by cos^4 of slopes up to 0.1: 1 to 1 %.
    expected = pitch**2 * open_area / (123.3 - z) ** 2
    assert total == pytest.approx(expected, rel=0.015, abs=4 * error)
    assert error < 0.01 * expected


# ---- shapes ----

STOPS = {
    "round": pl.CircularStop(5.0),
    "6 blades": pl.PolygonStop(6, 5.0, rotation=0.2),
    "12 blades": pl.PolygonStop(12, 5.0),
    "star": pl.StarStop(5, 5.0, 2.5, rotation=0.3),
    "curved blades": pl.PolygonStop(5, 5.0, blade_radius=7.0),
}


@pytest.mark.parametrize("name", list(STOPS))
@pytest.mark.parametrize("offset", [(0, 0), (6, -4)])
def test_the_stop_s_shape_appears_under_each_microlens(name: str, offset) -> None:
    # A thin lens and a thin microlens with b = f: the pixel at s under the microlens at c sees, through all of the
    # cell, the parallel beam of slope (s - c) / f, which crosses the stop around P = c - (s - c) D / f, as wide as the
    # cell times 1 (parallel). So it is fully lit where P +- half a cell is open, and dark where all of it is closed.
    lens, pitch = GAUSS.with_model(pl.LensModel.THIN).with_stop(STOPS[name]), 0.217
    camera = camera_of(lens, pitch=pitch)
    points = pl.paraxial.cardinal_points(lens, 587.6)
    away = 123.3 - points.rear_principal
    scale = points.entrance_pupil_semi_diameter / 5.0
    centre = np.array(offset) * pitch
    camera = alone(camera, centre)
    region, places = around(camera, centre * (1 + FOCAL / away), 0.12)
    shot = pl.render_white(camera, samples=128, region=region, progress=False).image[..., 0]
    slope = (places - centre) / FOCAL
    reach = 0.5 * (pitch + camera.sensor.pixel_pitch * away / FOCAL)
    corners = [centre - slope * away + reach * np.array(corner) for corner in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    # Between the corners too, where a hole is not convex.
    grid = [centre - slope * away + reach * np.array(c) for c in np.mgrid[-1:1:9j, -1:1:9j].reshape(2, -1).T]
    inside = [lens.stop.contains(*(p / scale).transpose(2, 0, 1)) for p in corners + grid]
    lit, dark = np.all(inside, axis=0), ~np.any(inside, axis=0)
    cos4 = (1 + (slope**2).sum(axis=-1)) ** -2
    full = pitch**2 / FOCAL**2 * cos4
    assert lit.sum() > 20 and dark.sum() > 20
    # The cell's corners see s under other angles: cos^4 changes by 4 slope (cell / 2 b), 2 %, on either side.
    assert shot[lit] == pytest.approx(full[lit], rel=0.03)
    assert np.all(shot[dark] == 0)


@pytest.mark.parametrize("name", ["6 blades", "star"])
@pytest.mark.parametrize("height", [1.3, 2.0])
def test_images_are_cut_off_where_the_second_stop_cuts(name: str, height: float) -> None:
    # Two stops and no lens: the beam of a pixel, as wide as the cell, crosses both. It is fully lit where all of it is
    # open in both, and dark where all of it is closed in one of them.
    stop, near = dataclasses.replace(STOPS[name], thickness=40.0), pl.CircularStop(2.2, thickness=1.0)
    tube = pl.LensStack([stop, near, *plane_plate()], iris=0).with_model(pl.LensModel.NONE)
    distance, pitch = 70.0, 0.1
    camera = camera_of(tube, distance, pitch)
    centre = np.round(np.array([0.8, 0.6]) * height / pitch) * pitch
    region, places = around(camera, centre * (1 + FOCAL / distance), 0.22)
    shot = pl.render_white(alone(camera, centre), samples=128, region=region, progress=False).image[..., 0]
    slope = (places - centre) / FOCAL
    steps = np.mgrid[-1:1:9j, -1:1:9j].reshape(2, -1).T
    lit, dark, cut = np.ones(slope.shape[:2], bool), np.zeros(slope.shape[:2], bool), np.zeros(slope.shape[:2], bool)
    for hole, away in ((stop, distance), (near, distance - 40.0)):
        reach = 0.5 * (pitch + camera.sensor.pixel_pitch * away / FOCAL)
        inside = [hole.contains(*(centre - slope * away + reach * step).transpose(2, 0, 1)) for step in steps]
        cut |= ~np.any(inside, axis=0) & ~dark if hole is near else False
        lit, dark = lit & np.all(inside, axis=0), dark | ~np.any(inside, axis=0)
    full = pitch**2 / FOCAL**2 * (1 + (slope**2).sum(axis=-1)) ** -2
    assert lit.sum() > 20 and dark.sum() > 20
    # The second stop really cuts: pixels that the first one alone would light are dark.
    assert cut.sum() > 5
    assert shot[lit] == pytest.approx(full[lit], rel=0.03)
    assert np.all(shot[dark] == 0)

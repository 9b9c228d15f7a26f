"""A plenoptic camera behind a Cassegrain telescope: rings behind microlenses, and both ways of tracing agree."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.sampling.region_bounds import no_core_reason

OUTER, INNER = 50.0, 18.0
SHARE = INNER / OUTER


def telescope(*elements) -> pl.LensStack:
    """A paraboloid of 200 mm and a secondary that makes 600 mm of it, f/6; the image is 320 mm behind the primary."""
    primary = pl.Surface(-400.0, 140.0, pl.optics.MIRROR, semi_diameter=52.0, conic=-1.0)
    secondary = pl.Surface(180.0, medium=pl.optics.MIRROR, semi_diameter=20.0, conic=-4.0)
    return pl.LensStack([*elements, primary, secondary], iris=len(elements) - 1)


IRIS = pl.CircularStop(OUTER)
SHADED = telescope(pl.optics.RingStop(60.0, INNER, thickness=140.0), IRIS)
LENSES = {"disc": SHADED, "ring": telescope(pl.optics.RingStop(OUTER, INNER)), "open": telescope(IRIS)}


def camera(lens: pl.LensStack, *, microlenses: bool = True) -> pl.PlenopticCamera:
    array = pl.MicrolensArray(pitch=0.2, focal_lengths=(1.2,), lattice=pl.Lattice.SQUARE) if microlenses else None
    sensor = pl.Sensor((60, 60), 0.01) if microlenses else pl.Sensor((4, 4), 0.01)
    return pl.PlenopticCamera(lens, sensor, 320.0, array, 1.2 if microlenses else 0.0)


@pytest.fixture(scope="module")
def white():
    shots = {name: pl.render_white(camera(lens), samples=64, progress=False) for name, lens in LENSES.items()}
    return {name: shot.image.astype(float).squeeze() for name, shot in shots.items()}


def test_microlenses_show_rings(white):
    # Cells of 20 x 20 pixels, the middle one in the middle of the sensor: its radii are those of the exit pupil, f/6,
    # 1.2 mm behind the lens: 10 pixels, and 3.6 for the disc.
    y, x = np.mgrid[-9.5:10.0, -9.5:10.0]
    r = np.hypot(x, y)
    for name in ("disc", "ring"):
        cell = white[name][20:40, 20:40]
        assert cell[r < 3.6 - 0.8].max() == 0.0
        lit = cell[(r > 3.6 + 0.8) & (r < 10.0 - 0.8)]
        assert lit.min() > 0.8 * lit.max()
    assert white["open"][20:40, 20:40][r < 8.0].min() > 0.8 * white["open"].max()


def test_a_disc_takes_its_share_of_the_light(white):
    # A classical Cassegrain unites light at angles with tan(a / 2) = y / (2 f), and a pixel takes up sin^2.
    sine2 = [math.sin(2.0 * math.atan(y / 1200.0)) ** 2 for y in (INNER, OUTER)]
    expected = 1.0 - sine2[0] / sine2[1]
    bare = (camera(LENSES[name], microlenses=False) for name in ("disc", "ring", "open"))
    *shaded, whole = (pl.render_white(each, samples=2048, progress=False).image.mean(dtype=float) for each in bare)
    # 16 pixels of 2048 points of the pupil by Sobol numbers: better than 1e-3.
    assert np.array(shaded) / whole == pytest.approx(expected, abs=2e-3)
    assert white["disc"].mean() == pytest.approx(white["ring"].mean(), rel=5e-3)


def test_the_plan_looks_for_no_certain_light_behind_a_ring():
    assert "2 reflecting" in str(pl.plan(pl.check_scene(), camera(SHADED)))
    assert no_core_reason(camera(SHADED)) == "an opening is no circle and no polygon"
    assert "no circle" not in no_core_reason(camera(LENSES["open"]))
    # Centres are found where the chief ray is shaded.
    with_disc, bare = (pl.microlens_centres(camera(LENSES[name])) for name in ("disc", "open"))
    assert np.abs(with_disc.pixel - bare.pixel).max() < 1e-9


def test_points_are_projected_to_where_their_light_lands():
    # Towards the scene by the one, from it by the other.
    shaded, point = camera(SHADED), (0.0, 20.0, -1e5)
    spread, projection = pl.point_spread(shaded, point), shaded.project([point])
    image = np.asarray(spread.image, dtype=float).squeeze()
    at = np.rint(projection.pixel).astype(int) - np.asarray(spread.corner)
    inside = projection.passes & ((at >= 0) & (at < image.shape)).all(axis=1)
    assert np.count_nonzero(inside) >= 4
    nearby = [image[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2].max() for r, c in at[inside]]
    assert min(nearby) > 0.1 * image.max()

"""Aimed rays pass the points of the real iris that they were aimed at, and start where they say."""

import itertools
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aiming import aimed_rays, aimed_rays_reverse, entrance_pupil_of, fan, hexapolar, square_grid
from plenoptic.optics.lens.trace import trace_part

EPS = np.finfo(float).eps

# Half fields in degrees: those that stand on the lenses' data sheets.
BUNDLED = {
    "achromat-100mm-f4.4": 10.0, "double-gauss-100mm-f2": 21.8, "double-gauss-105mm-f1.4": 22.5,
    "fisheye-100mm-f8": 85.4, "singlet-100mm-f4": 20.0, "telephoto-100mm-f2.8": 7.0, "topogon-100mm-f6.3": 50.0,
}  # fmt: skip

SHARED = Path(os.environ["PLENOPTIC_SHARED"])
FILES = sorted((SHARED / "lenses").glob("*.csv"))


def iris_points(lens: pl.LensStack, pupil: np.ndarray) -> np.ndarray:
    points = np.column_stack([lens.stop.semi_diameter * pupil, np.zeros(len(pupil))])
    placed = lens.stop.placement
    return points if placed is None else points @ np.asarray(placed.rotation).T + placed.shift


def on_iris(lens: pl.LensStack, rays: pl.RayBundle) -> np.ndarray:
    return trace_part(lens, rays, 0, lens.iris_index, clipping=False).origin


def seen_at(field: tuple[float, float]) -> np.ndarray:
    """The direction in which an infinitely far object point is seen from the lens."""
    theta, phi = math.hypot(*field), math.atan2(field[1], field[0])
    return np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), -math.cos(theta)])


def checked(lens: pl.LensStack, field: tuple[float, float], pupil: np.ndarray, z_object: float, tolerance: float):
    rays = aimed_rays(lens, field=field, pupil=pupil, z_object=z_object)
    assert np.all(rays.status == 0) and np.abs(on_iris(lens, rays) - iris_points(lens, pupil)).max() < tolerance
    return rays


def test_rays_fill_the_iris_over_the_whole_field():
    for name, share, azimuth in itertools.product(BUNDLED, (0.0, 0.5, 0.8, 1.0), (0.5 * math.pi, 0.3, -2.0)):
        lens, angle = pl.load_lens(name), share * math.radians(BUNDLED[name])
        field = (angle * math.cos(azimuth), angle * math.sin(azimuth))
        # Newton stops at about 1e-15 rad; the lenses are up to 1300 mm long: 1e-12 mm, and a reserve of 10.
        rays = checked(lens, field, hexapolar(6), -math.inf, 1e-11)
        # All rays have the object's direction, exactly, and start on one plane across it, before the lens.
        assert np.abs(rays.direction + seen_at(field)).max() <= 4 * EPS, (name, share, azimuth)
        ahead = rays.origin @ seen_at(field)
        assert np.ptp(ahead) < 1e-11, (name, share, azimuth)
        if azimuth == 0.5 * math.pi:
            z, y = np.concatenate([lens.profiles(9)[0], lens.profiles(9)[-1]]).T
            assert ahead.min() > (np.column_stack([0 * y, y, z]) @ seen_at(field)).max(), (name, share)


def test_rays_from_a_point_at_a_finite_distance():
    for name, z_object in itertools.product(BUNDLED, (-1.2e3, -1e5)):
        lens = pl.load_lens(name)
        reach = abs(z_object) * math.tan(min(math.radians(BUNDLED[name]), 0.8))
        for share in (0.0, 0.6, 1.0):
            field = (0.3 * share * reach, share * reach)
            # Rounding of the origin adds eps |z_object| to that of the search.
            rays = checked(lens, field, hexapolar(5), z_object, 1e-11 + 4 * EPS * -z_object)
            assert np.array_equal(rays.origin, np.broadcast_to([*field, z_object], (91, 3))), (name, z_object)


def passing_rays(lens: pl.LensStack, theta: float, n: int) -> pl.RayBundle:
    """Rays with the direction of the field theta, spread at random over the pupil, that pass all rims."""
    rng = np.random.default_rng(3)
    towards = seen_at((0.0, theta))
    rim = 3.0 * pl.paraxial.cardinal_points(lens).entrance_pupil_semi_diameter
    r, phi = rim * np.sqrt(rng.uniform(size=n)), rng.uniform(0, 2 * math.pi, n)
    # On a disc across the direction, around the entrance pupil as it is seen from there, and before the lens.
    up = np.array([0.0, math.cos(theta), math.sin(theta)])
    centre = np.array([0.0, 0.0, float(entrance_pupil_of(lens, (0.0, theta)))])
    start = centre + 2e3 * towards + np.outer(r * np.cos(phi), [1.0, 0.0, 0.0]) + np.outer(r * np.sin(phi), up)
    rays = pl.RayBundle(start, np.broadcast_to(-towards, start.shape))
    return rays.selected(lens.trace(rays).status == 0)


def refound(lens: pl.LensStack, theta: float, n: int = 10000) -> int:
    """Every ray that passes the lens is the one that is found when its point of the iris is aimed at."""
    passing = passing_rays(lens, theta, n)
    pupil = on_iris(lens, passing)[:, :2] / lens.stop.semi_diameter
    aimed = aimed_rays(lens, field=(0.0, theta), pupil=pupil)
    assert np.all(aimed.status == 0)
    across = np.eye(3) - np.outer(passing.direction[0], passing.direction[0]) if len(passing) else np.eye(3)
    # Some 1e-11 mm on the iris, where pupils are up to ten times smaller than in front.
    assert np.abs((aimed.origin - passing.origin) @ across).max(initial=0.0) < 1e-9
    return len(passing)


def test_every_ray_that_passes_a_bundled_lens_is_found():
    for name, share in itertools.product(BUNDLED, (0.0, 0.6, 1.0)):
        assert refound(pl.load_lens(name), share * math.radians(BUNDLED[name])) > 5, (name, share)


@pytest.mark.skipif(not FILES, reason="needs the shared lens tables")
def test_lenses_from_files():
    # Others are microscopes, which see no distant objects, and a lens whose stop stands by rule.
    stated = {path: float(found[1]) for path in FILES if (found := re.search(r"([\d.]+)deg", path.name))}
    for (path, degrees), share in itertools.product(stated.items(), (0.0, 1.0)):
        lens, angle = pl.load_lens(path), share * math.radians(degrees) / 2
        rays = aimed_rays(lens, field=(0.0, angle), pupil=hexapolar(6))
        # Beyond the rims, wide-angle lenses have points of the iris that no ray reaches.
        found = rays.status == 0
        assert np.mean(found) > 0.95, (path.name, share)
        off = np.abs(on_iris(lens, rays) - iris_points(lens, hexapolar(6)))[found]
        assert off.max() < 1e-9 and refound(lens, angle, 4000) > 2, (path.name, share)
    # A microscope objective from its front focus: sines of more than 0.8 in front.
    (path,) = (path for path in FILES if "Microscope F0.5 " in path.name)
    lens = pl.load_lens(path)
    rays = checked(lens, (0.0, 1.0), hexapolar(5), pl.paraxial.cardinal_points(lens).front_focus, 1e-9)
    assert rays.direction[:, 2].min() < 0.85


def on_iris_reversed(lens: pl.LensStack, rays: pl.RayBundle) -> np.ndarray:
    return trace_part(lens, rays, lens.iris_index, len(lens.elements) - 1, reverse=True, clipping=False).origin


def test_reverse_rays_fill_the_iris_too():
    for name in ("double-gauss-100mm-f2", "fisheye-100mm-f8", "topogon-100mm-f6.3"):
        lens, pupil = pl.load_lens(name), hexapolar(6)
        z = 1.05 * pl.paraxial.cardinal_points(lens).rear_focus
        for point in ((0.0, 0.0), (3.0, -20.0)):
            rays = aimed_rays_reverse(lens, image_point=point, z_image=z, pupil=pupil)
            assert np.all(rays.status == 0) and np.all(rays.direction[:, 2] < 0), (name, point)
            assert np.array_equal(rays.origin, np.broadcast_to([*point, z], (len(pupil), 3)))
            assert np.abs(on_iris_reversed(lens, rays) - iris_points(lens, pupil)).max() < 1e-11, (name, point)
    # From infinity they start before the last surface.
    lens = pl.load_lens("double-gauss-100mm-f2")
    rays = aimed_rays_reverse(lens, image_point=(0.0, 0.2), z_image=math.inf, pupil=0.5 * hexapolar(3))
    assert rays.direction[0] == pytest.approx([0.0, -math.sin(0.2), -math.cos(0.2)], abs=1e-15)
    assert np.abs(on_iris_reversed(lens, rays) - iris_points(lens, 0.5 * hexapolar(3))).max() < 1e-11
    last = len(lens.elements) - 1
    there = trace_part(lens, rays, last, last, reverse=True, clipping=False).origin
    assert np.einsum("ij,ij->i", there - rays.origin, rays.direction).min() > 0


def test_decentred_and_tilted_lenses_with_a_moved_stop():
    for name in ("double-gauss-100mm-f2", "fisheye-100mm-f8"):
        lens = pl.load_lens(name)
        lens = lens.moved(slice(0, 4), shift=(0.5, 0.3, 0.1), tilt=(0.01, -0.02, 0.0)).moved(2, tilt=(0.0, 0.01, 0.0))
        lens = lens.moved(lens.iris_index, shift=(0.2, 0.4, 0.1), tilt=(0.05, 0.03, 0.0))
        checked(lens, (0.1, 0.3), square_grid(15), -math.inf, 1e-11)
        checked(lens, (300.0, 500.0), square_grid(15), -2000.0, 1e-11)


def pair(radius: float, gap: float) -> list[pl.Surface]:
    front = pl.Surface(radius, 4.0, pl.ConstantMedium(1.5), semi_diameter=radius / 5 + 2)
    return [front, pl.Surface(-radius, gap, semi_diameter=radius / 5 + 2)]


def test_stops_before_behind_and_inside_glass():
    (front, back), stop = pair(60.0, 6.0), pl.CircularStop(4.0, thickness=6.0)
    for iris, elements in enumerate(
        ([stop, front, back], [front, pl.CircularStop(4.0, 3.0), back], [front, back, stop])
    ):
        lens = pl.LensStack(elements, iris=iris)
        rays = checked(lens, (0.02, 0.2), hexapolar(4), -math.inf, 1e-12)
        checked(lens, (1.0, 12.0), hexapolar(4), -80.0, 1e-12)
        assert np.all(lens.trace(rays).status[:37] == 0), iris
        back_rays = aimed_rays_reverse(lens, image_point=(1.0, 4.0), z_image=70.0, pupil=hexapolar(4))
        assert np.abs(on_iris_reversed(lens, back_rays) - iris_points(lens, hexapolar(4))).max() < 1e-12, iris
    # An image between two lenses before the stop: chief rays cross the axis, and objects above are seen below.
    relay = pl.LensStack([*pair(40.0, 80.0), *pair(40.0, 65.0), pl.CircularStop(1.5, thickness=5.0)])
    assert pl.paraxial.cardinal_points(relay).pupil_magnification > 0
    checked(relay, (0.01, 0.05), hexapolar(4), -math.inf, 1e-11)
    checked(relay, (0.5, 1.5), hexapolar(4), -200.0, 1e-11)


def test_many_rays_are_those_of_few_and_a_front_stop_needs_no_search():
    # Above 4096 points, the search starts from a polynomial.
    lens, pupil = pl.load_lens("fisheye-100mm-f8"), square_grid(74)
    field = (0.4, 1.2)
    many = checked(lens, field, pupil, -math.inf, 1e-11)
    few = aimed_rays(lens, field=field, pupil=pupil[::50])
    assert len(pupil) > 4096
    # Both are within 1e-15 rad at the iris, some 1000 mm from the origins.
    assert np.abs(many.origin[::50] - few.origin).max() < 1e-11
    # Of the plane of the front stop, the entrance pupil is the stop itself.
    lens = pl.load_lens("singlet-100mm-f4")
    assert lens.iris_index == 0
    rays = aimed_rays(lens, field=(0.0, 0.3), pupil=[[0.0, 1.0]])
    assert rays.at_z(0.0)[0, :2] == pytest.approx([0.0, lens.stop.semi_diameter], abs=1e-14)
    for n in (0, 1):
        assert len(aimed_rays(pl.load_lens("double-gauss-100mm-f2"), field=(0, 0), pupil=np.zeros((n, 2)))) == n


@pytest.mark.filterwarnings("error")
def test_rays_that_do_not_exist_are_missed():
    # From behind a plano-convex lens with its stop behind: beyond the critical angle of the glass, no ray gets there.
    front = pl.Surface(5.0, 5.0, pl.ConstantMedium(1.5), semi_diameter=5.0)
    ball = pl.LensStack([front, pl.Surface(math.inf, semi_diameter=5.0), pl.CircularStop(4.0)])
    rays = aimed_rays(ball, field=(0.0, 1.5), pupil=hexapolar(3))
    lost = rays.status != 0
    assert np.any(lost) and np.all(rays.status[lost] == pl.RayStatus.MISSED)
    assert np.all(np.isnan(rays.origin[lost])) and np.all(rays.weight[lost] == 0)
    assert np.all(ball.trace(rays).status[lost] == pl.RayStatus.MISSED)
    # Objects absurdly far away are none or found.
    for z in (-1e12, -1e100, -1e300):
        rays = aimed_rays(pl.load_lens("double-gauss-100mm-f2"), field=(0, -0.1 * z), pupil=hexapolar(2), z_object=z)
        assert np.all(np.isin(rays.status, (pl.RayStatus.OK, pl.RayStatus.MISSED))), z


def test_the_entrance_pupil_of_a_small_field_is_the_paraxial_one():
    for name in BUNDLED:
        lens = pl.load_lens(name)
        paraxial = pl.paraxial.cardinal_points(lens).entrance_pupil
        assert entrance_pupil_of(lens, (0.0, 0.0)) == paraxial
        # Pupil aberration grows with the square of the field: halving it leaves a quarter.
        whole, half = (entrance_pupil_of(lens, (0.0, angle)) - paraxial for angle in (0.02, 0.01))
        if abs(whole) > 1e-9:
            assert whole / half == pytest.approx(4.0, rel=0.01)


def test_ideal_models_pass_their_stop_where_they_are_aimed_at():
    for model in (pl.LensModel.NONE, pl.LensModel.THIN, pl.LensModel.PARAXIAL):
        lens = pl.load_lens("double-gauss-100mm-f2").with_model(model)
        inside, outside = 0.999 * hexapolar(3), 1.001 * hexapolar(3)[-18:]
        for pupil, passes in ((inside, True), (outside, False)):
            for field, z in (((0.02, 0.1), -math.inf), ((3.0, 20.0), -404.0)):
                rays = aimed_rays(lens, field=field, pupil=pupil, z_object=z)
                assert np.all((lens.trace(rays).status == 0) == passes), model
            back = aimed_rays_reverse(lens, image_point=(0.0, 8.0), z_image=120.0, pupil=pupil)
            assert np.all((lens.trace_reverse(back).status == 0) == passes), model


def test_patterns_of_points():
    for rings in (1, 2, 7):
        points = hexapolar(rings)
        assert len(points) == 1 + 3 * rings * (rings + 1)
        assert np.hypot(*points.T).max() == pytest.approx(1.0, abs=2 * EPS)
        assert np.abs(points.mean(axis=0)).max() < 1e-15
    for n in (1, 2, 33):
        points = square_grid(n)
        assert np.all(np.hypot(*points.T) <= 1)
        # Counting errs by about the root of the outline in cells.
        assert len(points) * (2 / n) ** 2 == pytest.approx(math.pi, abs=3 / n)
    assert fan(5)[:, 1].tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0] and not fan(5)[:, 0].any()
    for function in (hexapolar, square_grid, fan):
        with pytest.raises(pl.errors.InvalidValueError, match="at least"):
            function(0)


def test_what_cannot_be_aimed_at_is_refused():
    for changes, message in (
        ({"z_object": 10.0}, "before the first element"),
        ({"z_object": math.nan}, "nan"),
        ({"z_object": math.inf}, "before the first element"),
        ({"field": (0.0, 3.2)}, "below pi"),
        ({"field": (0.0, math.nan)}, "two finite numbers"),
        ({"field": (0.0,)}, "shape"),
        ({"pupil": [[0.0, math.inf]]}, "not finite"),
        ({"pupil": [0.0, 1.0]}, "shape"),
    ):
        given = {"field": (0.0, 0.1), "pupil": [[0.0, 0.0]], **changes}
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            aimed_rays(pl.load_lens("double-gauss-100mm-f2"), **given)

"""Ghosts: laws of a plate and a thin lens, and two reflections traced in the lens's own frame."""

import dataclasses
import math

import mirror_trace
import numpy as np
import pytest

import plenoptic as pl

GLASS = pl.ConstantMedium(1.5)
INFINITY = float("inf")


def plate(thickness=4.0, gap=3.0, semi_diameter=40.0):
    return pl.LensStack(
        [
            pl.CircularStop(5.0, thickness=gap),
            pl.Surface(INFINITY, thickness=thickness, medium=GLASS, semi_diameter=semi_diameter),
            pl.Surface(INFINITY, semi_diameter=semi_diameter),
        ]
    )


@pytest.mark.parametrize("angle", [0.0, 0.2, 0.6])
def test_a_plate_has_the_square_of_its_reflectance_and_displaces_by_twice_its_thickness(angle):
    thickness, gap, z = 4.0, 3.0, 30.0
    ghosts = plate(thickness, gap).ghosts(field=(0.0, -angle), z_image=z, rays=1 << 16)
    inside = math.asin(math.sin(angle) / 1.5)
    (reflectance,) = mirror_trace.fresnel(1.0, 1.5, np.array([math.cos(angle)]), np.array([math.cos(inside)]))
    assert ghosts.names == ("2-1",)
    # All rays have one angle, so nothing is sampled but the opening, which both lights share. Reflectances are
    # interpolated in tables.
    assert ghosts.energy[0] == pytest.approx(reflectance**2, rel=1e-12 if angle == 0.0 else 1e-5)
    assert ghosts.energy_error[0] < 1e-15
    # The centroid of sampled points of the opening is that of the image light plus the displacement.
    behind = (gap + z - gap - thickness) * math.tan(angle) + thickness * math.tan(inside)
    assert ghosts.centroid[0, 1] == pytest.approx(behind + 2 * thickness * math.tan(inside), abs=0.01)
    assert ghosts.radius[0] == pytest.approx(5.0 * math.sqrt((1.0 + math.cos(0.0) ** 2) / 4), rel=0.01)


def test_a_plate_shifts_the_focus_of_a_ghost_by_two_thirds_more():
    ghosts = plate(4.0, 3.0).ghosts(z_object=-50.0, z_image=30.0)
    # Virtual images lie at the object's reduced distance in front of the last vertex, z = 7.
    assert ghosts.focus[0] == pytest.approx(7.0 - (53.0 + 3 * 4.0 / 1.5) - 30.0, abs=1e-12)


def test_the_sensor_reflects_what_it_is_told():
    ghosts = plate().ghosts(z_image=30.0, sensor=0.3)
    energy = dict(zip(ghosts.names, ghosts.energy.tolist(), strict=True))
    r = 0.04
    closed = {"2-1": r * r, "sensor-2": 0.3 * r, "sensor-1": 0.3 * r * (1 - r) ** 2}
    assert energy == {name: pytest.approx(value, rel=1e-12) for name, value in closed.items()}
    assert ghosts.total == pytest.approx(sum(closed.values()), rel=1e-12)
    assert list(ghosts.energy) == sorted(ghosts.energy, reverse=True)


def test_the_ghost_of_a_thin_lens_has_its_own_focal_length():
    """Powers of both refractions and both reflections add up to (3 n - 1) (c1 - c2), over (n - 1) of the image's."""
    thin, n, c1, c2 = 1e-7, 1.5, 1 / 80.0, -1 / 120.0
    lens = pl.LensStack(
        [
            pl.Surface(1 / c1, thickness=thin, medium=GLASS, semi_diameter=1.0),
            pl.Surface(1 / c2, semi_diameter=1.0),
            pl.CircularStop(1.0),
        ]
    )
    ghosts = lens.ghosts()
    focal_length = 1.0 / ((n - 1.0) * (c1 - c2))
    # Shifts of the principal planes are of the order of the thickness.
    assert ghosts.z_image == pytest.approx(focal_length, abs=10 * thin)
    ghost_focal_length = focal_length * (n - 1.0) / (3.0 * n - 1.0)
    assert ghosts.z_image + ghosts.focus[0] == pytest.approx(ghost_focal_length, abs=10 * thin)
    # A cone of the ghost's focal length, on a disc of 1 mm whose RMS radius is that over root 2; third-order
    # aberrations are of the order (1 / 80)^2.
    spread = abs(focal_length / ghost_focal_length - 1.0) / math.sqrt(2.0)
    assert ghosts.radius[0] == pytest.approx(spread, rel=5e-3)
    assert ghosts.energy[0] == pytest.approx(0.04**2, rel=5e-3)


LENSES = ["double-gauss-100mm-f2", "cooke-triplet-50mm-f5", "heliar-254mm-f5"]


def random_rays(lens, n=400, angle=0.1):
    random, a = np.random.default_rng(7), lens.elements[0].semi_diameter
    origin = np.column_stack([random.uniform(-a, a, (n, 2)), np.full(n, lens.vertices[0] - 20.0)])
    direction = np.column_stack([random.uniform(-angle, angle, (n, 2)), np.ones(n)])
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)


@pytest.mark.parametrize("name", LENSES)
def test_each_pair_is_that_of_a_trace_that_turns_back(name):
    """Points to 1e-9 mm, clipped rays and light of all pairs, the sensor's too."""
    lens, z_sensor = pl.load_lens(name), 1.02 * pl.paraxial.cardinal_points(pl.load_lens(name)).rear_focus
    ghosts = lens.ghosts(z_image=z_sensor, sensor=0.4, rays=32)
    origin, direction = random_rays(lens)
    arrivals, errors = 0, []
    for k in range(len(ghosts)):
        stack, turns = ghosts.stack(k), (int(ghosts.first[k]), int(ghosts.second[k]))
        shift = np.array([0.0, 0.0, stack.vertices[0] - lens.vertices[0]])
        ours = stack.trace(pl.RayBundle(origin + shift, direction))
        points, directions, light = mirror_trace.trace(lens, origin, direction, turns, sensor=(z_sensor, 0.4))
        passes = light > 0
        np.testing.assert_array_equal(ours.status == 0, passes, err_msg=ghosts.names[k])
        moved = ours.origin - (0.0, 0.0, stack.vertices[-1] - lens.vertices[-1])
        np.testing.assert_allclose(moved[passes], points[passes], rtol=0, atol=1e-9, err_msg=ghosts.names[k])
        np.testing.assert_allclose(ours.direction[passes], directions[passes], rtol=0, atol=1e-11)
        arrivals += np.count_nonzero(passes)
        errors.append(np.abs(ours.weight[passes] / light[passes] - 1.0))
    assert arrivals > 500
    # Reflectances are interpolated, worst where total reflection begins.
    assert np.median(np.concatenate(errors)) < 1e-5
    assert np.quantile(np.concatenate(errors), 0.95) < 1e-3


@pytest.mark.parametrize("field", [0.0, 0.15])
def test_energies_are_those_of_a_trace_that_turns_back(field):
    lens = pl.load_lens("double-gauss-100mm-f2")
    ghosts = lens.ghosts(field=(0.0, field), sensor=0.3, rays=8192)
    # A square grid in front of the lens, wider than its first surface.
    side = np.linspace(-45.0, 45.0, 121)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side))
    direction = np.broadcast_to([0.0, -math.sin(field), math.cos(field)], (len(x), 3))
    origin = np.column_stack([x, y, np.full(len(x), lens.vertices[0])])
    image = mirror_trace.trace(lens, origin, direction, None)[2].sum()
    sensor = (ghosts.z_image, 0.3)
    for k in range(0, len(ghosts), 5):
        turns = int(ghosts.first[k]), int(ghosts.second[k])
        points, slopes, light = mirror_trace.trace(lens, origin, direction, turns, sensor=sensor)
        expected, lit = light.sum() / image, max(np.count_nonzero(light), 1)
        # Points of a grid in an area: see `illumination._COUNTING`, here of ghost and image.
        error = math.hypot(ghosts.energy_error[k], 0.6 * expected / lit**0.75)
        assert abs(ghosts.energy[k] - expected) < 5 * error + 1e-12, ghosts.names[k]
        if lit > 1000:
            ahead = (ghosts.z_image - points[:, 2]) / slopes[:, 2]
            height = points[:, 1] + ahead * slopes[:, 1]
            assert ghosts.centroid[k, 1] == pytest.approx(
                np.nansum(light * height) / light.sum(), abs=0.05 * ghosts.radius[k]
            )


def test_films_in_cement_reflect_differently_from_both_sides():
    """Planes of index 1.5 with a metal in between: 2-1 has its reflectance from the front, 3-2 that from behind."""
    glass = pl.ConstantMedium(1.5)
    films = [(pl.optics.FilmMaterial(2.0, 1.5), 15.0), (pl.ConstantMedium(1.38), 120.0)]
    cement = pl.optics.Coating(films)
    plane = pl.Surface(math.inf, 5.0, glass, semi_diameter=20.0)
    elements = [plane, dataclasses.replace(plane, coating=cement), pl.Surface(math.inf, semi_diameter=20.0)]
    ghosts = pl.LensStack([pl.CircularStop(5.0, thickness=1.0), *elements]).ghosts(z_image=30.0, rays=64)
    for name, coating in (("2-1", cement), ("3-2", pl.optics.Coating(films[::-1]))):
        reflectance = float(pl.optics.surface_powers(coating, 1.5, 1.5, 1.0, 587.6).reflectance)
        assert ghosts.energy[ghosts.names.index(name)] == pytest.approx(0.04 * reflectance, rel=1e-6)


def test_stated_errors_hold():
    """Energies of few rays against many, in stated errors, over the pairs of a lens; they share rays."""
    lens = pl.load_lens("cooke-triplet-50mm-f5")
    options = {"field": (0.0, 0.2), "z_object": -500.0}
    few, many = lens.ghosts(rays=1024, **options), lens.ghosts(rays=1 << 15, **options)
    values = {name: (e, s) for name, e, s in zip(many.names, many.energy, many.energy_error, strict=True)}
    z = [
        (e - values[name][0]) / math.hypot(s, values[name][1])
        for name, e, s in zip(few.names, few.energy, few.energy_error, strict=True)
        if s > 0
    ]
    assert len(z) > 8
    assert np.abs(z).max() < 4.5
    assert abs(few.total - many.total) < 4 * math.hypot(few.total_error, many.total_error)


def test_displaced_elements_and_aspheres_keep_their_ghosts():
    """A stack turned over as a whole: ghosts of the lens seen from behind, by reversibility."""
    lens = pl.LensStack(
        [
            pl.Surface(60.0, thickness=6.0, medium=GLASS, semi_diameter=12.0, conic=-0.5, aspheric=(0.0, 1e-6)),
            pl.Surface(-90.0, thickness=3.0, semi_diameter=12.0, freeform=pl.optics.BiconicSag(1000.0, -2000.0)),
            pl.CircularStop(20.0),
        ]
    ).moved(1, shift=(0.3, -0.2, 0.1), tilt=(0.01, -0.02, 0.3))
    stack = lens.ghosts(rays=32).stack(0)
    origin, direction = random_rays(lens, 50, angle=0.02)
    out = stack.trace(pl.RayBundle(0.5 * origin * (1, 1, 2) + (0, 0, stack.vertices[0] - lens.vertices[0]), direction))
    assert (out.status == 0).sum() > 40
    # Two mirrors in the lens's own frame by points and normals of each surface alone, found by its sag.
    first, second = lens.elements[:2]
    for ray in np.flatnonzero(out.status == 0)[:20]:
        p, d = 0.5 * origin[ray] * (1, 1, 2), direction[ray]
        for surface, z, way, ratio in (
            (first, lens.vertices[0], 1, 1 / 1.5),
            (second, lens.vertices[1], 1, None),
            (first, lens.vertices[0], -1, None),
            (second, lens.vertices[1], 1, 1.5),
        ):
            p, normal = meet_by_sag(surface, z, p, d)
            cosine = d @ (normal := way * normal)
            if ratio is None:
                d = d - 2.0 * cosine * normal
            else:
                d = ratio * d + (math.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * normal
        t = (lens.vertices[2] - p[2]) / d[2]
        np.testing.assert_allclose(out.origin[ray, :2], (p + t * d)[:2], rtol=0, atol=1e-9)


def meet_by_sag(surface, z, p, d):
    """Intersection by Newton's method in the surface's axes, and its normal in the lens's."""
    place = surface.placement or pl.optics.Placement()
    q, e = (p - (0, 0, z) - place.shift) @ place.rotation, d @ place.rotation
    t = -q[2] / e[2]
    for _ in range(50):
        x, y, w = q + t * e
        gx, gy = surface.gradient(x, y)
        t -= (w - float(surface.sag(x, y))) / (e[2] - gx * e[0] - gy * e[1])
    x, y, _ = q + t * e
    gx, gy = surface.gradient(x, y)
    normal = np.array([-gx, -gy, 1.0]) / math.sqrt(1.0 + gx * gx + gy * gy)
    return p + t * d, place.rotation @ normal


def test_one_surface_alone_has_no_ghost():
    lens = pl.LensStack([pl.CircularStop(5.0), pl.Surface(50.0, medium=GLASS, semi_diameter=8.0)], rear_medium=GLASS)
    ghosts = lens.ghosts()
    assert (len(ghosts), ghosts.total, ghosts.total_error) == (0, 0.0, 0.0)
    assert lens.ghosts(sensor=0.2).names == ("sensor-1",)


def test_bad_input_is_answered_by_a_sentence():
    lens = pl.load_lens("singlet-100mm-f4")
    with pytest.raises(pl.errors.InvalidValueError, match=r"sensor is 1\.5; its reflectance must be from 0 to 1"):
        lens.ghosts(sensor=1.5)
    with pytest.raises(pl.errors.PrescriptionError, match="does not lie behind the last element"):
        lens.ghosts(sensor=0.3, z_image=-1.0)
    mirror = pl.LensStack([pl.CircularStop(5.0), pl.Surface(-400.0, medium=pl.optics.MIRROR, semi_diameter=50.0)])
    with pytest.raises(pl.errors.PrescriptionError, match="has mirrors"):
        mirror.ghosts()
    opaque = pl.optics.coated(lens, pl.optics.Reflectance(1.0))
    for ghosts in (pl.LensStack.ghosts, lambda each: pl.aberrations.veiling_glare(each, patch=0.02)):
        with pytest.raises(pl.errors.InvalidValueError, match=r"singlet-100mm-f4 transmit no light at 587\.6 nm"):
            ghosts(opaque)
    narrow = plate(gap=100.0, semi_diameter=1.0)
    with pytest.warns(pl.errors.PlenopticWarning, match="no light"):
        assert math.isnan(narrow.ghosts(field=(0.0, 0.5), z_image=200.0).total)

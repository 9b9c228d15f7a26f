"""Lenses behind windows: Snell's law in closed form, Gaussian optics by matrices, domes, extreme numbers, bad input."""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import paraxial
from plenoptic.errors import InvalidValueError, PrescriptionError

AIR, GLASS, WATER = pl.optics.AIR, pl.glass("N-BK7"), pl.glass("water")
D = 587.6
N_GLASS, N_WATER = GLASS.index(D), WATER.index(D)


def opening(size=1e5):
    """A wide stop at z = 0 with a plane in air 1 mm behind: rays behind a window go straight on to z = 1."""
    return pl.LensStack([pl.CircularStop(size, thickness=1.0), pl.Surface(math.inf, semi_diameter=size)])


def refract(direction, normal, ratio):
    """Snell's law for unit vectors; nan where light is totally reflected."""
    cosine = (direction * normal).sum(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):
        along = np.sqrt(1.0 - ratio**2 * (1.0 - cosine) * (1.0 + cosine))
    return ratio * direction + (along - ratio * cosine) * normal


def through_planes(start, direction, normal, pivot, thickness, indices):
    """Points at z = 1 and directions of rays through a plate whose rear face has the point `pivot`."""
    for offset, ratio in ((thickness, indices[0] / indices[1]), (0.0, indices[1] / indices[2])):
        point = pivot - offset * normal
        way = ((point - start) * normal).sum(axis=-1) / (direction * normal).sum(axis=-1)
        start = start + way[:, None] * direction
        direction = refract(direction, normal, ratio)
    return start + ((1.0 - start[:, 2]) / direction[:, 2])[:, None] * direction, direction


def normal_of(tilt):
    """Normal of a plane that is turned about x, then about y."""
    a, b = tilt
    return np.array([math.sin(b) * math.cos(a), -math.sin(a), math.cos(b) * math.cos(a)])


def test_rays_through_random_windows_obey_snells_law():
    rng = np.random.default_rng(3)
    for _ in range(100):
        tilt, n, m = rng.uniform(-0.5, 0.5, 2), rng.uniform(1.0, 1.5), rng.uniform(1.3, 2.0)
        thickness, distance = 10.0 ** rng.uniform(-1, 2), rng.uniform(0, 200)
        media = pl.ConstantMedium(m), pl.ConstantMedium(n)
        lens = pl.optics.window(opening(), thickness, media[0], distance=distance, tilt=tilt, outside=media[1],
                                semi_diameter=1e5)  # fmt: skip
        assert lens.iris_index == 2 and lens.vertices[2] == 0.0 and len(lens.elements) == 4
        start = np.column_stack([rng.uniform(-50, 50, (40, 2)), np.full(40, -1000.0)])
        aim = np.column_stack([rng.uniform(-100, 100, (40, 2)), np.zeros(40)])
        direction = (aim - start) / np.linalg.norm(aim - start, axis=1, keepdims=True)
        out = lens.trace(pl.RayBundle(start, direction))
        pivot = np.array([0.0, 0.0, -distance])
        place, way = through_planes(start, direction, normal_of(tilt), pivot, thickness, (n, m, 1.0))
        # A thousand mm times eps, over the cosine of the refracted ray, some ten times: 1e-11 mm; asked are 1e-9.
        ok = np.isfinite(place[:, 0])
        assert ok.any() and np.array_equal(out.status == 0, ok)
        assert np.abs(out.origin[ok] - place[ok]).max() < 1e-9 and np.abs(out.direction[ok] - way[ok]).max() < 1e-12
        back = lens.trace_reverse(pl.RayBundle(out.origin[ok], -out.direction[ok]))
        np.testing.assert_allclose(back.direction, -direction[ok], atol=1e-11)


def two_by_two(*steps):
    """Product of matrices for (height, reduced angle): distances over an index, and powers."""
    total = np.eye(2)
    for kind, number in steps:
        step = [[1.0, number], [0.0, 1.0]] if kind == "gap" else [[1.0, 0.0], [-number, 1.0]]
        total = np.array(step) @ total
    return total


def bare_matrix(lens):
    """That of a lens of spheres in air, from its first to its last element."""
    steps, before = [], 1.0
    for element in lens.elements:
        if isinstance(element, pl.Surface):
            behind = element.medium.index(D)
            steps.append(("power", (behind - before) * element.curvature))
            before = behind
        steps.append(("gap", element.thickness / before))
    return two_by_two(*steps)


def test_gaussian_optics_of_a_lens_behind_a_flat_window():
    for name, thickness, gap in (
        ("double-gauss-100mm-f2", 10.0, 30.0),
        ("cooke-triplet-50mm-f5", 1e-3, 2.0),
        ("singlet-100mm-f4", 80.0, 1e6),
    ):
        lens = pl.load_lens(name)
        wet = pl.optics.window(lens, thickness, GLASS, distance=gap, tilt=(0.2, 0.1), outside=WATER)
        air, points = paraxial.cardinal_points(lens, D), paraxial.cardinal_points(wet, D)
        ((a, b), (c, d)) = bare_matrix(lens) @ two_by_two(("gap", thickness / N_GLASS), ("gap", gap))
        first, last = air.front_focus - air.ffl, air.rear_focus - air.bfl
        z = float(wet.vertices[0])
        leading = float(lens.vertices[0])  # a stop may stand before the first surface
        assert z == pytest.approx(leading - gap - thickness, rel=1e-15)
        size = thickness + gap + abs(air.efl)
        assert a * d - b * c == pytest.approx(1.0, rel=1e-9)
        expected = {
            "efl": -1 / c, "power": -c, "front_efl": -N_WATER / c, "rear_focus": last - a / c,
            "front_focus": z + N_WATER * d / c,
            # Apparent distances in the water: n times the reduced ones.
            "entrance_pupil": z + N_WATER * (thickness / N_GLASS + gap + air.entrance_pupil - leading),
            "entrance_pupil_semi_diameter": air.entrance_pupil_semi_diameter, "exit_pupil": air.exit_pupil,
        }  # fmt: skip
        assert last >= first
        for key, value in expected.items():
            assert abs(getattr(points, key) - value) <= 1e-12 * max(abs(value), size), (name, key)


def test_a_dome_around_the_pupil_leaves_chief_rays_alone_and_moves_the_focus():
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(4.0))
    pupil = paraxial.cardinal_points(lens).entrance_pupil
    r, t = 120.0, 6.0
    wet = pl.optics.window(lens, t, GLASS, radius=r, outside=WATER)
    assert wet.vertices[0] + r == pytest.approx(pupil, abs=1e-12)
    assert wet.vertices[1] + r - t == pytest.approx(pupil, abs=1e-12)
    angle = np.linspace(-0.25, 0.25, 21)
    way = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    rays = pl.RayBundle(np.array([0.0, 0.0, pupil]) - 500.0 * way, way)
    dry, out = lens.trace(rays), wet.trace(rays)
    assert np.array_equal(dry.status, out.status) and (out.status == 0).sum() > 10
    passes = out.status == 0
    assert np.abs(out.origin[passes] - dry.origin[passes]).max() < 1e-10
    assert np.abs(out.direction[passes] - dry.direction[passes]).max() < 1e-12
    # From the centre: 1 / (n' q) = 1 / (n p) + (1 / n - 1 / n') / R at each of the two spheres.
    for p in (-300.0, -1000.0, -math.inf):
        reciprocal = 1 / (N_WATER * p) + (1 / N_WATER - 1 / N_GLASS) / r + (1 / N_GLASS - 1.0) / (r - t)
        apparent = pupil + 1 / reciprocal
        focus, expected = paraxial.image_position(wet, pupil + p, D), paraxial.image_position(lens, apparent, D)
        assert focus == pytest.approx(expected, rel=1e-11), p
    points = paraxial.cardinal_points(wet)
    assert points.entrance_pupil == pytest.approx(pupil, abs=1e-10)
    # Angles at the centre stay, so that lengths there have the inverse ratio of the indices (Lagrange's invariant).
    dry_size = paraxial.cardinal_points(lens).entrance_pupil_semi_diameter
    assert points.entrance_pupil_semi_diameter * N_WATER == pytest.approx(dry_size, rel=1e-12)
    # A dome that stands elsewhere deflects them.
    away = pl.optics.window(lens, t, GLASS, radius=r, outside=WATER, distance=float(wet.elements[1].thickness) + 5.0)
    assert np.abs(away.trace(rays).direction[passes] - dry.direction[passes]).max() > 1e-4


def test_windows_stand_behind_each_other():
    lens, oil = pl.load_lens("cooke-triplet-50mm-f5"), pl.ConstantMedium(1.47)
    inner = pl.optics.window(lens, 3.0, GLASS, distance=20.0, outside=oil)
    both = pl.optics.window(inner, 5.0, pl.ConstantMedium(1.6), distance=7.0, outside=WATER)
    assert [medium.index(D) for medium in both.gap_media[:5]] == [N_WATER, 1.6, 1.47, N_GLASS, 1.0]
    points, air = paraxial.cardinal_points(both), paraxial.cardinal_points(lens)
    gap = N_WATER * (5.0 / 1.6 + 7.0 / 1.47 + 3.0 / N_GLASS + 20.0 + air.entrance_pupil - lens.vertices[0])
    assert points.entrance_pupil == pytest.approx(both.vertices[0] + gap, rel=1e-13)
    assert pl.optics.window(lens, 3.0, GLASS, distance=20.0).front_medium == AIR


def test_total_reflection_and_grazing_rays_are_lost_with_a_status():
    critical = math.asin(1.0 / N_WATER)
    below, above = (
        critical * (1 - 10.0 ** np.arange(-1.0, -15.0, -1)),
        critical * (1 + 10.0 ** np.arange(-1.0, -15.0, -1)),
    )
    for tilt in (0.0, 0.3):
        lens = pl.optics.window(opening(1e9), 2.0, GLASS, distance=1.0, tilt=(tilt, 0.0), outside=WATER,
                                semi_diameter=1e9)  # fmt: skip
        for angles, is_lost in ((below, False), (above, True)):
            # Angles against the window's normal, in the plane of the tilt; the tilt turns the normal towards -y.
            direction = np.column_stack([0 * angles, np.sin(angles - tilt), np.cos(angles - tilt)])
            out = lens.trace(pl.RayBundle(np.array([0.0, 0.0, -3.0]) - 10.0 * direction, direction))
            if is_lost:
                # One part in 1e14 is below the rounding of the sine.
                assert (out.status[:-1] == pl.RayStatus.TOTAL_REFLECTION).all() and (out.lost_at[:-1] == 1).all()
                assert (out.weight[:-1] == 0).all()
                continue
            cosine = np.cos(angles) + 0 * angles
            sine = N_WATER * np.sin(angles)
            grazing = np.sqrt(np.maximum((1 - sine) * (1 + sine), 0.0))
            passes = out.status == 0
            assert passes[:6].all() and (cosine > 0).all()
            ahead = out.direction @ normal_of((tilt, 0.0))
            # The cosine behind is the root of 1 - sin^2, so that a rounding error eps becomes eps / cos.
            assert (np.abs(ahead - grazing)[passes] <= 8 * np.finfo(float).eps / grazing[passes]).all()
            assert np.isfinite(out.origin[passes]).all()
    # Light along the faces does not enter, nor does light from behind.
    lens = pl.optics.window(opening(), 2.0, GLASS, distance=1.0, tilt=(0.3, 0.0), outside=WATER, semi_diameter=1e4)
    along = np.array([[0.0, math.cos(0.3), math.sin(0.3)], [0.0, math.sin(1.4), math.cos(1.4)]])
    out = lens.trace(pl.RayBundle([[0.0, -50.0, -30.0]] * 2, along))
    assert (out.status != 0).all() and (out.weight == 0).all()


def test_thin_windows_and_far_ones():
    for thickness, distance in ((1e-3, 10.0), (1e-6, 0.0), (10.0, 1e6), (1e3, 1e7)):
        lens = pl.optics.window(opening(1e8), thickness, GLASS, distance=distance, tilt=(0.05, -0.1), outside=WATER,
                                semi_diameter=1e8)  # fmt: skip
        start = np.array([[0.0, 0.0, -2.0 * distance - 1e3]] * 3)
        aim = np.array([[0.1, 0.2, 0.0], [5.0, -3.0, 0.0], [-0.3 * distance, 20.0, -distance]])
        direction = (aim - start) / np.linalg.norm(aim - start, axis=1, keepdims=True)
        out = lens.trace(pl.RayBundle(start, direction))
        pivot = np.array([0.0, 0.0, -distance])
        indices = (N_WATER, N_GLASS, 1.0)
        place, way = through_planes(start, direction, normal_of((0.05, -0.1)), pivot, thickness, indices)
        reach = 2.0 * distance + 1e3
        assert (out.status == 0).all() and np.abs(out.direction - way).max() < 1e-14
        assert np.abs(out.origin - place).max() < 1e-14 * reach, (thickness, distance)


def test_rims_and_files(tmp_path):
    lens = pl.load_lens("double-gauss-100mm-f2")
    port = pl.optics.window(lens, 10.0, GLASS, distance=30.0, tilt=(0.1, 0.0), outside=WATER, semi_diameter=20.0)
    dome = pl.optics.window(lens, 10.0, GLASS, radius=100.0, outside=WATER, semi_diameter=50.0)
    assert [e.semi_diameter for e in port.elements[:2]] == [20.0, 20.0]
    assert [e.semi_diameter for e in dome.elements[:2]] == [50.0, 45.0]
    for each in (port, dome):
        pl.save_lens(each, tmp_path / "lens.json")
        assert pl.load_lens(tmp_path / "lens.json") == each
    # Without a size, chief rays up to 63 degrees in air, and all of the entrance pupil, pass the window.
    wide = pl.optics.window(lens, 10.0, GLASS, distance=30.0)
    pupil = paraxial.cardinal_points(lens)
    needed = 2.0 * (pupil.entrance_pupil - wide.vertices[0]) + pupil.entrance_pupil_semi_diameter
    assert needed <= wide.elements[0].semi_diameter < 1.01 * needed
    assert not wide.check()
    assert pl.optics.window(lens, 5.0, GLASS, radius=100.0).elements[0].semi_diameter == 90.0


def test_bad_windows_are_refused_with_a_sentence():
    lens = pl.load_lens("double-gauss-100mm-f2")
    for arguments, message in (
        ((lens, 10.0, GLASS), "distance is missing: a flat window needs"),
        ((lens, 10.0, GLASS, {"distance": -1.0}), "distance is -1 mm; it must be at least 0"),
        ((lens, 10.0, GLASS, {"distance": math.nan}), "distance is nan; it must be finite"),
        ((lens, 0.0, GLASS, {"distance": 1.0}), "thickness is 0 mm; it must be above 0"),
        ((lens, 10.0, "N-BK7", {"distance": 1.0}), "medium is 'N-BK7'; it must be a medium"),
        ((lens, 10.0, GLASS, {"distance": 1.0, "outside": 1.33}), "outside is 1.33; it must be a medium"),
        ((lens, 10.0, GLASS, {"radius": 10.0}), "thickness 10 mm reaches the centre of the dome of radius 10 mm"),
        ((lens, 10.0, GLASS, {"radius": 30.0}), "dome of inner radius 20 mm .* would cut the lens"),
        (
            (lens, 10.0, GLASS, {"distance": 1.0, "tilt": (0.8, 0.0)}),
            "the window cuts the lens: element 1 reaches up to",
        ),
        ((lens, 10.0, GLASS, {"radius": -90.0}), "radius is -90 mm; it must be above 0"),
        ((lens, 10.0, GLASS, {"distance": 1.0, "tilt": 0.1}), "tilt is 0.1; it must be two angles"),
        ((lens, 10.0, GLASS, {"distance": 1.0, "tilt": (0.1, 0.0, 0.0)}), "tilt is .*; it must be two angles"),
        ((lens, 10.0, GLASS, {"distance": 1.0, "tilt": (2.0, 0.0)}), "about x and y it must be below pi / 2"),
        ((lens, 10.0, GLASS, {"radius": 90.0, "semi_diameter": 91.0}), "semi_diameter 91 mm exceeds the radius"),
        (("lens", 10.0, GLASS, {"distance": 1.0}), "lens is a str; give a LensStack"),
        ((pl.no_lens(5.0), 10.0, GLASS, {"distance": 1.0}), "NONE, which refracts no light; take lens.with_model"),
    ):
        keywords = arguments[3] if len(arguments) > 3 else {}
        with pytest.raises(InvalidValueError, match=message):
            pl.optics.window(*arguments[:3], **keywords)
    assert issubclass(PrescriptionError, InvalidValueError)

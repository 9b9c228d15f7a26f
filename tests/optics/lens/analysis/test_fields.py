"""Distortion, field curvature, coma and depth distortion: laws, third-order limits, closed forms."""

import itertools
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.aberrations import Projection, coma, depth_distortion, distortion, field_curvature, foci, seidel_sums
from plenoptic.aiming import aimed_rays, aimed_rays_reverse, chief_ray
from plenoptic.optics.lens.trace import trace_part

BUNDLED = sorted(pl.lens_names())

GLASS = pl.ConstantMedium(1.6)
IN_GLASS = pl.LensStack(
    [pl.Surface(40.0, 12.0, GLASS, semi_diameter=20.0), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-90.0, semi_diameter=25.0)],
    name="stop in glass",
)  # fmt: skip
ASPHERIC = pl.LensStack(
    [pl.Surface(45.0, 6.0, GLASS, semi_diameter=14.0, conic=-0.7, aspheric=(1e-4, 2e-6, -1e-9)),
     pl.Surface(-200.0, 9.0, semi_diameter=14.0, conic=2.0), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-60.0, 4.0, GLASS, semi_diameter=14.0), pl.Surface(-50.0, semi_diameter=14.0, conic=-3.0)],
    name="aspheric",
)  # fmt: skip


THIRD_ORDER = [IN_GLASS, *map(pl.load_lens, ["double-gauss-100mm-f2", "topogon-100mm-f6.3", "achromat-100mm-f4.4"])]
CASES = [
    *((lens, -math.inf) for lens in (*THIRD_ORDER, ASPHERIC)), (ASPHERIC, -300.0),
    (THIRD_ORDER[1], -400.0), (THIRD_ORDER[2], -60.0),
]  # fmt: skip


def test_field_curvature_and_distortion_converge_to_third_order():
    for lens, z_object in CASES:
        fields = np.array([0.08, 0.04, 0.02]) * (1.0 if z_object == -math.inf else -z_object)
        shifts, heights = field_curvature(lens, fields, z_object=z_object), distortion(lens, fields, z_object=z_object)
        left = []
        for i, field in enumerate(fields.tolist()):
            sums = seidel_sums(lens, field=field, z_object=z_object)
            sagittal, tangential = sums.total @ [[0, 0], [0, 0], [1, 3], [1, 1], [0, 0]] / (-2 * sums.aperture**2)
            distorted = sums.total[4] / (2 * sums.aperture)
            left.append([shifts.sagittal[i] - sagittal, shifts.tangential[i] - tangential,
                         heights.height[i] - heights.ideal[i] - distorted])  # fmt: skip
        # Fourth order in the field for the shifts, fifth for the height; the orders after these disturb the ratios.
        assert np.divide(*left[:2]) == pytest.approx([16.0, 16.0, 32.0], rel=0.25), (lens.name, z_object)
        assert np.divide(*left[1:]) == pytest.approx([16.0, 16.0, 32.0], rel=0.08), (lens.name, z_object)


def test_coma_converges_to_third_order():
    for lens in THIRD_ORDER:
        zone = 0.05
        found = coma(lens, [0.01], zone=zone)
        sums = seidel_sums(lens, field=0.01)
        third = zone**2 * sums.total[1] / (2 * sums.aperture)
        # What follows is smaller by the squares of field and zone, 1e-4 and 1e-3, times coefficients of some 10.
        assert found.sagittal[0] == pytest.approx(third, rel=0.03), lens.name
        assert found.tangential[0] == pytest.approx(3 * third, rel=0.03), lens.name


def close_foci(lens: pl.LensStack, angle: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Sagittal and tangential focus by rays a step of the iris away from the chief ray."""
    rays = aimed_rays(lens, field=(0.0, angle), pupil=[[step, 0.0], [0.0, step], [0.0, -step]])
    out = trace_part(lens, rays, 0, len(lens.elements) - 1, clipping=False)
    (side, up, down), (d_side, d_up, d_down) = out.origin, out.direction
    t = np.linalg.solve(np.column_stack([d_up, -d_down])[1:], (down - up)[1:])[0]
    return side - d_side * side[0] / d_side[0], up + t * d_up


def test_coddington_is_the_limit_of_close_rays():
    lenses = [*map(pl.load_lens, BUNDLED), ASPHERIC]
    largest = {lens.name: pl.aberrations.largest_field(lens) for lens in lenses}
    for lens, angle in itertools.product(lenses, (0.0, 0.1, 0.3)):
        if angle > largest[lens.name]:
            continue
        found = field_curvature(lens, [angle])
        exact = np.array([found.sagittal[0], found.tangential[0]]) + found.z_image
        coarse, fine = (np.array([focus[2] for focus in close_foci(lens, angle, step)]) for step in (4e-3, 2e-3))
        # Both rays' means leave an error of the second order, which Richardson's extrapolation takes away. Rounding of
        # some 1e-13 mm is divided by the angle between the rays, 1e-3 of 0.1, squared for the two lengths: 1e-8.
        allowed = 1e-7 * abs(exact[0]) + 1e-3 * abs(fine - coarse).max()
        assert (4 * fine - coarse) / 3 == pytest.approx(exact, abs=allowed), (lens.name, angle)


def test_a_symmetric_lens_at_unit_magnification():
    # The second half undoes what the first does to chief rays, and to each other's upper and lower rays.
    lens = pl.load_lens("topogon-100mm-f6.3")
    points = pl.paraxial.cardinal_points(lens)
    z_object = points.front_focus - points.efl
    assert pl.paraxial.magnification(lens, z_object) == pytest.approx(-1.0, abs=1e-12)
    found, of_coma = (function(lens, [0.0, 40.0, 120.0], z_object=z_object) for function in (distortion, coma))
    assert np.abs(found.relative).max() < 1e-12
    assert found.height == pytest.approx([0.0, -40.0, -120.0], abs=1e-10)
    # At the zone 1 its rays come off the image plane by spherical aberration, but symmetrically.
    assert np.abs([of_coma.sagittal[0], of_coma.tangential[0]]).max() < 1e-12


def test_projections_agree_in_the_middle_and_a_fisheye_images_angles():
    lens = pl.load_lens("fisheye-100mm-f8")
    angles = np.radians([0.0, 30.0, 60.0, 85.4, 91.0])
    by_angle = distortion(lens, angles, projection=Projection.EQUIDISTANT)
    # Miyamoto, J. Opt. Soc. Am. 54, 1964: close to f theta.
    assert np.abs(by_angle.relative).max() < 0.05 and abs(distortion(lens, angles[:3]).relative[2]) > 0.3
    with pytest.raises(pl.errors.InvalidValueError, match="RECTILINEAR image"):
        distortion(lens, angles)
    theta = 1e-4
    # Third order: theta^3 / 3 at most.
    for projection in Projection:
        assert projection.height(50.0, theta) == pytest.approx(50.0 * theta, abs=50 * theta**3 / 2.9)
        assert projection.height(50.0, -0.5) == -projection.height(50.0, 0.5)
    assert Projection.STEREOGRAPHIC.height(1.0, math.pi / 2) == pytest.approx(2.0)
    assert Projection.EQUISOLID.height(1.0, math.pi / 3) == pytest.approx(1.0)
    assert Projection.ORTHOGRAPHIC.height(1.0, math.pi / 2) == pytest.approx(1.0)


def test_depth_distortion_is_the_conjugate_of_field_curvature():
    for name in ("double-gauss-100mm-f2", "singlet-100mm-f4", "topogon-100mm-f6.3"):
        lens = pl.load_lens(name)
        plane = 1.3 * pl.paraxial.cardinal_points(lens).rear_focus
        found = depth_distortion(lens, [0.0, 5.0, 15.0], z_image=plane)
        assert found.sagittal.shape == (1, 3)
        assert found.sagittal[0, 0] == pytest.approx(found.z_object[0], rel=1e-10), name
        for kind, j in itertools.product(("sagittal", "tangential"), (1, 2)):
            z = float(getattr(found, kind)[0, j])
            # The object point lies on the chief ray backwards from the sensor; forwards again, it is sharp there.
            chief = aimed_rays_reverse(lens, image_point=(0.0, found.heights[j]), z_image=plane, pupil=[[0, 0]])
            point = lens.trace_reverse(chief).at_z(z)[0]
            focus = getattr(foci(lens, chief_ray(lens, field=point[:2], z_object=z), parallel=False), kind)[0]
            # Rounding of 1e-12 in the object's z of 400 mm, magnified little.
            assert focus[2] == pytest.approx(plane, abs=1e-8), (name, kind, j)


def test_a_field_without_a_chief_ray_is_nan_in_values_that_are_kept():
    lens = pl.load_lens("double-gauss-100mm-f2")
    angles = [0.1, 1.5]
    found = field_curvature(lens, angles)
    for values in (distortion(lens, angles).height, found.sagittal, found.height, coma(lens, angles).tangential):
        assert np.isnan(values).tolist() == [False, True]
    found = field_curvature(lens, [0.0, 0.1])
    assert found == field_curvature(lens, [0.0, 0.1]) and found != field_curvature(lens, [0.0, 0.11])
    with pytest.raises(ValueError, match="read-only"):
        found.sagittal[0] = 1.0
    assert found.medial == pytest.approx((found.sagittal + found.tangential) / 2)
    assert found.astigmatism == pytest.approx(found.tangential - found.sagittal)
    # Ideal models have no aberrations.
    lens = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.PARAXIAL)
    assert np.abs(distortion(lens, [0.0, 0.2, 0.4]).relative).max() < 1e-13
    assert np.abs(coma(lens, [0.1, 0.3], zone=0.5).tangential).max() < 1e-12
    with pytest.raises(pl.errors.InvalidValueError, match="PARAXIAL, which has no aberrations"):
        field_curvature(lens, [0.1])


def test_what_makes_no_sense_is_refused():
    lens = pl.load_lens("double-gauss-100mm-f2")
    in_focus = pl.paraxial.cardinal_points(lens).front_focus
    near = {"z_object": -400.0, "projection": Projection.EQUIDISTANT}
    for call, message in (
        (lambda: distortion(lens, [4.0]), "below pi"),
        (lambda: distortion(lens, [math.nan]), "below pi"),
        (lambda: distortion(lens, [[0.1]]), "shape"),
        (lambda: distortion(lens, [5.0], **near), "RECTILINEAR"),
        (lambda: distortion(lens, [0.1], projection=7), "Projection.RECTILINEAR or"),
        (lambda: field_curvature(lens.moved(1, shift=(0.1, 0, 0)), [0.1]), "decentred or tilted"),
        (lambda: coma(lens, [0.1], zone=0.0), "zone"),
        (lambda: depth_distortion(lens, [1.0], z_image=0.0), "behind the last element"),
        (lambda: field_curvature(lens, [0.0], z_object=in_focus), "infinity"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()

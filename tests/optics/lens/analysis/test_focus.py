"""Where the image is sharpest: third-order theory, quadratics, and the models of a lens."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import CircularStop, ConstantMedium, LensModel, LensStack, RayBundle, Surface, load_lens
from plenoptic.aberrations import spot_diagram
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.analysis.best_focus import best_focus, front_focus, paraxial_focus, working_f_number
from plenoptic.optics.lens.gaussian import paraxial
from plenoptic.optics.lens.pupil.beam import REPLICATES

GAUSS = load_lens("double-gauss-100mm-f2")
SINGLET = load_lens("singlet-100mm-f4")
PARAXIAL, THIN, NONE = (GAUSS.with_model(kind) for kind in (LensModel.PARAXIAL, LensModel.THIN, LensModel.NONE))
RMS, GEOMETRIC = pl.FocusCriterion.RMS_SPOT, pl.FocusCriterion.GEOMETRIC_SPOT


def test_a_perfect_lens_is_sharp_at_its_paraxial_image():
    for lens, z, criterion in itertools.product((PARAXIAL, THIN), (-math.inf, -1e6, -404.0), pl.FocusCriterion):
        found = best_focus(lens, z_object=z, criterion=criterion, rays=2048)
        # Positions of 1e-13 mm over slopes of 1/4; an object 1e6 mm away has the digits of its distance.
        allowed = 1e-8 if z == -1e6 else 1e-11
        assert found == pytest.approx(paraxial_focus(lens, z), abs=allowed), (lens.model, z, criterion)


def test_the_square_of_the_rms_radius_is_a_parabola(monkeypatch):
    # The rays that spots are of: those are drawn in more sets, so that their errors are known.
    monkeypatch.setattr("plenoptic.optics.lens.analysis.best_focus._REPLICATES", REPLICATES)
    for field in ((0.0, 0.0), (0.0, 0.15)):

        def spot(z):
            return spot_diagram(GAUSS, field=field, z_image=z, rays=4096)  # noqa: B023

        best = best_focus(GAUSS, field=field, rays=4096)
        at = [spot(best + dz).rms_radius ** 2 for dz in (-0.2, 0.0, 0.2)]
        # The same rays, so it is exact: rounding of 1e-4 mm^2 in squares of some 10 mm^2 before centring.
        assert at[1] < at[0] == pytest.approx(at[2], rel=1e-9), field
        # The circle of least confusion is the smallest.
        best = best_focus(GAUSS, field=field, criterion=GEOMETRIC, rays=4096)
        others = [spot(best + dz).geometric_radius for dz in (-1.0, -0.1, -1e-3, 1e-3, 0.1, 1.0)]
        assert min(others) >= spot(best).geometric_radius, field


def test_colours_compromise():
    lines = (486.1, 656.3)
    alone = [best_focus(SINGLET, wavelength=line) for line in lines]
    together = best_focus(SINGLET, wavelength=lines)
    # A singlet: blue focuses first. Both carry the same light, in cones that differ by 1.5 %.
    assert alone[0] < together < alone[1]
    assert together == pytest.approx(np.mean(alone), abs=0.02 * (alone[1] - alone[0]))


def test_third_order_spherical_aberration():
    """2/3 of the way to the marginal focus for the RMS radius, 3/4 for the largest."""
    front = Surface(50.0, 4.0, ConstantMedium(1.5), semi_diameter=20.0)
    lens = LensStack([CircularStop(1.5, thickness=1.0), front, Surface(math.inf, semi_diameter=20.0)])
    out = lens.trace(RayBundle([[0.0, 1.5, -10.0]], [[0.0, 0.0, 1.0]]))
    (_, y, z), (_, m, n) = out.origin[0], out.direction[0]
    marginal = float(z - y * n / m)
    gaussian = best_focus(lens, criterion=pl.FocusCriterion.PARAXIAL)
    assert gaussian == paraxial.image_position(lens, -math.inf)
    for criterion, share in ((RMS, 2 / 3), (GEOMETRIC, 3 / 4)):
        found = best_focus(lens, criterion=criterion, rays=1 << 15)
        # Fifth order: (1.5 / 50)^2 = 1e-3 with a factor of a few; the outermost rays lie within 5e-4 of the rim.
        assert (found - gaussian) / (marginal - gaussian) == pytest.approx(share, abs=5e-3), criterion


def test_models_image_by_their_own_planes():
    points = paraxial.cardinal_points(GAUSS)
    assert paraxial_focus(PARAXIAL, -404.0) == paraxial_focus(GAUSS, -404.0) == paraxial.image_position(GAUSS, -404.0)
    # 1 / image - 1 / object = 1 / f about the rear principal point.
    image = 1.0 / (1.0 / points.efl + 1.0 / (-404.0 - points.rear_principal))
    assert paraxial_focus(THIN, -404.0) - points.rear_principal == pytest.approx(image, rel=1e-14)
    assert paraxial_focus(THIN, -math.inf) == points.rear_focus
    assert paraxial_focus(THIN, points.rear_principal - points.efl) == math.inf
    assert front_focus(THIN) == points.rear_principal - points.efl
    assert front_focus(PARAXIAL) == front_focus(GAUSS) == points.front_focus


def test_the_working_f_number_is_the_slope_of_the_marginal_ray():
    for lens, z in itertools.product((GAUSS.with_stop(CircularStop(0.01)), PARAXIAL, THIN), (-math.inf, -404.0)):
        spot = spot_diagram(lens, z_object=z, z_image=paraxial_focus(lens, z) + 1.0, rays=1 << 13)
        # Rays at 1 mm from the focus: the outermost of 8000 lies within 1e-3 of the rim.
        assert spot.geometric_radius == pytest.approx(1.0 / (2 * working_f_number(lens, z)), rel=2e-3), (lens.model, z)


def test_the_working_f_number_of_telecentric_lenses_and_in_any_medium():
    sides = [Surface(50.0, 2.0, ConstantMedium(1.5), semi_diameter=20.0), Surface(-50.0, semi_diameter=20.0)]
    focus = paraxial.cardinal_points(LensStack([CircularStop(5.0), *sides])).front_focus
    lens = LensStack([CircularStop(5.0, thickness=-focus), *sides])
    points = paraxial.cardinal_points(lens)
    assert points.exit_pupil > 1e10
    # Behind a stop in the front focus, the rim of the stop is seen at 5 mm / f from any axial image point.
    assert working_f_number(lens, -300.0) == pytest.approx(points.efl / 10.0, rel=1e-9)
    assert working_f_number(lens) == pytest.approx(points.efl / 10.0, rel=1e-12)
    # In any medium it is that of the numerical aperture.
    elements = [
        dataclasses.replace(e, medium=ConstantMedium(1.33 * e.medium.index(587.6))) if isinstance(e, Surface) else e
        for e in GAUSS.elements
    ]
    wet = LensStack(elements, front_medium=ConstantMedium(1.33), rear_medium=ConstantMedium(1.33))
    for z in (-math.inf, -404.0):
        _, aperture = paraxial.numerical_apertures(wet, z)
        assert working_f_number(wet, z) == pytest.approx(1 / (2 * aperture), rel=1e-12)
    a, b = (spot_diagram(one, rays=256).airy_radius for one in (GAUSS, wet))
    assert a / b == pytest.approx(1.33, rel=1e-12)


def test_images_at_infinity_before_the_lens_and_nowhere():
    z = paraxial.cardinal_points(PARAXIAL).front_focus
    assert paraxial_focus(PARAXIAL, z) == math.inf
    for criterion in (pl.FocusCriterion.PARAXIAL, RMS):
        assert best_focus(PARAXIAL, z_object=z, criterion=criterion) == math.inf
    # A virtual image lies before the lens.
    near = 0.5 * (z + float(PARAXIAL.vertices[0]))
    assert best_focus(PARAXIAL, z_object=near) == pytest.approx(paraxial_focus(PARAXIAL, near), rel=1e-12)
    assert paraxial_focus(PARAXIAL, near) < near and math.isnan(working_f_number(NONE))
    nothing = r"LensModel\.NONE, which refracts no ray, so there is no image plane"
    for call, text in (
        (lambda: pl.aberrations.through_focus(PARAXIAL, z_object=z), "parallel"),
        (
            lambda: best_focus(GAUSS, field=(0.0, 1.3)),
            r"no ray from the field \(0, 1.3\) rad reaches .* rad, not degrees",
        ),
        (lambda: best_focus(GAUSS, field=(0, 5e3), z_object=-400), r"field \(0, 5000\) mm reaches the iris .* in mm$"),
        (lambda: best_focus(GAUSS, field=(0.0, 0.6), rays=64), r"^0 of 64 rays .* rims and stops clip the others"),
        (lambda: best_focus(pl.optics.coated(GAUSS, pl.optics.Reflectance(1.0))), "coatings reflect all of"),
        (lambda: best_focus(GAUSS, criterion="rms"), r"criterion is 'rms'; it must be FocusCriterion\.PARAXIAL or"),
        (lambda: best_focus(NONE), nothing),
        (lambda: paraxial_focus(NONE, -404.0), nothing),
        (lambda: front_focus(NONE), nothing),
    ):
        with pytest.raises(InvalidValueError, match=text):
            call()


def test_through_focus_has_its_minimum_at_the_best_focus():
    lens = pl.load_lens("double-gauss-100mm-f2")
    found = pl.aberrations.through_focus(lens, field=(0.0, 0.1))
    assert found.best == pl.aberrations.best_focus(lens, field=(0.0, 0.1))
    # The square of the RMS radius is a parabola in z: the same three numbers everywhere, to rounding.
    fit = np.polynomial.Polynomial.fit(found.z - found.best, found.rms_radius**2, 2)
    assert np.abs(fit(found.z - found.best) - found.rms_radius**2).max() <= 1e-12 * (found.rms_radius**2).max()
    assert np.all(found.geometric_radius >= found.rms_radius)
    one = pl.aberrations.spot_diagram(lens, field=(0.0, 0.1), z_image=float(found.z[80]), rays=1 << 14)
    assert one.rms_radius == pytest.approx(found.rms_radius[80], abs=4 * one.rms_radius_error)

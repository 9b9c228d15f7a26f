"""Gaussian optics and Seidel sums beside rayoptics (M. Hayford), which was written independently."""

import math
import warnings

import numpy as np
import pytest

import plenoptic as pl

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what its own dependencies deprecate
    # Not from rayoptics.environment, which asks for Qt.
    optical = pytest.importorskip("rayoptics.optical.opticalmodel", reason="the extra `validation` installs it")
    spec = pytest.importorskip("rayoptics.raytr.opticalspec")
    third_order = pytest.importorskip("rayoptics.parax.thirdorder")
    profiles = pytest.importorskip("rayoptics.elem.profiles")

WAVELENGTH = 587.6

FAR = 1e9
"""mm. rayoptics has objects at infinity at a large distance: this one leaves a beam parallel to 100 / FAR, and rounds
heights to eps FAR = 2e-7 mm of some 10 mm."""

GLASS = pl.ConstantMedium(1.6)
ASPHERIC = pl.LensStack(
    [
        pl.Surface(45.0, 6.0, GLASS, semi_diameter=14.0, conic=-0.7, aspheric=(0.0, 2e-6, -1e-9)),
        pl.Surface(-200.0, 9.0, semi_diameter=14.0, conic=2.0),
        pl.CircularStop(4.0, thickness=5.0),
        pl.Surface(-60.0, 4.0, GLASS, semi_diameter=14.0, aspheric=(0.0, -1e-6)),
        pl.Surface(-50.0, semi_diameter=14.0, conic=-3.0),
    ],
    name="aspheric",
)
# All in air: rayoptics 0.9.8 finds the entrance pupil elsewhere if the object is in another medium, dividing by its
# index where it should multiply.
LENSES = [*(pl.load_lens(name) for name in pl.lens_names() if not name.startswith("mirror")), ASPHERIC]

pytestmark = [pytest.mark.validation, pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)]


def model(lens, field, z_object):
    """The same elements, iris, aperture and field in rayoptics, by indices at one wavelength."""
    made = optical.OpticalModel()
    stack, about = made["seq_model"], made["optical_spec"]
    diameter = 2 * pl.paraxial.cardinal_points(lens, WAVELENGTH).entrance_pupil_semi_diameter
    # Its angles are those of rays that rise towards the lens, ours those of points above the axis.
    far = math.isinf(z_object)
    kind, size = ("angle", -math.degrees(field)) if far else ("height", field)
    about["pupil"] = spec.PupilSpec(about, key=["object", "epd"], value=diameter)
    about["fov"] = spec.FieldSpec(about, key=["object", kind], value=size, flds=[0.0, 1.0], is_relative=True)
    about["wvls"] = spec.WvlSpec([(WAVELENGTH, 1.0)], ref_wl=0)
    made.radius_mode = True
    n = lens.indices(WAVELENGTH)
    stack.gaps[0].thi = FAR if far else float(lens.vertices[0]) - z_object
    behind = pl.paraxial.image_position(lens, z_object, WAVELENGTH) - float(lens.vertices[-1])
    for i, element in enumerate(lens.elements):
        radius = getattr(element, "radius", math.inf)
        gap = element.thickness if i + 1 < len(lens.elements) else behind
        stack.add_surface([radius if math.isfinite(radius) else 0.0, gap, float(n[i + 1])])  # 0: a plane
        if i == lens.iris_index:
            stack.set_stop()
        if getattr(element, "conic", 0.0) or getattr(element, "aspheric", ()):
            stack.ifcs[stack.cur_surface].profile = profiles.EvenPolynomial(
                r=radius, cc=element.conic, coefs=[*element.aspheric, 0.0, 0.0]
            )
    made.update_model()
    return made


def field_of(z_object):
    return 0.17 if math.isinf(z_object) else 40.0


@pytest.mark.parametrize("z_object", [-math.inf, -2500.0])
def test_seidel_sums_by_surface(lens, z_object):
    field = field_of(z_object)
    theirs = third_order.compute_third_order(model(lens, field, z_object))
    ours = pl.aberrations.seidel_sums(lens, field=field, z_object=z_object, wavelength=WAVELENGTH)
    # It has rows of their own for what aspheres add ("1.asp" behind "1"), and the sum at the end.
    table = np.zeros_like(ours.table)
    for name, row in theirs.iloc[:-1].iterrows():
        table[int(str(name).split(".")[0]) - 1] += row.to_numpy()
    # 100 / FAR and 2e-7 / 10, times up to the fourth power, and distortion divides by the marginal ray's angle of
    # incidence, which is small on some surfaces: there it is 1.6e-6. From nearer objects rounding only.
    tolerance = 5e-6 if math.isinf(z_object) else 1e-10
    scale = np.abs(ours.table).max(axis=0)
    assert np.all(np.abs(table - ours.table) <= tolerance * scale)
    assert np.all(np.abs(theirs.iloc[-1].to_numpy() - ours.total) <= tolerance * scale)


@pytest.mark.parametrize("z_object", [-math.inf, -2500.0])
def test_paraxial_data(lens, z_object):
    field = field_of(z_object)
    theirs = model(lens, field, z_object)["analysis_results"]["parax_data"].fod
    points = pl.paraxial.cardinal_points(lens, WAVELENGTH)
    z = lens.vertices
    # Its ffl and bfl are counted from its first and last interface, stops included.
    assert theirs.efl == pytest.approx(points.efl, rel=1e-12)
    assert theirs.bfl == pytest.approx(points.rear_focus - z[-1], rel=1e-12)
    assert theirs.ffl == pytest.approx(points.front_focus - z[0], rel=1e-12, abs=1e-10)
    # FAR rounds: see there.
    far = math.isinf(z_object)
    tolerance = 1e-6 if far else 1e-11
    assert theirs.enp_dist == pytest.approx(points.entrance_pupil - z[0], rel=tolerance, abs=1e-9)
    # It counts from the image of its own far object, f^2 / FAR behind the focus.
    shift = 1.1 * points.efl**2 / FAR if far else 1e-9
    assert theirs.exp_dist == pytest.approx(points.exit_pupil - z[-1], rel=tolerance, abs=shift)
    assert theirs.exp_radius == pytest.approx(points.exit_pupil_semi_diameter, rel=tolerance)
    marginal = pl.paraxial.marginal_ray(lens, z_object, WAVELENGTH)
    chief = pl.paraxial.chief_ray(lens, field, z_object, WAVELENGTH)
    assert abs(theirs.opt_inv) == pytest.approx(pl.paraxial.lagrange_invariant(marginal, chief), rel=tolerance)
    before, behind = pl.paraxial.numerical_apertures(lens, z_object, WAVELENGTH)
    assert abs(theirs.obj_na) == pytest.approx(before, rel=tolerance, abs=1e-6 if far else 0.0)
    assert abs(theirs.img_na) == pytest.approx(behind, rel=tolerance)
    assert theirs.fno == pytest.approx(pl.paraxial.working_f_number(lens, z_object, WAVELENGTH), rel=tolerance)
    if not far:
        assert theirs.m == pytest.approx(pl.paraxial.magnification(lens, z_object, WAVELENGTH), rel=1e-11)

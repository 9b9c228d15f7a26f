"""Gaussian optics, Seidel sums and, ray by ray, path differences beside rayoptics (M. Hayford)."""

import math

import numpy as np
import pytest
from in_rayoptics import FAR, LENSES, WAVELENGTH, model

import plenoptic as pl

third_order = pytest.importorskip("rayoptics.parax.thirdorder")
tracing = pytest.importorskip("rayoptics.raytr.trace")

pytestmark = [pytest.mark.validation, pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.name)]


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


@pytest.mark.parametrize("part", [0.0, 0.7, 1.0])
def test_path_differences(lens, part):
    """Rays through 0.7 of the opening, which pass. Hopkins' formulas, theirs, leave some 1e-4 of the difference."""
    made = model(lens, part * 40.0, -2500.0)
    place, wave, focus = made["optical_spec"].lookup_fld_wvl_focus(1)
    stop, theirs = [], []
    for point in 0.7 * pl.aiming.square_grid(8):
        ray, _, _, difference = tracing.trace_with_opd(made, np.array(point), place, wave, focus)
        stop.append(ray[made["seq_model"].stop_surface][0][:2])
        theirs.append(difference / (1e-6 * WAVELENGTH))
    pupil = np.array(stop) / lens.stop.semi_diameter
    # Its heights are those of rays that rise towards the lens.
    where = {"field": (0.0, -part * 40.0), "z_object": -2500.0, "wavelength": WAVELENGTH}
    ours = pl.aberrations.wavefront(lens, pupil=pupil, **where)
    kept = [np.flatnonzero((pupil == at).all(axis=1))[0] for at in ours.pupil]
    theirs = np.array(theirs)[kept]
    assert len(kept) > 20
    np.testing.assert_allclose(ours.opd, theirs, rtol=0, atol=1e-3 + 3e-4 * np.abs(theirs).max())

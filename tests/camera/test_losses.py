"""Images of lenses with coatings: a constant factor in closed form, the transmission of the lens, plans and reports."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import GAUSS, bare_camera, camera_with, total, white, with_array

import plenoptic as pl
from plenoptic.camera.camera_record import camera_record, lens_transmission
from plenoptic.optics.lens.analysis.transmission import light_balance, transmission_to
from plenoptic.rendering import Stage

HALF_PERCENT, SINGLE = pl.optics.Reflectance(0.005), pl.optics.SingleLayer()
TWICE = 0.995**2
SINGLET = pl.load_lens("singlet-100mm-f4")
SKY = pl.Scene(background=1.0)


def coated(camera, coating=SINGLE):
    return dataclasses.replace(camera, lens=pl.optics.coated(camera.lens, coating))


def in_colour(camera):
    return dataclasses.replace(camera, sensitivity=pl.sensitivities.linear_srgb())


def sky(camera, samples=16):
    return pl.render(SKY, camera, samples=samples, progress=False)


CAMERAS = {
    "bare sensor": bare_camera(SINGLET, z=110.0, shape=(12, 16), pitch=0.1),
    "microlenses": camera_with(lens=SINGLET, shape=(24, 24), to_array=110.0),
    "colours": dataclasses.replace(
        camera_with(lens=SINGLET, shape=(24, 24), to_array=110.0),
        sensitivity=pl.sensor.Sensitivity([450.0, 550.0, 600.0]),
    ),
}


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_constant_reflectance_is_a_factor(camera):
    """Paths are the same; each loses 0.5 % at two surfaces. Images are float32."""
    plain, weak = sky(camera), sky(coated(camera, HALF_PERCENT))
    assert plain.image.max() > 0
    np.testing.assert_allclose(weak.image, TWICE * plain.image, rtol=1e-6)
    np.testing.assert_allclose(weak.standard_error, TWICE * plain.standard_error, rtol=2e-3, atol=1e-9)


def test_colours_lose_what_their_wavelength_loses():
    colours = dataclasses.replace(CAMERAS["colours"], sensitivity=pl.sensor.Sensitivity([450.0]))
    table = pl.optics.Reflectance([0.1, 0.3], wavelengths=[400.0, 700.0])
    plain, weak = sky(colours), sky(coated(colours, table))
    expected = (0.9 - 0.2 * 50.0 / 300.0) ** 2
    np.testing.assert_allclose(weak.image, expected * plain.image, rtol=1e-6)


def test_forward_images_lose_the_same():
    camera, point = CAMERAS["microlenses"], [(0.0, 0.0, -1100.0)]
    on = coated(camera, HALF_PERCENT)
    plain, weak = (pl.point_spread(each, point, rays=1 << 14, progress=False) for each in (camera, on))
    assert float(weak.light[0]) == pytest.approx(TWICE * float(plain.light[0]), rel=1e-12)
    particles = pl.Scene(points=pl.Points([(0.1, 0.0, -1100.0)], intensity=1.0))
    plain, weak = (pl.render(particles, each, samples=4, progress=False).image for each in (camera, on))
    assert plain.max() > 0
    np.testing.assert_allclose(weak, TWICE * plain, rtol=1e-6)


@pytest.mark.parametrize("coating", [pl.optics.Coating(), SINGLE], ids=["bare", "single layer"])
def test_a_uniform_scene_is_the_transmission_of_the_lens(coating):
    """Sums over a region around one image point, so small that its transmission is that of the point."""
    camera = bare_camera(GAUSS, z=113.6, shape=(40, 48), pitch=0.4)
    on = coated(camera, coating)
    for row in (20, 3):
        region, y = (slice(row, row + 1), slice(23, 25)), 0.4 * (19.5 - row)
        (ideal, ideal_error), (light, error) = (total(white(each, 4096, region=region)) for each in (camera, on))
        expected = transmission_to(on.lens, np.array([0.0, y, 113.6]), 587.6, 96)
        z = (light / ideal - expected) / math.hypot(error / ideal, light * ideal_error / ideal**2)
        assert abs(z) < 4, (row, z, light / ideal, expected)
        assert error < 2e-3 * light and expected < 0.97


def test_all_light_of_the_sensor_is_accounted_for():
    """Rays of a pixel through the lens: transmitted, reflected, absorbed and vignetted light sum to 1 for each."""
    metallic = pl.optics.Coating([(pl.optics.FilmMaterial(3.18, 3.33), 1.0)])
    lens = pl.optics.coated(GAUSS, metallic)
    random = np.random.default_rng(3)
    start = np.tile([6.0, -3.0, 113.6], (400, 1))
    aims = np.column_stack([random.uniform(-40.0, 40.0, (400, 2)), np.full(400, lens.vertices[-1])])
    balance = light_balance(lens, pl.RayBundle(start, aims - start), reverse=True)
    parts = np.stack(balance[:4])
    np.testing.assert_allclose(parts.sum(axis=0), 1.0, atol=1e-12)
    assert (parts.max(axis=1) > [0.1, 0.2, 0.5, 0.9]).all() and parts.min() > -1e-12


SPHERICAL = pl.optics.MicrolensModel.SPHERICAL
PLATES = with_array(CAMERAS["microlenses"], model=SPHERICAL, convex_side=pl.optics.ConvexSide.SENSOR)


def test_plates_with_a_constant_reflectance_are_a_factor():
    """Renders, white images, points, particles, replays and waves; with a lens that loses as much, its square."""
    weak_plates = with_array(PLATES, coating=HALF_PERCENT)
    plain, weak, both = shots = [sky(each) for each in (PLATES, weak_plates, coated(weak_plates, HALF_PERCENT))]
    assert plain.image.max() > 0
    np.testing.assert_allclose(weak.image, TWICE * plain.image, rtol=1e-6)
    np.testing.assert_allclose(both.image, TWICE**2 * plain.image, rtol=1e-6)
    first, second = (pl.replay(shot, SKY, pixel=(11, 12), sample=1) for shot in shots[:2])
    assert second.weight == pytest.approx(TWICE * first.weight, rel=1e-12)
    np.testing.assert_allclose(white(weak_plates).image, TWICE * white(PLATES).image, rtol=1e-6)
    point, particle = [(0.0, 0.0, -1100.0)], pl.Scene(points=pl.Points([(0.1, 0.0, -1100.0)], intensity=1.0))
    for forward in (
        lambda camera: pl.point_spread(camera, point, rays=1 << 12, progress=False).light,
        lambda camera: pl.render(particle, camera, samples=4, progress=False).image,
        lambda camera: pl.wave.point_spread(camera, (0.0, 0.0, -1050.0)).image,
    ):
        one, other = forward(PLATES), forward(weak_plates)
        assert one.max() > 0
        np.testing.assert_allclose(other, TWICE * one, rtol=2e-6, atol=1e-9 * one.max())


def test_plates_lose_the_light_of_the_wavelengths_that_paths_draw():
    table = pl.optics.Reflectance([0.1, 0.3], wavelengths=[400.0, 700.0])
    colours = dataclasses.replace(PLATES, sensitivity=pl.sensor.Sensitivity([450.0]), wavelength=650.0)
    plain, weak = sky(colours), sky(with_array(colours, coating=table))
    np.testing.assert_allclose(weak.image, (0.9 - 0.2 * 50.0 / 300.0) ** 2 * plain.image, rtol=1e-6)
    particle = pl.Scene(points=pl.Points([(0.1, 0.0, -1100.0)], intensity=1.0))
    cameras = colours, with_array(colours, coating=table)
    one, other = (pl.render(particle, each, samples=4, progress=False).image for each in cameras)
    np.testing.assert_allclose(other, (0.9 - 0.2 * 50.0 / 300.0) ** 2 * one, rtol=1e-6)


@pytest.mark.parametrize("side", pl.optics.ConvexSide)
def test_plates_in_fast_light_lose_the_same_forwards_and_backwards(side):
    """A film with fringes in the light of f/2, whose losses differ from those on the axis by a sixth of the light.

    Errors of the ratios, of some 1e5 paths that differ by a tenth, are below 1e-3: both images have the same paths.
    """
    fringes = pl.optics.Coating([(pl.ConstantMedium(2.2), 6000.0)])
    camera = camera_with(lens=GAUSS, b=0.5, shape=(96, 96), to_array=105.3, model=SPHERICAL, convex_side=side)
    weak = with_array(camera, coating=fringes)
    z = -1985.0
    scene = pl.Scene([pl.quad((-1.0, -1.0, z), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0), material=pl.materials.Emissive(1.0))])
    back = [pl.render(scene, each, samples=256, truth=pl.Truth.NONE, progress=False) for each in (camera, weak)]
    there = [pl.point_spread(each, [(0.0, 0.0, z)], rays=1 << 17, progress=False) for each in (camera, weak)]
    ratio = total(back[1])[0] / total(back[0])[0]
    assert ratio == pytest.approx(float(there[1].light[0] / there[0].light[0]), abs=1e-3)
    assert ratio < weak.report().microlens_transmission - 0.1


def test_plans_and_reports_state_losses_of_plates():
    weak = with_array(PLATES, coating=SINGLE)
    plan = pl.plan(None, weak)
    assert plan.runs(Stage.LOSSES) and not plan.runs(Stage.UNVIGNETTED_CORE)
    assert "the microlenses take light" in repr(plan) and not pl.plan(None, PLATES).runs(Stage.LOSSES)
    assert "2 surfaces and the glasses and the microlenses take light" in repr(pl.plan(None, coated(weak)))
    ideal = dataclasses.replace(weak, lens=SINGLET.with_model(pl.LensModel.THIN))
    assert pl.plan(None, ideal).runs(Stage.LOSSES)
    report = weak.report()
    once = pl.optics.surface_powers(SINGLE, 1.0, 1.5, 1.0, 587.6).transmittance
    assert report.microlens_transmission == pytest.approx(float(once) ** 2, rel=1e-12)
    assert report.transmission is None and f"{100 * report.microlens_transmission:.6g} %" in repr(report)
    assert PLATES.report().microlens_transmission is None
    assert camera_record(PLATES).array.model.losses is None and camera_record(weak).array.model.losses is not None
    water = pl.ConstantMedium(1.33)
    *front, last = SINGLET.elements
    elements = [*front, dataclasses.replace(last, medium=water)]
    wet = dataclasses.replace(weak, lens=dataclasses.replace(SINGLET, elements=elements, rear_medium=water))
    in_water = pl.optics.surface_powers(SINGLE, 1.33, 1.33 * 1.5, 1.0, 587.6).transmittance
    assert camera_record(wet).array.model.losses.transmittance[0, -1] == pytest.approx(float(in_water), rel=1e-12)


def test_plans_and_reports_state_losses():
    camera = camera_with(shape=(32, 32))
    off, on = pl.plan(None, camera), pl.plan(None, coated(camera))
    assert not off.runs(Stage.LOSSES) and off.runs(Stage.UNVIGNETTED_CORE)
    assert on.runs(Stage.LOSSES) and on.runs(Stage.UNVIGNETTED_CORE)
    assert "the lens transmits all light" in repr(off) and "10 surfaces and the glasses take light" in repr(on)
    several = pl.plan(None, coated(camera_with(shape=(32, 32), focal_lengths=(1.9, 2.0, 2.1))))
    assert not several.runs(Stage.UNVIGNETTED_CORE) and "and microlenses differ" in repr(several)
    assert not pl.plan(None, coated(dataclasses.replace(camera, lens=GAUSS.with_model(pl.LensModel.THIN)))).runs(
        Stage.LOSSES
    )
    assert camera.report().transmission is None
    report = coated(camera).report()
    assert report.transmission == pytest.approx(coated(camera).lens.transmission(), abs=0.01)
    assert f"{100 * report.transmission:.6g} %" in repr(report)
    assert report.corner_pupil_fraction == camera.report().corner_pupil_fraction
    assert camera_record(camera).lens.losses is None and camera_record(coated(camera)).lens.losses is not None


def test_replays_have_the_weight_of_their_path():
    camera = CAMERAS["microlenses"]
    shots = [sky(each, samples=4) for each in (camera, coated(camera, HALF_PERCENT))]
    plain, weak = (pl.replay(shot, SKY, pixel=(11, 12), sample=1) for shot in shots)
    assert weak.weight == pytest.approx(TWICE * plain.weight, rel=1e-12)


def behind_grey_mask(camera):
    """The camera with a mask in place of its iris, through which half of the light passes."""
    elements, stop = list(camera.lens.elements), camera.lens.stop
    mask = pl.optics.MaskStop([[0.5]], semi_diameter=stop.semi_diameter, thickness=stop.thickness)
    elements[elements.index(stop)] = mask
    return dataclasses.replace(camera, lens=dataclasses.replace(camera.lens, elements=elements))


def traced(camera, monkeypatch):
    """White image of rays that lose light at each surface."""
    with monkeypatch.context() as patch:
        patch.setattr("plenoptic.camera.cache.lens_transmission", lambda record: None)
        return white(dataclasses.replace(camera, lens=dataclasses.replace(camera.lens, name="traced")), 64)


@pytest.mark.parametrize(
    "camera",
    [
        coated(camera_with(shape=(48, 48)), pl.optics.Coating()),
        coated(bare_camera(shape=(12, 16), pitch=1.5)),
        coated(camera_with(lens=GAUSS, b=0.5, shape=(48, 48), to_array=105.3)),
        coated(camera_with(lens=GAUSS.moved(0, tilt=(0.02, 0.0, 0.0)), shape=(48, 48))),
        behind_grey_mask(coated(bare_camera(shape=(12, 16), pitch=1.5))),
        in_colour(coated(camera_with(lens=GAUSS, b=0.5, shape=(48, 48), to_array=105.3))),
        in_colour(coated(bare_camera(shape=(12, 16), pitch=1.5))),
    ],
    ids=["microlenses", "bare", "fast lens", "tilted surface", "grey mask", "fast lens, colours", "bare, colours"],
)
def test_the_fitted_transmission_is_that_of_traced_rays(camera, monkeypatch):
    """Within twice the tolerance of fits, 1e-6, which some rays exceed; lenses that are not centred are traced.

    Tables by wavelength, by which single rays are traced, are within 6e-7 at each of ten surfaces.
    """
    record, fitted = camera_record(camera), white(camera, 64)
    fit, expected = lens_transmission(record), traced(camera, monkeypatch).image
    has_core = camera.sensitivity is None and isinstance(camera.lens.stop, pl.optics.CircularStop)
    assert (fit is None) == (camera.lens.elements[0].placement is not None)
    assert pl.plan(None, camera).runs(Stage.UNVIGNETTED_CORE) == has_core
    assert fitted.image.max() > 0
    np.testing.assert_allclose(fitted.image, expected, rtol=2e-6 if camera.sensitivity is None else 8e-6)
    if fit is not None:
        halved = fit._replace(factors=0.5 * fit.factors)
        monkeypatch.setattr("plenoptic.camera.cache.lens_transmission", lambda _: halved)
        other = dataclasses.replace(camera, lens=dataclasses.replace(camera.lens, name="half"))
        np.testing.assert_allclose(white(other, 64).image, 0.5 * fitted.image, rtol=1e-12)

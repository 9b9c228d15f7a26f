"""Diffraction kernel and remainder, compared with deflections drawn one by one."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from camera_helpers import CAMERA, the_lens, with_array
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import plenoptic as pl
from plenoptic.camera.camera_record import camera_record
from plenoptic.camera.sampling.diffraction_kernel import DEFLECTION_INTERVAL, remainder_batch
from plenoptic.optics import ApertureShape, Gaps, MicrolensAperture
from plenoptic.optics.diffraction.kernels.far_field import fill_deflections
from plenoptic.rendering.context import batch_of
from plenoptic.rendering.kernels import film_sums
from plenoptic.rendering.settings import RenderSettings

CLEAR = MicrolensAperture(ApertureShape.CIRCLE, 0.6, Gaps.CLEAR)


def camera(pixel=0.01, *, aperture=None, pixel_aperture=(1.0, 1.0), **more):
    sensor = pl.Sensor((32, 32), pixel, pixel_aperture=pixel_aperture)
    parts = {"lens": the_lens(8.0), "sensor": sensor, "diffraction": pl.Diffraction()}
    return dataclasses.replace(with_array(CAMERA, aperture=aperture), **(parts | more))


def shoot(scene, camera_, **options):
    """Render a scene, or a white image without one."""
    return (
        pl.render_white(camera_, **options)
        if scene is None
        else pl.render(scene, camera_, truth=pl.Truth.NONE, **options)
    )


def test_kernel_and_remainder_are_all_light():
    for pixel, aperture in ((0.02, (1.0, 1.0)), (0.01, (0.7, 0.8)), (0.005, (1.0, 1.0)), (0.002, (0.7, 0.8))):
        record = camera_record(camera(pixel, pixel_aperture=aperture))
        table, drawn = record.diffraction_kernel.table, record.diffraction_kernel.remainder_share
        assert np.all(table.weights >= 0)
        assert_allclose(table.means, table.weights.mean(axis=0)[None], rtol=1e-12)
        # Even light brings a pixel as much as it brings its surroundings, whatever part of it sees light.
        assert table.means.sum() + drawn == pytest.approx(1.0, abs=1e-12), pixel
        if aperture == (1.0, 1.0):
            assert_allclose(table.weights.sum(axis=1), 1.0 - drawn, rtol=1e-12)
        # Openings and pixels are alike from all sides.
        side = 2 * table.reach + 1
        assert_allclose(table.means.reshape(side, side), table.means.reshape(side, side)[::-1, ::-1], rtol=1e-9)


@pytest.mark.parametrize(
    ("pixel", "turned", "more"),
    [
        pytest.param(0.01, 0.0, {}, marks=pytest.mark.slow),
        pytest.param(0.003, 0.4, {"pixel_aperture": (0.9, 0.6)}, marks=pytest.mark.slow),
        (0.006, 0.3, {"aperture": CLEAR, "pixel_aperture": (0.9, 0.6)}),
        (0.01, 0.2, {"sensitivity": pl.sensitivities.linear_srgb()}),
    ],
)
def test_kernel_weights_equal_drawn_deflections(pixel, turned, more):
    # Bends of the whole pattern, from two places of a pixel to those around, with the drawn rest taken away.
    turned_camera = camera(pixel, **more).moved(pl.CameraPart.SENSOR, tilt=(0.0, 0.0, turned))
    record = camera_record(turned_camera)
    table, deflection = record.diffraction_kernel.table, record.deflection
    part = np.array(turned_camera.sensor.pixel_aperture)
    n, scale = 1 << 19, deflection.wavelengths * record.sensor.plane.distance
    levels = (scale - table.lowest_scale) * table.scales_per_area
    # Of the wavelengths, one in the middle of its level.
    wave = 0 if len(levels) == 1 else 1 + int(np.abs(levels[1:] - np.rint(levels[1:] - 0.5) - 0.5).argmin())
    wavelength, level = deflection.wavelengths[wave], min(int(levels[wave]), table.scales - 1)
    numbers = np.random.default_rng(2).random((n, 2))
    draws = {}
    for name, field in (("all", deflection.field), ("rest", record.diffraction_kernel.remainder.field)):
        draws[name] = np.empty((n, 4))
        fill_deflections(draws[name], numbers, field)
    steps = np.arange(-table.reach, table.reach + 1)
    for kind in range(table.patterns):
        for across, down in ((5, 20), (31, 0)):
            drawn_weights, noise = np.zeros((len(steps),) * 2), 0.0
            for name, sign in (("all", 1.0), ("rest", -record.diffraction_kernel.remainder_share)):
                ends = draws[name][:, :2] @ deflection.back.T * (wavelength * record.sensor.plane.distance)
                ends += (np.array([across, down]) + np.random.default_rng(3).random((n, 2))) / table.subdivisions - 0.5
                at = np.rint(ends).astype(int)
                in_pixel = (np.abs(ends - at) <= 0.5 * part).all(axis=1) & (np.abs(at) <= table.reach).all(axis=1)
                weights, place = sign * draws[name][in_pixel, 2 + kind], at[in_pixel] + table.reach
                np.add.at(drawn_weights, (place[:, 1], place[:, 0]), weights)
                noise += float((weights**2).sum())
            row = ((level * table.patterns + kind) * table.subdivisions + down) * table.subdivisions + across
            expected = table.weights[row].reshape(drawn_weights.shape) * part.prod()
            assert_allclose(drawn_weights / n, expected, atol=2.5 * math.sqrt(noise) / n)


def batches(samples, replicates, cuts):
    """Batches of samples, divided at whole numbers of each replicate; the last one has the remainder."""
    context = SimpleNamespace(seed=np.uint64(1), replicates=replicates, settings=RenderSettings())
    first = 0
    for cut in [*cuts, samples]:
        n = min(cut * replicates, samples - first)
        if n > 0:
            yield batch_of(context, first, n)
            first += n


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 70), st.integers(1, 5), st.lists(st.integers(1, 9), max_size=4))
def test_drawn_deflections_represent_all_samples_in_any_batches(samples, replicates, cuts):
    # The light is the index of the deflection plus one: sums must equal those of a whole render for each replicate.
    totals = np.zeros(replicates)
    for batch in batches(samples, replicates, cuts):
        drawn = remainder_batch(batch)
        n, blocks = drawn.samples, np.zeros(8 * 256)
        sums = np.zeros((1, replicates, 1)), np.zeros((1, 1))
        longest = -(-n // drawn.streams)
        order = [(s, i) for s in range(drawn.streams) for i in range(longest) if i * drawn.streams + s < n]
        for k, (_, index) in enumerate(order):
            blocks[6 * 256 + k] = drawn.first_index + index + 1
        film_sums.fill_deflected_sums(
            sums, film_sums.Light(blocks, None, None, None), 0, n, drawn, batch, DEFLECTION_INTERVAL
        )
        totals += sums[0][0, :, 0]
    indices_of_replicate = [np.arange(len(range(r, samples, replicates))) for r in range(replicates)]
    assert_allclose(totals, [(indices // DEFLECTION_INTERVAL + 1).sum() for indices in indices_of_replicate])


def test_few_samples_are_right_on_average():
    # In two replicates, against many.
    scene, camera_, options = pl.check_scene(), camera(), {"region": np.s_[4:24, 4:24], "truth": pl.Truth.NONE}
    reference = pl.render(scene, camera_, samples=1024, replicates=8, progress=False, **options)
    for samples, sampler in ((2, pl.rendering.Sampler.SOBOL), *((8, each) for each in pl.rendering.Sampler)):
        few = {"samples": samples, "replicates": 2, "sampler": sampler, **options}
        images = [pl.render(scene, camera_, seed=s, progress=False, **few).image.astype(float) for s in range(40)]
        assert min(image.min() for image in images) >= 0
        mean, error = np.mean(images, axis=0), np.std(images, axis=0, ddof=1) / math.sqrt(40)
        chi = (mean - reference.image) / np.hypot(error, reference.standard_error)
        assert float(np.sqrt((chi**2).mean())) < 1.12, (samples, sampler)
        total = np.array([image.sum() for image in images])
        sigma = math.hypot(total.std(ddof=1) / math.sqrt(40), 3 * float(np.linalg.norm(reference.standard_error)))
        assert total.mean() == pytest.approx(float(reference.image.sum()), abs=4 * sigma), (samples, sampler)


def test_standard_errors_equal_the_scatter_of_seeds():
    camera_, region = camera(sensor=pl.Sensor((64, 64), 0.01)), np.s_[8:40, 8:40]
    for scene, replicates in ((None, 2), (None, 8), (pl.check_scene(), 2), (pl.check_scene(), 8)):
        options = {"samples": 32, "replicates": replicates, "region": region, "progress": False}
        shots = [shoot(scene, camera_, seed=seed, **options) for seed in range(8)]
        between = np.var([shot.image for shot in shots], axis=0, ddof=1)
        within = np.mean([shot.standard_error.astype(float) ** 2 for shot in shots], axis=0)
        mean = np.mean([shot.image for shot in shots], axis=0)
        assert math.sqrt(within.mean() / between.mean()) == pytest.approx(1.0, abs=0.1), (scene is None, replicates)
        if scene is None:  # bright and dim pixels, each
            for part in (mean > 0.6 * mean.max(), mean < 0.6 * mean.max()):
                assert math.sqrt(within[part].mean() / between[part].mean()) == pytest.approx(1.0, abs=0.15)


def test_a_tilted_sensor_has_several_distances():
    table = camera_record(camera().moved(pl.CameraPart.SENSOR, tilt=(0.9, 0.0, 0.0))).diffraction_kernel.table
    assert table.scales > 5
    assert table.means is None
    # Farther from the array, more leaves the pixel.
    middle = table.weights.shape[1] // 2
    assert np.all(np.diff(table.weights[:, middle].reshape(table.scales, -1).mean(axis=1)) < 0)


def test_no_kernel_if_it_adds_noise():
    assert camera_record(dataclasses.replace(camera(), diffraction=None)).diffraction_kernel is None
    # Most deflections are far, or most paths would miss the sensitive area: all deflections are drawn.
    for other in (camera(0.0004), camera(pixel_aperture=(0.5, 0.5))):
        assert camera_record(other).diffraction_kernel is None
        image = pl.render_white(other, samples=16, region=np.s_[10:14, 10:14], progress=False).image
        assert image.min() > 0

"""Particles of whose rays few reach the sensor: the mean over seeds is that of many rays."""

import warnings

import numpy as np
from camera_helpers import bare_camera

import plenoptic as pl
from plenoptic.rendering.points import particle_tracing

# A star, far out of focus: one ray in some hundreds falls on the sensor.
SMALL = bare_camera(shape=(8, 8), pitch=0.03)
STAR = pl.Points([(0.0, 0.0, -150.0)], intensity=1.0)


def light_of(points, seed, **options):
    weights = pl.rendering.point_weights(points, SMALL, seed=seed, progress=False, **options)
    return weights.light[0], weights.light_error[0]


def test_a_particle_whose_first_rays_miss_the_sensor_is_not_dark():
    truth, truth_error = light_of(STAR, 99, rays=1 << 18)
    few = [light_of(STAR, seed, rays=128)[0] for seed in range(8)]
    assert truth_error < 0.02 * truth and few.count(0.0) > 1
    light, error = np.transpose([light_of(STAR, seed, target_error=0.1) for seed in range(8)])
    assert (light > 0).all()
    z = (light - truth) / np.hypot(error, truth_error)
    # Errors are those of 8 replicates; the mean of 8 values has 1 / sqrt(8).
    assert abs(z.mean()) < 4 / np.sqrt(8) and np.abs(z).max() < 6


def test_particles_beyond_the_field_end_at_once(monkeypatch):
    """And those whose rays all miss the sensor, after a million rays."""
    traced = []
    fill = particle_tracing.fill_to_sensor
    monkeypatch.setattr(
        particle_tracing, "fill_to_sensor", lambda blocks, r: traced.append(len(blocks)) or fill(blocks, r)
    )
    beyond = pl.Points([(5000.0 + k, 0.0, -404.0) for k in range(80)], intensity=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pl.rendering.point_weights(beyond, SMALL, progress=False).rays == 128
    assert not traced
    beside = pl.Points([(40.0 + 0.1 * k, 0.0, -404.0) for k in range(80)], intensity=1.0)
    weights = pl.rendering.point_weights(beside, SMALL, progress=False)
    assert traced and weights.rays == 128 and not weights.light.any()

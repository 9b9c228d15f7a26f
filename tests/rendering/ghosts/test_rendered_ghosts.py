"""Ghosts in images beside paths that reflect by chance at all surfaces of the lens, and laws of their light."""

import dataclasses
import math

import mirror_trace
import numpy as np
import pytest

import plenoptic as pl

TRIPLET = pl.load_lens("cooke-triplet-50mm-f5")
SINGLET = pl.load_lens("singlet-100mm-f4")
LAMP, DISTANCE = 150.0, 500.0
"""Half side and distance in mm of a square lamp before a dark or grey background."""


def camera_of(lens, side=6, **parts):
    focus = pl.paraxial.cardinal_points(lens).rear_focus
    sensor = pl.Sensor(shape=(side, side), pixel_pitch=24.0 / side)
    return pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=focus, **parts)


def scene_of(background):
    corners = [[-LAMP, -LAMP, 0], [LAMP, -LAMP, 0], [LAMP, LAMP, 0], [-LAMP, LAMP, 0]]
    lamp = pl.Mesh(np.array(corners) + [10.0, 0.0, -DISTANCE], [[0, 1, 2], [0, 2, 3]], material=pl.Emissive(1.0))
    return pl.Scene([lamp], background=background)


def by_chance(camera, background, *, sensor=None, n=60_000, seed=3):
    """Light of two reflections on each pixel and its standard error."""
    lens, random, z = camera.lens, np.random.default_rng(seed), camera.z_sensor
    rows, columns = camera.sensor.shape
    image, errors = np.zeros((2, rows, columns))
    last = lens.elements[-1]
    for row in range(rows):
        for column in range(columns):
            points = camera.sensor.centre_of(row, column) + camera.sensor.pixel_pitch * random.uniform(-0.5, 0.5, (n, 2))
            # Points of a disc around the rear element: the area per projected solid angle is distance^2 / cos^4 ...
            radius = 1.3 * last.semi_diameter
            r, angle = radius * np.sqrt(random.random(n)), 2 * math.pi * random.random(n)
            target = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(n, lens.vertices[-1])])
            origin = np.column_stack([points, np.full(n, z)])
            along = target - origin
            length = np.linalg.norm(along, axis=1)
            cosine = -along[:, 2] / length
            solid = math.pi * radius**2 * cosine**2 / length**2  # projected at both ends
            p, d, light, turns = mirror_trace.chance(
                lens, origin, along / length[:, None], random, sensor=None if sensor is None else (z, sensor)
            )
            hit = p[:, :2] + ((-DISTANCE - p[:, 2]) / d[:, 2])[:, None] * d[:, :2]
            lit = np.abs(hit - [10.0, 0.0]).max(axis=1) <= LAMP
            light = np.where(turns == 2, light * solid * np.where(lit, 1.0, background), 0.0)
            image[row, column], errors[row, column] = light.mean(), light.std() / math.sqrt(n)
    return image, errors


def ghosts_of(camera, scene, ghosts, *, seeds=8):
    """Light of ghosts alone, (seeds, rows, columns): images with them less those without, whose bits they share."""
    images = []
    for seed in range(seeds):
        options = {"samples": 2, "seed": seed, "progress": False}
        image, both = (pl.render(scene, camera, ghosts=g, **options) for g in (None, ghosts))
        images.append((both.image.astype(float) - image.image)[..., 0])
    return np.array(images)


@pytest.mark.parametrize(
    "lens, background, sensor",
    [(SINGLET, 0.0, None), (TRIPLET, 0.2, None), (TRIPLET, 0.0, 0.3)],
    ids=["one pair", "all pairs", "sensor"],
)
def test_images_of_ghosts_are_those_of_paths_that_reflect_by_chance(lens, background, sensor):
    camera = camera_of(lens)
    expected, expected_error = by_chance(camera, background, sensor=sensor)
    images = ghosts_of(camera, scene_of(background), pl.rendering.Ghosts(sensor=sensor, samples=1024))
    image, error = images.mean(axis=0), images.std(axis=0, ddof=1) / math.sqrt(len(images))
    # Student's t of 7 degrees of freedom has a variance of 1.4.
    z = (image - expected) / np.hypot(error, expected_error)
    print(np.mean(z * z), np.abs(z).max(), np.median(error / image), np.median(expected_error / expected))
    assert np.abs(z).max() < 6.0
    assert np.mean(z * z) < 2.5
    totals = images.sum(axis=(1, 2))
    total_error = math.hypot(totals.std(ddof=1) / math.sqrt(len(totals)), np.linalg.norm(expected_error))
    print(totals.mean(), expected.sum(), total_error)
    assert abs(totals.mean() - expected.sum()) < 4 * total_error < 0.1 * expected.sum()

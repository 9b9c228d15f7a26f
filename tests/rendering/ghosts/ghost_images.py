"""Cameras, a lamp, and images of ghosts alone."""

import numpy as np

import plenoptic as pl

TRIPLET = pl.load_lens("cooke-triplet-50mm-f5")
SINGLET = pl.load_lens("singlet-100mm-f4")
LAMP, DISTANCE = 150.0, 500.0
"""Half side and distance in mm of a square lamp before a dark or grey background."""


def camera_of(lens, side=6, **parts):
    focus = pl.paraxial.cardinal_points(lens).rear_focus
    sensor = pl.Sensor(shape=(side, side), pixel_pitch=24.0 / side)
    return pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=focus, **parts)


def scene_of(background, distance=DISTANCE):
    lamp = LAMP * distance / DISTANCE
    corners = [[-lamp, -lamp, 0], [lamp, -lamp, 0], [lamp, lamp, 0], [-lamp, lamp, 0]]
    vertices = np.add(corners, (10.0, 0.0, -distance))
    lamp = pl.Mesh(vertices, [[0, 1, 2], [0, 2, 3]], material=pl.Emissive(1.0))
    return pl.Scene([lamp], background=background)


def ghosts_of(camera, scene, ghosts, *, seeds=8):
    """Light of ghosts alone, (seeds, rows, columns): images with them less those without, whose bits they share."""
    images = []
    for seed in range(seeds):
        options = {"samples": 2, "seed": seed, "progress": False}
        image, both = (pl.render(scene, camera, ghosts=g, **options) for g in (None, ghosts))
        images.append((both.image.astype(float) - image.image)[..., 0])
    return np.array(images)


def bins(image, side):
    """Sums over blocks of side x side pixels in the last two axes."""
    rows, columns = image.shape[-2:]
    return image.reshape(*image.shape[:-2], rows // side, side, columns // side, side).sum(axis=(-3, -1))

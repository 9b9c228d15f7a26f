"""All that can be wrong with single microlenses and with parts: centres against rendered white images of one lens."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import the_lens

import plenoptic as pl
from plenoptic.camera.camera import CameraPart
from plenoptic.camera.points import centroids
from plenoptic.camera.points.centres import CentreMethod, microlens_centres

PITCH, PIXEL = 0.217, 0.01
PLACE = np.array([2.8, -2.1])
"""mm, so far off the axis that light is vignetted."""
MOVED, FAR = (0.02, -0.01), (0.05, -0.03)
FREE = [[0, 0], [0.21, 0.02], [-0.2, 0.05], [0.03, 0.19], [-0.02, -0.22], [0.19, 0.2], [-0.18, 0.22], [0.2, -0.18]]
FREE = PLACE + np.array([*FREE, [-0.21, -0.17], [0.4, 0.0], [0.0, 0.4], [0.0, -0.42], [-0.42, 0.0]])
SHAPE, GAPS, MODEL = pl.optics.ApertureShape, pl.optics.Gaps, pl.optics.MicrolensModel
SPHERICAL = {"model": MODEL.SPHERICAL}
TO_SENSOR = SPHERICAL | {"convex_side": pl.optics.ConvexSide.SENSOR}


def opened(shape, fill, gaps=GAPS.OPAQUE):
    return {"aperture": pl.optics.MicrolensAperture(shape, fill, gaps)}


CASES = {
    "as designed": ({}, {}),
    "displaced": ({}, {"shift": FAR}),
    "displaced, square": ({"lattice": pl.Lattice.SQUARE}, {"shift": FAR}),
    "displaced, rectangular": ({"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.15, 0.25)}, {"shift": FAR}),
    "displaced, of three types": ({"focal_lengths": (1.8, 2.0, 2.3)}, {"shift": FAR}),
    "decentred": ({}, {"decentre": FAR}),
    "longer": ({}, {"focal_length_factor": 1.3}),
    "longer, displaced": ({}, {"focal_length_factor": 1.3, "shift": FAR}),
    "missing": ({}, {"focal_length_factor": np.inf}),
    "missing, displaced": ({}, {"focal_length_factor": np.inf, "shift": FAR}),
    "round, displaced": (opened(SHAPE.CIRCLE, 0.5), {"shift": MOVED}),
    "round, displaced, cut": (opened(SHAPE.CIRCLE, 0.9), {"shift": FAR}),
    "round, decentred": (opened(SHAPE.CIRCLE, 0.6), {"decentre": FAR}),
    "square opening, missing": (opened(SHAPE.SQUARE, 0.6), {"focal_length_factor": np.inf, "shift": FAR}),
    "clear gaps": (opened(SHAPE.CIRCLE, 0.6, GAPS.CLEAR), {}),
    "clear gaps, displaced": (opened(SHAPE.CELL, 0.6, GAPS.CLEAR), {"shift": FAR}),
    "clear gaps, decentred": (opened(SHAPE.HEXAGON, 0.6, GAPS.CLEAR), {"decentre": FAR}),
    "pinhole, displaced": ({"model": MODEL.PINHOLE}, {"shift": FAR}),
    "round pinhole, displaced": ({"model": MODEL.PINHOLE} | opened(SHAPE.CIRCLE, 0.6), {"shift": FAR}),
    "flat plate, displaced": ({"model": MODEL.FLAT_HIGH_INDEX, "index": 100.0}, {"shift": FAR}),
    "plate, displaced": (SPHERICAL, {"shift": FAR}),
    "plate, round, displaced": (SPHERICAL | opened(SHAPE.CIRCLE, 0.9), {"shift": MOVED}),
    "plate, missing": (SPHERICAL, {"focal_length_factor": np.inf}),
    "plate towards the sensor, displaced": (TO_SENSOR, {"shift": FAR}),
    "free": ({"lattice": pl.Lattice.FREE}, {}),
    "free, displaced": ({"lattice": pl.Lattice.FREE}, {"shift": FAR}),
    "free, round, displaced, cut": ({"lattice": pl.Lattice.FREE} | opened(SHAPE.CIRCLE, 0.4), {"shift": FAR}),
}


def the_camera(changes, deviations, **camera):
    """One microlens near `PLACE`, all others dark, and its index."""
    if changes.get("lattice") is pl.Lattice.FREE:
        changes = {"centres": FREE, "pitch": 0.3} | changes
    array = pl.MicrolensArray(**({"pitch": PITCH, "focal_lengths": (2.0,)} | changes))
    nearby = array.lenses((-6.0, -6.0), (6.0, 6.0))
    mine = np.hypot(*(nearby.design - PLACE).T).argmin()
    given = {}
    for name, amount in deviations.items():
        given[name] = np.full((len(nearby), *np.shape(amount)), 1.0 if name == "focal_length_factor" else 0.0)
        given[name][mine] = amount
    lit = (np.arange(len(nearby)) == mine).astype(float)
    spoiled = pl.optics.MicrolensDeviations(index=nearby.index, transmission=lit, **given)
    lens = the_lens(3.6).inserted(pl.CircularStop(3.5), 60.0)
    given = {"lens": lens, "stop_to_microlenses": 123.3, "microlenses_to_sensor": 1.7} | camera
    array = dataclasses.replace(array, imperfections=spoiled)
    return pl.PlenopticCamera(microlenses=array, sensor=pl.Sensor((800, 800), PIXEL), **given), nearby.index[mine]


def centre(camera, index, method, white=None):
    centres = microlens_centres(camera, method, white=white)
    (row,) = np.flatnonzero((centres.index == index).all(axis=1))
    return centres.position[row]


def seen(camera, index, half=28):
    """The white image of the lens, its centroid, and the standard error of that from replicates."""
    row, column = np.rint(camera.sensor.pixel_of(centre(camera, index, CentreMethod.CHIEF_RAY))).astype(int)
    region = np.s_[row - half : row + half + 1, column - half : column + half + 1]
    white = pl.render_white(camera, samples=256, region=region, seed=3, progress=False)
    image, error = white.image[..., 0].astype(float), white.standard_error[..., 0].astype(float)
    rim = max(image[[0, -1]].max(), image[:, [0, -1]].max())
    assert rim == 0 < image.max()  # all of the light is in it
    place = camera.sensor.centre_of(*np.mgrid[region])
    centroid = np.einsum("ij,ijk->k", image, place) / image.sum()
    away = np.linalg.norm(place - centroid, axis=-1)
    return white, centroid, math.sqrt(np.sum((error * away) ** 2)) / image.sum()


def tolerance(sigma, case):
    """Five standard errors, and what is documented of geometry: 0.02 pixels.

    In third order, spherical aberration of a plano-convex lens of index 1.5 moves rays at height h sideways by
    A h^3 / f^2, A = 1.17 with the curved side to the scene and 4.5 with it to the sensor; of an opening displaced by d
    the mean by A d (2 <h^2> + d^2) / f^2, with <h^2> = 5 pitch^2 / 36 of a hexagon.
    """
    changes = CASES[case][0]
    amount = 4.5 if "convex_side" in changes else 1.17 if changes.get("model") is MODEL.SPHERICAL else 0.0
    d = math.hypot(*CASES[case][1].get("shift", (0.0, 0.0)))
    return 5 * sigma + 0.02 * PIXEL + amount * d * (2 * 5 / 36 * PITCH**2 + d**2) / 2.0**2


QUICK = (
    *("as designed", "displaced, square", "decentred", "longer, displaced", "missing, displaced"),
    *("round, displaced, cut", "clear gaps, decentred", "pinhole, displaced", "plate towards the sensor, displaced"),
    "free, round, displaced, cut",
)
MORE = [case for case in CASES if case not in QUICK]


@pytest.mark.parametrize("cases", [QUICK, pytest.param(MORE, marks=pytest.mark.slow)], ids=["few", "more"])
def test_centroids_are_those_of_white_images(cases):
    for case in cases:
        camera, index = the_camera(*CASES[case])
        white, centroid, sigma = seen(camera, index)
        geometric_centroid = centre(camera, index, CentreMethod.CENTROID)
        assert np.linalg.norm(geometric_centroid - centroid) < tolerance(sigma, case), case
        # Vignetted: the test can fail.
        assert np.linalg.norm(centre(camera, index, CentreMethod.CHIEF_RAY) - centroid) > 0.1 * PIXEL, case
        if not any(kind in case for kind in ("missing", "clear", "free", "rectangular")):
            # All but a trace of its light lies in the cell around its chief ray.
            of_image = centre(camera, index, CentreMethod.CENTROID, white)
            assert np.linalg.norm(of_image - centroid) < 0.02 * PIXEL, case


@pytest.mark.slow
@pytest.mark.parametrize("part", CameraPart)
def test_centroids_where_parts_are_out_of_place_too(part):
    for case in ("displaced", "missing", "free, displaced"):
        camera, index = the_camera(*CASES[case])
        camera = camera.moved(part, shift=(0.03, 0.05, -0.02), tilt=(0.02, -0.03, 0.1))
        _, centroid, sigma = seen(camera, index)
        geometric_centroid = centre(camera, index, CentreMethod.CENTROID)
        assert np.linalg.norm(geometric_centroid - centroid) < tolerance(sigma, case), case


def test_chief_rays_are_the_middle_of_white_images_of_the_iris():
    """An ideal microlens images the pupil, at the distance D, behind b = f D / (D - f), whatever its opening."""
    lens = the_lens(2.5, pl.LensModel.THIN)
    away = 123.3 - pl.paraxial.cardinal_points(lens).rear_principal
    for case in ("decentred", "missing, displaced", "round, displaced, cut", "free, displaced"):
        camera, index = the_camera(*CASES[case], lens=lens, microlenses_to_sensor=2.0 * away / (away - 2.0))
        _, centroid, sigma = seen(camera, index)
        # cos^4 varies over the pupil by 4 u r / D = 4 x 0.03 x 0.02, and moves the centroid by a quarter of that times
        # the image's radius of 0.04 mm: 2.4e-5 mm.
        chief = centre(camera, index, CentreMethod.CHIEF_RAY)
        assert np.linalg.norm(chief - centroid) < 5 * sigma + 0.02 * PIXEL, case


def test_many_spoiled_lenses_are_as_few(monkeypatch):
    """Interpolated between fields, or each by itself."""
    spoiled = pl.MicrolensImperfections(pitch_jitter=0.02, decentre=0.01, focal_length_spread=0.05, missing=0.1, seed=2)
    camera, _ = the_camera({}, {}, lens=the_lens(3.6))
    array = pl.MicrolensArray(PITCH, (1.8, 2.0, 2.2), imperfections=spoiled, **opened(SHAPE.CIRCLE, 0.7))
    camera = dataclasses.replace(camera, microlenses=array, sensor=pl.Sensor((250, 250), PIXEL))
    each = microlens_centres(camera, CentreMethod.CENTROID)
    assert len(each) > 3 * 6 * 6
    monkeypatch.setattr(centroids, "FIELDS", 6)
    many = microlens_centres(camera, CentreMethod.CENTROID)
    assert np.array_equal(each.index, many.index)
    assert not np.array_equal(each.position, many.position)
    # As documented for each.
    assert np.abs(each.position - many.position).max() < 0.02 * PIXEL

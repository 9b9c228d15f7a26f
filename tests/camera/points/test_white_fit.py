"""White images against their cameras: displacements are those of the centres, and right cameras are never suspected."""

import dataclasses
import re
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.points.micro_image_models import to_complex
from plenoptic.camera.points.white_fit import lattice_shift
from plenoptic.errors import InvalidValueError, PlenopticWarning

LENS = pl.load_lens("double-gauss-100mm-f2")
STOP = LENS.with_stop(pl.CircularStop(5.0))


def camera_of(lens=STOP, shape=(200, 260), b=2.0, f=(2.0,), pitch=0.217, **array):
    return pl.PlenopticCamera(lens, pl.Sensor(shape, 0.01), 123.3, pl.MicrolensArray(pitch, f, **array), b)


def moved(camera, shift=(0.0, 0.0), turn=0.0, ratio=1.0):
    array = dataclasses.replace(camera.microlenses, pitch=ratio * camera.microlenses.pitch)
    there = dataclasses.replace(camera, microlenses=array)
    return there.moved(pl.CameraPart.MICROLENSES, shift=(*shift, 0.0), tilt=(0.0, 0.0, turn))


def white_of(camera, electrons=650.0):
    """A white image with the noise of a sensor."""
    white = pl.render_white(camera, samples=16, progress=False)
    scale = electrons / np.median(white.image[white.image > 0.1 * white.image.max()])
    noisy = np.random.default_rng(2).poisson(scale * white.image) / scale
    return dataclasses.replace(white, image=noisy.astype(np.float32))


def pixels_of(camera):
    centres = pl.microlens_centres(camera, margin=2.0, progress=False)
    return {tuple(index): pixel for index, pixel in zip(centres.index.tolist(), centres.pixel, strict=True)}


RIGHT = {
    "hexagonal": camera_of(),
    "square, multi-focus, 2.0": camera_of(b=1.7, f=(1.7, 2.4), lattice=pl.Lattice.SQUARE),
    "vignetted": camera_of(shape=(1100, 1100)),
    "lens out of place": camera_of().moved(pl.CameraPart.LENS, shift=(0.5, 0.3, 0.0), tilt=(0.01, 0.02, 0.0)),
    "parts out of place": camera_of(f=(1.7, 2.0, 2.4))
    .moved(pl.CameraPart.MICROLENSES, shift=(0.03, 0.02, 0.01), tilt=(0.002, 0.001, 0.3))
    .moved(pl.CameraPart.SENSOR, tilt=(0.01, -0.01, 0.1)),
    "blades": camera_of(LENS.with_stop(pl.PolygonStop(blades=5, semi_diameter=5.0))),
    "overlap": camera_of(LENS.with_stop(pl.CircularStop(8.5))),
    "imperfect": camera_of(
        imperfections=pl.MicrolensImperfections(0.003, 0.002, focal_length_spread=0.02, missing=0.02, dark=0.02, seed=3)
    ),
}


@pytest.mark.parametrize("name", RIGHT)
def test_right_cameras_are_not_suspected(name):
    camera = RIGHT[name]
    centres, white = pl.microlens_centres(camera, progress=False), white_of(camera)
    for trace in (False, True):
        shift = lattice_shift(camera, white, centres, trace=trace)
        assert not shift.is_significant
        if name != "imperfect":  # whose patches scatter, as the standard error says
            assert shift.largest < (0.03 if trace else 0.1)


@pytest.mark.parametrize("name", ["hexagonal", "square, multi-focus, 2.0", "parts out of place", "overlap"])
def test_the_fitted_camera_is_the_one_that_took_the_image(name):
    camera, motion = RIGHT[name], {"shift": (0.03, -0.05), "turn": 0.004, "ratio": 1.002}
    built = moved(camera, **motion)
    white, design, truth = white_of(built), pixels_of(camera), pixels_of(built)
    shift = lattice_shift(camera, white, pl.microlens_centres(camera, progress=False))
    places = np.array([pixel for index, pixel in design.items() if index in truth])
    expected = np.array([truth[index] - pixel for index, pixel in design.items() if index in truth])
    # Aberrations of the pupil make the displacement differ from a similarity.
    assert np.abs(shift.at(to_complex(places)) - to_complex(expected)).max() < 0.1
    fit = camera.fitted_to(white)
    found = pixels_of(fit.camera)
    # Noise: some 0.02 pixels in nine patches, three times as much in the corners.
    assert max(np.abs(found[index] - truth[index]).max() for index in found if index in truth) < 0.1
    assert fit.shift == pytest.approx([0.03, -0.05], abs=6e-4)
    assert f"pitch ratio {fit.pitch_ratio:.7g}, residual" in repr(fit) and len(repr(fit)) < 120
    assert [fit.turn, fit.pitch_ratio] == pytest.approx([0.004, 1.002], abs=4e-4) and fit.residual < 0.06


def test_fits_put_each_type_of_microlens_in_its_place():
    """A displacement beyond half a pitch: the least one by the lattice alone permutes the focal lengths."""
    for name, shift in (("parts out of place", (0.0, 0.13)), ("square, multi-focus, 2.0", (-0.13, 0.02))):  # mm
        camera = RIGHT[name]
        assert camera.fitted_to(white_of(moved(camera, shift=shift))).shift == pytest.approx(shift, abs=6e-4)
    alike = camera_of(f=(2.0, 2.00001))
    with pytest.warns(PlenopticWarning, match="which microlens has which focal length"):
        alike.fitted_to(white_of(alike))


def test_decoding_warns_of_another_camera_and_of_none_and_refuses_half_a_pitch():
    def decode(white, camera):
        pl.lightfield.decode(white, white, views=3, camera=camera)

    def render_view(white, camera):
        pl.lightfield.render_view(white, white, 3.0, camera=camera, progress=False)

    def depth(white, camera):
        pl.lightfield.depth(white, white, camera=camera, progress=False)

    focused = "square, multi-focus, 2.0"
    for name, read in (("hexagonal", decode), (focused, render_view), (focused, depth)):
        white = white_of(RIGHT[name])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read(white, RIGHT[name])
            read(white, moved(RIGHT[name], shift=(0.0008, 0.0)))  # 0.08 pixels
        finer = np.tile(white.image[::2, ::2], (2, 2, 1))  # of half the pitch
        for image in (np.ones_like(white.image), finer):
            with pytest.warns(PlenopticWarning, match="shows no lattice of micro images near that of the camera"):
                read(dataclasses.replace(white, image=image), RIGHT[name])
        for _ in range(2):
            with pytest.warns(PlenopticWarning, match=r"up to 0\.\d+ pixels .* shifted by .* turned by .* pitch mult"):
                read(white, moved(RIGHT[name], shift=(0.0025, 0.0)))
        with pytest.raises(InvalidValueError, match=r"camera=camera\.fitted_to\(white\)\.camera"):
            read(white, moved(RIGHT[name], shift=(0.0025, 0.0), turn=0.1))


@pytest.mark.parametrize("motion", [{"shift": (0.02, 0.0)}, {"shift": (-0.07, 0.05)}, {"turn": 0.03}, {"ratio": 1.01}])
def test_centroids_follow_a_displaced_white_image(motion):
    camera = camera_of(LENS.with_stop(pl.CircularStop(4.25)))
    built = moved(camera, **motion)
    white, truth = white_of(built, 5000.0), pixels_of(built)
    found = pl.microlens_centres(camera, pl.CentreMethod.CENTROID, white=white)
    error = [pixel - truth[tuple(index)] for index, pixel in zip(found.index.tolist(), found.pixel, strict=True)]
    assert len(error) > 70 and np.sqrt(np.mean(np.square(error))) < 0.05
    flat = dataclasses.replace(white, image=np.ones_like(white.image))
    with pytest.warns(PlenopticWarning, match="cannot be located"):
        pl.microlens_centres(camera, pl.CentreMethod.CENTROID, white=flat)
    with pytest.raises(InvalidValueError, match=re.escape("shows no lattice of micro images")):
        camera.fitted_to(flat)

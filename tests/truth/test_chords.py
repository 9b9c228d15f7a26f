"""Disparity between chief rays through neighbouring microlenses."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.placement import rotation_about_axes
from plenoptic.truth.channels import Truth

WANTED = Truth.POSITION | Truth.MICROLENS | Truth.DISPARITY | Truth.CHORD_DISPARITY
LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=5.0))
TILTED = pl.optics.Placement(rotation=rotation_about_axes((0.01, 0.02, 0.05)), shift=(0.03, -0.02, 0.01))
SCENE = pl.Scene([pl.quad((-900, -900, -380.0), (1800, 0, -90), (0, 1800, 200), material=pl.Emissive(1.0))])


def camera(lens=LENS, b=1.7, lattice=pl.Lattice.HEXAGONAL, pitch=0.217, model=None, **more):
    array = pl.MicrolensArray(pitch=pitch, focal_lengths=(2.0,), lattice=lattice, **({} if model is None else model))
    sensor = pl.Sensor(shape=(400, 400), pixel_pitch=0.01)
    return pl.PlenopticCamera(
        lens=lens, microlenses=array, sensor=sensor, stop_to_microlenses=123.3, microlenses_to_sensor=b, **more
    )


CAMERAS = {
    "hexagonal": camera(),
    "Keplerian, square": camera(b=2.3, lattice=pl.Lattice.SQUARE).focused_at(z=-300.0),
    "rectangular": camera(lattice=pl.Lattice.RECTANGULAR, pitch=(0.2, 0.25)),
    "out of place": camera(
        microlenses_placement=TILTED,
        sensor_placement=TILTED,
        model={"imperfections": pl.MicrolensImperfections(decentre=0.002, seed=3)},
    ),
}


def of_projection(camera, point, lens):
    """The slope as `project` gives it, from a microlens to all around it; through a wider stop, which shows more."""
    wide = dataclasses.replace(camera, lens=LENS.with_stop(pl.CircularStop(semi_diameter=22.0)))
    seen, array = pl.project(wide, point, rays=8), camera.microlenses
    centres = pl.microlens_centres(camera, pl.CentreMethod.ORTHOGONAL, margin=1.0)
    steps = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    if array.lattice is pl.Lattice.HEXAGONAL:
        steps += [(1, -1), (-1, 1)]

    def found(index):
        row = (seen.index == index).all(axis=1)
        return seen.pixel[row][0] - found_centre(index), found_centre(index)

    def found_centre(index):
        return centres.pixel[(centres.index == index).all(axis=1)][0]

    offset, centre = found(lens)
    pairs = [found(lens + np.array(step)) for step in steps]
    moved = np.array([other - offset for other, _ in pairs])
    apart = np.array([other - centre for _, other in pairs])
    return -min(array.pitches) / 0.01 * (moved * apart).sum() / (apart**2).sum()


@pytest.mark.parametrize("name", CAMERAS)
def test_it_is_that_of_projections_through_neighbours(name):
    """To 1e-8 pixels: chief rays pass their centres to 1e-10 mm, and lenses are 0.2 mm apart."""
    found = pl.ground_truth(SCENE, CAMERAS[name], truth=WANTED, region=np.s_[190:214, 150:174])
    pixels = [(3, 4), (12, 12), (20, 7)]
    for pixel in pixels:
        expected = of_projection(CAMERAS[name], found.position[pixel], found.microlens[pixel])
        assert found.chord_disparity[pixel] == pytest.approx(expected, rel=0, abs=1e-8)
    # Aberrations over a pitch.
    assert np.nanmax(np.abs(found.chord_disparity / found.disparity - 1)) < 0.05


def test_without_aberrations_it_is_that_of_rays_near_the_pixels_own():
    """Both are pitch / (v pixel pitch); derivatives of the latter are differences, good to 1e-8 of it."""
    thin = camera(lens=LENS.with_model(pl.LensModel.THIN))
    found = pl.ground_truth(SCENE, thin, truth=WANTED, region=np.s_[100:130, 20:60])
    seen = np.isfinite(found.disparity)
    assert seen.any() and np.array_equal(np.isfinite(found.chord_disparity), seen)
    assert np.abs(found.chord_disparity / found.disparity - 1)[seen].max() < 1e-7


@pytest.mark.parametrize("name", ["hexagonal", "out of place"])
def test_regions_have_the_bits_of_the_whole(name):
    whole = pl.ground_truth(SCENE, CAMERAS[name], truth=WANTED, region=np.s_[100:140, 100:151], threads=2)
    part = pl.ground_truth(SCENE, CAMERAS[name], truth=WANTED, region=np.s_[113:126, 107:130], threads=1)
    assert np.array_equal(part.chord_disparity, whole.chord_disparity[13:26, 7:30], equal_nan=True)


def test_lenses_without_a_lattice_have_no_neighbours():
    centres = camera().microlenses.lenses((-1.0, -1.0), (1.0, 1.0)).design
    array = pl.MicrolensArray(pitch=0.12, focal_lengths=(2.0,), lattice=pl.Lattice.FREE, centres=centres)
    free = pl.PlenopticCamera(
        lens=LENS,
        microlenses=array,
        sensor=pl.Sensor(shape=(32, 32), pixel_pitch=0.01),
        stop_to_microlenses=123.3,
        microlenses_to_sensor=1.7,
    )
    found = pl.ground_truth(SCENE, free, truth=WANTED)
    assert np.isfinite(found.disparity).any() and np.isnan(found.chord_disparity).all()


def test_a_camera_without_a_main_lens_has_it_too():
    bare = camera(lens=LENS.with_model(pl.LensModel.NONE))
    found = pl.ground_truth(SCENE, bare, truth=WANTED, region=np.s_[190:200, 190:200])
    seen = np.isfinite(found.disparity)
    assert np.abs(found.chord_disparity / found.disparity - 1)[seen].max() < 1e-7

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


def test_it_is_that_of_projections_through_neighbours():
    """To 1e-8 pixels: chief rays pass their centres to 1e-10 mm, and lenses are 0.2 mm apart."""
    for name, made in CAMERAS.items():
        found = pl.ground_truth(SCENE, made, truth=WANTED, region=np.s_[190:214, 150:174], threads=2)
        for pixel in ((3, 4), (12, 12), (20, 7)):
            expected = of_projection(made, found.position[pixel], found.microlens[pixel])
            assert found.chord_disparity[pixel] == pytest.approx(expected, rel=0, abs=1e-8), name
        # Aberrations over a pitch.
        assert np.nanmax(np.abs(found.chord_disparity / found.disparity - 1)) < 0.05
        part = pl.ground_truth(SCENE, made, truth=WANTED, region=np.s_[197:209, 155:168], threads=1)
        assert np.array_equal(part.chord_disparity, found.chord_disparity[7:19, 5:18], equal_nan=True)


def test_without_aberrations_it_is_that_of_rays_near_the_pixels_own():
    """Both are pitch / (v pixel pitch); derivatives of the latter are differences, good to 1e-8 of it."""
    for model, region in ((pl.LensModel.THIN, np.s_[100:130, 20:60]), (pl.LensModel.NONE, np.s_[190:200, 190:200])):
        found = pl.ground_truth(SCENE, camera(lens=LENS.with_model(model)), truth=WANTED, region=region)
        seen = np.isfinite(found.disparity)
        assert seen.any() and np.array_equal(np.isfinite(found.chord_disparity), seen)
        assert np.abs(found.chord_disparity / found.disparity - 1)[seen].max() < 1e-7
    # Lenses without a lattice have no neighbours.
    centres = camera().microlenses.lenses((-1.0, -1.0), (1.0, 1.0)).design
    array = pl.MicrolensArray(pitch=0.12, focal_lengths=(2.0,), lattice=pl.Lattice.FREE, centres=centres)
    free = dataclasses.replace(camera(), microlenses=array)
    found = pl.ground_truth(SCENE, free, truth=WANTED, region=np.s_[184:216, 184:216])
    assert np.isfinite(found.disparity).any() and np.isnan(found.chord_disparity).all()

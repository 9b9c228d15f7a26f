"""Light fields by a grid of micro images, without a camera: as with the camera, and without millimetres."""

import dataclasses
import functools
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield import decode, depth, refocus, render_view, render_views

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import depth_scenes as scenes
import reference

SHAPE = (256, 256)
HEXAGONAL, SQUARE, RECTANGULAR, _ = pl.Lattice
FOCUSED = {
    "one type": ({}, 7.0),
    "three types": ({"focal_lengths": (1.87, 2.0, 2.41)}, 7.0),
    "Keplerian": ({"focal_lengths": (1.45,)}, -7.0),
    "square": ({"lattice": SQUARE}, 7.0),
}


def noisy(image, rate, seed):
    """As a sensor sees it: shot noise of 10 000 electrons in full light, and read noise."""
    rng, electrons = np.random.default_rng(seed), np.maximum(image * rate, 0.0)
    return ((rng.poisson(electrons) + rng.normal(0.0, 4.0, image.shape)) / rate).astype(np.float32)


def photographed(camera, scene):
    """Noisy raw image and white image without a camera, and the grid of the white one."""
    white = pl.render_white(camera, samples=64, progress=False)
    shot = pl.render(scene, camera, samples=48, progress=False)
    rate = 10000 / np.percentile(white.image, 99)
    white = pl.Exposure(noisy(white.image, rate, 2), white=True)
    return pl.Exposure(noisy(shot.image, rate, 1)), white, pl.calibration.find_micro_images(white)


@functools.cache
def focused(name):
    changes, v = FOCUSED[name]
    camera = reference.built(SHAPE, **changes)
    scene = pl.Scene([scenes.plane(camera, v, 5), scenes.plane(camera, 0.7 * v, 6, right=True)])
    return camera, *photographed(camera, scene)


@functools.cache
def unfocused(lattice):
    camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=SHAPE, lattice=SQUARE)
    array = camera.microlenses
    pitch = (array.pitch, 1.2 * array.pitch) if lattice is RECTANGULAR else array.pitch
    camera = dataclasses.replace(camera, microlenses=dataclasses.replace(array, lattice=lattice, pitch=pitch))
    return camera, *photographed(camera, pl.check_scene())


@pytest.mark.parametrize("name", FOCUSED)
def test_disparity_is_that_with_the_camera(name):
    camera, shot, white, grid = focused(name)
    expected = depth(shot, white, camera=camera, progress=False)
    # Disparities of a grid count from the centres of micro images, which lie farther apart than microlenses.
    excess = grid.pitch - camera.microlenses.pitch / camera.sensor.pixel_pitch
    for found in (depth(shot, grid, progress=False), depth(shot, white, camera=grid, progress=False)):
        sure = np.isfinite(found.disparity) & (expected.confidence > 0.7)
        assert sure.sum() > 0.97 * (expected.confidence > 0.7).sum()
        assert np.sqrt(np.mean((found.disparity - expected.disparity - excess)[sure] ** 2)) < 0.05
        np.testing.assert_allclose((found.virtual_depth * found.disparity)[sure], grid.pitch, rtol=1e-5)
        assert np.isnan(found.depth).all()


@pytest.mark.parametrize("lattice", [HEXAGONAL, SQUARE, RECTANGULAR])
def test_views_are_those_with_the_camera(lattice):
    camera, shot, white, grid = unfocused(lattice)
    expected, field = decode(shot, white, camera=camera), decode(shot, white, camera=grid)
    # Centres differ by 0.002 pixels, over which the rims of micro images change by a thousandth.
    np.testing.assert_allclose(field.pixel, expected.pixel, atol=0.003)
    np.testing.assert_allclose(field.centre, expected.centre, atol=1e-3)
    assert np.mean(np.isfinite(field.views) != np.isfinite(expected.views)) < 0.01
    np.testing.assert_allclose(np.array(field.spacing), np.array(expected.spacing) * 22.01 / 0.217, rtol=1e-3)
    # Points of the pupil, by the radius of the micro images.
    np.testing.assert_allclose(field.pupil, expected.pupil, rtol=0.01, atol=1e-9)
    # Without a white image, views show the light that arrives: the same picture within the pupil.
    alone = decode(shot, grid)
    ratio = alone.centre / expected.centre
    assert np.nanmax(np.abs(ratio / np.nanmedian(ratio) - 1.0)) < 0.02


def test_views_of_a_grid_have_disparities_and_no_millimetres():
    camera, shot, white, grid = unfocused(RECTANGULAR)
    field, with_camera = decode(shot, white, camera=grid), decode(shot, white, camera=camera)
    found, expected = depth(field), depth(with_camera)
    sure = (expected.confidence > 0.9) & (found.confidence > 0.9)
    assert sure.any()
    np.testing.assert_allclose(found.disparity[sure], expected.disparity[sure], atol=0.02)
    assert np.isnan(found.depth).all() and np.isnan(field.z_focus) and field.camera is None
    pictures = [refocus(each, disparity=0.3)[3:-3, 3:-3] for each in (field, with_camera)]
    np.testing.assert_allclose(*pictures, atol=0.02)
    for call in (lambda: field.disparity_at(-400.0), lambda: field.truth(pl.check_scene())):
        with pytest.raises(InvalidValueError, match="refocus it by disparity|names no camera"):
            call()
    assert "iframe" in field.viewer()._repr_html_() or len(field.viewer()._repr_html_()) > 1000


@pytest.mark.parametrize("name", ["three types", "Keplerian"])
def test_pictures_of_focused_cameras_are_those_with_the_camera(name):
    camera, shot, white, grid = focused(name)
    with_camera, found = depth(shot, white, camera=camera, progress=False), depth(shot, grid, progress=False)
    expected = render_view(shot, white, with_camera, camera=camera)
    view = render_view(shot, white, found, camera=grid)
    assert view.camera is None
    # Pixels lie at multiples of the spacing from the array's centre, y downwards and x to the left.
    first = [np.rint(each.on_array[0, 0, ::-1] * (1, -1) / each.spacing).astype(int) for each in (view, expected)]
    (top, left), (rows, columns) = (
        np.max(first, axis=0),
        np.min([view.picture.shape, expected.picture.shape], axis=0)[:2] - 2,
    )
    found_picture, expected_picture = (
        each.picture[top - y :, left - x :][:rows, :columns]
        for each, (y, x) in zip((view, expected), first, strict=True)
    )
    difference = found_picture - expected_picture
    difference = difference[np.isfinite(difference)]
    assert len(difference) > 0.8 * expected.picture.size
    # The scene's standard deviation is 0.2 of its mean; the planes' edge may be a pixel off.
    assert np.median(np.abs(difference)) < 0.02 * np.nanmean(expected.picture)
    field = render_views(shot, grid, found, views=3)
    assert field.camera is None and np.isnan(field.z_focus)
    np.testing.assert_allclose(field.pupil[2, 2], (0.6, -0.6), rtol=1e-6)
    for call in (lambda: render_view(shot, grid, z=-404.0), lambda: view.truth(pl.check_scene())):
        with pytest.raises(InvalidValueError, match="tells no distances.*pl.calibrate"):
            call()


def test_grids_of_other_cameras_are_refused():
    camera, shot, white, grid = focused("one type")
    moved = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.05, 0.0, 0.0))
    others = {
        "moved": pl.calibration.find_micro_images(pl.render_white(moved, samples=16, progress=False)),
        "square": focused("square")[3],
    }
    for other in others.values():
        for call in (
            lambda other=other: depth(shot, other),
            lambda other=other: decode(shot, other),
            lambda other=other: render_view(shot, other, 3.5),
            lambda other=other: depth(shot, white, camera=other),
        ):
            with pytest.raises(InvalidValueError, match="another camera"):
                call()
    for call, reason in (
        (lambda: depth(pl.Exposure(shot.image[:200]), grid), "256 x 256 pixels, and the shot is 200 x 256"),
        (lambda: decode(shot, pl.Exposure(white.image[:200], white=True), camera=grid), "the white image is 200 x 256"),
        (
            lambda: decode(shot, white.develop(pl.SensorModel(1e4)), camera=grid),
            r"white is a RawImage.* white.demosaic\(\)",
        ),
        (lambda: depth(shot.image, grid), r"image is an ndarray.* pl.Exposure\(image\)"),
        (lambda: depth(shot, grid, camera=camera), "leave camera= out"),
        (lambda: depth(shot, grid, virtual_depth_range=(0.0, 3.0)), "virtual depths from 1"),
    ):
        with pytest.raises(InvalidValueError, match=reason):
            call()


def test_regions_and_grids_from_files(tmp_path):
    """A grid of a file has neither radii nor borders: micro images touch, and are sharp."""
    camera, shot, white, grid = focused("one type")
    pl.export.plenoptic_toolbox(tmp_path, pl.Exposure(shot.image, camera=camera))
    from_file = pl.calibration.read_grid(tmp_path / "shot.xml", SHAPE)
    found, expected = (depth(shot, white, camera=each, progress=False) for each in (from_file, grid))
    sure = np.isfinite(found.disparity) & (expected.confidence > 0.7)
    assert sure.sum() > 0.9 * (expected.confidence > 0.7).sum()
    assert np.median(np.abs(found.disparity - expected.disparity)[sure]) < 0.05
    region = (40, 160, 20, 200)
    part = depth(pl.Exposure(shot.image[40:160, 20:200], region=region), grid, progress=False)
    whole = depth(shot, grid, progress=False).disparity[40:160, 20:200]
    inner = np.s_[50:-50, 50:-50]
    np.testing.assert_allclose(np.nanmedian(part.disparity[inner]), np.nanmedian(whole[inner]), rtol=0.01)

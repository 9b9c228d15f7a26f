"""Depth from raw images and from views: planes, edges, invariances; table of accuracy (slow); scores."""

import dataclasses
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies

import plenoptic as pl
from plenoptic.camera.gaussian import object_plane
from plenoptic.errors import InvalidValueError, PlenopticWarning
from plenoptic.lightfield import depth, disparity_edges, disparity_scores
from plenoptic.lightfield.kernels.cubic import spline_noise, spline_weights
from plenoptic.lightfield.matching.image_stack import spline_coefficients
from plenoptic.lightfield.pinhole_model import chord_disparity, pinhole_model
from plenoptic.lightfield.reading import light_field
from plenoptic.optics.microlens.lattice import neighbour_steps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import depth_scenes as scenes
import reference

TRUTH = pl.Truth.CHORD_DISPARITY | pl.Truth.DEPTH
CAMERA = scenes.focused()
REGION = np.s_[200:310, 200:310]


def shown(camera, *meshes, samples=32, region=REGION):
    return pl.render(pl.Scene(list(meshes)), camera, samples=samples, region=region, truth=TRUTH, progress=False)


def white_of(camera, region=REGION):
    return pl.render_white(camera, samples=64, region=region, progress=False, seed=9)


@pytest.fixture(scope="module")
def white():
    return white_of(CAMERA)


@pytest.fixture(scope="module")
def edge():
    return shown(CAMERA, scenes.plane(CAMERA, 3.5, 5), scenes.plane(CAMERA, 6.0, 6, right=True))


@pytest.fixture(scope="module")
def depth_map(edge, white):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return depth(edge, white, threads=1)


@pytest.fixture(scope="module")
def plane():
    return shown(CAMERA, scenes.plane(CAMERA, 4.5, 45))


def test_displacements_along_the_axis_are_distances(edge, white, depth_map):
    # The same camera, as designed and as built.
    lens, array, sensor = 0.1, 0.3, 0.2
    camera = dataclasses.replace(
        CAMERA,
        stop_to_microlenses=CAMERA.stop_to_microlenses - array + lens,
        microlenses_to_sensor=CAMERA.microlenses_to_sensor - sensor + array,
    )
    for part, z in zip(pl.CameraPart, (lens, array, sensor), strict=True):
        camera = camera.moved(part, shift=(0.0, 0.0, z))
    found = depth(dataclasses.replace(edge, camera=camera), dataclasses.replace(white, camera=camera), threads=1)
    np.testing.assert_allclose(found.disparity, depth_map.disparity, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.depth + lens, depth_map.depth, rtol=1e-5)


def scores_of(camera, shot, depth_map):
    return disparity_scores(depth_map.disparity, shot.truth.chord_disparity, where=scenes.near_centres(camera, shot))


def test_a_plane_is_found_where_it_is(white, plane):
    """Within the half percent that accuracy is stated with."""
    depth_map, where = depth(plane, white), scenes.near_centres(CAMERA, plane)
    scores = scores_of(CAMERA, plane, depth_map)
    assert scores.kept == 1 and abs(scores.bias) < 0.005 and scores.relative[1] < 1
    assert abs(np.nanmedian((depth_map.depth / plane.truth.depth)[where]) - 1) < 0.002
    np.testing.assert_allclose((depth_map.virtual_depth * depth_map.disparity)[where], 21.7)


def test_spherical_aberration_beyond_the_step_of_the_sweep_does_not_bias_depth():
    """A triplet's is 9 % of the disparity, and the sweep's planes are 6 % apart: refinement within errs by 2 %."""
    lens, sensor, kind = pl.load_lens("cooke-triplet-50mm-f5"), pl.Sensor((400, 400), 0.0055), pl.CameraKind.GALILEAN
    camera = pl.design_camera(lens, sensor=sensor, kind=kind, z=-500.0, pitch=0.127, virtual_depth=4.0).camera
    region = np.s_[145:255, 145:255]
    shot, white = shown(camera, scenes.plane(camera, 4.0, 40), region=region), white_of(camera, region)
    scores = scores_of(camera, shot, depth(shot, white))
    assert scores.kept == 1 and abs(scores.bias) < 0.005
    # The true disparity of the model becomes the true chord.
    centres = pl.microlens_centres(camera, pl.CentreMethod.CHIEF_RAY)
    nearest = np.argmin(np.hypot(*(centres.pixel - 199.5).T))
    row, column = np.rint(centres.pixel[nearest]).astype(int)
    model = pinhole_model(camera, (2.0, 12.0), 1)
    near = np.array([[row, column - 3], [row, column], [row + 3, column]])
    lens, steps = np.full(3, nearest), neighbour_steps(pl.Lattice.HEXAGONAL)
    chord = chord_disparity(model, near.astype(float), lens, centres.index, steps, np.full(3, 1 / 4.0))
    truth = shot.truth.chord_disparity[tuple((near - 145).T)]
    np.testing.assert_allclose(chord * 0.127 / 0.0055, truth, rtol=2e-4)  # 3e-3 after one iteration


def test_both_sides_of_an_edge_lie_in_order(edge, depth_map):
    """All of these few microlenses see the edge, and windows reach across: a tenth of the step between the planes."""
    truth, where = edge.truth, scenes.near_centres(CAMERA, edge)
    near = truth.depth < 0.5 * (np.nanmin(truth.depth) + np.nanmax(truth.depth))
    step = np.nanmax(truth.chord_disparity) - np.nanmin(truth.chord_disparity)
    for side in (near, ~near):
        assert np.nanmedian(np.abs(depth_map.disparity - truth.chord_disparity)[where & side]) < 0.1 * step
    for map_ in (depth_map.disparity, depth_map.depth):
        assert np.nanmedian(map_[where & near]) < np.nanmedian(map_[where & ~near])


def test_threads_and_the_scale_of_radiance_do_not_matter(edge, white, depth_map):
    """Bits are the same on two threads, and for light times a power of two: floors and correlations scale with it."""
    brighter = dataclasses.replace(edge, image=4 * edge.image, standard_error=4 * edge.standard_error)
    other = depth(brighter, white, threads=2)
    for name in ("disparity", "standard_error", "confidence", "depth"):
        assert np.array_equal(getattr(depth_map, name), getattr(other, name), equal_nan=True), name


def test_a_region_has_the_bits_of_the_whole_away_from_its_border():
    """A pixel's disparity depends on microlenses up to three pitches away, and on their neighbours' disparities."""
    camera = scenes.focused(focal_lengths=(0.6,), b=0.5, pitch=0.08)
    whole = np.s_[200:296, 200:296]
    white, shot = white_of(camera, whole), shown(camera, scenes.plane(camera, 5.0, 3), region=whole, samples=8)

    def cut(exposure):
        part = {name: getattr(exposure, name)[8:, 8:] for name in ("image", "standard_error")}
        return dataclasses.replace(exposure, **part, region=(208, 296, 208, 296), truth=None)

    part, all_ = depth(cut(shot), white), depth(shot, white)
    inner = np.s_[48:, 48:]
    for name in ("disparity", "standard_error", "depth"):
        assert np.array_equal(getattr(part, name)[40:, 40:], getattr(all_, name)[inner], equal_nan=True), name
    assert np.isfinite(all_.disparity[inner]).mean() > 0.5


def test_without_texture_errors_are_large_and_confidence_is_low(white):
    """Noise resembles noise by chance; the stated error and confidence must show it."""
    flat = shown(CAMERA, scenes.plane(CAMERA, 4.5, 1, contrast=0.0))
    with pytest.warns(PlenopticWarning, match="unless it has little texture"):
        depth_map = depth(flat, white)
    where = scenes.near_centres(CAMERA, flat) & np.isfinite(depth_map.disparity)
    error = np.abs(depth_map.disparity - flat.truth.chord_disparity)[where]
    small_error = depth_map.standard_error[where] < 0.02 * depth_map.disparity[where]
    assert (
        np.mean(small_error & (error > 3 * depth_map.standard_error[where]) & (depth_map.confidence[where] > 0.9))
        < 0.02
    )


@pytest.mark.parametrize(("v", "square"), [(4.5, 1.0), (4.5, 4.0), (3.5, 2.5), (7.0, 2.0)])
def test_high_confidence_is_right_on_checkerboards(white, v, square):
    """Squares repeat, and windows that show a part of an edge yield smooth, wrong disparities beside it."""
    z = object_plane(CAMERA.lens, CAMERA.stop_to_microlenses + v * CAMERA.microlenses_to_sensor, CAMERA.wavelength)
    paint = {"even": pl.Emissive(0.95), "odd": pl.Emissive(0.05), "offset": (0.13 * square, 0.21 * square)}
    shot = shown(CAMERA, *(mesh.translated(z=z) for mesh in pl.checkerboard((60 * square,) * 2, square, **paint)))
    found, truth = depth(shot, white), shot.truth.chord_disparity
    error = np.abs(found.disparity - truth)
    sure = (found.confidence > 0.95) & np.isfinite(error)
    assert sure.sum() > 500
    wrong = (error > 0.03 * truth) & (error > 3 * found.standard_error)
    assert wrong[sure].mean() <= 0.01


def test_high_confidence_is_right_beside_edges(edge, depth_map):
    """Windows make the nearer surface wider by one or two pixels, all of which were confident (5 %)."""
    truth = edge.truth.chord_disparity
    error = np.abs(depth_map.disparity - truth)
    sure = (depth_map.confidence > 0.95) & np.isfinite(error)
    wrong = (error > 0.03 * truth) & (error > 3 * depth_map.standard_error)
    assert sure.sum() > 2000 and wrong[sure].mean() <= 0.01, (sure.sum(), wrong[sure].mean())


def test_a_matcher_of_ones_own_takes_the_place_of_the_steps(edge, white, depth_map, plane):
    """The steps in a function give the bits of the default; the true disparity as a match gives the true depth."""
    stacks = []

    def steps(stack, first, end):
        stacks.append(stack)
        disparity = pl.lightfield.semi_global(pl.lightfield.plane_sweep(stack, first, end), stack.disparities)
        return pl.lightfield.refine(stack, disparity, first)

    again = depth(edge, white, matcher=steps, threads=1)
    assert again == depth_map and len(stacks) > 1

    def constant(stack, first, end):
        plane = np.ones((end - first, *stack.values.shape[1:]))
        return pl.lightfield.Matches(stack.pitch / 4.5 * plane, 0.01 * plane, plane)

    flat, where = depth(plane, white, matcher=constant), scenes.near_centres(CAMERA, plane)
    assert np.abs(flat.disparity / plane.truth.chord_disparity - 1)[where].max() < 0.005
    assert np.abs(flat.depth / plane.truth.depth - 1)[where].max() < 0.002 and flat.confidence[where].max() == 1
    views = depth(field(0.5), disparity_range=(-1.0, 1.0), matcher=constant)
    assert np.all(views.disparity == 1 / 4.5) and np.all(views.standard_error == 0.01)
    with pytest.raises(InvalidValueError, match="returns disparity of shape"):
        depth(edge, white, matcher=lambda stack, first, end: constant(stack, first, end + 1))


def test_what_cannot_be_matched_is_refused(edge, white):
    free = pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), lattice=pl.Lattice.FREE, centres=[(0.0, 0.0), (0.2, 0.0)])
    for arguments, said in (
        ({"camera": dataclasses.replace(CAMERA, microlenses=None, microlenses_to_sensor=0.0)}, "no microlenses"),
        ({"camera": dataclasses.replace(CAMERA, microlenses=free)}, "on no lattice"),
        ({"camera": dataclasses.replace(CAMERA, microlenses_to_sensor=2.0)}, "focused at infinity"),
        ({"virtual_depth_range": (3.0, 2.0)}, "smaller one first"),
        ({"virtual_depth_range": (0.5, 2.0)}, "virtual depths from 1 to"),
        ({"disparity_range": (1.0, 2.0)}, "searched by virtual depth"),
        ({"window_radius": 0}, "window_radius"),
        ({"min_relative_light": 0.0}, "min_relative_light"),
        ({"white": None}, "its white image"),
        ({"image": "views"}, "image"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            depth(**({"image": edge, "white": white} | arguments))


def field(disparity, slant=0.0, count=5, steps=1.0):
    """Views of smooth random waves whose disparity is `disparity` and grows to the right, without a camera."""
    rng = np.random.default_rng(4)
    waves = rng.uniform(0.2, 1.2, (30, 2)) * rng.choice([-1, 1], (30, 2))
    phase = rng.uniform(0, 2 * np.pi, 30)
    offsets = steps * (np.arange(count) - count // 2.0)
    row, column = np.ogrid[:40, :48]
    u, v, x = offsets[:, None, None, None], offsets[:, None, None], column
    # A point p of the central view, with the disparity d(p), is seen at p - d (v, u).
    for _ in range(60 if slant else 1):
        x = column + u * (disparity + slant * x)
    down = row + v * (disparity + slant * x)
    angle = np.multiply.outer(down, waves[:, 0]) + np.multiply.outer(x, waves[:, 1])
    views = (2 + 0.2 * np.cos(angle + phase).sum(axis=-1, keepdims=True)).astype(np.float32)
    return dataclasses.replace(light_field(views), u=offsets, v=offsets)


def test_slopes_of_epipolar_lines():
    """Cubic convolution of these waves is good to a percent of their amplitude, which a gradient turns into place."""
    for disparity, slant in ((-1.3, 0.0), (0.02, 0.0), (0.2, 0.01)):
        depth_map, inside = depth(field(disparity, slant), disparity_range=(-2.0, 2.0)), np.s_[5:-5, 5:-5]
        error = (depth_map.disparity - (disparity + slant * np.arange(48)))[inside]
        assert np.isfinite(error).all() and np.abs(error).max() < 0.02, (disparity, slant)
        assert np.sqrt((error**2).mean()) < 0.006, (disparity, slant)
        assert np.isnan(depth_map.depth).all() and (depth_map.confidence[inside] > 0.9).all()


def test_views_are_less_confident_beside_a_farther_surface():
    """A card of disparity 0.8 before a wall of -0.5: within the radius of a window, and a pixel, depth may be wrong."""
    far, near = field(-0.5), field(0.8)
    u, v, row, column = np.ogrid[-2:3, -2:3, :40, :48]
    on_card = (np.abs(row + 0.8 * v - 19.5) < 10) & (np.abs(column + 0.8 * u - 23.5) < 12)
    # The card shows another part of the same waves.
    views = np.where(on_card[..., None], near.views[::-1, ::-1, ::-1, ::-1], far.views)
    card, confidence = on_card[2, 2], depth(dataclasses.replace(far, views=views)).confidence
    around = np.lib.stride_tricks.sliding_window_view(np.pad(card, 3), (7, 7))
    is_rim, is_inner = card & ~around.all(axis=(2, 3)), np.lib.stride_tricks.sliding_window_view(card, (13, 13))
    assert (confidence[is_rim] <= 0.7).mean() > 0.97 and np.count_nonzero(is_rim) == 20 * 24 - 14 * 18
    assert (confidence[6:-6, 6:-6][is_inner.all(axis=(2, 3))] > 0.9).all()
    assert (confidence[3:-3, 3:-3][~around.any(axis=(2, 3))[3:-3, 3:-3]] > 0.9).mean() > 0.95


def test_a_range_without_the_depth_of_the_scene_is_warned_of(edge, white):
    for wrong in ((20.0, 25.0), (400.0, 600.0), (-8.0, -2.0)):
        with pytest.warns(PlenopticWarning, match=r"median confidence 0\.\d+: widen virtual_depth_range"):
            depth(edge, white, virtual_depth_range=wrong)


def test_a_range_that_ends_before_the_scene_is_warned_of(edge, white, depth_map):
    """Surfaces at 3.5 and 6: the refinement finds each of them 6 % beyond the end of the range, with confidence 1."""
    for ends in ((1.8, 5.3), (3.9, 25.0)):
        with pytest.warns(PlenopticWarning, match="beyond the end of virtual_depth_range"):
            depth(edge, white, virtual_depth_range=ends)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        enough = depth(edge, white, virtual_depth_range=(3.4, 6.2))
    assert np.nanmedian(np.abs(enough.disparity / depth_map.disparity - 1)) < 0.003


def test_splines_go_through_pixels_and_know_their_noise():
    """Along rows. Halfway along waves of five pixels they err by 1 %, and cubic convolution by 5 %."""
    noise = np.random.default_rng(3).standard_normal((4000, 25))
    wave = np.cos(2 * np.pi / 5 * np.arange(25.0))[None]
    for values in (noise, wave):
        image = np.stack([values] * 25, axis=1)  # the same in all rows
        coefficients = spline_coefficients(image, np.ones(image.shape, dtype=bool))[:, 12].astype(float)
        np.testing.assert_allclose(coefficients[:, 10:14] @ spline_weights(0.0)[0], values[:, 11], atol=1e-5)
        found = [[coefficients[:, 10:14] @ part for part in spline_weights(t)] for t in (0.2, 0.5)]
        if values is wave:
            assert found[1][0][0] == pytest.approx(np.cos(2 * np.pi / 5 * 11.5), rel=0.012)
            continue
        for t, pair in zip((0.2, 0.5), found, strict=True):
            weights, slopes = spline_weights(t)
            stated = [[spline_noise(a, b) for b in (weights, slopes)] for a in (weights, slopes)]
            np.testing.assert_allclose(stated, np.cov(pair), atol=4 * 2 / np.sqrt(len(noise)))


def test_noise_of_views_is_stated_without_errors_of_interpolation():
    """20 000 electrons at full light: 7 views of 160 pixels, whose errors by blur are larger."""
    camera = scenes.view_camera("tessar", 160)
    white = pl.render_white(camera, samples=512, progress=False, seed=5)
    full = float(np.median(white.image[white.image > 0.1 * white.image.max()]))
    shot = pl.render(pl.Scene([scenes.resolved_card(camera, -450.5, 3)]), camera, samples=32, progress=False)
    one, other = (pl.lightfield.decode(exposed(shot, 2e4 / full, seed), white, views=7) for seed in (1, 2))
    difference, variance = np.nanmean((one.views - other.views) ** 2) / 2, np.nanmean(one.noise**2)
    # Some 3000 independent pixels, and the white image's part of the variance, a hundredth.
    assert difference == pytest.approx(variance, rel=0.12)
    assert np.nanmean(one.standard_error**2) > 4 * variance


def test_stated_errors_are_those_that_noise_makes():
    """In interpolated views, whose pixels share noise: here means of four. Few views scatter little or much."""
    clean, rng, inside, found = field(1.0, count=3), np.random.default_rng(6), np.s_[5:-5, 5:-5], []
    for _ in range(16):
        noise = 0.01 * rng.standard_normal((3, 3, 41, 49, 1)).astype(np.float32)
        shared = 0.25 * sum(noise[:, :, i : i + 40, j : j + 48] for i in (0, 1) for j in (0, 1))
        maps = [depth(dataclasses.replace(clean, views=clean.views + n)) for n in (noise[:, :, 1:, 1:], shared)]
        stated = [np.mean(m.standard_error[inside] ** 2 - 0.0015**2 / 2) for m in maps]  # the systematic part apart
        found.append([np.mean((m.disparity - 1)[inside] ** 2) / s for m, s in zip(maps, stated, strict=True)])
    # 1 / 1.7^2 of noise of their own, and half of it, since eight views scatter by chance as much beyond it.
    error, least, most = np.std(found, axis=0, ddof=1) / 4, np.array([0.16, 0.11]), np.array([0.22, 0.19])
    assert np.all(np.abs(np.mean(found, axis=0) - (least + most) / 2) < (most - least) / 2 + 4 * error)
    assert np.all(error < 0.1 * least)


def apart(spacing=(0.8, 0.8)):
    """Views of 3 x 3 cameras side by side, of disparity 0.5, focused at z = -500."""
    places = np.stack(np.meshgrid([-4.0, 0.0, 4.0], [4.0, 0.0, -4.0], indexing="ij"), axis=-1)
    return dataclasses.replace(field(0.5, count=3), exit_pupil=places, object_spacing=spacing, z_focus=-500.0)


def test_views_of_cameras_side_by_side_have_depth():
    """z = z_focus / (1 + d pixel / step), the inverse of `disparity_at`, and steps of views may be fractions."""
    views = apart()
    z = -np.nanmedian(depth(views, disparity_range=(-1.0, 1.0)).depth)
    assert views.disparity_at(z) == pytest.approx((0.5, 0.5), abs=5e-3)
    halved = depth(field(0.5, steps=0.5), disparity_range=(-1.0, 1.0))
    assert np.nanmedian(halved.disparity) == pytest.approx(0.5, abs=1e-2)  # half the lever
    for arguments, said in (
        ({"white": views}, "neither white"),
        ({"disparity_range": (-900, 900)}, "planes to compare"),
        ({"virtual_depth_range": (2.0, 9.0)}, "no virtual depth"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            depth(views, **arguments)
    with pytest.raises(InvalidValueError, match="no views other than"):
        depth(field(0.5, count=1))


def test_a_line_of_cameras_has_depth():
    """One column of views moves along rows alone, one row along columns."""
    square = apart()
    expected = np.nanmedian(depth(square, disparity_range=(-1.0, 1.0)).depth)
    for line in (np.s_[1:2, :], np.s_[:, 1:2]):
        cut = {name: getattr(square, name)[line] for name in ("views", "exit_pupil", "pupil")}
        views = dataclasses.replace(square, **cut, u=square.u[line[0]], v=square.v[line[1]])
        depth_map = depth(views, disparity_range=(-1.0, 1.0))
        assert np.nanmedian(depth_map.depth) == pytest.approx(expected, rel=1e-3), line
        picture, inside = pl.lightfield.refocus(views, -500.0 / (1.0 + 0.5 * 0.8 / 4.0)), np.s_[5:-5, 5:-5]
        np.testing.assert_allclose(picture, pl.lightfield.refocus(views, disparity=0.5), rtol=1e-5)
        # Sharp: the picture is the central view, but for a percent of the waves' amplitude, 30 x 0.2.
        assert np.abs(picture - views.centre)[inside].max() < 0.06, line


def test_refocusing_by_disparity_knows_pixels_that_are_not_square():
    """Pixels of half the height: a shift of 0.5 pixels along columns is a shift of 1 along rows."""
    views = apart(spacing=(0.8, 0.4))
    across, down = views.disparity_at(-450.0)
    assert down == pytest.approx(2 * across)
    by_disparity = pl.lightfield.refocus(views, disparity=across)
    np.testing.assert_allclose(by_disparity, pl.lightfield.refocus(views, z=-450.0), rtol=1e-5)


def test_decoded_views_have_the_disparity_of_their_plane():
    """Within 0.005 pixels a step of views, as is stated."""
    lens = CAMERA.lens.with_stop(pl.CircularStop(semi_diameter=4.25))
    sensor = pl.Sensor(shape=(286, 286), pixel_pitch=0.01)
    camera = dataclasses.replace(CAMERA, lens=lens, sensor=sensor, microlenses_to_sensor=2.0)
    side = abs(0.217 / pl.paraxial.magnification(lens, -470.0)) * 256
    texture = pl.Texture(np.clip(0.5 + 0.2 * reference.noise(3, 512), 0.02, 1.0)[..., None].astype(np.float32))
    corner = (-side / 2, -side / 2, -470.0)
    scene = pl.Scene([pl.quad(corner, (side, 0, 0), (0, side, 0), material=pl.Emissive(texture))])
    shot = pl.render(scene, camera, samples=16, progress=False)
    views = pl.lightfield.decode(shot, pl.render_white(camera, samples=16, progress=False), views=13)
    depth_map = depth(views, disparity_range=(-0.5, 0.5))
    assert np.nanmedian(depth_map.disparity) == pytest.approx(views.disparity_at(-470.0)[0], abs=0.005)
    assert np.nanmedian(depth_map.depth) == pytest.approx(470.0, rel=0.01)


def test_depth_of_a_lens_that_aberrates_is_that_of_the_plane():
    """By Gaussian optics 1.2 % too large, eight stated errors."""
    camera, z, inside = scenes.view_camera("tessar", 250), -450.5, np.s_[3:-3, 3:-3]
    white = pl.render_white(camera, samples=64, progress=False, seed=5)
    shot = pl.render(pl.Scene([scenes.resolved_card(camera, z, 3)]), camera, samples=32, progress=False)
    views = pl.lightfield.decode(shot, white)
    found = depth(views, progress=False)
    assert abs(np.nanmean(found.depth[inside]) / -z - 1) < 0.002
    error = (found.disparity[inside] - views.disparity_at(z)[0]) / found.standard_error[inside]
    # Of one plane: of 48 planes and lenses 0.3 to 2, and of all of them 1.
    assert np.sqrt(np.nanmean(error**2)) < 2.0
    focused = [pl.lightfield.refocus(views, plane)[inside].std() for plane in (z, 1.02 * z, 0.98 * z)]
    assert focused[0] == max(focused)
    # Outermost views, with light of neighbouring microlenses, made it four times as much.
    central = views.view(0, 0)[inside]
    assert (pl.lightfield.refocus(views, z)[inside] - central).std() < 0.03 * central.std()


@pytest.mark.slow
def test_depth_of_a_camera_with_fast_microlenses():
    """A double Gauss of 30 mm f/2, with microlenses of 20 um: by Gaussian optics at 253.1, 303.2 and 343.2 mm."""
    camera, inside, squares = scenes.small_camera(), np.s_[4:-4, 4:-4], []
    white = pl.render_white(camera, samples=128, progress=False, seed=5)
    for z in (-250.0, -260.0, -300.0, -340.0):
        shot = pl.render(pl.Scene([scenes.resolved_card(camera, z, 7)]), camera, samples=64, progress=False)
        views = pl.lightfield.decode(shot, white)
        found = depth(views, progress=False)
        traced = views.model.traced_disparity(1).of(views.model.disparity(camera, z))
        squares.append(np.nanmean(((found.disparity - traced)[inside] / found.standard_error[inside]) ** 2))
        print(f"{-z:g} mm: {np.nanmedian(found.depth[inside]):.2f} mm, error over stated {squares[-1] ** 0.5:.2f}")
        assert abs(np.nanmedian(found.depth[inside]) / -z - 1) < 0.0005
    # By neighbours' light in the outermost views it was 1.1 to 1.9.
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.25


def exposed(image, electrons, seed, frames=1):
    """An exposure with the noise of so many electrons at radiance 1, and 2 electrons of read noise."""
    rng, light = np.random.default_rng(seed), electrons * frames
    counted = rng.poisson(image.image * light) + rng.normal(0.0, 2.0 * np.sqrt(frames), image.image.shape)
    error = np.sqrt(np.maximum(counted, 1.0) + 4.0 * frames) / light
    noisy = {"image": (counted / light).astype(np.float32), "standard_error": error.astype(np.float32)}
    return dataclasses.replace(image, **noisy)


def test_noise_does_not_bias_depth(white):
    """Of 650 electrons at full light: -1.3 % at v = 3.7, and 13 % of pixels off by 3 %, by interpolated noise."""
    full = float(np.median(white.image[white.image > 0.1 * white.image.max()]))
    found = []
    for v in (3.7, 6.0):
        shot = shown(CAMERA, scenes.plane(CAMERA, v, int(10 * v)), samples=128)
        noisy, noisy_white = exposed(shot, 650 / full, 1), exposed(white, 650 / full, 2, frames=16)
        depth_map, where = depth(noisy, noisy_white), scenes.near_centres(CAMERA, shot)
        scores = scores_of(CAMERA, shot, depth_map)
        assert scores.relative[1] < 3 and abs(scores.bias) < 0.005, str(scores)
        error = (depth_map.disparity - shot.truth.chord_disparity)[where] / depth_map.standard_error[where]
        found.append(np.nanmean(error**2))
    assert 0.8 < np.sqrt(np.mean(found)) < 1.25


SLOW = {
    "one type": (CAMERA, 1.0, 0.4, 0.5),
    "three types": (scenes.three_types(), 1.0, 0.5, 1.0),
    "turned": (scenes.turned(), 1.0, 0.5, 0.5),
    "Keplerian": (scenes.focused(focal_lengths=(1.9,), b=2.2, z=145.0), -1.0, 0.5, 0.5),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_accuracy_is_what_the_page_states(name):
    """Planes at v = 3, 4.5 and 7: bias and Rel3 in percent; docs/depth.md has more."""
    camera, sign, bias, beyond = SLOW[name]
    region = np.s_[192:320, 192:320]  # 0.1 % of them are 16 pixels
    white = white_of(camera, region)
    for v in (3.0, 4.5, 7.0):
        shot = shown(camera, scenes.plane(camera, sign * v, int(10 * v)), samples=128, region=region)
        scores = scores_of(camera, shot, depth(shot, white))
        assert scores.kept > 0.999 and abs(100 * scores.bias) < bias, (v, str(scores))
        assert scores.relative[0] <= 0.1 and scores.relative[1] <= beyond, (v, str(scores))


@pytest.mark.slow
def test_edges_are_wrong_in_few_pixels(white):
    """Rel7 at most 4.4 %, the measured value of the Toolbox."""
    region = np.s_[128:384, 128:384]
    meshes = scenes.plane(CAMERA, 3.5, 5), scenes.plane(CAMERA, 6.0, 6, right=True)
    shot = shown(CAMERA, *meshes, samples=128, region=region)
    assert scores_of(CAMERA, shot, depth(shot, white_of(CAMERA, region))).relative[0] <= 4.4


@pytest.mark.parametrize("focal_lengths", [(1.6, 2.0, 2.6), pytest.param((1.7, 2.0, 2.6), marks=pytest.mark.slow)])
def test_the_order_of_focal_lengths_does_not_say_on_which_side_images_are(focal_lengths):
    # One type is focused before the array or at infinity; the card's image lies behind it.
    camera = dataclasses.replace(scenes.focused(focal_lengths=focal_lengths), sensor=pl.Sensor((110, 110), 0.01))
    shot = pl.render(pl.check_scene(), camera, samples=24, progress=False, truth=pl.Truth.CHORD_DISPARITY)
    white = pl.render_white(camera, samples=16, progress=False)
    depth_map = depth(shot, white)
    assert np.nanmedian(depth_map.disparity) == pytest.approx(np.nanmedian(shot.truth.chord_disparity), rel=0.03)
    with pytest.warns(PlenopticWarning, match="widen virtual_depth_range"):
        other = depth(shot, white, virtual_depth_range=(-25.0, -1.8))
    assert not np.nanmax(other.disparity, initial=-1.0) > 0


def test_uniform_errors_have_closed_forms():
    """Errors uniform in (-a, a): MSE a^2 / 3, shares 1 - t / a above t, a quarter below a / 4."""
    a, n = 0.1, 400
    error = a * (2 * (np.arange(n * n) + 0.5) / n**2 - 1).reshape(n, n)
    truth = np.full((n, n), 2.0)
    scores = disparity_scores(truth + error, truth)
    assert scores.mse == pytest.approx(100 * a**2 / 3, rel=1e-4)
    np.testing.assert_allclose(scores.bad, [100 * (1 - t / a) for t in (0.07, 0.03, 0.01)], atol=0.01)
    assert scores.q25 == pytest.approx(100 * a / 4, rel=1e-3) and scores.kept == 1.0 and scores.pixels == n * n
    np.testing.assert_allclose(scores.relative, [0, 100 * (1 - 0.06 / a), 100 * (1 - 0.02 / a)], atol=0.01)
    assert abs(scores.bias) < 1e-5


@given(scale=strategies.floats(0.1, 10), factor=strategies.floats(0.5, 2), seed=strategies.integers(0, 99))
def test_relative_scores_do_not_know_units(scale, factor, seed):
    random = np.random.default_rng(seed)
    truth = random.uniform(1, 9, (7, 9))
    estimate = truth * factor * random.normal(1, 0.03, truth.shape)
    one, other = disparity_scores(estimate, truth), disparity_scores(scale * estimate, scale * truth)
    np.testing.assert_allclose(other.relative, one.relative, atol=100 / 63 + 1e-9)
    assert other.bias == pytest.approx(one.bias, abs=1e-12)
    assert other.mse == pytest.approx(one.mse * scale**2)


def test_what_is_not_known_does_not_count_and_types_add_up():
    random = np.random.default_rng(3)
    truth, types = random.uniform(2, 3, (20, 30)), random.integers(-1, 3, (20, 30))
    estimate = truth + random.normal(0, 0.05, truth.shape)
    estimate[:5], truth[:, :3] = np.nan, np.nan
    where = np.arange(20)[:, None] * np.ones(30) >= 2
    scores = disparity_scores(estimate, truth, where=where, types=types)
    assert scores.pixels == 15 * 27 and scores.kept == pytest.approx(15 / 18)
    assert sum(part.pixels for part in scores.of_types) == ((types >= 0)[5:, 3:]).sum()
    assert scores.of_types[1] == disparity_scores(estimate, truth, where=where & (types == 1))
    assert str(scores).splitlines()[0].split()[:3] == ["pixels", "kept", "%"] and len(str(scores).splitlines()) == 5
    nothing = disparity_scores(np.full((2, 2), np.nan), np.ones((2, 2)))
    assert nothing.pixels == 0 and nothing.kept == 0 and np.isnan(nothing.mse)


def test_bumpiness_is_the_norm_of_second_derivatives():
    """Error a (x^2 + 2 x y): Hessian (2 a, 2 a; 2 a, 0), norm 2 a sqrt(3), exact by central differences."""
    y, x = np.mgrid[0:20, 0:30].astype(float)
    truth = np.full(x.shape, 3.0)
    for a in (1e-3, 0.1):
        scores = disparity_scores(truth + a * (x**2 + 2 * x * y), truth)
        assert scores.bumpiness == pytest.approx(100 * min(2 * a * np.sqrt(3), 0.05), rel=1e-9)
    slanted = disparity_scores(truth + 0.3 * x - 0.2 * y, truth, where=x < 15)
    assert slanted.bumpiness == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(disparity_scores(truth[:4], truth[:4]).bumpiness)


def test_edges_are_where_the_truth_steps():
    truth = np.full((9, 9), 4.0)
    truth[4, 4], truth[0, 0] = 4.3, np.nan
    edges = disparity_edges(truth)
    expected = np.zeros((9, 9), dtype=bool)
    expected[4, 2:7] = expected[2:7, 4] = expected[0, :3] = expected[:3, 0] = True
    np.testing.assert_array_equal(edges, expected)
    assert not disparity_edges(np.full((5, 5), 4.0) + 0.04 * np.eye(5)).any()
    with pytest.raises(InvalidValueError, match="step"):
        disparity_edges(truth, step=-1.0)


def test_impossible_maps_are_refused():
    for arguments, said in (
        ({"estimate": np.ones((2, 3))}, "estimate has shape"),
        ({"truth": np.ones(4)}, "truth has shape"),
        ({"where": np.ones((2, 2))}, "it must be booleans"),
        ({"types": np.full((2, 2), 0.5)}, "whole numbers"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            disparity_scores(**({"estimate": np.ones((2, 2)), "truth": np.ones((2, 2))} | arguments))

"""Views of focused cameras: constants, positions of textures, occlusion."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield import refocus, render_view, render_views
from plenoptic.lightfield.focused.pixel_rays import pixel_rays
from plenoptic.lightfield.kernels.splat import exp_minus
from plenoptic.optics.lens.placement import rotation_about_axes

LENS = pl.load_lens("double-gauss-100mm-f2").with_model(pl.LensModel.THIN)
TURNED = pl.optics.Placement(rotation=rotation_about_axes((0.003, -0.004, 0.2)), shift=(0.03, -0.02, 0.01))


def the_camera(b=1.7, stop=5.0, types=(2.0,), lattice=pl.Lattice.HEXAGONAL, shape=(120, 120), **more):
    camera = pl.camera.example_camera(shape=shape, lattice=lattice)
    lens, array = LENS.with_stop(pl.CircularStop(stop)), dataclasses.replace(camera.microlenses, focal_lengths=types)
    return dataclasses.replace(camera, lens=lens, microlenses=array, microlenses_to_sensor=b, **more)


GALILEAN = the_camera()
CAMERAS = {
    "one type": GALILEAN,
    "Keplerian, square": the_camera(b=2.3, stop=3.7, types=(1.95, 2.05), lattice=pl.Lattice.SQUARE),
    "three types, turned and tilted": the_camera(types=(1.85, 2.0, 2.3), microlenses_placement=TURNED),
}


def plane_at(camera, v):
    """z of the plane that the lens images v times b behind the array."""
    points = pl.paraxial.cardinal_points(camera.lens, wavelength=camera.wavelength)
    image = camera.stop_to_microlenses + v * camera.microlenses_to_sensor - points.rear_principal
    return points.rear_principal - 1.0 / (1.0 / points.efl - 1.0 / image)


def test_micro_images_are_read_as_far_as_the_traced_cone_reaches():
    """Rims of the triplet vignette a sixth of its paraxial cone, which left out a quarter of each touching image."""
    sensor, kind, lens = pl.Sensor((60, 60), 0.0055), pl.CameraKind.GALILEAN, pl.load_lens("cooke-triplet-50mm-f5")
    design = {"z": -600.0, "pitch": 0.1, "semi_diameter": 4.5, "virtual_depth": 4.0}
    white = pl.render_white(pl.design_camera(lens, sensor=sensor, kind=kind, **design).camera, samples=16)
    assert np.bincount(pixel_rays(white, white, None, 0.1).lens).max() > 0.8 * math.pi * (0.5 * 0.1 / 0.0055) ** 2


def glowing(z, side, radiance, centre=(0.0, 0.0)):
    x, y = centre
    return pl.quad((x - side / 2, y - side / 2, z), (side, 0, 0), (0, side, 0), material=pl.Emissive(radiance))


def waves(camera, v):
    """Plane whose radiance is a product of waves of 6 pitches, or 64 texels; and the radiance at points."""
    z = plane_at(camera, v)
    period = 6 * 0.217 * abs(z / (camera.stop_to_microlenses + v * camera.microlenses_to_sensor))
    at = 2 * np.pi * (np.arange(512) + 0.5) / 64
    texels = 0.5 + 0.2 * np.sin(at)[None, :] * np.cos(at)[::-1, None]
    texture = pl.Texture(texels[..., None].astype(np.float32))

    def radiance(position):
        x, y = (2 * np.pi * (position[..., k] + 4 * period) / period for k in range(2))
        return 0.5 + 0.2 * np.sin(x) * np.cos(y)

    return pl.Scene([glowing(z, 8 * period, texture)]), radiance


def white_of(camera):
    return pl.render_white(camera, samples=64, seed=9, progress=False)


def shot_of(scene, camera, samples=64, **more):
    truth = pl.Truth.CHORD_DISPARITY
    return pl.render(scene, camera, samples=samples, seed=3, max_bounces=0, truth=truth, progress=False, **more)


@pytest.fixture(scope="module")
def white():
    return white_of(GALILEAN)


@pytest.fixture(scope="module")
def hidden():
    """A dark square before a bright plane."""
    near, far = plane_at(GALILEAN, 7.0), plane_at(GALILEAN, 3.5)
    scene = pl.Scene([glowing(near, 2.0, 0.2, (0.3, 0.2)), glowing(far, 60.0, 1.0)])
    return scene, shot_of(scene, GALILEAN)


def test_a_constant_scene_gives_the_constant_whatever_the_depth(white):
    """Fits reproduce constants up to rounding of float32."""
    depth = np.where(np.arange(120) < 60, 3.0, 5.0) * np.ones((120, 1))
    depth[:, :20] = np.nan
    for disparity, viewpoint in ((4.0, (0.0, 0.0)), (depth, (0.0, 0.0)), (depth, (-0.6, 0.5))):
        view = render_view(white, white, disparity, viewpoint=viewpoint)
        visible = np.isfinite(view.picture)
        assert visible.any() and np.abs(view.picture[visible] - 1.0).max() < 1e-6, viewpoint
        assert np.array_equal(np.isfinite(view.disparity), visible[..., 0])
        assert np.array_equal(view.coverage > 0, visible[..., 0])
    assert np.isnan(view.picture).any() and set(view.disparity[np.isfinite(view.disparity)].round(6)) == {3.0, 5.0}


@pytest.mark.parametrize("name", [pytest.param("one type", marks=pytest.mark.slow), *list(CAMERAS)[1:]])
def test_a_texture_lies_where_it_is(name):
    """In focus or not, from the middle of the pupil and beside it, upright.

    Waves of 6 pitches are 36 pixels long: a quadratic fit over a window of variance w^2 = 0.36, of samples whose
    footprints have variances up to s = 0.5, misses terms of fourth order, 0.2 (2 pi / 36)^4 (w^2 + s)^2 = 1.4e-4,
    and of third order, where samples lie to one side, ten times that. The rest is noise.
    """
    camera = CAMERAS[name]
    scene, radiance = waves(camera, 4.0 if camera.microlenses_to_sensor < 2 else -4.0)
    shot, white = shot_of(scene, camera), white_of(camera)
    for viewpoint in ((0.0, 0.0), (0.5, -0.4)):
        view = render_view(shot, white, shot.truth.chord_disparity, viewpoint=viewpoint)
        expected = radiance(view.truth(scene, truth=pl.Truth.POSITION).position)
        off = np.abs(view.picture - expected[..., None]) - 1e-3
        visible = np.isfinite(off)
        assert visible.mean() > 0.75
        assert (off[visible] < 3 * view.standard_error[visible]).mean() > 0.97


def test_the_rays_of_a_view_meet_at_the_viewpoint(white):
    """In object space at the pupil, right of its middle and above it; of a thin lens, in its own plane, exactly."""
    view = render_view(white, white, z=-400.0, viewpoint=(0.5, 0.25))
    points = [view.truth(pl.Scene([glowing(z, 900.0, 1.0)])).position for z in (-300.0, -600.0)]
    pupil = pl.paraxial.cardinal_points(GALILEAN.lens, wavelength=587.6)
    fraction = (pupil.rear_principal - points[0][..., 2:]) / (points[1][..., 2:] - points[0][..., 2:])
    at_pupil = (points[0] + fraction * (points[1] - points[0]))[..., :2] / pupil.entrance_pupil_semi_diameter
    assert np.abs(at_pupil - (0.5, 0.25)).max() < 1e-6
    # Upright.
    assert (np.diff(points[0][..., 0], axis=1) > 0).all() and (np.diff(points[0][..., 1], axis=0) < 0).all()


def test_what_is_nearer_hides_what_is_behind(white, hidden):
    """Also where the map of disparity shows it wider than it is, as matching in windows does."""
    scene, shot = hidden
    for fat, viewpoint in ((0, (0.0, 0.0)), (2, (0.0, 0.0)), (2, (0.5, 0.5))):
        padded = np.pad(shot.truth.chord_disparity, fat, mode="edge")
        disparity = np.lib.stride_tricks.sliding_window_view(padded, (2 * fat + 1,) * 2).min(axis=(2, 3))
        view = render_view(shot, white, disparity, viewpoint=viewpoint)
        objects = view.truth(scene, truth=pl.Truth.OBJECT).object
        # Pixels that see one object as far as two pixels around.
        same = np.all([np.roll(objects, step, axis) == objects for axis in (0, 1) for step in (-2, -1, 1, 2)], axis=0)
        pure = np.pad(same[2:-2, 2:-2], 2)
        for mesh, radiance in enumerate((0.2, 1.0)):
            of_mesh = view.picture[pure & (objects == mesh) & np.isfinite(view.disparity)]
            assert len(of_mesh) > 100
            # Where pixels mix both, farther out than matters elsewhere, bright and dark differ by 0.8.
            assert (np.abs(of_mesh - radiance) < 0.1).mean() > 0.95, (fat, viewpoint)


def test_holes_are_filled_from_the_same_surface(white, hidden):
    """Disparities are unknown near the edge of the square; the radiance tells the side. Other pixels stay."""
    _, shot = hidden
    truth = shot.truth.chord_disparity
    around = np.lib.stride_tricks.sliding_window_view(np.pad(truth, 2, mode="edge"), (5, 5))
    partly = np.where(around.max(axis=(2, 3)) > 1.1 * around.min(axis=(2, 3)), np.nan, truth)
    # Of a depth map, wrong disparities without confidence do not count.
    wrong = np.arange(120)[:, None] % np.full(120, 40) == 0
    maps = [np.where(wrong, 1.5 * partly, partly), np.full(truth.shape, 0.01), np.where(wrong, 0.0, 1.0)]
    depth_map = pl.lightfield.DepthMap(*maps, truth, truth)
    exact, plain, plain_map = (render_view(shot, white, disparity) for disparity in (truth, partly, depth_map))
    view = render_view(shot, white, partly, fill=True, threads=2)
    assert plain.filled is None and view.filled.any() and view.filled[np.isnan(plain.disparity)].all()
    for filled, unfilled in ((view, plain), (render_view(shot, white, depth_map, fill=True), plain_map)):
        for name in ("picture", "standard_error", "disparity", "coverage"):
            assert np.array_equal(getattr(filled, name)[~filled.filled], getattr(unfilled, name)[~filled.filled])
        assert np.isfinite(filled.picture).all()
        off = np.abs(filled.disparity / exact.disparity - 1)[filled.filled]
        assert (off < 0.05).mean() > 0.8, (off < 0.05).mean()
    rms = [np.sqrt(np.mean((part.picture - exact.picture)[view.filled] ** 2)) for part in (view, plain)]
    assert rms[0] < 0.15, rms
    field = render_views(shot, white, partly, views=3, fill=True)
    assert np.array_equal(field.centre, render_view(shot, white, partly, fill=True).picture)
    # Infinite disparities and 0 are as unknown as nan, and a map without any confidence is trusted everywhere.
    for unknown in (np.inf, -np.inf, 0.0):
        with_gaps = np.where(np.isnan(partly), unknown, partly)
        assert np.array_equal(render_view(shot, white, with_gaps, fill=True).picture, view.picture)
    doubtful = dataclasses.replace(depth_map, disparity=partly, confidence=np.zeros(truth.shape))
    assert np.array_equal(render_view(shot, white, doubtful, fill=True).picture, view.picture)


def test_noisy_uniform_surfaces_leave_no_holes(white, hidden):
    """Matching finds wrong disparities in noise of 15 %, which scattered their pixels: 1.8 % of the view were nan."""
    _, shot = hidden
    noise = 0.15 * np.random.default_rng(3).normal(size=shot.image.shape).astype(np.float32)
    noisy = dataclasses.replace(shot, image=shot.image * (1 + noise), standard_error=0.15 * shot.image)
    view = render_view(noisy, white, pl.lightfield.depth(noisy, white, progress=False), fill=True)
    assert np.isfinite(view.picture).all()
    exact, best = (render_view(part, white, shot.truth.chord_disparity).picture for part in (shot, noisy))
    # The edges of the square, beside which pixels of both surfaces mix, cost a tenth.
    assert np.std(view.picture - exact) < 1.2 * np.std(best - exact)


def test_one_plane_is_sharp_where_it_is_refocused(hidden, white):
    """The edge of the dark square: as sharp as the samples are, or blurred by the aperture."""
    _, shot = hidden
    sharp, blurred, stopped = (
        render_view(shot, white, z=plane_at(GALILEAN, v), aperture=aperture).picture[..., 0]
        for v, aperture in ((7.0, None), (3.5, None), (3.5, 0.5))
    )
    # Columns between dark and bright, right of the square's middle.
    between = [np.count_nonzero(np.abs(p[13:21].mean(axis=0)[17:] - 0.6) < 0.25) for p in (sharp, blurred, stopped)]
    assert between[0] < between[2] < between[1] and between[0] <= 2
    again = render_view(shot, white, 0.217 / (7.0 * 0.01)).picture[..., 0]
    assert np.allclose(again, sharp, atol=1e-5, equal_nan=True)


def test_a_light_field_of_views_is_one_like_others(white):
    """The rays are those of single views at the same pupil points, and disparities align views of a plane."""
    shot = shot_of(scene := waves(GALILEAN, 4.0)[0], GALILEAN)
    field = render_views(shot, white, shot.truth.chord_disparity, views=3)
    assert field.views.shape[:2] == (3, 3) and np.allclose(field.pupil[2, 0], (0.6, 0.6), rtol=0, atol=1e-12)
    view = render_view(shot, white, shot.truth.chord_disparity, viewpoint=(0.6, 0.6))
    assert np.array_equal(field.view(1, -1), view.picture, equal_nan=True)
    assert np.array_equal(field.standard_error[2, 0], view.standard_error, equal_nan=True)
    rays, expected = (truth.position for truth in (field.truth(scene, 1, -1), view.truth(scene)))
    # A nanometre of chief rays' places on the sensor, 250 times as far at the plane.
    assert np.allclose(rays, expected, rtol=0, atol=1e-6)
    off = (refocus(field, z=plane_at(GALILEAN, 4.0)) - field.centre)[8:-8, 8:-8]
    # Cubic convolution of waves of 36 pixels: third order, 0.2 (2 pi / 36)^3 / 8.
    assert np.abs(off).max() < 3e-4 + 4 * np.nanmax(field.standard_error[1, 1, 8:-8, 8:-8])
    with pytest.raises(InvalidValueError, match="odd"):
        render_views(shot, white, shot.truth.chord_disparity, views=4)


def test_weights_are_exponentials():
    """Of x up to 10, at the rim of the widest window 4.5, to rounding; beyond it they vanish and stay positive."""
    x = np.linspace(0.0, 10.0, 1001)
    np.testing.assert_allclose([exp_minus(value) for value in x.tolist()], np.exp(-x), rtol=1e-13)
    far = np.array([exp_minus(value) for value in (100.0, 1e3, 1e6, math.inf)])
    assert (far >= 0).all() and (far < 1e-40).all()


def test_errors_are_those_of_independent_pixels(white):
    spread = 0.03 * white.image
    noisy = white.image + spread * np.random.default_rng(5).normal(size=spread.shape)
    exact = dataclasses.replace(white, standard_error=None)
    shot = dataclasses.replace(exact, image=noisy.astype(np.float32), standard_error=spread.astype(np.float32))
    for disparity in (np.full(spread.shape[:2], 4.0), 4.0):
        view = render_view(shot, exact, disparity)
        off = (view.picture - 1.0) / view.standard_error
        # Some 100 independent ones: 7 % of the deviation, times three.
        assert np.nanstd(off) == pytest.approx(1.0, rel=0.2)
        assert abs(np.nanmean(off)) < 0.3
    assert render_view(exact, exact, 4.0).standard_error is None


def test_the_view_of_a_region_is_part_of_the_whole_on_any_number_of_threads():
    """Inside, where no pixel beyond the region shows: 2.5 (1 + 0.5) pitches from its border."""
    camera = the_camera(shape=(230, 240))
    scene = pl.Scene([glowing(plane_at(camera, 2.5), 60.0, 1.0)])
    white = white_of(camera)
    whole = render_view(shot := shot_of(scene, camera, 16), white, shot.truth.chord_disparity, threads=2)
    cut = shot_of(scene, camera, 16, region=np.s_[20:206, 30:220])
    view = render_view(cut, white, cut.truth.chord_disparity, threads=1)
    offset = np.rint((view.on_array[0, 0] - whole.on_array[0, 0]) / whole.spacing).astype(int)
    down, along = int(offset[1]), -int(offset[0])
    rows, columns = view.picture.shape[:2]
    inner = np.s_[18:-18, 18:-18]
    for name in ("picture", "standard_error", "disparity", "coverage"):
        larger = getattr(whole, name)[down : down + rows, along : along + columns]
        assert np.array_equal(getattr(view, name)[inner], larger[inner], equal_nan=True)
        assert getattr(view, name)[inner].size > 200


def test_spacing_and_colour(white):
    scene = pl.Scene([glowing(plane_at(GALILEAN, 4.0), 60.0, (0.9, 0.5, 0.1))])
    shot = shot_of(scene, GALILEAN, 16)
    view = render_view(shot, white, shot.truth.chord_disparity, spacing=0.1)
    assert view.picture.shape[2] == 3 and view.spacing == 0.1
    assert np.abs(np.diff(view.on_array[:, 0, 1]) - 0.1).max() < 1e-12
    off = np.abs(view.picture - (0.9, 0.5, 0.1))[2:-2, 2:-2]
    assert off.max() < 8 * np.nanmax(view.standard_error[2:-2, 2:-2])


def test_mistakes_are_named(white):
    for arguments, message in (
        ({}, "give either disparity"),
        ({"disparity": 3.0, "z": -400.0}, "give either disparity"),
        ({"disparity": np.zeros((3, 3))}, "disparity has shape"),
        ({"disparity": math.nan}, "nowhere finite"),
        ({"z": 10.0}, "in front of the camera"),
        ({"disparity": 3.0, "viewpoint": 0.5}, "viewpoint has shape"),
        ({"disparity": 3.0, "aperture": 0.0}, "aperture is 0"),
        ({"disparity": 3.0, "spacing": -1.0}, "spacing is -1"),
        ({"z": -400.0, "fill": True}, "no holes to fill"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            render_view(white, white, **arguments)
    unfocused = white_of(the_camera(b=2.0, shape=(60, 60)))
    with pytest.raises(InvalidValueError, match="decode"):
        render_view(unfocused, unfocused, 3.0)

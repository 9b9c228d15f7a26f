"""Sub-aperture views: white images, resampling, one picture from everywhere in focus, disparity beside it."""

import dataclasses
import math
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.images import PixelState
from plenoptic.lightfield import decode, refocus
from plenoptic.lightfield.outward_rays import aperture_variance
from plenoptic.lightfield.raw_arrays import raw_arrays
from plenoptic.lightfield.resample import resampling

HEXAGONAL, SQUARE, RECTANGULAR = pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR


def the_camera(shape=(242, 242), model=pl.LensModel.THIN, **array):
    """The reference camera in mode 1.0, focused at z = -404."""
    camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=shape, lattice=SQUARE)
    lens, array = camera.lens.with_model(model), dataclasses.replace(camera.microlenses, **array)
    return dataclasses.replace(camera, lens=lens, microlenses=array).focused_at(z=-404.0)


def white_of(camera, samples=64, seed=11, **more):
    return pl.render_white(camera, samples=samples, seed=seed, replicates=8, progress=False, **more)


def tiles(radiance, side, z):
    """A scene of square emitters: radiance (n, m) with row 0 at the top, centred on the axis."""
    n, m = radiance.shape
    meshes = []
    for (i, j), bright in np.ndenumerate(radiance):
        corner = ((j - m / 2) * side, (n / 2 - i - 1) * side, z)
        meshes.append(pl.quad(corner, (side, 0, 0), (0, side, 0), material=pl.Emissive(float(bright))))
    return pl.Scene(meshes)


def shot_of(scene, camera, samples=64, **more):
    return pl.render(scene, camera, samples=samples, seed=3, replicates=8, max_bounces=0, progress=False, **more)


def in_both(part, whole):
    """The views of two light fields, of pixels that both have, by the axis that their grids have in common."""
    down = round((part.origin[1] - whole.origin[1]) / whole.spacing[1])
    right = round((whole.origin[0] - part.origin[0]) / whole.spacing[0])
    rows, columns = part.views.shape[2:4]
    in_whole = whole.views[:, :, max(down, 0) : down + rows, max(right, 0) : right + columns]
    in_part = part.views[:, :, max(-down, 0) :, max(-right, 0) :]
    return in_part[:, :, : in_whole.shape[2], : in_whole.shape[3]], in_whole


def test_white_decodes_to_one_wherever_it_is_lit():
    thin, exact = pl.LensModel.THIN, pl.LensModel.EXACT
    for lattice, pitch, model in (
        (HEXAGONAL, 0.217, exact),
        (SQUARE, 0.217, thin),
        (RECTANGULAR, (0.217, 0.24), exact),
    ):
        white = white_of(the_camera((190, 210), model, lattice=lattice, pitch=pitch), samples=16)
        field = decode(white, white)
        lit, off_axis = np.isfinite(field.views), np.linalg.norm(field.pupil, axis=-1)
        # Float32 rounding of 1.
        np.testing.assert_allclose(field.views[lit], 1.0, rtol=1e-6)
        inside = lit[off_axis < 0.85][:, 2:-2, 2:-2]  # the border of a hexagonal lattice is ragged
        assert inside.all() and inside.size > 1000 and not lit[off_axis > 1.25].any(), lattice


def test_errors_are_those_of_independent_pixels():
    """The quotient of two white images scatters around 1 by its standard error."""
    camera = the_camera((242, 242), lattice=HEXAGONAL)
    field = decode(white_of(camera, samples=64, seed=1), white_of(camera, samples=64, seed=2), views=11)
    off = (field.views - 1.0) / field.standard_error
    off = off[np.isfinite(off)]
    assert off.size > 5000
    # Standard errors from 8 replicates: t with 7 degrees of freedom has variance 7/5, less after averaging several
    # pixels; neighbouring views share pixels, so that the sample counts as some 1000.
    assert 0.85 < np.sqrt(np.mean(off**2)) < 1.3
    assert abs(np.median(off)) < 0.15


def test_an_exact_white_image_leaves_the_error_of_the_shot():
    camera, even = the_camera((70, 70)), np.full((70, 70, 1), 0.5)
    shot, white = pl.Exposure(even, standard_error=0.06 * even, camera=camera), pl.Exposure(2 * even)
    field = decode(shot, white, views=3)
    valid = np.isfinite(field.views)
    np.testing.assert_allclose(field.views[valid], 0.5, rtol=1e-6)
    # Centres fall between pixels: bilinear weights w have a sum of squares from 1/4 to 1.
    errors = field.standard_error[valid]
    np.testing.assert_allclose(np.clip(errors, 0.015, 0.03), errors, rtol=1e-6)
    assert decode(dataclasses.replace(shot, standard_error=None), white, views=3).standard_error is None


def test_reading_between_pixels_reproduces_linear_functions_exactly():
    rows, columns = np.mgrid[0:9, 0:12]
    shot = pl.Exposure((2.0 + 0.5 * rows - 0.25 * columns)[:, :, None] + 10)
    raw = raw_arrays(shot, pl.Exposure(np.ones((9, 12, 1))), 0.05)
    places = np.random.default_rng(1).uniform((0, 0), (8, 11), (200, 2))
    values, _ = raw.read(places)
    np.testing.assert_allclose(values[:, 0], 12 + 0.5 * places[:, 0] - 0.25 * places[:, 1], rtol=1e-12)
    assert np.isnan(raw.read(np.array([[-0.1, 3.0], [3.0, 11.2]]))[0]).all()
    assert np.isfinite(raw.read(np.array([[0.0, 0.0], [8.0, 11.0]]))[0]).all()


def grid_of(lattice, half, spacing=None, pitch=0.1):
    array = pl.MicrolensArray(pitch, (1.0,), lattice)
    lenses = array.lenses((-half, -half), (half, half))
    grid = resampling(array, lenses.index, spacing)
    x = grid.origin[0] - grid.spacing[0] * np.arange(grid.columns)
    y = grid.origin[1] + grid.spacing[1] * np.arange(grid.rows)
    return lenses.design, grid, *np.meshgrid(x, y)


def test_resampling_reproduces_linear_functions_exactly():
    for lattice, spacing in ((HEXAGONAL, None), (HEXAGONAL, 0.037), (SQUARE, None), (SQUARE, 0.037)):
        design, grid, x, y = grid_of(lattice, 1.0, spacing)
        resampled = grid.interpolate((3.0 + 2.0 * design[:, 0] - 5.0 * design[:, 1])[:, None])[:, :, 0]
        valid = np.isfinite(resampled)
        # The lattice is known a row beyond all but the ragged border.
        assert valid[2:-2, 2:-2].all(), (lattice, spacing)
        np.testing.assert_allclose(resampled[valid], (3.0 + 2.0 * x - 5.0 * y)[valid], atol=1e-12)


def test_resampling_of_a_smooth_function_errs_by_the_square_of_the_pitch():
    """Linear interpolation on triangles of side h errs by h^2 / 6 times the second derivative; cubic functions less."""
    largest = []
    for pitch in (0.1, 0.05):
        design, grid, x, y = grid_of(HEXAGONAL, 1.0, 0.0137, pitch)
        values = np.sin(3 * design[:, :1]) * np.cos(2 * design[:, 1:])
        true = np.sin(3 * x) * np.cos(2 * y)
        smooth = grid.smooth.interpolate(values)[:, 0].reshape(x.shape)
        linear = grid.linear.interpolate(values)[:, 0].reshape(x.shape)
        # Second derivatives are at most 9 + 4 in sum of the main directions.
        assert np.nanmax(np.abs(linear - true)) < pitch**2 / 6 * 13
        valid = np.isfinite(smooth)
        assert valid.mean() > 0.5
        np.testing.assert_array_equal(grid.interpolate(values)[:, :, 0], np.where(valid, smooth, linear))
        largest.append(np.abs(smooth - true)[valid].max())
        assert largest[-1] < 0.1 * np.abs(linear - true)[valid].max()
    assert largest[0] / largest[1] > 3.0


def test_weights_are_shares():
    for lattice in (HEXAGONAL, SQUARE):
        _, grid, _, _ = grid_of(lattice, 0.7, 0.031)
        assert (grid.linear.weight >= 0).all()
        for weights in (grid.linear, grid.smooth, grid.prediction):
            np.testing.assert_allclose(weights.weight.sum(axis=1), 1.0, rtol=1e-12)
    _, plain, _, _ = grid_of(SQUARE, 0.7)
    assert plain.smooth is None and plain.prediction is None  # every pixel is a microlens


def test_interpolation_errors_are_as_large_as_stated():
    random = np.random.default_rng(5)
    for lattice in (HEXAGONAL, SQUARE):
        # 0.1 mm between microlenses; a finer grid than that of a square lattice meets it everywhere.
        design, grid, x, y = grid_of(lattice, 2.0, 0.0473)
        middle, noise = np.s_[8:-8, 8:-8], random.normal(size=(len(design), 1))
        frequency, angle, phase = np.exp(random.uniform(-1.6, 3.4, 600)), *random.uniform(0, 2 * np.pi, (2, 600))
        wave = 2 * np.pi * frequency * np.array([np.cos(angle), np.sin(angle)])
        # As many waves in each octave: amplitudes f^(1 - power) are those of noise that falls as f^-power.
        for power, resolved in ((1.0, 99.0), (1.5, 99.0), (2.0, 99.0), (0.0, 2.0)):
            size = frequency ** (1 - power) * np.sinc(0.1 * frequency) * (frequency < resolved)
            expected, values = (
                (size * np.cos(places @ wave + phase)).sum(axis=-1, keepdims=True)
                for places in (np.stack([x, y], axis=-1), design)
            )
            error = (grid.interpolate(values) - expected)[middle]
            stated = np.sqrt(np.mean(grid.interpolation_variance(values, np.zeros_like(values))[middle]))
            true = np.sqrt(np.mean(error**2))
            assert stated < 0.02 * expected.std() if resolved == 2.0 else 0.8 < true / stated < 1.25, (lattice, power)
        # Noise alone is not taken for detail.
        assert np.mean(grid.interpolation_variance(noise, np.ones_like(noise))[middle]) < 0.25
    # A view on the microlenses themselves misses nothing.
    design, square, _, _ = grid_of(SQUARE, 1.0)
    assert square.interpolation_variance(design[:, :1] ** 2, 0 * design[:, :1]).max() == 0.0


def noise_card(z, size, corner, seed):
    """A card with 1/f noise, as (quad, its radiance at points (n, 2)): waves from half a pixel of a view on."""
    random = np.random.default_rng(seed)
    frequency, angle, phase = np.exp(random.uniform(-3.0, 1.6, 300)), *random.uniform(0, 2 * np.pi, (2, 300))
    wave = 2 * np.pi * frequency * np.array([np.cos(angle), np.sin(angle)])

    def radiance(points):
        return 1.0 + 0.015 * sum(np.cos(points @ wave[:, k] + phase[k]) for k in range(300))

    at = (np.arange(1024) + 0.5) / 1024 * size
    x, y = np.meshgrid(corner + at, corner + at[::-1])
    texels = radiance(np.stack([x, y], axis=-1))[..., None].astype(np.float32)
    glow = pl.Emissive(pl.Texture(texels))
    return pl.quad((corner, corner, z), (size, 0, 0), (0, size, 0), material=glow), radiance


def test_merged_views_show_what_the_lattice_does_not_resolve():
    """Against means of the texture over pixels, traced; interpolation has 30 dB for both scenes."""
    camera = the_camera((230, 230), pl.LensModel.EXACT, lattice=HEXAGONAL, pitch=0.147)
    white, parts = white_of(camera), 7
    field = decode(white, white, views=7)
    rows, columns = field.views.shape[2:4]
    fine = decode(white, white, views=7, spacing=field.spacing[0] / parts)
    # Pixels (i, j) of the field have the middle part of parts x parts pixels of the fine one.
    shift = (field.origin - fine.origin) * (-1.0, 1.0) / fine.spacing
    first = np.rint(shift[::-1]).astype(int) + parts * 3 - parts // 2
    cut = tuple(slice(k, k + parts * (n - 6)) for k, n in zip(first, (rows, columns), strict=True))
    far, near = noise_card(-452.0, 60.0, -30.0, 1), noise_card(-364.0, 30.0, -30.0, 2)
    for cards, least in (((far,), 40.0), ((far, near), 33.0)):
        scene = pl.Scene([quad for quad, _ in cards])
        plain = decode(shot := shot_of(scene, camera, 128), white, views=7)
        depth, model = plain.truth(scene, truth=pl.Truth.DEPTH).depth, plain.model
        far_map, near_map = (model.traced_disparity(1).of(model.disparity(camera, z)) for z in (-452.0, -364.0))
        disparity = np.where(depth > 400, far_map, np.where(depth > 0, near_map, np.nan))
        merged = decode(shot, white, views=7, disparity=disparity)
        squares = np.zeros((2, 2))
        for u, v in ((0, 0), (2, 0), (-2, 1)):
            truth = fine.truth(scene, u, v, truth=pl.Truth.POSITION | pl.Truth.DEPTH)
            points = truth.position[cut][..., :2]
            radiance = np.where(truth.depth[cut] > 400, cards[0][1](points), cards[-1][1](points))
            expected = radiance.reshape(rows - 6, parts, columns - 6, parts).mean(axis=(1, 3))
            for n, views in enumerate((plain, merged)):
                off = views.view(u, v)[3:-3, 3:-3, 0] - expected
                squares[n] += np.mean(off**2), np.mean(views.standard_error[u + 3, v + 3, 3:-3, 3:-3] ** 2)
        error, stated = np.sqrt(squares / 3).T
        assert error[1] < 10 ** (-least / 20)
        assert ((error / stated > 0.8) & (error / stated < 1.25)).all(), error / stated


def test_a_turned_array_shows_the_scene_upright():
    """Linear functions of the camera's own x and y stay linear for any position and rotation of the array."""
    jitter = pl.MicrolensImperfections(pitch_jitter=0.01, seed=2)
    for lattice in (HEXAGONAL, SQUARE):
        built = the_camera((242, 242), lattice=lattice, imperfections=jitter)
        camera = built.moved(pl.CameraPart.MICROLENSES, shift=(0.1, -0.05, 0.0), tilt=(0.0, 0.0, 0.35))
        place = camera.sensor.centre_of(*np.mgrid[0:242, 0:242])
        shot = pl.Exposure((5 + place @ [0.7, -0.4])[:, :, None], camera=camera)
        with pytest.warns(pl.errors.PlenopticWarning, match="shows no lattice"):
            field = decode(shot, pl.Exposure(np.ones((242, 242, 1))), views=1)
        x = field.origin[0] - field.spacing[0] * np.arange(field.views.shape[3])
        y = field.origin[1] + field.spacing[1] * np.arange(field.views.shape[2])
        radiance = field.centre[:, :, 0]
        valid = np.isfinite(radiance)
        table = np.column_stack([*(part[valid] for part in np.meshgrid(x, y)), np.ones(valid.sum())])
        fit, *_ = np.linalg.lstsq(table, radiance[valid], rcond=None)
        assert valid.mean() > 0.5
        assert fit[1] / fit[0] == pytest.approx(-0.4 / 0.7, rel=1e-3), lattice
        assert np.abs(table @ fit - radiance[valid]).max() < 1e-3, lattice


def test_in_focus_all_views_show_the_same_picture():
    pattern, camera = 0.3 + np.random.default_rng(6).uniform(0, 1, (14, 14)), the_camera((242, 242))
    white = white_of(camera, 128)
    side = 0.25 / 0.217 * decode(white, white, views=1).object_spacing[0]
    field = decode(shot_of(tiles(pattern, side, -404.0), camera, 128), white, views=13)
    inside, middle = np.linalg.norm(field.pupil, axis=-1) < 0.75, np.s_[:, 1:-1, 1:-1]
    views, error = field.views[inside][middle], field.standard_error[inside][middle]
    assert np.isfinite(views).all() and len(views) > 60
    mean = views.mean(axis=0)
    chi2 = ((views - mean) / error) ** 2
    # Expected near 1 (7/5 at most, for 7 degrees of freedom); a picture that moved by a tenth of a microlens would
    # differ by a tenth of the contrast.
    assert 0.7 < np.median(chi2) / 0.455 < 1.5
    assert np.sqrt(np.mean((views - mean) ** 2)) < 0.03 * mean.std() + 1.2 * np.sqrt(np.mean(error**2))
    # The picture correlates with the pattern as the camera sees it, and with no mirrored or turned one. Centre of each
    # view pixel on the pattern: 0.217 / 0.25 tiles apart, the axis in the middle.
    centre, step = field.centre[1:-1, 1:-1, 0], 0.217 / 0.25
    down, right = (
        np.clip(((first / 0.217 + 1 + np.arange(count)) * step + 7).astype(int), 0, 13)
        for first, count in zip((field.origin[1], -field.origin[0]), centre.shape, strict=True)
    )
    upright, *other_views = (
        np.corrcoef(turned[down][:, right].ravel(), centre.ravel())[0, 1]
        for turned in (pattern, pattern[::-1], pattern[:, ::-1], pattern[::-1, ::-1])
    )
    assert upright > 0.7 and max(other_views) < 0.5


@pytest.mark.parametrize("z, lattice", [(-520.0, SQUARE), (-330.0, HEXAGONAL)])
def test_points_out_of_focus_move_by_the_disparity_of_a_thin_lens(z, lattice):
    """Closed form, from the lens formula alone: f = 100.72, both principal planes in one."""
    camera = the_camera((352, 352), lattice=lattice)
    white = white_of(camera, 32)
    points = pl.paraxial.cardinal_points(camera.lens)
    f, plane = points.efl, points.rear_principal
    # Beside the axis, up and to the right; a spot of 1.3 microlenses, so that sampling by cells leaves no ripple
    # (exp(-2 pi^2 1.3^2) is 1e-15).
    size = 1.3 * 0.217 / 0.318
    y, x = np.arange(21)[:, None] - 12.0, np.arange(21) - 8.0
    scene = tiles(np.exp(-(y**2 + x**2) / (2 * 3.0**2)), size / 3.0, z)
    field = decode(shot_of(scene, camera, 64), white, views=11)
    image = 1 / (1 / f - 1 / (plane - z))
    behind = plane + image - camera.stop_to_microlenses
    gap = camera.stop_to_microlenses - plane
    expected = -0.010 * gap / (field.spacing[0] * 2.0) * behind / (gap + behind)
    views = np.nan_to_num(field.views[:, 2:9:3, ..., 0].astype(float))
    views /= views.sum(axis=(2, 3), keepdims=True)
    down, right = (np.tensordot(views, part, 2) for part in np.indices(views.shape[2:]))
    u, v = np.indices(down.shape)
    across, along = np.polyfit(u.ravel(), right.ravel(), 1)[0], np.polyfit(3 * v.ravel(), down.ravel(), 1)[0]
    # Noise: a spot of 1.3 pixels seen with some percent in each of 20 pixels has its centre to 0.015 pixels, and slopes
    # over 33 views some 0.0015.
    assert across == pytest.approx(expected, abs=0.004)
    assert along == pytest.approx(expected, abs=0.006)
    # The rim cuts up to a tenth off the outermost views.
    np.testing.assert_allclose(field.disparity_at(z), np.full(2, towards_pixels(camera, field) - expected), atol=5e-4)
    # Nearer than the focus, what the right view sees lies farther left.
    assert math.copysign(1, expected) == (-1 if z > -404 else 1)


def test_refocusing_gathers_what_lies_beside_the_focus():
    camera = the_camera((242, 242))
    scene = tiles(np.ones((1, 1)), 1.0, -330.0)
    field = decode(shot_of(scene, camera, 64), white_of(camera, 64), views=13)
    near, design = (np.nan_to_num(refocus(field, z)) for z in (-330.0, -404.0))
    assert near.max() > 2 * design.max()
    # Shift and add loses no light: the sums agree as long as all of it is in the picture.
    assert near.sum() == pytest.approx(design.sum(), rel=0.1)


def test_a_region_decodes_to_a_part_of_the_whole():
    scene = pl.Scene([pl.sphere(12.0, center=(3, 2, -404), material=pl.Emissive(2.0))])
    for lattice, cut_white in ((HEXAGONAL, False), (SQUARE, True)):
        camera = the_camera((240, 260), lattice=lattice)
        region, white = np.s_[40:210, 30:230], white_of(camera, 16)
        whole, cut = decode(shot_of(scene, camera, 16), white, views=5), shot_of(scene, camera, 16, region=region)
        # The same dark level, which is a percentile of the white image, is not needed here: all of it is bright.
        whites = white_of(camera, 16, region=region) if cut_white else white
        part, in_whole = in_both(decode(cut, whites, views=5, least_light=1e-3), whole)
        valid = np.isfinite(part)
        assert valid.mean() > 0.6
        # At the border of the part, a hexagonal lattice lacks neighbours that the whole has.
        inner = np.s_[:, :, 3:-3, 3:-3] if lattice is HEXAGONAL else np.s_[:]
        assert valid[inner].all() or lattice is SQUARE
        np.testing.assert_array_equal(part[inner][valid[inner]], in_whole[inner][valid[inner]])


def test_pupil_coordinates_and_object_space_follow_gaussian_optics():
    camera = the_camera((110, 110), pl.LensModel.PARAXIAL)
    white = white_of(camera, 8)
    field = decode(white, white, views=5, step=2.0)
    assert field.u.tolist() == field.v.tolist() == [-4.0, -2.0, 0.0, 2.0, 4.0]
    points = pl.paraxial.cardinal_points(camera.lens)
    gap = camera.stop_to_microlenses - points.exit_pupil
    np.testing.assert_allclose(field.exit_pupil[4, 2], [0.04 * gap / 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(field.exit_pupil[2, 4], [0.0, -0.04 * gap / 2.0], atol=1e-12)
    np.testing.assert_allclose(field.pupil, field.exit_pupil / (points.pupil_magnification * 4.25))
    assert field.z_focus == pytest.approx(-404.0, abs=0.1)
    enlarged = abs(pl.paraxial.magnification(camera.lens, -404.0))
    assert field.object_spacing == pytest.approx((0.217 / enlarged, 0.217 / enlarged), rel=3e-4)
    assert field.disparity_at(-404.0) == pytest.approx(np.full(2, towards_pixels(camera, field)), rel=5e-3)


def towards_pixels(camera, field):
    """Disparity by which cos^4 moves the centre of a pixel's light on its microlens: 4 s / b^2 times the variance."""
    variance = aperture_variance(camera.microlenses)
    return 4 * variance * camera.sensor.pixel_pitch / camera.microlenses_to_sensor**2 / field.spacing[0]


def test_shifts_of_points_are_those_of_rays_traced_one_by_one():
    """Truth tells where the rays of two views meet a plane. Gaussian optics errs by 7 % here."""
    lens = pl.load_lens("tessar-102mm-f4.5").with_stop(pl.CircularStop(5.0))
    camera = pl.PlenopticCamera(lens, pl.Sensor((280, 360), 0.0055), 125.0, pl.MicrolensArray(0.077, (0.78,)), 0.78)
    white = white_of(camera, 8)
    field = decode(white, white, views=5, step=2.0)
    columns, (row, column), lit = field.views.shape[3], field.model.axis, field.model.light > 0
    towards = towards_pixels(camera, field)
    for z in (-420.0, -530.0, -900.0):
        scene = pl.Scene([pl.quad((-400, -400, z), (800, 0, 0), (0, 800, 0))])
        rays = np.array(
            [
                [field.truth(scene, u, v, truth=pl.Truth.POSITION).position[..., 0] for v in range(-2, 3)]
                for u in range(-2, 3)
            ]
        )
        # A view is the mean over two pixels with linear weights: 1/8 of their variance of the views two pixels away.
        mean, inner, part = rays.copy(), rays[1:-1, 1:-1], field.pixel % 1.0
        down, right = 1 / 96 + np.nanmean(part * (1.0 - part), axis=(0, 1)) / 8
        mean[1:-1, 1:-1] += right * (rays[2:, 1:-1] + rays[:-2, 1:-1] - 2 * inner)
        mean[1:-1, 1:-1] += down * (rays[1:-1, 2:] + rays[1:-1, :-2] - 2 * inner)
        shifts = []
        for u, v in np.ndindex(5, 5):
            # Where a row of the view sees the points of the central one: places grow along columns.
            found = [np.interp(*pair, np.arange(columns)) for pair in zip(mean[2, 2], mean[u, v], strict=True)]
            shift = (np.array(found) - np.arange(columns))[:, 6:-6] - towards * field.u[u]
            # Light falls off by cos^4 over the pixels, too: 4 s^2 u times their variance, 8 right.
            shift *= 1.0 - 32.0 * right * (camera.sensor.pixel_pitch / camera.microlenses_to_sensor) ** 2
            shifts.append(shift[row, column - 6])
            if 1 <= u <= 3 and v == 2:
                model, d = field.model, field.model.disparity(camera, z)
                expected = model.shifts(d, u)[v]
                np.testing.assert_allclose(shift, expected[:, 6:-6, 1], atol=1e-4, err_msg=f"{z} {u}")
                at = np.stack(np.indices(model.size), axis=-1).reshape(-1, 2) * 1.0
                d = np.full(len(at), d)
                seen = model.seen_at((u, v), model.model_positions(model.centre, at, d), d, at)
                np.testing.assert_allclose(seen - at, expected.reshape(-1, 2), atol=1e-9)
        places, across = np.array(shifts).reshape(5, 5)[lit], np.repeat(field.u, 5).reshape(5, 5)[lit]
        slope = -(places * across).sum() / (across**2).sum()
        assert field.disparity_at(z)[0] == pytest.approx(slope, abs=3e-3), z
        assert field.z_focus != -530 and abs(field.disparity_at(field.z_focus)[0]) < 1e-9


def test_a_view_from_a_chosen_place_is_that_of_a_light_field_there():
    camera = the_camera((110, 110), lattice=HEXAGONAL)
    white, scene = white_of(camera, 8), pl.Scene([pl.sphere(12.0, center=(3, 2, -404), material=pl.Emissive(2.0))])
    shot = shot_of(scene, camera, 8)
    many = decode(shot, white, views=9, step=0.5)
    place = many.pupil[7, 2]
    one = decode(shot, white, views=1, viewpoint=(float(place[0]), float(place[1])))
    np.testing.assert_allclose(one.pupil[0, 0], place, atol=1e-12)
    assert (one.u[0], one.v[0]) == pytest.approx((1.5, -1.0))
    # Other lenses at the border may be in reach of the larger light field.
    part, in_light_field = (views[place] for views, place in zip(in_both(one, many), ((0, 0), (7, 2)), strict=True))
    both = np.isfinite(part) & np.isfinite(in_light_field)
    assert both.mean() > 0.5
    np.testing.assert_allclose(part[both], in_light_field[both], atol=2e-6)
    for wrong, message in (((9.0, 0.0), "within -1 to 1"), ((0.1,), "must be"), ((math.nan, 0.0), "viewpoint")):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            decode(shot, white, views=1, viewpoint=wrong)


def test_impossible_calls_say_what_to_do():
    camera = the_camera((70, 70))
    white = white_of(camera, 8)
    field = decode(white, white, views=3)
    small = white_of(camera, 8, region=np.s_[0:40, 0:40])
    bent = dataclasses.replace(camera, diffraction=pl.Diffraction())
    bare = dataclasses.replace(camera, microlenses=None, microlenses_to_sensor=0.0)
    beyond = pl.Exposure(white.image[30:], region=(40, 80, 0, 70), camera=camera)
    free = the_camera((70, 70), lattice=pl.Lattice.FREE, centres=[[0.0, 0.0], [0.2, 0.0]])
    for call, message in (
        (lambda: decode(white, small), "render it for the same region"),
        (lambda: decode(white, white, views=4), "take 5"),
        (lambda: decode(white, white_of(the_camera((70, 70), lattice=HEXAGONAL), 8)), "they differ in microlenses"),
        (lambda: decode(white, dataclasses.replace(white, camera=bent)), "they differ in diffraction"),
        (lambda: decode(white, white, least_light=0.0), "above 0"),
        (lambda: decode(white, white, disparity=np.zeros((2, 3))), r"give that of the views, \(\d+, \d+\)"),
        (lambda: decode(dataclasses.replace(white, camera=None), white), "give camera="),
        (lambda: decode(white.image, white), "shot is an ndarray"),
        (lambda: decode(pl.Exposure(white.image[::2, ::2], camera=camera), white), "35 x 35, .* the sensor 70 x 70"),
        (lambda: decode(pl.Exposure(white.image[30:]), white, camera=camera), "shot is 40 x 70, .* the sensor 70 x 70"),
        (lambda: decode(white, pl.Exposure(np.tile(white.image, (2, 2, 1)))), "white is 140 x 140"),
        (lambda: decode(beyond, beyond), r"40 x 70, its region \(40, 80, 0, 70\), the sensor 70 x 70"),
        (lambda: decode(white, dataclasses.replace(white, image=np.zeros((70, 70, 1)))), "black"),
        (lambda: decode(white, white, camera=bare), "no microlenses"),
        (lambda: decode(white, white, camera=free), "no lattice"),
        (lambda: refocus(white, -400.0), "field is an Exposure"),
        (lambda: refocus(field), "give either z"),
        (lambda: refocus(field, z=-390.0, disparity=0.1), "give either z"),
        (lambda: field.view(2, 0), "from -1 to 1"),
        (lambda: field.view(0, -2), "from -1 to 1"),
        (lambda: field.view(0.5, 0), "from -1 to 1"),
        (lambda: field.disparity_at(3.0), "in front of the camera"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            call()


def test_a_view_from_outside_the_pupil_says_that_it_is_empty():
    white = white_of(the_camera((110, 110)), 8)
    for viewpoint, empty in (((0.8, 0.0), False), ((1.4, 0.0), True), ((0.9, 0.9), True)):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            field = decode(white, white, views=1, viewpoint=viewpoint)
        assert np.isnan(field.views).all() == empty
        assert [f"viewpoint {viewpoint} is empty" in str(one.message) for one in said] == [True] * empty
        assert all("of the iris, -1 to 1" in str(one.message) for one in said)


def test_views_are_drawn_as_they_lie_in_the_pupil():
    plt = pytest.importorskip("matplotlib.pyplot")
    white = white_of(the_camera((110, 154)), 8)
    field = decode(white, white, views=5)
    rows, columns = field.centre.shape[:2]
    bright = np.full_like(field.views, 0.1)
    bright[4, 1] = 1.0  # u = 2, v = -1: right, above the middle
    drawn = pl.plots.plot_views(dataclasses.replace(field, views=bright)).images[0].get_array()
    assert drawn.shape == (5 * (rows + 1), 5 * (columns + 1), 3)
    assert (np.argwhere(drawn[:, :, 0] > 0.9).min(axis=0) == [rows + 1, 4 * (columns + 1)]).all()
    assert pl.plots.plot_views(field, every=2).images[0].get_array().shape[0] == 3 * (rows + 1)
    plt.close("all")


def test_sensors_where_a_near_pupil_is_sharp_are_unfocused():
    """1 / b = 1 / f - 1 / distance of the pupil: 7 % behind the focal plane of microlenses close to the pupil."""
    f, gap = 3.0, 47.0
    lens = pl.load_lens("telephoto-100mm-f2.8")
    camera = pl.PlenopticCamera(
        lens=lens,
        microlenses=pl.MicrolensArray(pitch=1.0, focal_lengths=(f,), lattice=SQUARE),
        sensor=pl.Sensor(shape=(100, 100), pixel_pitch=0.02),
        stop_to_microlenses=pl.paraxial.cardinal_points(lens).exit_pupil + gap,
        microlenses_to_sensor=1 / (1 / f - 1 / gap),
    )
    white = pl.render_white(camera, samples=4, progress=False)
    assert decode(white, white, views=3).views.shape[:2] == (3, 3)
    focused = dataclasses.replace(camera, microlenses_to_sensor=1.15 * camera.microlenses_to_sensor)
    white = pl.render_white(focused, samples=4, progress=False)
    with pytest.raises(pl.errors.InvalidValueError, match="render_view"):
        decode(white, white, views=3)


TWO_PLANES = pl.Scene(
    [
        pl.quad((0, -2000, -350), (2000, 0, 0), (0, 4000, 0), material=pl.Emissive(1.0)),
        pl.quad((-2000, -2000, -450), (4000, 0, 0), (0, 4000, 0), material=pl.Emissive(0.5)),
    ]
)


def test_what_a_view_sees_is_projected_onto_its_pixel_of_the_raw_image():
    # On a square lattice each ray passes the optical centre of a microlens: it is a chief ray.
    designed = the_camera((160, 180), pl.LensModel.EXACT)
    tilted = designed.moved(pl.CameraPart.MICROLENSES, tilt=(0.004, -0.003, 0.01))
    moved = tilted.moved(pl.CameraPart.SENSOR, shift=(0.02, 0.01, 0.0))
    for camera, views in ((designed, ((2, 0),)), (moved, ((0, 0), (-1, 2)))):
        white = white_of(camera, 16)
        field = decode(white, white, views=5, step=2.0)
        for u, v in views:
            truth = field.truth(TWO_PLANES, u, v)
            hit = truth.state == PixelState.SEEN
            assert hit.sum() > 20
            projected = pl.project(camera, truth.position[hit])
            for k, expected in enumerate((field.pixel + np.array([2.0 * v, 2.0 * u]))[hit]):
                assert np.abs(projected.pixel[projected.point == k] - expected).max(axis=1).min() < 1e-6, (u, v)


def test_no_depth_lies_between_objects():
    # Depths of a raw image, resampled as its colours are, lay between the planes in a tenth of the pixels.
    white = white_of(the_camera((160, 180), pl.LensModel.EXACT, lattice=HEXAGONAL), 16)
    field = decode(white, white, views=5, step=2.0)
    for u in (-2, 0, 2):
        truth = field.truth(TWO_PLANES, u, 0)
        hit = truth.state == PixelState.SEEN
        np.testing.assert_array_equal(np.isfinite(field.pixel).all(axis=-1), truth.state != PixelState.UNKNOWN)
        off = np.minimum(np.abs(truth.depth[hit] - 350.0), np.abs(truth.depth[hit] - 450.0))
        assert off.max() < 1e-9 and len(np.unique(truth.object[hit])) == 2
    assert field.truth(TWO_PLANES).kinds == pl.Truth.ALL & ~pl.Truth.MICROLENS
    with pytest.raises(pl.errors.InvalidValueError, match="along rays of a view: they have no microlens"):
        field.truth(TWO_PLANES, truth=pl.Truth.MICROLENS)
    with pytest.raises(pl.errors.InvalidValueError, match="u is 3"):
        field.truth(TWO_PLANES, 3, 0)

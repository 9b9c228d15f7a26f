"""Dual and quad pixels: responses of wells, pairs, disparity, light of both halves, and depth, against other code."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
import plenoptic.truth.pair_geometry
from plenoptic.camera.gaussian import model_pupil

DOUBLE_GAUSS = pl.load_lens("double-gauss-100mm-f2")


@pytest.fixture(autouse=True)
def few_rays(monkeypatch):
    """An eighth of the rays: disparities are off by 1e-4 (thin lens) to 6e-3 (real, wide open), asymmetries by 2e-3."""
    monkeypatch.setattr(plenoptic.truth.pair_geometry, "_SAMPLES", 1 << 13)


def camera_of(semi_diameter, model=pl.LensModel.EXACT, *, shape=(65, 97), pitch=0.02, z=-404.0, matched=True, **pixels):
    """A camera of 100 mm focused on a plane, whose on-chip lenses are shifted for its exit pupil if `matched`."""
    lens = DOUBLE_GAUSS.with_stop(pl.CircularStop(semi_diameter)).with_model(model)
    camera = pl.PlenopticCamera(lens, pl.Sensor(shape, pitch), 134.0).focused_at(z)
    if matched:
        pixels["cra"] = math.atan(camera.sensor.half_diagonal / (camera.z_sensor - model_pupil(camera)[0]))
    return dataclasses.replace(camera, sensor=pl.sensor.dual_pixel(pitch, shape, **pixels))


def whites(camera, samples=64, region=None):
    shots = [
        pl.render_white(each, samples=samples, region=region, progress=False) for each in pl.sensor.well_cameras(camera)
    ]
    return pl.sensor.read_wells(shots)


def rays_through(lens, starts, aims, *, rims=True):
    """Points and directions in front of a lens of spheres, of rays from the sensor; a tracer of the test's own."""
    points, directions = np.array(starts, dtype=float), np.array(aims, dtype=float) - starts
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    passes, indices = np.ones(len(points), dtype=bool), lens.indices(587.6)
    for k in reversed(range(len(lens.elements))):
        element, vertex = lens.elements[k], np.array([0.0, 0.0, lens.vertices[k]])
        radius = getattr(element, "radius", math.inf)
        offset = points - vertex
        with np.errstate(invalid="ignore"):
            if math.isinf(radius):
                length = -offset[:, 2] / directions[:, 2]
            else:  # the intersection near the vertex: c r^2 = 2 z on the sphere
                c = 1.0 / radius
                a = c * np.sum(offset**2, axis=1) - 2.0 * offset[:, 2]
                b = c * np.sum(offset * directions, axis=1) - directions[:, 2]
                length = -a / (b + np.sqrt(b * b - c * a))
            points = points + length[:, None] * directions
            passes &= ~(np.hypot(points[:, 0], points[:, 1]) > element.semi_diameter) | (not rims)
            if math.isfinite(radius):
                normal = (points - vertex) / radius - [0.0, 0.0, 1.0]  # towards -z, as the rays
                normal /= np.linalg.norm(normal, axis=1, keepdims=True)
                ratio, cos = indices[k + 1] / indices[k], np.sum(normal * directions, axis=1)
                cos_after = np.sqrt(1.0 - ratio**2 * (1.0 - cos**2))
                directions = ratio * directions + (cos_after - ratio * cos)[:, None] * normal
        passes &= np.isfinite(length) & np.isfinite(directions[:, 0])
    return points, directions, passes


def pupil_grid(camera, x, y, count=600, middle=0.0):
    """Rays of a sensor point: points and directions in front of the lens, weights, and slopes towards the lens.

    On a grid of the rear lens; `middle` is an x halfway between two of its columns.
    """
    z_last, reach = float(camera.lens.vertices[-1]), camera.lens.elements[-1].semi_diameter
    at = (np.arange(count) + 0.5) / count * 2.0 * reach - reach
    aim_x, aim_y = (part.ravel() for part in np.meshgrid(middle + at, at))
    starts = np.broadcast_to([x, y, camera.z_sensor], (count * count, 3))
    aims = np.stack([aim_x, aim_y, np.full(count * count, z_last)], axis=1)
    point, direction, passes = rays_through(camera.lens, starts, aims)
    h = camera.z_sensor - z_last
    slopes = np.stack([(aim_x - x) / h, (aim_y - y) / h], axis=1)
    # Projected solid angle of an area of the plane: cos^4 / h^2.
    weights = passes / (1.0 + np.sum(slopes**2, axis=1)) ** 2
    return point[passes], direction[passes], weights[passes], slopes[passes]


def inside(slope, other):
    """Slope in the stack by Snell's law, with angles."""
    sine = math.sin(math.atan(math.hypot(slope, other))) / 1.5
    return 0.0 if slope == 0 else slope / math.hypot(slope, other) * math.tan(math.asin(sine))


@pytest.mark.parametrize("matched", [True, False])
def test_disparity_of_a_thin_lens_is_that_of_half_discs(matched):
    # The centroid of a half disc of radius r at the distance s, whose light goes with cos^4, lies at
    # 2/pi s (atan t - t / (1 + t^2)) (1 + t^2) / t^2 with t = r/s; t = 0.045 here. The cosines of other
    # pixels are left out, 4e-4 at most. Chief rays do not matter: the
    # image of a point on the axis is divided along its middle with any of them.
    camera = camera_of(6.0, pl.LensModel.THIN, matched=matched)
    geometry = pl.sensor.pair_geometry(camera)
    pupil, magnification = model_pupil(camera)
    s = camera.z_sensor - pupil
    t = 6.0 * abs(magnification) / s
    centroid = 2.0 / math.pi * s * (math.atan(t) - t / (1.0 + t * t)) * (1.0 + t * t) / t**2
    for depth in (200.0, 300.0, 390.0, 420.0, 1000.0, math.inf):
        points = pl.paraxial.cardinal_points(camera.lens)
        image = points.rear_principal + 1.0 / (1.0 / points.efl - 1.0 / (depth + points.rear_principal))
        assert geometry.defocus(depth) == pytest.approx(image - camera.z_sensor, rel=1e-9)
        closed = 2.0 * centroid * (image - camera.z_sensor) / (image - pupil) / 0.02
        measured = geometry.disparity(depth)[32, 48]
        assert measured == pytest.approx(closed, rel=4e-4)
        assert geometry.depth(measured)[32, 48] == pytest.approx(depth, rel=1e-9)
    infinity = geometry.disparity(math.inf)
    assert np.isinf(geometry.depth(infinity)).all() and np.isnan(geometry.depth(infinity - 1e-3)).all()
    assert (np.sign(geometry.disparity(300.0)) == 1).all() and (np.sign(geometry.disparity(600.0)) == -1).all()
    assert geometry.disparity(404.0) == pytest.approx(0.0, abs=2e-3)


def test_slope_of_a_real_lens_is_that_of_its_half_pupils(monkeypatch):
    monkeypatch.setattr(plenoptic.truth.pair_geometry, "_SAMPLES", 1 << 15)
    camera = camera_of(12.0)
    geometry = pl.sensor.pair_geometry(camera)
    # On the axis wells divide light by the sign of its slope; away from it along with the chief ray, as matched.
    step, distance, sides, beams = 2.0, camera.sensor.half_diagonal / math.tan(chief_angle(camera)), {}, {}
    for x in (-step, 0.0, step):
        middle = x * (1.0 - (camera.z_sensor - camera.lens.vertices[-1]) / distance)  # where the chief ray passes
        point, direction, weights, slopes = pupil_grid(camera, x, 0.0, 350, middle)
        chief = inside(-x / distance, 0.0)
        across = slopes[:, 0] / np.sqrt(2.25 + 1.25 * np.sum(slopes**2, axis=1))
        by_z = direction[:, 0] / direction[:, 2]
        planes = np.stack([point[:, 0] - by_z * point[:, 2], by_z])
        beams[x] = planes.mean(axis=1)
        for half, of_half in enumerate((across < chief, across >= chief)):
            sides[x, half] = np.average(planes[:, of_half], axis=1, weights=weights[of_half])
    difference = sides[0.0, 0] - sides[0.0, 1]
    # Columns run along -x.
    by_column = 0.02 * (beams[-step] - beams[step]) / (2 * step)
    for depth in (250.0, 330.0, 500.0, 1000.0):
        expected = -(difference @ [1.0, -depth]) / (by_column @ [1.0, -depth])
        # A grid of 350 points across the rear lens, some 150 across the beam: edges count to (1 / 150)^1.5 = 5e-4. The
        # beam is 12 times as wide as this sensor, over which the geometry's rays give dX/dc to 1e-3.
        assert geometry.disparity(depth)[32, 48] == pytest.approx(expected, rel=2e-3)


def chief_angle(camera):
    return math.atan(camera.sensor.half_diagonal / camera.sensor.angular_response.pupil_distance)


KERNEL = [[0.0, 0.02, 0.0], [0.02, 0.88, 0.04], [0.01, 0.02, 0.01]]
"""Crosstalk to the left 0.03, to the right 0.05."""


def with_crosstalk(geometry, crosstalk):
    """The geometry of a pair without crosstalk, whose camera gets one: its rays are the same."""
    pixels = dataclasses.replace(geometry.camera.sensor.angular_response, crosstalk=crosstalk)
    sensor = dataclasses.replace(geometry.camera.sensor, angular_response=pixels)
    return dataclasses.replace(geometry, camera=dataclasses.replace(geometry.camera, sensor=sensor))


def test_rendered_halves_are_displaced_by_the_disparity():
    camera = camera_of(3.0, shape=(24, 64), pitch=0.05)
    plain, column = pl.sensor.pair_geometry(camera), np.arange(64) - 31.5
    for depth in (350.0, 460.0):
        pixel = 0.05 / abs(pl.paraxial.magnification(camera.lens, -depth))
        wave = 0.5 + 0.4 * np.sin(2 * np.pi * np.arange(6400) / 16 / 20.0)  # of some 20 pixels
        texture, side = pl.Texture(np.broadcast_to(wave[None, :, None], (2, 6400, 3))), 400 * pixel
        board = pl.quad((-side / 2, -side / 2, -depth), (side, 0, 0), (0, side, 0), material=pl.Lambertian(texture))
        scene = pl.Scene([board], background=1.0)
        shots = [pl.render(scene, each, samples=64, progress=False) for each in pl.sensor.well_cameras(camera)]
        for crosstalk in (0.0, KERNEL):
            geometry = with_crosstalk(plain, crosstalk)
            wells = zip(shots, pl.sensor.well_cameras(geometry.camera), strict=True)
            images = pl.sensor.read_wells([dataclasses.replace(shot, camera=each) for shot, each in wells])
            lines, fits = np.stack([half.mean(axis=(0, 2)) for half in (images.left, images.right)], axis=1), []
            for period in np.linspace(12.0, 28.0, 801):
                waves = [f(2 * np.pi * column / period) for f in (np.cos, np.sin)]
                terms = np.stack([np.ones(64), column, *waves], axis=1)
                fit, residual, *_ = np.linalg.lstsq(terms[1:-1], lines[1:-1], rcond=None)
                fits.append((float(residual.sum()), period, *(np.arctan2(fit[3], fit[2]) / (2 * np.pi))))
            _, period, left, right = min(fits)
            expected = geometry.disparity(depth)[12, 32]
            # Half discs shift waves by their centroids, to second order in their width over the period.
            width = geometry.blur(expected)[:, 0]
            light = geometry.pupils[6, 6, :, 4:].T @ np.exp(2j * np.pi * width / period)
            kernel = geometry.camera.sensor.angular_response.crosstalk
            (to_left, kept, to_right), column_away = kernel.sum(axis=0), np.exp(2j * np.pi / period)
            crossing = [[kept, to_left + to_right * column_away], [to_right + to_left / column_away, kept]]
            turns = np.angle(crossing @ light) / (2 * np.pi)
            assert (turns[0] - turns[1]) * period == pytest.approx(expected, rel=0.05)
            assert (left - right - round(left - right)) == pytest.approx(turns[0] - turns[1], rel=3e-3)


def test_crosstalk_shortens_the_baseline():
    # Half discs divided off their middle, with shares l and r of the light. The left image collects kept l, to_left r,
    # and to_right r of the column before; the right one kept r, to_right l, and to_left l of the next column.
    camera = camera_of(6.0, pl.LensModel.THIN, cra=0.03, pitch=0.1, matched=False)
    plain = pl.sensor.pair_geometry(camera)
    geometry = with_crosstalk(plain, KERNEL)
    to_left, kept, to_right = 0.03, 0.92, 0.05
    asymmetry = plain.asymmetry()
    share = np.stack([1.0 + asymmetry, 1.0 - asymmetry]) / 2
    assert np.ptp(share[0]) > 0.05
    for depth in (300.0, 404.0, 900.0):
        right = plain.disparity(depth)  # centroid of the right half, with that of the left one at 0
        left_light = kept * share[0] + (to_left + to_right) * share[1]
        right_light = kept * share[1] + (to_left + to_right) * share[0]
        left_mean = (to_left * right + to_right * (right - 1.0)) * share[1] / left_light
        right_mean = (kept * right * share[1] + to_left * 1.0 * share[0]) / right_light
        assert geometry.disparity(depth) == pytest.approx(right_mean - left_mean, abs=1e-9)
        assert geometry.depth(geometry.disparity(depth)) == pytest.approx(depth, rel=1e-9)
        assert geometry.asymmetry() == pytest.approx(left_light - right_light, abs=1e-12)
    middle = [each.disparity(300.0)[32, 48] for each in (with_crosstalk(plain, 0.02), plain)]
    assert middle[0] == pytest.approx(0.98 * middle[1] + 0.01, abs=1e-4)  # the second order of unequal halves


@pytest.mark.slow
def test_asymmetry_at_the_edge_against_brute_force(monkeypatch):
    monkeypatch.setattr(plenoptic.truth.pair_geometry, "_SAMPLES", 1 << 14)
    # On-chip lenses are shifted for twice the angle of the chief rays, and the edge of the field is vignetted.
    camera = camera_of(17.0, shape=(41, 61), pitch=0.5, cra=0.25, height=0.7, gap=0.05, matched=False)
    geometry, images = pl.sensor.pair_geometry(camera), whites(camera, 256, np.s_[20:21, 0:61])
    pixels = camera.sensor.angular_response
    for column in (1, 20, 30, 50):
        x, y = camera.sensor.centre_of(20, column)
        light = np.zeros(2)
        for dx in (np.arange(4) + 0.5) / 8 - 0.25:  # over the pixel's width
            _, _, weights, slopes = pupil_grid(camera, x + dx, y, 240)
            chief = inside(-(x + dx) / pixels.pupil_distance, 0.0)
            root = np.sqrt(2.25 + 1.25 * np.sum(slopes**2, axis=1))
            across, down = 0.7 * (slopes[:, 0] / root - chief), 0.7 * slopes[:, 1] / root
            in_rows = np.abs(down) < 0.25 - 0.025
            for half, (low, high) in enumerate(((-0.225, -0.025), (0.025, 0.225))):
                light[half] += weights[in_rows & (across > low) & (across < high)].sum()
        expected = (light[0] - light[1]) / light.sum()
        left, right = images.left[0, column, 0], images.right[0, column, 0]
        error = math.hypot(*(float(shot.standard_error[0, column, 0]) for shot in images.exposures)) / (left + right)
        # Grids of 240 points are off by 1.5e-3. The geometry's rays are off by 1.2e-3 at most, measured with four times
        # as many; its polynomials of order 6 are off by 3.5e-3 where rims set in.
        assert (left - right) / (left + right) == pytest.approx(expected, abs=4 * error + 2e-3)
        assert geometry.asymmetry()[20, column] == pytest.approx(expected, abs=6e-3)
    assert abs(geometry.asymmetry()[20, 1]) > 0.2


@pytest.mark.parametrize("columns", [21, 31])
def test_asymmetry_beyond_the_light_of_a_half(columns):
    # Chief rays that are not matched divide a pupil of radius r at the column's own x: beyond r one half is dark.
    camera = camera_of(6.0, pl.LensModel.THIN, shape=(5, columns), pitch=1.0, matched=False)
    geometry, radius = pl.sensor.pair_geometry(camera), 6.0 * abs(model_pupil(camera)[1])
    x = camera.sensor.centre_of(2, np.arange(columns))[:, 0] / radius
    inside = np.clip(x, -1.0, 1.0)
    expected = 2.0 / math.pi * (inside * np.sqrt(1.0 - inside**2) + np.arcsin(inside))
    asymmetry, disparity, node = geometry.asymmetry()[2], geometry.disparity(300.0)[2], columns / 12 / radius
    known, measured = np.isfinite(asymmetry), np.isfinite(disparity)
    # nan between two places of which one alone is lit by both halves.
    assert known[(np.abs(x) < 1.0 - node) | (np.abs(x) > 1.0 + node)].all()
    assert asymmetry[known] == pytest.approx(expected[known], abs=0.02)
    assert (asymmetry[known & (np.abs(x) > 1.0)] == np.sign(x[known & (np.abs(x) > 1.0)])).all()
    assert measured[np.abs(x) < 1.0 - node].all() and not measured[np.abs(x) > 1.0].any()


def test_no_depth_where_a_half_is_dark():
    camera = camera_of(6.0, pl.LensModel.THIN, shape=(40, 80), pitch=0.3, matched=False)
    dark = np.abs(pl.sensor.pair_geometry(camera).asymmetry()) == 1.0
    found = pl.lightfield.depth(whites(camera, 8), disparity_range=(-1.0, 1.0), window_radius=3)
    assert dark[20, [5, -6]].all() and np.isnan(found.disparity[dark]).all()
    assert np.isfinite(found.disparity[10:-10, 30:-30]).any()


def test_wells_add_up_to_the_whole_pixel():
    for pixels in ({}, {"split": (2, 2), "gap": 0.002}, {"table": [[-0.4, 0.7, 0.1], [0.4, 0.2, 0.6]]}):
        camera = camera_of(12.0, shape=(12, 16), **pixels)
        images, whole = whites(camera), pl.render_white(camera, samples=64, progress=False)
        assert np.array_equal(images.left + images.right, images.whole)
        text = f"WellImages({pixels.get('split', (1, 2))[0]} x 2 wells of Exposure(12 x 16 x 1, 64 samples per pixel"
        assert repr(images).startswith(text) and len(repr(images)) < 150
        assert np.array_equal(images.wells.sum(axis=(0, 1)), images.whole)
        if "table" in pixels:  # these share their rays
            assert images.whole == pytest.approx(whole.image, rel=5e-7)  # rounding of float32
        errors = [shot.standard_error for shot in (whole, *images.exposures)]
        z = (images.whole - whole.image).sum() / math.sqrt(sum(float((error**2).sum()) for error in errors))
        assert abs(z) < 4


def test_a_table_weighs_directions():
    angles = np.linspace(-0.5, 0.5, 11)
    table = np.stack([angles, 0.5 - 0.8 * angles, 0.5 + 0.8 * angles], axis=1)
    camera = camera_of(1.0, pl.LensModel.THIN, shape=(3, 60), pitch=1.0, table=table, matched=False, cra=0.1)
    images = whites(camera)
    x = camera.sensor.centre_of(1, np.arange(60))[:, 0]
    chief = np.arctan(-x / (camera.z_sensor - model_pupil(camera)[0]))
    shift = np.arctan(-x / camera.sensor.angular_response.pupil_distance)
    share = images.left[1, :, 0] / images.whole[1, :, 0]
    assert share == pytest.approx(0.5 - 0.8 * (chief - shift), abs=1e-3)


def test_crosstalk_moves_light_to_neighbouring_wells_and_pixels():
    camera = camera_of(12.0, shape=(9, 11))
    dark = [np.zeros((9, 11, 1)) for _ in range(2)]
    for kernel in (0.2, [[0.0, 0.1, 0.0], [0.05, 0.7, 0.15], [0.0, 0.0, 0.0]]):
        crossed = dataclasses.replace(camera, sensor=pl.sensor.dual_pixel(0.02, (9, 11), crosstalk=kernel))
        shares = crossed.sensor.angular_response.crosstalk
        for well in (0, 1):
            light = [each.copy() for each in dark]
            light[well][4, 5] = 1.0
            shots = [
                pl.Exposure(image, camera=each, standard_error=0.1 * image)
                for image, each in zip(light, pl.sensor.well_cameras(crossed), strict=True)
            ]
            images = pl.sensor.read_wells(shots)
            lattice = images.wells[0, ..., 0].transpose(1, 2, 0).reshape(9, 22)
            around = lattice[3:6, 9 + well : 12 + well]
            assert around == pytest.approx(shares, abs=1e-7) and lattice.sum() == pytest.approx(1.0)
            error = (
                np.stack([shot.standard_error for shot in images.exposures])[..., 0].transpose(1, 2, 0).reshape(9, 22)
            )
            assert error[3:6, 9 + well : 12 + well] == pytest.approx(0.1 * shares, abs=1e-7)
        flat = [pl.Exposure(np.ones((9, 11, 1)), camera=each) for each in pl.sensor.well_cameras(crossed)]
        assert pl.sensor.read_wells(flat).wells == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("crosstalk", [0.0, KERNEL])
def test_the_stated_error_of_strong_blur_is_that_of_noise(crosstalk):
    lens, side = DOUBLE_GAUSS.scaled(focal_length=4.4).with_stop(pl.CircularStop(1.1)), 240
    camera = pl.PlenopticCamera(lens, pl.sensor.dual_pixel(0.0014, (side, side)), 5.0).focused_at(-500.0)
    geometry = with_crosstalk(pl.sensor.pair_geometry(camera), crosstalk)
    disparity = float(geometry.disparity(260.0)[side // 2, side // 2])
    assert 2.5 < disparity < 6.0
    # A texture of waves, which rays of both halves displace, and columns of the sensor by crosstalk.
    random, pixel = np.random.default_rng(7), np.arange(side)
    waves = random.normal(0.0, 0.1, (2, 600))  # cycles per pixel
    heights = random.normal(size=600) * np.exp(2j * np.pi * random.uniform(size=600))
    light = geometry.pupils[6, 6, :, 4:].T @ np.exp(-2j * np.pi * geometry.blur(disparity) @ waves)
    moves = np.exp(-2j * np.pi * np.outer([-1.0, 0.0, 1.0], waves[1]))  # by rows
    kernel, column = geometry.camera.sensor.angular_response.crosstalk, np.exp(-2j * np.pi * waves[0])
    (to_left, kept, to_right), (shares_left, shares_kept, shares_right) = kernel.T @ moves, kernel.sum(axis=0)
    left = kept * light[0] + (to_left + to_right * column) * light[1]
    right = kept * light[1] + (to_right + to_left / column) * light[0]
    white = [[shares_kept, shares_left + shares_right], [shares_left + shares_right, shares_kept]]
    white = white @ geometry.pupils[6, 6, :, 4:].sum(axis=0)
    along = [np.exp(2j * np.pi * np.outer(pixel, wave)) for wave in waves]
    halves = np.stack(
        [((along[1] * (heights * half)) @ along[0].T).real for half in (left / white[0], right / white[1])]
    )
    asymmetry = geometry.asymmetry()
    halves *= [1.0 + asymmetry, 1.0 - asymmetry]
    halves += random.normal(0.0, 0.4 * halves.std(), halves.shape)
    exposures = tuple(pl.Exposure(half[..., None], camera=geometry.camera) for half in halves)
    found = pl.lightfield.depth(pl.sensor.WellImages(geometry.camera, exposures), disparity_range=(-1.0, 9.0))
    z = ((found.disparity - disparity) / found.standard_error)[30:-30, 30:-30]
    assert np.isfinite(z).all()
    # 180 x 180 pixels are 112 windows: an error of 0.067 of their rms, of 0.094 of their mean.
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.2)
    assert abs(z.mean()) < 0.35


@pytest.mark.slow
def test_depth_of_a_pair_of_planes_within_its_stated_error():
    lens = DOUBLE_GAUSS.scaled(focal_length=4.4).with_stop(pl.CircularStop(1.1))
    pitch, side = 0.0014, 144
    camera = pl.PlenopticCamera(lens, pl.sensor.dual_pixel(pitch, (side, side)), 5.0).focused_at(-500.0)
    random, pixel = np.random.default_rng(1), pitch / 4.4

    def board(x, z, width):
        texels = random.uniform(0.1, 0.9, (int(side * 0.3), int(width * 0.3), 1)).repeat(3, axis=2)
        corner, sides = (z * pixel * x, -z * pixel * side / 2, -z), z * pixel * np.array([width, side])
        return pl.quad(corner, (sides[0], 0, 0), (0, sides[1], 0), material=pl.Lambertian(pl.Texture(texels)))

    scene = pl.Scene([board(-side / 2 - 5, 300.0, side / 2), board(-side / 2 - 5, 900.0, side + 10)], background=1.0)
    shots = [pl.render(scene, each, samples=32, progress=False) for each in pl.sensor.well_cameras(camera)]
    images = pl.sensor.read_wells(shots)
    found = pl.lightfield.depth(images, disparity_range=(-6.0, 6.0))
    truth = pl.ground_truth(scene, camera, truth=pl.Truth.DEPTH, progress=False).depth
    geometry = pl.sensor.pair_geometry(camera)
    disparity = geometry.disparity(truth)
    for depth, columns in ((300.0, np.s_[20:124, 20:46]), (900.0, np.s_[20:124, 96:124])):
        assert truth[columns] == pytest.approx(depth, rel=1e-6)
        z = (found.disparity - disparity)[columns] / found.standard_error[columns]
        assert np.isfinite(z).all()
        # Windows of 17 pixels overlap: some 20 independent ones, whose rms has an error of a sixth.
        assert 0.6 < np.sqrt(np.mean(z**2)) < 1.6
        # 0.02 pixels of bias and twice the error of 20 windows, 0.03: 14 mm at 900.
        assert np.median(found.depth[columns]) == pytest.approx(depth, rel=0.016)
        assert np.median(found.standard_error[columns]) < 0.15
    # Without crosstalk in the model the pair is the same; a region keeps its place on the sensor.
    part = np.s_[30:110, 20:124]
    crops = [pl.render(scene, each, samples=32, region=part, progress=False) for each in pl.sensor.well_cameras(camera)]
    cropped = pl.lightfield.depth(pl.sensor.read_wells(crops), disparity_range=(-6.0, 6.0))
    same = np.isfinite(cropped.disparity)
    assert same.any() and np.nanmedian(np.abs(cropped.disparity - found.disparity[part])) < 0.02


@pytest.mark.slow
def test_depth_of_a_pair_whose_chief_rays_are_not_matched():
    # The images of a point, 9 pixels wide on either side, lie on pixels whose halves get unequal light.
    camera = camera_of(12.0, pl.LensModel.THIN, shape=(112, 112), pitch=0.1, z=-2000.0, matched=False)
    random, side, errors = np.random.default_rng(3), 15.68, []
    for seed in range(2):
        material = pl.Lambertian(pl.Texture(random.uniform(0.1, 0.9, (24, 24, 3))))
        board = pl.quad((-5 * side, -5 * side, -1000.0), (10 * side, 0, 0), (0, 10 * side, 0), material=material)
        scene, wells = pl.Scene([board], background=1.0), enumerate(pl.sensor.well_cameras(camera))
        shots = [pl.render(scene, each, samples=64, seed=2 * seed + k, progress=False) for k, each in wells]
        found = pl.lightfield.depth(pl.sensor.read_wells(shots), disparity_range=(1.0, 13.0))
        errors.append((found.disparity - pl.sensor.pair_geometry(camera).disparity(1000.0))[30:-30, 30:-30])
    # Some 18 independent windows with errors of 0.1 pixels.
    assert abs(np.mean(errors)) < 0.08


def test_a_table_of_halves_that_share_light():
    # Blur of 2.3 times the width of half discs of the same disparity, in closed form by waves, without noise.
    angles = np.linspace(-0.7, 0.7, 81)
    left = 0.9 / (1.0 + np.exp(angles / 0.14))
    lens = DOUBLE_GAUSS.scaled(focal_length=4.4).with_stop(pl.CircularStop(1.1))
    sensor = pl.sensor.dual_pixel(0.0014, (64, 64), table=np.stack([angles, left, 0.9 - left], axis=1))
    camera = pl.PlenopticCamera(lens, sensor, 5.0).focused_at(-500.0)
    geometry, random, pixel = pl.sensor.pair_geometry(camera), np.random.default_rng(3), np.arange(64)
    disparity, waves = float(geometry.disparity(900.0)[32, 32]), random.normal(0.0, 0.08, (2, 400))
    light = geometry.pupils[6, 6, :, 4:].T @ np.exp(-2j * np.pi * geometry.blur(disparity) @ waves)
    heights = random.normal(size=400) * np.exp(2j * np.pi * random.uniform(size=400))
    across, down = (np.exp(2j * np.pi * np.outer(pixel, wave)) for wave in waves)
    halves = [((down * (heights * half)) @ across.T).real for half in light]
    shots = tuple(pl.Exposure(half[..., None], camera=camera) for half in halves)
    found = pl.lightfield.depth(pl.sensor.WellImages(camera, shots), disparity_range=(-2.0, 0.0))
    # Steps of 0.25 pixels, those of half discs, would be off by 0.04.
    assert np.nanmedian(found.disparity) == pytest.approx(disparity, abs=0.015)


@pytest.mark.slow
def test_depth_at_the_edge_of_the_field():
    # Vignetting and field curvature make half discs there other than those of the centre, by 0.5 pixels of disparity.
    lens = DOUBLE_GAUSS.scaled(focal_length=4.4).with_stop(pl.CircularStop(1.1))
    camera = pl.PlenopticCamera(lens, pl.sensor.dual_pixel(0.0014, (1000, 1500)), 5.0).focused_at(-500.0)
    material = pl.Lambertian(pl.Texture(np.random.default_rng(2).uniform(0.1, 0.9, (60, 60, 3))))
    pixel = 300.0 * 0.0014 / 4.4  # texels of some 3 pixels, below the middle of the image's upper edge
    board = pl.quad((-90 * pixel, 380 * pixel, -300.0), (180 * pixel, 0, 0), (0, 180 * pixel, 0), material=material)
    scene, region = pl.Scene([board], background=1.0), np.s_[0:120, 690:810]
    wells = enumerate(pl.sensor.well_cameras(camera))
    shots = [pl.render(scene, each, samples=64, seed=k, region=region, progress=False) for k, each in wells]
    found = pl.lightfield.depth(pl.sensor.read_wells(shots), disparity_range=(1.0, 7.0))
    error = found.disparity - pl.sensor.pair_geometry(camera).disparity(300.0, region=shots[0].region)
    inside = np.isfinite(error)
    # Some 15 independent windows with errors of 0.04 pixels.
    assert inside.mean() > 0.3 and abs(error[inside].mean()) < 0.06


GEOMETRY = pl.sensor.PairGeometry(
    camera_of(6.0, shape=(4, 6)), np.ones((5, 7, 7)), np.ones((1, 1, 9, 6)), np.zeros((12, 12))
)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), split=(1, 3)), r"split is \(1, 3\); it must be \(1, 2\)"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), cra=3.0), "cra is 3 rad; it must be from 0 to below pi / 2"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), gap=0.0005), "gap is 0.5 pitches; two wells leave room below"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), height=-1.0), "height is -1 mm; it must be above 0"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), crosstalk=1.5), "crosstalk has shares from -0.5"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), crosstalk=np.ones((3, 3))), "which add up to 9"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), split=(2, 2), table=[[0, 0, 0]]), "leave split at"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), table=[[1, 0, 0], [0, 0, 0]]), "two or more angles, rising"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), table=[[-9, 0, 0], [9, 0, 0]]), r"in radians: np.radians\(...\)"),
        (lambda: pl.sensor.dual_pixel(0.001, (4, 4), table=[[0, 1, 1], [1, 0, 0]]), "divide them by the largest sum"),
        (lambda: pl.sensor.well_cameras(pl.camera.example_camera()), r"make it with pl.sensor.dual_pixel"),
        (lambda: pl.sensor.pair_geometry(pl.camera.example_camera()), r"make it with pl.sensor.dual_pixel"),
        (lambda: pl.sensor.read_wells([pl.Exposure(np.ones((2, 2, 1)))]), "not those of all wells of one camera"),
        (lambda: pl.sensor.pair_geometry(camera_of(1.0, cra=1.4, matched=False, pitch=0.3)), "get no light in one of"),
        (lambda: pl.sensor.well_cameras(3), "camera is an int; give a PlenopticCamera"),
        (lambda: pl.sensor.read_wells([3]), "an item of exposures is an int; give an Exposure"),
        (
            lambda: GEOMETRY.asymmetry(region=(0, 9, 0, 5)),
            r"region is \(0, 9, 0, 5\); give the first and end row, .* 4 x 6",
        ),
        (lambda: GEOMETRY.blur(1.0, node=(9, 0)), r"node is \(9, 0\); give a row and column of 1 x 1 nodes"),
        (lambda: GEOMETRY.disparity(-400.0), "depth holds -400 mm; it must be above 0"),
        (lambda: GEOMETRY.defocus([300.0, -5.0]), "depth holds -5 mm; it must be above 0"),
        (lambda: pl.Sensor((4, 4), 0.01, angular_response=3), "AngularResponse, DualPixels or None"),
    ],
)
def test_mistakes_get_a_sentence(call, message):
    with pytest.raises(pl.PlenopticError, match=message):
        call()


def test_tables_in_files(tmp_path):
    path = tmp_path / "response.csv"
    path.write_text("angle,left,right\n-20,0.6,0.2\n0,0.4,0.4\n20,0.2,0.6\n", encoding="utf-8")
    sensor = pl.sensor.dual_pixel(0.001, (4, 4), table=path)
    assert sensor.angular_response.table[:, 0] == pytest.approx(np.radians([-20.0, 0.0, 20.0]))
    path.write_text("-20,0.6\n", encoding="utf-8")
    for wrong in (path, tmp_path / "none.csv"):
        with pytest.raises(pl.errors.FileError, match="no table of angle in degrees, left and right"):
            pl.sensor.dual_pixel(0.001, (4, 4), table=wrong)


def test_files_keep_dual_pixels(tmp_path):
    camera = camera_of(12.0, shape=(4, 6), crosstalk=0.1, table=[[-0.4, 0.7, 0.1], [0.4, 0.2, 0.6]])
    shots = [pl.render_white(each, samples=4, progress=False) for each in pl.sensor.well_cameras(camera)]
    for name, shot in zip("ab", shots, strict=True):
        shot.save(tmp_path / f"{name}.exr")
    again = [pl.Exposure.load(tmp_path / f"{name}.exr") for name in "ab"]
    assert [shot.camera for shot in again] == [shot.camera for shot in shots]
    assert np.array_equal(pl.sensor.read_wells(again).wells, pl.sensor.read_wells(shots).wells)


def test_no_warning_of_gaps_or_few_pixels():
    kinds = {finding.kind.name for finding in camera_of(12.0).report().warnings}
    assert not kinds & {"DARK_GAPS", "FEW_PIXELS"}

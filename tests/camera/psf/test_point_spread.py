"""Forward tracing: reversibility and etendue, agreement with rendering, closed forms, and points of all kinds."""

import math
import pickle
import warnings

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.psf import sensor_hits
from plenoptic.camera.psf.point_spread import landing_points, point_spread
from plenoptic.camera.record import camera_record
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.microlens.kernels.ideal import fill_thin
from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex
from plenoptic.optics.microlens.record import SensorPlane
from plenoptic.truth.channels import Truth

THIN, FLAT, SPHERICAL = (
    pl.optics.MicrolensModel.THIN,
    pl.optics.MicrolensModel.FLAT_HIGH_INDEX,
    pl.optics.MicrolensModel.SPHERICAL,
)


def the_lens(stop=5.0):
    stop = pl.CircularStop(semi_diameter=stop) if isinstance(stop, float) else stop
    return pl.load_lens("double-gauss-100mm-f2").with_stop(stop)


def reference_camera(b=1.7, lens=None, shape=(512, 512), **array):
    """The camera of the reference scenes; mode 2.0 by default, 1.0 with b = 2.0 and stop = 4.25."""
    return pl.PlenopticCamera(
        lens=the_lens() if lens is None else lens,
        microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), **array),
        sensor=pl.Sensor(shape=shape, pixel_pitch=0.010),
        stop_to_microlenses=123.3,
        microlenses_to_sensor=b,
    )


def bare_camera(lens=None, z=134.6, shape=(512, 512), pitch=0.010):
    lens = the_lens() if lens is None else lens
    return pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=shape, pixel_pitch=pitch), stop_to_microlenses=z)


# ---- laws of the kernels ----

PLATES = [
    {"lattice": lattice, "model": model, "index": index, "convex_side": side}
    for lattice in (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE)
    for model, index in ((FLAT, 50.0), (SPHERICAL, 1.5))
    for side in pl.optics.ConvexSide
]
ARRAYS = [{"lattice": lattice, "model": THIN} for lattice in (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE)] + PLATES


def forwards(camera, x, y, u, v):
    """x, y on the sensor, slopes, weights, indices and status of rays of weight 1, which start on the array's plane."""
    fields = np.zeros((8, -(-x.size // BLOCK) * BLOCK))
    fields[5] = 1.0
    n = 1 / np.sqrt(1 + u * u + v * v)
    fields[:7, : x.size] = x, y, np.full(x.size, camera.stop_to_microlenses), u * n, v * n, n, np.ones(x.size)
    blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
    sensor_hits.fill_through_array_forward(blocks.reshape(-1), sensor_hits.forward_record(camera).array)
    out = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : x.size]
    return out[:2], out[3:5], out[6], out[[2, 5]], out[7]


@pytest.mark.parametrize("array", ARRAYS, ids=str)
def test_rays_of_the_renderer_come_back_to_where_they_began(array):
    camera = reference_camera(**array)
    made, distance = camera.microlenses, camera.microlenses_to_sensor
    rng = np.random.default_rng(1)
    n = 4 * BLOCK
    cells = np.rint(rng.uniform(-30, 30, (n, 2))) @ made.basis
    points = cells + rng.uniform(-1, 1, (n, 2)) * made.cell_radius
    slopes = rng.uniform(-0.4, 0.4, (n, 2))
    start = points - slopes * distance
    fields = np.zeros((8, n))
    fields[0:2], fields[3:5], fields[6] = points.T, (points - start).T, 1.0
    fields[2], fields[5] = cells.T
    blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
    sensor = SensorPlane(distance, None)
    if made.model is THIN:
        fill_thin(blocks.reshape(-1), None, sensor, 1 / made.focal_length, camera.stop_to_microlenses, None, None)
    else:
        plates, power = camera_record(camera).array, 1 / made.focal_length
        fill_plano_convex(
            blocks.reshape(-1), None, sensor, plates.model, power, plates.edges, camera.stop_to_microlenses, None
        )
    x, y, z, l, m, n_z, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)
    if made.model is THIN or made.model is FLAT:
        # Aimed beyond their own cell; plates with real height sort these out themselves.
        inside = ((points - cells) @ made.cell_edges[:, :2].T <= made.cell_edges[:, 2]).all(axis=1)
    else:
        inside = np.ones(len(x), dtype=bool)
    kept = (status == 0) & inside
    assert kept.sum() > 300
    x, y, z, l, m, n_z = (a[kept] for a in (x, y, z, l, m, n_z))
    t = (camera.stop_to_microlenses - z) / n_z
    place, slope, _, index, lost = forwards(camera, x + t * l, y + t * m, l / n_z, m / n_z)
    # A ray that strikes an edge between cells to within rounding may be given to either: none does here.
    assert not lost.any()
    np.testing.assert_allclose(index.T @ made.basis, cells[kept], atol=1e-12)
    # Some ten operations on coordinates below 10 mm, magnified by at most 10: 1e-12; measured 6e-14. Slopes of the flat
    # model lose a factor of its index: 50.
    np.testing.assert_allclose(place.T, start[kept], atol=1e-11)
    # By z, which grows towards the sensor.
    np.testing.assert_allclose(slope.T, -slopes[kept], atol=1e-11)


@pytest.mark.parametrize("array", ARRAYS, ids=str)
def test_weight_behind_the_microlenses_is_etendue(array):
    # The Jacobian of the map of phase space (x, y, u, v) from the array's plane to the sensor, by central differences
    # of h = 1e-5: errors of O(h^2 / f^2) = 1e-10 and eps * 10 mm / h = 2e-10 for each of four factors. Etendue is
    # dx dy du dv cos^4.
    camera = reference_camera(**array)
    rng = np.random.default_rng(2)
    cells = np.rint(rng.uniform(-20, 20, (64, 2))) @ camera.microlenses.basis
    state = np.concatenate([cells + rng.uniform(-0.05, 0.05, (64, 2)), rng.uniform(-0.3, 0.3, (64, 2))], axis=1)
    h = 1e-5
    columns = []
    for k in range(4):
        ends = []
        for sign in (1, -1):
            moved = state.copy()
            moved[:, k] += sign * h
            place, slope, _, _, lost = forwards(camera, *moved.T)
            assert not lost.any()
            ends.append(np.concatenate([place, slope]))
        columns.append((ends[0] - ends[1]) / (2 * h))
    jacobian = np.abs(np.linalg.det(np.stack(columns, axis=-1).transpose(1, 0, 2)))
    _, slope, weight, _, _ = forwards(camera, *state.T)
    before, after = (1 / (1 + (s * s).sum(axis=0)) for s in (state[:, 2:].T, slope))
    np.testing.assert_allclose(weight, jacobian * after**2 / before**2, rtol=1e-7)
    if camera.microlenses.model is SPHERICAL:
        np.testing.assert_allclose(weight, 1.0, rtol=1e-12)


# ---- agreement with the renderer ----


def in_world(camera, points):
    return np.asarray(points, dtype=float) if camera.pose is None else camera.pose.to_world(points)


def forward_square(camera, centre, side, *, across, rays, groups=16, seed=3):
    """Mean image of points spread over a square, jittered in a grid, and its error from independent groups."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(across), np.arange(across)), axis=-1).reshape(-1, 2)
    offsets = ((np.tile(grid, (groups, 1)) + rng.random((groups * across**2, 2))) / across - 0.5) * side
    points = np.column_stack([offsets, np.zeros(len(offsets))]) + centre
    spread = point_spread(camera, in_world(camera, points), rays=rays, replicates=1, seed=seed)
    images = np.zeros((groups, *camera.sensor.shape))
    for k, (image, region) in enumerate(zip(spread.image, spread.regions, strict=True)):
        images[k // across**2][region] += image / across**2
    return images


def assert_agrees_with_rendering(camera, centre, *, side=0.3, across=4, rays=2048, samples=256, bright=0.1):
    """A square emitter of radiance 1, rendered, over its area, against the mean over its points, forwards."""
    images = forward_square(camera, centre, side, across=across, rays=rays)
    mean, error = images.mean(axis=0), images.std(axis=0, ddof=1) / math.sqrt(len(images))
    lit = np.argwhere(mean)
    region = tuple(slice(max(a - 3, 0), b + 4) for a, b in zip(lit.min(axis=0), lit.max(axis=0), strict=True))
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [-0.5, 0.5, 0]])
    ends = in_world(camera, centre + side * square)
    quad = pl.quad(ends[0], ends[1] - ends[0], ends[2] - ends[0], material=pl.Emissive(1.0))
    shot = pl.render(
        pl.Scene([quad]),
        camera,
        samples=samples,
        region=region,
        replicates=16,
        seed=5,
        truth=Truth.NONE,
        progress=False,
    )
    # Pixels that no path found bright have the error of one sample, which in sums would outweigh that of the others.
    found = shot.standard_error * (shot.image > 0)
    rendered, rendered_error = (a[:, :, 0].astype(float) / side**2 for a in (shot.image, found))
    mean, error = mean[region], error[region]
    # Only pixels with enough light that their error is known: it has 15 degrees of freedom, so that the mean square of
    # deviation over error is 15 / 13, its root 1.07. Errors of the forward images go together from pixel to pixel (a
    # point that is drawn further to the left shifts all of its image), which leaves some ten independent ones: 3
    # standard deviations of the root of a mean of ten squares are 3 / sqrt(20).
    seen = mean > bright * mean.max()
    assert seen.sum() > 50
    z = (rendered - mean)[seen] / np.hypot(rendered_error, error)[seen]
    assert math.sqrt(np.mean(z * z)) < 1.07 + 3 / math.sqrt(20)
    # All the light: 4 standard errors.
    light = images.sum(axis=(1, 2))
    joint = math.hypot(light.std(ddof=1) / math.sqrt(len(light)), math.sqrt((rendered_error**2).sum()))
    assert abs(rendered.sum() - light.mean()) < 4 * joint
    assert joint < 0.01 * light.mean()


MODE_1 = {"b": 2.0}
SQUARE = {"lattice": pl.Lattice.SQUARE}
MOVED = {"shift": (1.5, 0.5, 0.0), "tilt": (0.02, -0.03, 0.0)}
PENTAGON = pl.PolygonStop(blades=5, semi_diameter=5.0, rotation=0.3)

QUICK = {
    "2.0": lambda: (reference_camera(), (5.0, 3.0, -380.0)),
    "1.0, square, spherical": lambda: (
        reference_camera(**MODE_1, **SQUARE, lens=the_lens(4.25), model=SPHERICAL),
        (-2.0, 4.0, -404.0),
    ),
    "polygon, posed": lambda: (
        reference_camera(lens=the_lens(PENTAGON)).posed((100, 50, 700), (30, -20, 10), (0.1, 1, 0)),
        (3.0, 1.0, -404.0),
    ),
    "conventional, decentred": lambda: (
        bare_camera(the_lens().moved(slice(6, 9), **MOVED), z=132.0),
        (3.0, 1.0, -404.0),
    ),
}
LONG = {
    "2.0 on the axis": lambda: (reference_camera(), (0.0, 0.0, -404.0)),
    "1.0 on the axis": lambda: (reference_camera(**MODE_1, lens=the_lens(4.25)), (0.0, 0.0, -404.0)),
    "2.0, square": lambda: (reference_camera(**SQUARE), (-4.0, 5.0, -430.0)),
    "1.0, square": lambda: (reference_camera(**MODE_1, **SQUARE, lens=the_lens(4.25)), (-4.0, 5.0, -430.0)),
    "2.0, spherical": lambda: (reference_camera(model=SPHERICAL), (5.0, 3.0, -380.0)),
    "2.0, spherical to the sensor": lambda: (
        reference_camera(model=SPHERICAL, convex_side=pl.optics.ConvexSide.SENSOR),
        (5.0, 3.0, -380.0),
    ),
    "2.0, flat": lambda: (reference_camera(model=FLAT, index=100.0), (5.0, 3.0, -380.0)),
    "2.0, flat to the sensor": lambda: (
        reference_camera(model=FLAT, index=100.0, convex_side=pl.optics.ConvexSide.SENSOR),
        (5.0, 3.0, -380.0),
    ),
    "2.0, decentred": lambda: (reference_camera(lens=the_lens().moved(slice(6, 9), **MOVED)), (3.0, 1.0, -404.0)),
    "2.0, tilted": lambda: (
        reference_camera(lens=the_lens().moved(0, shift=(0.3, 0.1, 0), tilt=(0.01, -0.006, 0))),
        (3.0, 1.0, -404.0),
    ),
    "thin lens": lambda: (reference_camera(lens=the_lens().with_model(pl.LensModel.THIN)), (7.0, -6.0, -404.0)),
    "paraxial lens": lambda: (reference_camera(lens=the_lens().with_model(pl.LensModel.PARAXIAL)), (7.0, -6.0, -404.0)),
    "conventional, polygon": lambda: (bare_camera(the_lens(PENTAGON), z=133.0), (3.0, 1.0, -404.0)),
}


@pytest.mark.parametrize("made", QUICK.values(), ids=QUICK)
def test_forward_image_is_what_is_rendered(made):
    assert_agrees_with_rendering(*made())


@pytest.mark.slow
@pytest.mark.parametrize("made", LONG.values(), ids=LONG)
def test_forward_image_of_further_cameras_is_what_is_rendered(made):
    assert_agrees_with_rendering(*made())


@pytest.mark.parametrize("model", [pl.LensModel.THIN, pl.LensModel.PARAXIAL, pl.LensModel.NONE])
def test_steep_light_of_an_ideal_lens_is_what_is_rendered(model):
    # At 45 degrees and f/1.5 the weight of ideal elements matters: without it the light of the thin lens were 10 % more
    # and that of the thick one 4 % less.
    lens = the_lens(33.0).with_model(model)
    camera = bare_camera(lens, z=60.0, shape=(32, 32), pitch=6.0)
    centre, side = (90.0, -30.0, -90.0), 40.0
    images = forward_square(camera, np.array(centre), side, across=8, rays=512, groups=8)
    corner = np.array(centre) - [side / 2, side / 2, 0]
    quad = pl.quad(corner, (side, 0, 0), (0, side, 0), material=pl.Emissive(1.0))
    shot = pl.render(pl.Scene([quad]), camera, samples=2048, truth=Truth.NONE, progress=False)
    light = images.sum(axis=(1, 2))
    rendered = shot.image.sum(dtype=np.float64) / side**2
    joint = math.hypot(
        light.std(ddof=1) / math.sqrt(len(light)),
        math.sqrt(np.square(shot.standard_error[shot.image > 0], dtype=np.float64).sum()) / side**2,
    )
    assert abs(rendered - light.mean()) < 4.5 * joint  # 7 degrees of freedom
    assert joint < 0.006 * light.mean()


# ---- closed forms ----


def test_light_of_a_narrow_stop_is_the_projected_solid_angle_of_the_entrance_pupil():
    lens = the_lens(0.5)
    points = pl.paraxial.cardinal_points(lens)
    a, d = points.entrance_pupil_semi_diameter, points.entrance_pupil + 404.0
    spread = point_spread(bare_camera(lens), (0, 0, -404), replicates=8)
    # Aberrations of the pupil are of the order of (stop / focal length)^2 = 2.5e-5.
    expected = math.pi * a * a / (a * a + d * d)
    assert abs(spread.light - expected) < 5 * spread.light_error + 1e-4 * expected
    assert spread.light_error < 1e-4 * expected


@pytest.mark.parametrize("z", [110.0, 134.624])
def test_light_of_a_perfect_lens_is_pi_m2_sin2(z):
    # All rays through the exit pupil with the slopes u / m, weighed by du dv cos^4: pi m^2 sin^2 of the image-side
    # angle. For a narrow pupil it is the projected solid angle of the entrance pupil, off it by the cosines.
    lens = the_lens(20.0).with_model(pl.LensModel.PARAXIAL)
    points = pl.paraxial.cardinal_points(lens)
    spread = point_spread(bare_camera(lens, z=z, shape=(512, 512), pitch=0.1), (0, 0, -404), replicates=8)
    away = points.front_focus + 404.0
    m, image = points.efl / away, points.rear_focus + points.efl**2 / away
    tangent = points.exit_pupil_semi_diameter / (image - points.exit_pupil)
    assert abs(spread.light / (math.pi * m * m * math.sin(math.atan(tangent)) ** 2) - 1) < 1e-4
    a, d = points.entrance_pupil_semi_diameter, points.entrance_pupil + 404.0
    assert abs(spread.light / (math.pi * a * a / (a * a + d * d)) - 1) < tangent**2


def test_light_of_a_stop_alone_is_that_of_a_disc_seen_from_beside():
    # Point and disc in parallel planes: pi / 2 (1 - (h^2 + s^2 - R^2) / sqrt((h^2 + s^2 + R^2)^2 - 4 R^2 s^2)), H. C.
    # Hottel's disc seen from an element (J. R. Howell, A Catalog of Radiation Configuration Factors, B-13).
    lens = the_lens(20.0).with_model(pl.LensModel.NONE)
    h, s, r = 50.0, 40.0, 20.0
    q = h * h + s * s
    expected = math.pi / 2 * (1 - (q - r * r) / math.sqrt((q + r * r) ** 2 - 4 * r * r * s * s))
    spread = point_spread(bare_camera(lens, z=40.0, shape=(100, 100), pitch=5.0), (24, -32, -50))
    assert abs(spread.light - expected) < 5 * spread.light_error
    assert spread.light_error < 1e-3 * expected
    assert spread.fraction_by_fate["beside_sensor"] == 0


@pytest.mark.parametrize("height", [0.0, 5.0])
def test_a_perfect_lens_in_focus_gathers_all_light_in_the_paraxial_image_point(height):
    lens = the_lens(20.0).with_model(pl.LensModel.PARAXIAL)
    points = pl.paraxial.cardinal_points(lens)
    camera = bare_camera(lens).focused_at(z=-404.0)
    m = points.efl / (points.front_focus + 404.0)
    landed = landing_points(camera, (height, -0.3 * height, -404))
    # eps times lengths of some 500 mm, times a few.
    np.testing.assert_allclose(landed.position, [[-m * height, 0.3 * m * height]] * len(landed.position), atol=1e-11)
    assert landed.microlens is None
    spread = point_spread(camera, (height, -0.3 * height, -404))
    np.testing.assert_allclose(spread.centroid, [-m * height, 0.3 * m * height], atol=1e-11)
    # The image of a point that lies between two or four pixels may be split by rounding.
    assert spread.image.size <= 4


def test_centroid_of_a_real_lens_tends_to_the_paraxial_image_point():
    # Third-order aberrations: halving field and stop together reduces the distance eightfold.
    off = []
    for scale in (1.0, 0.5):
        camera = bare_camera(the_lens(5.0 * scale)).focused_at(z=-404.0)
        points = pl.paraxial.cardinal_points(camera.lens)
        m = points.efl / (points.front_focus + 404.0)
        spread = point_spread(camera, (0, 6.0 * scale, -404))
        off.append(spread.centroid[1] + m * 6.0 * scale)
        assert spread.centroid_error[1] < 0.03 * abs(off[-1])
    assert 6.5 < off[0] / off[1] < 9.5


def test_in_focus_plenoptic_camera_sends_a_point_once_through_each_microlens():
    # Mode 2.0 with ideal lenses, focused exactly: through each microlens to one point of the sensor.
    lens = the_lens().with_model(pl.LensModel.PARAXIAL)
    camera = reference_camera(lens=lens).focused_at(z=-404.0)
    landed = landing_points(camera, (1.0, 2.0, -404.0))
    centres, number = np.unique(np.round(landed.microlens, 9), axis=0, return_inverse=True)
    assert len(centres) > 20
    for k in range(len(centres)):
        assert np.ptp(landed.position[number.ravel() == k], axis=0).max() < 1e-10
    np.testing.assert_allclose(landed.microlens, camera.microlenses.nearest(landed.microlens), atol=1e-12)


# ---- errors, seeds, threads ----


def test_standard_errors_are_honest():
    # 12 seeds: the spread of 'light' against what each reports, F-distributed with 11 and 372 degrees of freedom.
    camera = reference_camera()
    spreads = [point_spread(camera, (5, 3, -380), rays=1 << 12, seed=s) for s in range(12)]
    light = np.array([s.light for s in spreads])
    reported = np.mean([s.light_error**2 for s in spreads])
    assert 0.2 < light.var(ddof=1) / reported < 3.0
    # Of 32 replicates, each variance is off by sqrt(2 / 31) = 0.25; of 8, by 0.53.
    assert np.std([s.light_error**2 for s in spreads], ddof=1) / reported < 0.42
    pixels = np.array([s.whole() for s in spreads])
    errors = np.zeros_like(pixels)
    for error, s in zip(errors, spreads, strict=True):
        error[s.regions[0]] = s.standard_error
    seen = pixels.mean(axis=0) > 0.2 * pixels.mean(axis=0).max()
    ratio = pixels.var(axis=0, ddof=1)[seen].mean() / (errors**2).mean(axis=0)[seen].mean()
    assert 0.7 < ratio < 1.4


def test_threads_and_other_points_do_not_change_a_bit(monkeypatch):
    camera = reference_camera()
    points = [(5, 3, -380), (0, 0, -404), (-2, 1, -500)]
    alone = point_spread(camera, points[0], rays=5000, threads=1)
    one = point_spread(camera, points, rays=5000, threads=1)
    assert one == point_spread(camera, points, rays=5000, threads=3)
    np.testing.assert_array_equal(alone.whole(), one.whole()[0])
    assert point_spread(camera, points[0], rays=5000, seed=1) != alone
    # More chunks sum in another order only.
    monkeypatch.setattr(sensor_hits, "CHUNK", 100)
    np.testing.assert_allclose(point_spread(camera, points[0], rays=5000).whole(), alone.whole(), rtol=1e-12)


def test_landing_points_are_the_rays_of_the_spread():
    camera = reference_camera()
    points = [(5, 3, -380), (0, 0, -404)]
    spread = point_spread(camera, points, rays=4096, replicates=1)
    landed = landing_points(camera, points, rays=4096)
    assert landed == landing_points(camera, points, rays=4096, threads=1)
    for k in range(2):
        mine = landed.source == k
        assert landed.weight[mine].sum() == pytest.approx(spread.light[k], rel=1e-12)
        mean = landed.weight[mine] @ landed.position[mine] / landed.weight[mine].sum()
        np.testing.assert_allclose(spread.centroid[k], mean, rtol=1e-10)
    assert spread.standard_error is None and spread.light_error is None and spread.centroid_error is None


def test_spread_keeps_the_lit_pixels_and_the_fates_of_all_rays():
    spread = point_spread(reference_camera(), [(5, 3, -380), (8.5, 0, -404), (0, 0, -404)], rays=1 << 14)
    assert spread.image.shape == spread.standard_error.shape and len(spread.image) == 3
    np.testing.assert_allclose(spread.fractions.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(spread.image.sum(axis=(1, 2)) * 1e-4, spread.light, rtol=1e-12)
    # The light of the second point falls half beside the sensor.
    assert 0.1 < spread.fraction_by_fate["beside_sensor"][1] < 0.9 and spread.fraction_by_fate["beside_sensor"][2] == 0
    # Rays are aimed closely: the iris alone stops the few that pass it by.
    assert spread.fates[2:] == (("clipped", 5),) and spread.fraction_by_fate["landed"][2] > 0.85
    one = spread.of(1)
    np.testing.assert_array_equal(one.whole(), spread.whole()[1])
    assert one.of(0) is one and spread.of(2).light == spread.light[2]
    assert pickle.loads(pickle.dumps(spread)) == spread and not spread.image.flags.writeable
    assert repr(one).startswith("<CameraSpread of 1 point: ") and "3 points" in repr(spread)
    with pytest.raises(pl.errors.InvalidValueError, match="3 points"):
        spread.of(3)


# ---- points of all kinds ----


def test_a_point_out_of_sight_leaves_nothing():
    spread = point_spread(reference_camera(), [(1e4, 0, -50), (0, 0, -404)], rays=1024)
    dark = spread.of(0)
    assert dark.light == 0 and dark.light_error == 0 and not dark.image.any() and np.isnan(dark.centroid).all()
    assert dark.fraction_by_fate["landed"] == 0 and spread.light[1] > 0
    assert not point_spread(reference_camera(), (1e4, 0, -50), rays=8).whole().any()
    assert len(landing_points(reference_camera(), (1e4, 0, -50)).position) == 0


def test_near_far_and_tiny():
    lens = the_lens(0.01)
    points = pl.paraxial.cardinal_points(lens)
    # A stop of a hundredth of a millimetre, 1000 km away: E = pi a^2 / d^2.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        far = point_spread(bare_camera(lens, z=102.52), (0, 0, -1e9), rays=1 << 14)
        near = point_spread(bare_camera(the_lens(), shape=(16, 16), pitch=10.0), (0, 0, -33.771), rays=1 << 14)
        beyond = point_spread(reference_camera(), [(0, 0, -1e300), (1e300, 0, -100)], rays=64)
    a = points.entrance_pupil_semi_diameter
    assert far.light == pytest.approx(math.pi * a * a / 1e18, rel=1e-4)
    assert 0 < near.light < math.pi
    assert not beyond.light.any() and not np.isnan(beyond.image).any()
    np.testing.assert_allclose(near.fractions.sum(), 1.0, rtol=1e-12)


def test_polygons_around_the_light_hold_all_of_it():
    from plenoptic.optics.lens.pupil.entrance_pupil import entering_polygon, entrance

    rng = np.random.default_rng(4)
    near_axis = [(0, 0, -404.0), (60, 90, -404), (20, 10, -60)]
    lenses = [the_lens(17.1), the_lens(1.0), the_lens().moved(0, shift=(4, 0, 0), tilt=(0.1, 0.05, 0))]
    # A pupil 4 mm wide at the rim of a front lens of 900 mm, beside where the paraxial one is.
    cases = [(lens, near_axis) for lens in lenses] + [(pl.load_lens("fisheye-100mm-f8"), [(300, 0, -606.679)])]
    for lens, seen_from in cases:
        where = entrance(lens, 587.6)
        for point in np.array(seen_from):
            corners = entering_polygon(where, point)
            assert corners is not None
            low, high = corners.min(axis=0), corners.max(axis=0)
            close = rng.uniform(1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low, (5000, 2))
            everywhere = rng.uniform(-35, 35, (20000, 2))
            aims = np.column_stack([np.concatenate([close, everywhere]), np.full(25000, where.z)])
            passing = aims[lens.trace(pl.RayBundle(np.tile(point, (25000, 1)), aims - point)).status == 0, :2]
            assert len(passing) > 100
            edges = np.roll(corners, -1, axis=0) - corners
            beside = passing[:, None] - corners
            assert (edges[:, 0] * beside[..., 1] - edges[:, 1] * beside[..., 0] >= 0).all()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"points": (0, 0, -30)}, "in front of it"),
        ({"points": (0, 0, 500)}, "point 0 lies at z = 500 mm"),
        ({"points": [(0, 0, -404), (0, 0, -33.76)]}, "point 1"),
        ({"points": (0, float("nan"), -404)}, "finite"),
        ({"points": (0, -404)}, "shape"),
        ({"points": np.zeros((0, 3))}, "at least one point"),
        ({"points": "here"}, "points"),
        ({"points": None}, "points"),
        ({"points": [(0, 0, -404), (0, -404)]}, "points"),
        ({"rays": 0}, "rays"),
        ({"replicates": 0}, "replicates"),
        ({"seed": -1}, "seed"),
        ({"seed": 1 << 64}, "at most 18446744073709551615"),
        ({"threads": 0}, "threads"),
        ({"camera": "camera"}, "PlenopticCamera"),
        ({"camera": reference_camera(model=pl.optics.MicrolensModel.PINHOLE)}, "PINHOLE"),
    ],
    ids=str,
)
def test_impossible_arguments_are_refused(changed, message):
    given = {"camera": reference_camera(shape=(8, 8)), "points": (0, 0, -404), **changed}
    with pytest.raises(pl.errors.InvalidValueError, match=message):
        point_spread(given.pop("camera"), given.pop("points"), **given)


def test_points_behind_a_posed_camera_are_refused():
    camera = reference_camera().posed((0, 0, 900), (0, 0, 0))
    assert point_spread(camera, (0, 0, 500), rays=64).light > 0
    with pytest.raises(pl.errors.InvalidValueError, match="in front"):
        point_spread(camera, (0, 0, 1000), rays=64)


# ---- figure ----


def test_figure_shows_the_pixels_where_the_sensor_has_them():
    plt = pytest.importorskip("matplotlib.pyplot")
    from plenoptic.plots.camera import plot_camera_spread

    spread = point_spread(reference_camera(), [(3, 1, -404), (-4, 2, -404)], rays=1 << 13)
    ax = plot_camera_spread(spread)
    shown = np.asarray(ax.images[0].get_array())
    left, right, bottom, top = ax.images[0].get_extent()
    assert shown.sum() == pytest.approx(spread.image.sum(), rel=1e-12)
    whole = spread.whole().sum(axis=0)
    cut = whole[round(top + 0.5) : round(bottom + 0.5), round(left + 0.5) : round(right + 0.5)]
    np.testing.assert_allclose(shown, cut, rtol=1e-12)
    # The cross lies at the mean of the pixels, to within a pixel's half.
    rows, columns = np.indices(whole.shape)
    mine = spread.of(0).whole()
    place = [(mine * rows).sum() / mine.sum(), (mine * columns).sum() / mine.sum()]
    np.testing.assert_allclose(ax.lines[0].get_xydata()[0][::-1], place, atol=0.5)
    plt.close("all")
    dark = plot_camera_spread(point_spread(reference_camera(), (1e4, 0, -50), rays=8))
    assert "no light" in [text.get_text() for text in dark.texts]
    plt.close("all")
    with pytest.raises(pl.errors.InvalidValueError, match="CameraSpread"):
        plot_camera_spread("spread")

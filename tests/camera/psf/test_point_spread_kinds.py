"""Forward tracing through every kind of camera: agreement with rendering, limits, and which microlens is which."""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import bare_camera, camera_with, in_blocks, in_world, out_of_blocks, the_lens, with_array

import plenoptic as pl
from plenoptic.camera.camera import CameraPart
from plenoptic.camera.camera_record import camera_record
from plenoptic.camera.psf.point_spread import landing_points, point_spread
from plenoptic.camera.psf.sensor_hits import fill_through_array_forward, forward_record
from plenoptic.optics import ApertureShape, Blemishes, BlemishSite, Gaps, MicrolensAperture, MicrolensDeviations
from plenoptic.optics.lens.placement import rotation_about_axes
from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_thin
from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex
from plenoptic.optics.microlens.microlens_record import SensorPlane

_, THIN, FLAT, SPHERICAL = pl.optics.MicrolensModel
LENS, ARRAY, SENSOR = CameraPart.LENS, CameraPart.MICROLENSES, CameraPart.SENSOR
TO_SENSOR = {"model": SPHERICAL, "convex_side": pl.optics.ConvexSide.SENSOR}
PLATES = {
    "thin": {},
    "spherical": {"model": SPHERICAL},
    "spherical to the sensor": TO_SENSOR,
    "flat": {"model": FLAT, "index": 100.0},
}
MULTI = {"focal_lengths": (1.7, 2.0, 2.4)}
RECTANGLES = {"lattice": pl.Lattice.RECTANGULAR, "pitch": (0.26, 0.18)}
LOST = {"missing": 0.05, "dark": 0.1}
SPOILED = pl.MicrolensImperfections(pitch_jitter=0.012, decentre=0.008, focal_length_spread=0.06, seed=3, **LOST)
ROUND = MicrolensAperture(ApertureShape.CIRCLE, 0.7)
POINT = (5.0, 3.0, -380.0)


def scattered(n=500, reach=2.9, least=0.16):
    """Centres drawn one by one, no two of them closer than `least`."""
    rng = np.random.default_rng(7)
    centres = np.zeros((0, 2))
    for point in rng.uniform(-reach, reach, (20 * n, 2)):
        if len(centres) < n and (np.hypot(*(centres - point).T) > least).all():
            centres = np.concatenate([centres, point[None]])
    return centres


FREE = {"lattice": pl.Lattice.FREE, "centres": scattered(), "pitch": 0.18, "focal_lengths": (1.8, 2.2)}
FREE["types"] = np.arange(500) % 2


def deviations(camera, centre=POINT, *, side=0.8, across=4, groups=16, rays=1024, samples=128):
    """Of a square emitter of radiance 1 over its area, forwards and rendered, over the joint error.

    Root mean square over pixels, and of total and centroid (3,); and the joint error of the total.
    """
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(across), np.arange(across)), axis=-1).reshape(-1, 2)
    offsets = ((np.tile(grid, (groups, 1)) + rng.random((groups * across**2, 2))) / across - 0.5) * side
    points = np.column_stack([offsets, np.zeros(len(offsets))]) + centre
    spread = point_spread(camera, in_world(camera, points), rays=rays, replicates=1, seed=3)
    images = np.zeros((groups, *camera.sensor.shape))
    for k, (image, region) in enumerate(zip(spread.image, spread.regions, strict=True)):
        images[k // across**2][region] += image / across**2
    lit = np.argwhere(images.any(axis=0))
    region = tuple(slice(max(a - 3, 0), b + 4) for a, b in zip(lit.min(axis=0), lit.max(axis=0), strict=True))
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [-0.5, 0.5, 0]])
    ends = in_world(camera, centre + side * square)
    quad = pl.quad(ends[0], ends[1] - ends[0], ends[2] - ends[0], material=pl.Emissive(1.0))
    options = {"samples": samples, "region": region, "replicates": 16, "seed": 5}
    shot = pl.render(pl.Scene([quad]), camera, truth=pl.Truth.NONE, progress=False, **options)
    # Pixels that no path found bright have the error of one sample, which in sums would outweigh that of the others.
    weights_ = shot.standard_error * (shot.image > 0)
    rendered, error = (a[:, :, 0].astype(float) / side**2 for a in (shot.image, weights_))
    images = images[(slice(None), *region)]
    root = math.sqrt(len(images))
    mean, spread = images.mean(axis=0), images.std(axis=0, ddof=1) / root
    is_bright = mean > 0.1 * mean.max()
    z = (rendered - mean)[is_bright] / np.hypot(error, spread)[is_bright]
    rows, columns = np.indices(rendered.shape)
    moments = np.stack([np.ones_like(rendered), rows, columns])
    forward = np.einsum("gij,kij->gk", images, moments)
    forward[:, 1:] /= forward[:, :1]
    backward = np.einsum("ij,kij->k", rendered, moments)
    backward[1:] /= backward[0]
    moments[1:] -= backward[1:, None, None]
    error_ = np.sqrt(np.einsum("ij,kij->k", error**2, moments**2))
    error_[1:] /= backward[0]
    joint = np.hypot(error_, forward.std(axis=0, ddof=1) / root)
    off = (backward - forward.mean(axis=0)) / joint
    return float(np.sqrt(np.mean(z * z))), off, joint[0] / backward[0]


def assert_agrees(camera, centre=POINT, *, precision, name="", **how):
    """Root mean square of deviations over errors of pixels, all the light, and the centroid.

    Errors of pixels with enough light have 15 degrees of freedom: the root of the mean square of deviation over error
    is sqrt(15 / 13) = 1.07. Errors of the forward images go together from pixel to pixel (a point drawn further to the
    left shifts all of its image), which leaves some ten independent ones: 3 standard deviations are 3 / sqrt(20).
    Total and centroid: 3.5 standard errors, which 15 degrees of freedom exceed once in 300.
    """
    pixels, off, error = deviations(camera, centre, **how)
    assert pixels < 1.07 + 3 / math.sqrt(20), name
    assert (np.abs(off) < 3.5).all(), name
    assert error < precision, name


HEXAGONS = MicrolensAperture(ApertureShape.HEXAGON, 0.5)
SQUARES, ROUND_CLEAR = (MicrolensAperture(shape, 0.5, Gaps.CLEAR) for shape in (ApertureShape.SQUARE, ROUND.shape))
ALL_MOVED = (
    (LENS, (0.5, 0.3, 0.2), (0.02, -0.03, 0.3)),
    (ARRAY, (0.1, -0.1, -0.05), (0.04, -0.03, 0.1)),
    (SENSOR, (0.3, -0.2, 0.05), (0.03, -0.05, 0.2)),
)
STEEP = (
    (LENS, (1.0, 0.5, 0.3), (0.2, -0.15, 0.3)),
    (ARRAY, (0.1, -0.1, -0.05), (0.2, -0.25, 0.1)),
    (SENSOR, (0.3, -0.2, 0.05), (0.2, -0.25, 0.2)),
)
OPEN_IN_PART = {"pixel_aperture": (0.6, 0.8)}
# Light arrives some 6 degrees off the axis at most; a deep well, shifted for another pupil, loses a fifth of it.
DEEP = {"angular_response": pl.sensor.AngularResponse(well_depth=3.0, index=1.2, pupil_distance=40.0, exponent=2.0)}


def dust(site, **how):
    """Grains and scratches that take a tenth of a point's light or more; wider where its beam is wide."""
    wide = site in (BlemishSite.LENS_REAR, BlemishSite.LENS_FRONT)
    size = {"half_size": (20.0, 20.0), "dust_per_mm2": 0.15, "dust_radius": 0.6, "scratch_length": 9.0}
    if not wide:
        size = {"half_size": (3.0, 3.0), "dust_per_mm2": 60.0, "dust_radius": 0.025, "scratch_length": 1.5}
    return Blemishes.scattered(
        site, **size, scratches=20, scratch_width=1.2 * size["dust_radius"], transmission=0.2, seed=site + 1, **how
    )


REAR, FRONT = BlemishSite.LENS_REAR, BlemishSite.LENS_FRONT
BEHIND = dust(BlemishSite.SENSOR), dust(BlemishSite.SENSOR, height=0.7), dust(REAR), dust(FRONT)
DUSTY = (*BEHIND, dust(BlemishSite.ARRAY))
ALL_DIMMED = {"pixels": OPEN_IN_PART | DEEP, "blemishes": DUSTY}
QUICK = {**MULTI, **PLATES["spherical"], "moved": ((SENSOR, (0.3, -0.2, 0.05), (0.03, -0.05, 0.2)),)}
SQUARE = {"lattice": pl.Lattice.SQUARE}
DECENTRED = the_lens().moved(slice(6, 9), shift=(1.5, 0.5, 0.0), tilt=(0.02, -0.03, 0.0))
PENTAGON = the_lens(pl.PolygonStop(blades=5, semi_diameter=5.0, rotation=0.3))
TILTED_STOP = the_lens().moved(0, shift=(0.3, 0.1, 0), tilt=(0.01, -0.006, 0))
AXIS, ASIDE = (0.0, 0.0, -404.0), (3.0, 1.0, -404.0)
PLAIN = [
    *(camera_with(2.0, 4.25), camera_with(lens=DECENTRED), camera_with(lens=TILTED_STOP)),
    camera_with(lens=the_lens(model=pl.LensModel.PARAXIAL)),
    *(camera_with(**PLATES["flat"], **SQUARE), bare_camera(DECENTRED, z=132.0), bare_camera(PENTAGON, z=133.0)),
]
LONG = [
    MULTI | {"imperfections": SPOILED, "aperture": ROUND, "moved": ALL_MOVED},
    RECTANGLES | PLATES["flat"] | {"aperture": SQUARES, "moved": ((ARRAY, (0.3, -0.2, -0.05), (0.0, 0.0, 0.2)),)},
    FREE | {"imperfections": SPOILED, "moved": ((ARRAY, (0.2, 0.1, 0.0), (0.0, 0.0, 0.4)),)},
    *(MULTI | plate | {"imperfections": SPOILED, "aperture": ROUND_CLEAR} for plate in PLATES.values()),
    *(FREE | plate | {"imperfections": SPOILED, "aperture": HEXAGONS, "moved": ALL_MOVED} for plate in PLATES.values()),
]
"""Several properties at a time with each plate; regular arrays that are moved and dimmed: below."""


def test_multi_focus_on_a_tilted_sensor_is_what_is_rendered():
    assert_agrees(camera_with(**QUICK), side=1.0, rays=512, samples=64, precision=0.006)


def test_a_posed_camera_with_an_iris_of_blades_is_what_is_rendered():
    posed = camera_with(lens=PENTAGON, **SQUARE).posed((100, 50, 700), (30, -20, 10), (0.1, 1, 0))
    assert_agrees(posed, ASIDE, side=0.3, rays=2048, precision=0.01)


@pytest.mark.slow
def test_plain_cameras_are_what_is_rendered():
    for camera in PLAIN:
        assert_agrees(camera, ASIDE, name=camera, side=0.3, rays=2048, samples=256, precision=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 4, 8])
def test_every_kind_is_what_is_rendered(first):
    for case in LONG[first : first + 4]:
        # Where gaps are clear, half of the renderer's paths are in vain.
        assert_agrees(camera_with(**case), samples=256, precision=0.01, name=case)


@pytest.mark.slow
def test_without_microlenses_what_dims_is_what_is_rendered():
    for model in (pl.LensModel.THIN, pl.LensModel.EXACT):
        sensor = camera_with(pixels=OPEN_IN_PART | DEEP).sensor
        camera = pl.PlenopticCamera(the_lens(model=model), sensor, 128.0, blemishes=BEHIND)
        moved = camera.moved(SENSOR, shift=(0.3, -0.2, 0.05), tilt=(0.03, -0.05, 0.2))
        assert_agrees(moved, samples=512, precision=0.005, name=model)


def test_all_that_dims_together_is_what_is_rendered():
    # A sixth of the light is left, with more noise.
    camera = camera_with(**TO_SENSOR, **ALL_DIMMED, moved=ALL_MOVED)
    assert_agrees(camera, side=1.0, rays=512, samples=64, precision=0.012)


@pytest.mark.slow
def test_all_that_dims_together_is_what_is_rendered_to_more_digits():
    for name, plate in PLATES.items():
        assert_agrees(camera_with(**plate, **ALL_DIMMED, moved=ALL_MOVED), precision=0.009, name=name)


def test_what_dims_takes_more_light_than_agreement_could_hide():
    # Otherwise the comparison with the renderer, to some 0.5 %, could not fail.
    plain = point_spread(camera_with(), POINT, rays=1 << 14).light
    dimmed = {"pixels": OPEN_IN_PART}, {"pixels": DEEP}, *({"blemishes": (grains,)} for grains in DUSTY)
    for case in dimmed:
        assert point_spread(camera_with(**case), POINT, rays=1 << 14).light < 0.93 * plain, case


@pytest.mark.slow
@pytest.mark.parametrize("half", [0, 1])
def test_steep_tilts_are_what_is_rendered(half):
    # cos(0.25) is 3 % below 1, four errors or more: a cosine about the wrong axis would show. Lens and array do not
    # know each other, so that not all models of one meet all of the other.
    exact = [(pl.LensModel.EXACT, name) for name in PLATES if name != "thin"]
    cases = [*exact, (pl.LensModel.THIN, "thin"), (pl.LensModel.PARAXIAL, "thin")]
    for model, plate in cases[half::2]:
        camera = camera_with(lens=the_lens(8.0, model), moved=STEEP, **PLATES[plate])
        assert_agrees(camera, (2.0, -0.5, -404.0), samples=256, precision=0.0065, name=(model, plate))


@pytest.mark.slow
def test_strong_single_lenses_are_what_is_rendered():
    # On a small sensor, all of whose lenses have 0.3 of their focal length.
    index = camera_with().microlenses.lenses((-1.0, -1.0), (1.0, 1.0)).index
    strong = MicrolensDeviations(index=index, focal_length_factor=np.full(len(index), 0.3))
    for name in ("thin", "spherical"):
        camera = camera_with(shape=(40, 40), imperfections=strong, **PLATES[name])
        assert_agrees(camera, AXIS, side=8.0, across=16, rays=512, samples=1024, precision=0.006, name=name)


def test_steep_light_of_an_ideal_lens_is_what_is_rendered():
    # At 45 degrees and f/1.5 the weight of ideal elements matters: without it the light of the thin lens were 10 % more
    # and that of the thick one 4 % less.
    for model in (pl.LensModel.THIN, pl.LensModel.PARAXIAL):
        camera = bare_camera(the_lens(33.0, model), z=60.0, shape=(32, 32), pitch=6.0)
        options = {"side": 40.0, "across": 8, "rays": 512, "groups": 8, "samples": 2048}
        _, off, error = deviations(camera, np.array((90.0, -30.0, -90.0)), **options)
        assert abs(off[0]) < 4.5, model  # 7 degrees of freedom
        assert error < 0.006, model


def forwards(camera, z, x, y, u, v):
    """Place on the sensor, slopes, weight, index and status of rays of weight 1 that start at z of the lens's axes."""
    n, one = 1 / np.sqrt(1 + u * u + v * v), np.ones(x.size)
    blocks = in_blocks(np.stack([x, y, z * one, u * n, v * n, n, one, 0 * one]))
    fill_through_array_forward(blocks, forward_record(camera))
    out = out_of_blocks(blocks, x.size)
    return out[:2], out[3:5], out[6], out[[2, 5]], out[7]


def assert_weight_is_etendue(camera, z, state, case):
    """The Jacobian of the map of phase space (x, y, u, v) from the plane z to the sensor, by central differences.

    Truncation of h = 1e-5 is h^2 over the square of the shortest length, 1 mm: 1e-10; rounding eps * 10 mm / h = 2e-10
    for each of four factors. Etendue is dx dy du dv cos^4.
    """
    h = 1e-5
    _, slope, weight, cell, _ = forwards(camera, z, *state.T)
    columns, valid = [], np.ones(len(state), dtype=bool)
    for step in h * np.eye(4):
        ends = []
        for moved in (state + step, state - step):
            place, turned, _, index, lost = forwards(camera, z, *moved.T)
            # Neither lost beside a shifted lens nor in another cell.
            valid &= (lost == 0) & (index == cell).all(axis=0)
            ends.append(np.concatenate([place, turned]))
        columns.append((ends[0] - ends[1]) / (2 * h))
    jacobian = np.abs(np.linalg.det(np.stack(columns, axis=-1).transpose(1, 0, 2)))
    before, after = (1 / (1 + (s * s).sum(axis=0)) for s in (state[:, 2:].T, slope))
    assert valid.sum() > 150, case
    np.testing.assert_allclose(weight[valid], (jacobian * after**2 / before**2)[valid], rtol=1e-7, err_msg=str(case))


REGULAR = [
    {"lattice": lattice, **kind}
    for lattice in (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE)
    for kind in (
        {"model": THIN},
        *(
            {"model": model, "index": index, "convex_side": side}
            for model, index in ((FLAT, 50.0), (SPHERICAL, 1.5))
            for side in pl.optics.ConvexSide
        ),
    )
]


def test_weight_behind_a_tilted_array_of_lenses_that_differ_is_etendue():
    # From a plane 1 mm before the array, across the lens's axis, to the sensor, which is tilted with the array.
    tilt, rng = (0.15, -0.2, 0.3), np.random.default_rng(2)
    state = np.concatenate([rng.uniform(-1.0, 1.0, (256, 2)), rng.uniform(-0.05, 0.05, (256, 2))], axis=1)
    spoiled = pl.MicrolensImperfections(pitch_jitter=0.01, decentre=0.01, focal_length_spread=0.1)
    moved = (ARRAY, (0.1, 0.2, 0.0), tilt), (SENSOR, (0.0, 0.0, 0.1), tilt)
    for plate in (*PLATES.values(), PLATES["flat"] | {"convex_side": pl.optics.ConvexSide.SENSOR}):
        for lattice in ({}, SQUARE):
            camera = camera_with(**MULTI, **plate, **lattice, imperfections=spoiled, moved=moved)
            assert_weight_is_etendue(camera, 122.5, state, (plate, lattice))


def test_rays_of_the_renderer_come_back_to_where_they_began():
    for array in REGULAR:
        camera = camera_with(**array)
        microlenses_, distance = camera.microlenses, camera.microlenses_to_sensor
        rng, n = np.random.default_rng(1), 1024
        cells = np.rint(rng.uniform(-30, 30, (n, 2))) @ microlenses_.basis
        points = cells + rng.uniform(-1, 1, (n, 2)) * microlenses_.cell_radius
        slopes = rng.uniform(-0.4, 0.4, (n, 2))
        start = points - slopes * distance
        one, along = np.ones(n), points - start
        blocks = in_blocks(np.stack([*points.T, cells[:, 0], *along.T, cells[:, 1], one, 0 * one]))
        sensor, power, plane = SensorPlane(distance, None), 1 / microlenses_.focal_length, camera.stop_to_microlenses
        if microlenses_.model is THIN:
            fill_thin(blocks, None, sensor, power, plane, None, None)
        else:
            plates = camera_record(camera).array
            fill_plano_convex(blocks, None, sensor, plates.model, power, plates.edges, plane, None)
        x, y, z, l, m, n_z, _, status = out_of_blocks(blocks, n)
        inside = np.ones(n, dtype=bool)
        if microlenses_.model is not SPHERICAL:
            # Aimed beyond their own cell; plates with real height sort these out themselves.
            inside = ((points - cells) @ microlenses_.cell_edges[:, :2].T <= microlenses_.cell_edges[:, 2]).all(axis=1)
        valid = (status == 0) & inside
        assert valid.sum() > 300
        x, y, z, l, m, n_z = (a[valid] for a in (x, y, z, l, m, n_z))
        t = (plane - z) / n_z
        place, slope, _, index, lost = forwards(camera, plane, x + t * l, y + t * m, l / n_z, m / n_z)
        # A ray that strikes an edge between cells to within rounding may be given to either: none does here.
        assert not lost.any(), array
        np.testing.assert_allclose(index.T @ microlenses_.basis, cells[valid], atol=1e-12)
        # Some ten operations on coordinates below 10 mm, magnified by at most 10: 1e-12. Slopes of the flat model lose
        # a factor of its index, 50; they are by z, which grows towards the sensor.
        came = np.column_stack([start, -slopes])[valid]
        np.testing.assert_allclose(np.concatenate([place, slope]).T, came, atol=1e-11, err_msg=str(array))


def assert_same_landing(found, expected):
    np.testing.assert_array_equal(found.source, expected.source)
    # Coordinates of some 100 mm, divided by focal lengths of 2 mm.
    np.testing.assert_allclose(found.position, expected.position, atol=1e-11)
    np.testing.assert_allclose(found.weight, expected.weight, rtol=1e-9)
    np.testing.assert_allclose(found.microlens, expected.microlens, atol=1e-12)


def test_small_imperfections_tend_to_none_and_free_centres_of_a_lattice_are_the_lattice():
    slight = pl.MicrolensImperfections(pitch_jitter=1e-15, decentre=1e-15, focal_length_spread=1e-15)
    lattice = camera_with().microlenses.lenses((-3.2, -3.2), (3.2, 3.2))
    order = np.random.default_rng(8).permutation(len(lattice))
    centres, index = lattice.centre[order], lattice.index[order]
    for plate in PLATES.values():
        plain = camera_with(**plate)
        spoiled = with_array(plain, imperfections=slight)
        free = with_array(plain, lattice=pl.Lattice.FREE, centres=centres)
        expected, spoiled_points, listed = (landing_points(camera, POINT) for camera in (plain, spoiled, free))
        assert_same_landing(spoiled_points, expected)
        assert_same_landing(listed, expected)
        np.testing.assert_array_equal(spoiled_points.index, expected.index)
        np.testing.assert_array_equal(index[listed.index[:, 0]], expected.index)
        assert not listed.index[:, 1].any()
        # What becomes of the other rays is the same, too.
        assert point_spread(spoiled, POINT, rays=4096).fates == point_spread(plain, POINT, rays=4096).fates


def test_a_camera_moved_as_a_whole_is_a_posed_camera():
    # All parts turned about the iris and shifted; only that emitters face along the axis of the design differs.
    camera = camera_with(stop=0.05, **MULTI, imperfections=SPOILED, aperture=ROUND)
    turn, shift = rotation_about_axes((0.1, -0.2, 0.4)), np.array([3.0, -2.0, 5.0])
    whole = {}
    for name, z in (("lens", 0.0), ("microlenses", camera.stop_to_microlenses), ("sensor", camera.z_sensor)):
        place = np.array([0.0, 0.0, z])
        whole[f"{name}_placement"] = pl.optics.Placement(shift=turn @ place + shift - place, rotation=turn)
    moved = dataclasses.replace(camera, **whole)
    posed = dataclasses.replace(camera, pose=pl.Pose(rotation=turn, position=shift))
    point = posed.pose.to_world((5.0, 3.0, -380.0))
    expected, moved_points = landing_points(posed, point), landing_points(moved, point)
    np.testing.assert_allclose(moved_points.position, expected.position, atol=1e-9)
    np.testing.assert_array_equal(moved_points.index, expected.index)
    # Towards the pupil, which is 0.1 mm wide and some 410 mm away.
    pupil = pl.paraxial.cardinal_points(camera.lens).entrance_pupil
    towards = posed.pose.to_world((0.0, 0.0, pupil)) - point
    np.testing.assert_allclose(moved_points.weight / expected.weight, towards[2] / (towards @ turn[:, 2]), rtol=2e-3)


@pytest.mark.parametrize("lattice", [{}, FREE], ids=["hexagonal", "free"])
def test_deviations_belong_to_the_lens_that_is_listed(lattice):
    plain = camera_with(**lattice)
    expected = landing_points(plain, POINT)
    lenses, count = np.unique(expected.index, axis=0, return_counts=True)
    dim, gone, off = lenses[np.argsort(-count)[:3]]
    changes = {"transmission": [0.25, 1.0, 1.0], "focal_length_factor": [1.0, math.inf, 1.0]}
    listed = MicrolensDeviations([dim, gone, off], decentre=[(0.0, 0.0), (0.0, 0.0), (0.03, -0.01)], **changes)
    spoiled = with_array(plain, imperfections=listed)
    landed_points = landing_points(spoiled, POINT)
    np.testing.assert_array_equal(landed_points.index, expected.index)
    is_dim, is_gone, is_off = ((landed_points.index == lens).all(axis=1) for lens in (dim, gone, off))
    np.testing.assert_allclose(landed_points.weight[is_dim], 0.25 * expected.weight[is_dim], rtol=1e-12)
    is_plain = ~(is_dim | is_gone | is_off)
    # Coordinates of some 2 mm.
    np.testing.assert_allclose(landed_points.position[is_plain], expected.position[is_plain], atol=1e-14)
    # Flat glass: where the rays land without an array.
    straight = landing_points(bare_camera(plain.lens, plain.z_sensor), POINT)
    assert straight.index is None and straight.microlens is None
    away = landed_points.position[is_gone][:, None] - straight.position
    assert np.hypot(away[..., 0], away[..., 1]).min(axis=1).max() < 1e-11
    # A thin lens that is shifted by s moves where all its rays land by s b / f.
    f = spoiled.microlenses.lenses((-4.0, -4.0), (4.0, 4.0))
    power = f.power[(f.index == off).all(axis=1)][0]
    step = landed_points.position[is_off] - expected.position[is_off]
    np.testing.assert_allclose(step, np.tile([0.03 * 1.7 * power, -0.01 * 1.7 * power], (len(step), 1)), atol=1e-11)


def test_light_beside_the_openings_is_lost_or_not_bent():
    rays = 1 << 14
    for name in ("thin", "flat"):
        closed = camera_with(**PLATES[name], aperture=ROUND)
        opened = with_array(closed, aperture=dataclasses.replace(ROUND, gaps=Gaps.CLEAR))
        lens, both = landing_points(closed, POINT, rays=rays), landing_points(opened, POINT, rays=rays)
        # 0.7 of the area of the array is open; a point's light covers some 60 cells.
        assert len(lens.position) / len(both.position) == pytest.approx(0.7, abs=0.03), name
        mine = set(map(tuple, lens.position.tolist()))
        through = np.array([tuple(place) in mine for place in both.position.tolist()])
        assert through.sum() == len(lens.position), name
        if name == "thin":
            straight = landing_points(bare_camera(closed.lens, closed.z_sensor), POINT, rays=rays)
            np.testing.assert_allclose(both.position[~through], straight.position[~through], atol=1e-11)
        lost = point_spread(closed, POINT, rays=rays).fraction_by_fate["outside_microlens"]
        assert lost == pytest.approx(0.3, abs=0.05), name


def test_free_lenses_end_at_the_pitch():
    # One lens alone: light lands through the square of +- pitch around it, and nowhere else.
    camera = camera_with(lattice=pl.Lattice.FREE, centres=[(0.1, 0.0)], pitch=0.3)
    expected, trace_task = (landing_points(each, AXIS, rays=1 << 14) for each in (camera_with(), camera))
    # The disc of light on the array is some 1 mm wide.
    assert 0.05 < len(trace_task.position) / len(expected.position) < 1.0
    np.testing.assert_array_equal(trace_task.index, np.zeros_like(trace_task.index))
    np.testing.assert_array_equal(trace_task.microlens, np.tile([0.1, 0.0], (len(trace_task.index), 1)))

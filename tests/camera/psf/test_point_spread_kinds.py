"""Forward tracing through every kind of camera: agreement with rendering, limits, and which microlens is which."""

import dataclasses
import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.camera import CameraPart
from plenoptic.camera.psf.forward_array import fill_through_array_forward
from plenoptic.camera.psf.point_spread import landing_points, point_spread
from plenoptic.camera.psf.sensor_hits import forward_record
from plenoptic.camera.record import camera_record
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.lens.placement import rotation_about_axes
from plenoptic.optics.microlens.aperture import ApertureShape, Gaps, MicrolensAperture
from plenoptic.optics.microlens.dust import Blemishes, BlemishSite
from plenoptic.optics.microlens.imperfections import MicrolensDeviations, MicrolensImperfections
from plenoptic.optics.microlens.kernels.ideal import fill_thin
from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex
from plenoptic.optics.microlens.record import SensorPlane
from plenoptic.optics.sensor.angular_response import AngularResponse
from plenoptic.truth.channels import Truth

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
SPOILED = MicrolensImperfections(
    pitch_jitter=0.012, decentre=0.008, focal_length_spread=0.06, missing=0.05, dark=0.1, seed=3
)
ROUND = MicrolensAperture(ApertureShape.CIRCLE, 0.7)
POINT = (5.0, 3.0, -380.0)


GAUSS = pl.load_lens("double-gauss-100mm-f2")


def the_lens(stop=5.0, model=pl.LensModel.EXACT):
    return GAUSS.with_stop(pl.CircularStop(stop) if isinstance(stop, float) else stop).with_model(model)


def camera_with(b=1.7, stop=5.0, shape=(512, 512), lens=None, moved=(), pixels=None, blemishes=(), **array):
    """The camera of the reference scenes with another array; `moved` are parts with their shift and tilt."""
    camera = pl.PlenopticCamera(
        lens=the_lens(stop) if lens is None else lens,
        microlenses=pl.MicrolensArray(**({"pitch": 0.217, "focal_lengths": (2.0,)} | array)),
        sensor=pl.Sensor(shape=shape, pixel_pitch=0.010, **(pixels or {})),
        stop_to_microlenses=123.3,
        microlenses_to_sensor=b,
        blemishes=blemishes,
    )
    for part, shift, tilt in moved:
        camera = camera.moved(part, shift=shift, tilt=tilt)
    return camera


def bare_camera(lens, z=134.6, shape=(512, 512), pitch=0.010):
    return pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=shape, pixel_pitch=pitch), stop_to_microlenses=z)


def with_array(camera, **changes):
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, **changes))


def hexagonal(reach=3.2, pitch=0.217):
    """The centres of a hexagonal lattice, in an order of their own."""
    found = pl.MicrolensArray(pitch=pitch, focal_lengths=(2.0,)).lenses((-reach, -reach), (reach, reach))
    order = np.random.default_rng(8).permutation(len(found))
    return found.centre[order], found.index[order]


def scattered(n=500, reach=2.9, least=0.16):
    """Centres drawn one by one, no two of them closer than `least`."""
    rng = np.random.default_rng(7)
    kept = np.zeros((0, 2))
    for point in rng.uniform(-reach, reach, (20 * n, 2)):
        if len(kept) < n and (np.hypot(*(kept - point).T) > least).all():
            kept = np.concatenate([kept, point[None]])
    return kept


FREE = {"lattice": pl.Lattice.FREE, "centres": scattered(), "pitch": 0.18, "focal_lengths": (1.8, 2.2)}
FREE["types"] = np.arange(500) % 2


def in_world(camera, points):
    return np.asarray(points, dtype=float) if camera.pose is None else camera.pose.to_world(points)


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
    given = {"samples": samples, "region": region, "replicates": 16, "seed": 5}
    shot = pl.render(pl.Scene([quad]), camera, truth=Truth.NONE, progress=False, **given)
    # Pixels that no path found bright have the error of one sample, which in sums would outweigh that of the others.
    found = shot.standard_error * (shot.image > 0)
    rendered, error = (a[:, :, 0].astype(float) / side**2 for a in (shot.image, found))
    images = images[(slice(None), *region)]
    root = math.sqrt(len(images))
    mean, spread = images.mean(axis=0), images.std(axis=0, ddof=1) / root
    seen = mean > 0.1 * mean.max()
    z = (rendered - mean)[seen] / np.hypot(error, spread)[seen]
    rows, columns = np.indices(rendered.shape)
    moments = np.stack([np.ones_like(rendered), rows, columns])
    forward = np.einsum("gij,kij->gk", images, moments)
    forward[:, 1:] /= forward[:, :1]
    backward = np.einsum("ij,kij->k", rendered, moments)
    backward[1:] /= backward[0]
    moments[1:] -= backward[1:, None, None]
    own = np.sqrt(np.einsum("ij,kij->k", error**2, moments**2))
    own[1:] /= backward[0]
    joint = np.hypot(own, forward.std(axis=0, ddof=1) / root)
    off = (backward - forward.mean(axis=0)) / joint
    return float(np.sqrt(np.mean(z * z))), off, joint[0] / backward[0]


def assert_agrees(camera, centre=POINT, *, precision, name="", most=3.5, **how):
    """Root mean square of deviations over errors of pixels, all the light, and the centroid.

    Only pixels with enough light that their error is known: it has 15 degrees of freedom, so that the mean square of
    deviation over error is 15 / 13, its root 1.07. Errors of the forward images go together from pixel to pixel (a
    point that is drawn further to the left shifts all of its image), which leaves some ten independent ones: 3
    standard deviations of the root of a mean of ten squares are 3 / sqrt(20). Total and centroid: 3.5 standard errors,
    which 15 degrees of freedom exceed once in 300.
    """
    pixels, off, error = deviations(camera, centre, **how)
    assert pixels < 1.07 + 3 / math.sqrt(20), name
    assert (np.abs(off) < most).all(), name
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
DEEP = {"angular_response": AngularResponse(well_depth=3.0, index=1.2, pupil_distance=40.0, exponent=2.0)}


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
SQUARE, MODE_1 = {"lattice": pl.Lattice.SQUARE}, {"b": 2.0, "stop": 4.25}
DECENTRED = the_lens().moved(slice(6, 9), shift=(1.5, 0.5, 0.0), tilt=(0.02, -0.03, 0.0))
PENTAGON = the_lens(pl.PolygonStop(blades=5, semi_diameter=5.0, rotation=0.3))
TILTED_STOP = the_lens().moved(0, shift=(0.3, 0.1, 0), tilt=(0.01, -0.006, 0))
AXIS, ASIDE, SQUARELY, FAR_ASIDE = (0.0, 0.0, -404.0), (3.0, 1.0, -404.0), (-4.0, 5.0, -430.0), (7.0, -6.0, -404.0)
PLAIN = [
    *((camera_with(), AXIS), (camera_with(**MODE_1), AXIS)),
    *((camera_with(**SQUARE), SQUARELY), (camera_with(**MODE_1, **SQUARE), SQUARELY)),
    *((camera_with(model=SPHERICAL), POINT), (camera_with(**TO_SENSOR), POINT)),
    *(
        (camera_with(**flat, model=FLAT, index=100.0), POINT)
        for flat in ({}, {"convex_side": pl.optics.ConvexSide.SENSOR})
    ),
    *((camera_with(lens=DECENTRED), ASIDE), (camera_with(lens=TILTED_STOP), ASIDE)),
    *((camera_with(lens=the_lens(model=model)), FAR_ASIDE) for model in (pl.LensModel.THIN, pl.LensModel.PARAXIAL)),
    *((bare_camera(DECENTRED, z=132.0), ASIDE), (bare_camera(PENTAGON, z=133.0), ASIDE)),
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
@pytest.mark.parametrize("first", [0, 5, 10])
def test_plain_cameras_are_what_is_rendered(first):
    for camera, point in PLAIN[first : first + 5]:
        # Of 42 numbers with 15 degrees of freedom one is beyond 4 once in twenty.
        given = {"side": 0.3, "rays": 2048, "samples": 256, "precision": 0.01, "most": 4.0}
        assert_agrees(camera, point, name=camera, **given)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, 4, 8])
def test_every_kind_is_what_is_rendered(first):
    for given in LONG[first : first + 4]:
        # Where gaps are clear, half of the renderer's paths are in vain.
        assert_agrees(camera_with(**given), samples=256, precision=0.01, name=given)


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
    for given in dimmed:
        assert point_spread(camera_with(**given), POINT, rays=1 << 14).light < 0.93 * plain, given


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
    index = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)).lenses((-1.0, -1.0), (1.0, 1.0)).index
    strong = MicrolensDeviations(index=index, focal_length_factor=np.full(len(index), 0.3))
    for name in ("thin", "spherical"):
        camera = camera_with(shape=(40, 40), imperfections=strong, **PLATES[name])
        assert_agrees(camera, AXIS, side=8.0, across=16, rays=512, samples=1024, precision=0.006, name=name)


def test_steep_light_of_an_ideal_lens_is_what_is_rendered():
    # At 45 degrees and f/1.5 the weight of ideal elements matters: without it the light of the thin lens were 10 % more
    # and that of the thick one 4 % less.
    for model in (pl.LensModel.THIN, pl.LensModel.PARAXIAL):
        camera = bare_camera(the_lens(33.0, model), z=60.0, shape=(32, 32), pitch=6.0)
        how = {"side": 40.0, "across": 8, "rays": 512, "groups": 8, "samples": 2048}
        _, off, error = deviations(camera, np.array((90.0, -30.0, -90.0)), **how)
        assert abs(off[0]) < 4.5, model  # 7 degrees of freedom
        assert error < 0.006, model


def forwards(camera, z, x, y, u, v):
    """Place on the sensor, slopes, weight, index and status of rays of weight 1 that start at z of the lens's axes."""
    fields = np.zeros((8, -(-x.size // BLOCK) * BLOCK))
    fields[5] = 1.0
    n = 1 / np.sqrt(1 + u * u + v * v)
    fields[:7, : x.size] = x, y, np.full(x.size, z), u * n, v * n, n, np.ones(x.size)
    blocks = np.ascontiguousarray(fields.reshape(8, -1, BLOCK).transpose(1, 0, 2))
    fill_through_array_forward(blocks.reshape(-1), forward_record(camera).array)
    out = blocks.transpose(1, 0, 2).reshape(8, -1)[:, : x.size]
    return out[:2], out[3:5], out[6], out[[2, 5]], out[7]


def assert_weight_is_etendue(camera, z, state, name):
    """The Jacobian of the map of phase space (x, y, u, v) from the plane z to the sensor, by central differences.

    Truncation of h = 1e-5 is h^2 over the square of the shortest length, 1 mm: 1e-10; rounding eps * 10 mm / h = 2e-10
    for each of four factors. Etendue is dx dy du dv cos^4.
    """
    h = 1e-5
    _, slope, weight, cell, _ = forwards(camera, z, *state.T)
    columns, kept = [], np.ones(len(state), dtype=bool)
    for step in h * np.eye(4):
        ends = []
        for moved in (state + step, state - step):
            place, turned, _, index, lost = forwards(camera, z, *moved.T)
            # Neither lost beside a shifted lens nor in another cell.
            kept &= (lost == 0) & (index == cell).all(axis=0)
            ends.append(np.concatenate([place, turned]))
        columns.append((ends[0] - ends[1]) / (2 * h))
    jacobian = np.abs(np.linalg.det(np.stack(columns, axis=-1).transpose(1, 0, 2)))
    before, after = (1 / (1 + (s * s).sum(axis=0)) for s in (state[:, 2:].T, slope))
    np.testing.assert_allclose(weight[kept], (jacobian * after**2 / before**2)[kept], rtol=1e-7, err_msg=str(name))
    return weight, kept


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


def test_weight_behind_the_microlenses_is_etendue():
    for array in REGULAR:
        camera, rng = camera_with(**array), np.random.default_rng(2)
        cells = np.rint(rng.uniform(-20, 20, (64, 2))) @ camera.microlenses.basis
        state = np.concatenate([cells + rng.uniform(-0.05, 0.05, (64, 2)), rng.uniform(-0.3, 0.3, (64, 2))], axis=1)
        weight, kept = assert_weight_is_etendue(camera, 123.3, state, array)
        assert kept.all()
        if array["model"] is SPHERICAL:
            np.testing.assert_allclose(weight, 1.0, rtol=1e-12)


def test_weight_behind_a_tilted_array_of_lenses_that_differ_is_etendue():
    # From a plane 1 mm before the array, across the lens's axis, to the sensor, which is tilted with the array.
    tilt, rng = (0.15, -0.2, 0.3), np.random.default_rng(2)
    state = np.concatenate([rng.uniform(-1.0, 1.0, (256, 2)), rng.uniform(-0.05, 0.05, (256, 2))], axis=1)
    for name, plate in PLATES.items():
        camera = camera_with(
            **{**MULTI, **plate},
            imperfections=MicrolensImperfections(pitch_jitter=0.01, decentre=0.01, focal_length_spread=0.1),
            moved=((ARRAY, (0.1, 0.2, 0.0), tilt), (SENSOR, (0.0, 0.0, 0.1), tilt)),
        )
        assert assert_weight_is_etendue(camera, 122.5, state, name)[1].sum() > 150, name


def test_rays_of_the_renderer_come_back_to_where_they_began():
    for array in REGULAR:
        camera = camera_with(**array)
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
        sensor, power = SensorPlane(distance, None), 1 / made.focal_length
        if made.model is THIN:
            fill_thin(blocks.reshape(-1), None, sensor, power, camera.stop_to_microlenses, None, None)
        else:
            plates = camera_record(camera).array
            fill_plano_convex(
                blocks.reshape(-1), None, sensor, plates.model, power, plates.edges, camera.stop_to_microlenses, None
            )
        x, y, z, l, m, n_z, _, status = blocks.transpose(1, 0, 2).reshape(8, -1)
        inside = np.ones(len(x), dtype=bool)
        if made.model is not SPHERICAL:
            # Aimed beyond their own cell; plates with real height sort these out themselves.
            inside = ((points - cells) @ made.cell_edges[:, :2].T <= made.cell_edges[:, 2]).all(axis=1)
        kept = (status == 0) & inside
        assert kept.sum() > 300
        x, y, z, l, m, n_z = (a[kept] for a in (x, y, z, l, m, n_z))
        t = (camera.stop_to_microlenses - z) / n_z
        place, slope, _, index, lost = forwards(
            camera, camera.stop_to_microlenses, x + t * l, y + t * m, l / n_z, m / n_z
        )
        # A ray that strikes an edge between cells to within rounding may be given to either: none does here.
        assert not lost.any(), array
        np.testing.assert_allclose(index.T @ made.basis, cells[kept], atol=1e-12)
        # Some ten operations on coordinates below 10 mm, magnified by at most 10: 1e-12; measured 6e-14. Slopes of the
        # flat model lose a factor of its index: 50.
        np.testing.assert_allclose(place.T, start[kept], atol=1e-11, err_msg=str(array))
        # By z, which grows towards the sensor.
        np.testing.assert_allclose(slope.T, -slopes[kept], atol=1e-11, err_msg=str(array))


def assert_same_landing(found, expected, atol=1e-11):
    np.testing.assert_array_equal(found.source, expected.source)
    # Coordinates of some 100 mm, divided by focal lengths of 2 mm.
    np.testing.assert_allclose(found.position, expected.position, atol=atol)
    np.testing.assert_allclose(found.weight, expected.weight, rtol=1e-9)
    np.testing.assert_allclose(found.microlens, expected.microlens, atol=1e-12)


def test_small_imperfections_tend_to_none():
    slight = MicrolensImperfections(pitch_jitter=1e-15, decentre=1e-15, focal_length_spread=1e-15)
    for plate in PLATES.values():
        plain = camera_with(**plate)
        spoiled = with_array(plain, imperfections=slight)
        expected, found = landing_points(plain, POINT), landing_points(spoiled, POINT)
        assert_same_landing(found, expected)
        np.testing.assert_array_equal(found.index, expected.index)
        # What becomes of the other rays is the same, too.
        assert point_spread(spoiled, POINT, rays=4096).fates == point_spread(plain, POINT, rays=4096).fates


def test_free_centres_of_a_hexagonal_lattice_are_the_lattice():
    centres, index = hexagonal()
    for plate in PLATES.values():
        expected = landing_points(camera_with(**plate), POINT)
        found = landing_points(camera_with(**plate, lattice=pl.Lattice.FREE, centres=centres), POINT)
        assert_same_landing(found, expected)
        np.testing.assert_array_equal(index[found.index[:, 0]], expected.index)
        assert not found.index[:, 1].any()


def test_types_are_those_of_the_pattern():
    # A camera focused for one of three types: light of a point through its lenses meets in one point of the sensor.
    ideal = camera_with(lens=the_lens(model=pl.LensModel.PARAXIAL)).focused_at(z=-404.0)
    camera = with_array(ideal, **MULTI)
    array = camera.microlenses
    landed = landing_points(camera, (1.0, 2.0, -404.0), rays=1 << 14)
    kinds = array.type_pattern[landed.index[:, 0] % 3, landed.index[:, 1] % 3]
    lenses, number = np.unique(landed.index, axis=0, return_inverse=True)
    for k in range(len(lenses)):
        mine = number.ravel() == k
        width = np.ptp(landed.position[mine], axis=0).max()
        if kinds[mine][0] == 1:
            assert width < 1e-10
        elif mine.sum() > 50:
            assert width > 1e-3
    np.testing.assert_allclose(landed.microlens, array.nearest(landed.microlens), atol=1e-12)


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
    expected, found = landing_points(posed, point), landing_points(moved, point)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-9)
    np.testing.assert_array_equal(found.index, expected.index)
    # Towards the pupil, which is 0.1 mm wide and some 410 mm away.
    pupil = pl.paraxial.cardinal_points(camera.lens).entrance_pupil
    towards = posed.pose.to_world((0.0, 0.0, pupil)) - point
    np.testing.assert_allclose(found.weight / expected.weight, towards[2] / (towards @ turn[:, 2]), rtol=2e-3)


@pytest.mark.parametrize("lattice", [{}, FREE], ids=["hexagonal", "free"])
def test_deviations_belong_to_the_lens_that_is_listed(lattice):
    plain = camera_with(**lattice)
    expected = landing_points(plain, POINT)
    lenses, count = np.unique(expected.index, axis=0, return_counts=True)
    dim, gone, off = lenses[np.argsort(-count)[:3]]
    listed = MicrolensDeviations(
        index=[dim, gone, off],
        transmission=[0.25, 1.0, 1.0],
        focal_length_factor=[1.0, math.inf, 1.0],
        decentre=[(0.0, 0.0), (0.0, 0.0), (0.03, -0.01)],
    )
    spoiled = with_array(plain, imperfections=listed)
    found = landing_points(spoiled, POINT)
    np.testing.assert_array_equal(found.index, expected.index)
    is_dim, is_gone, is_off = ((found.index == lens).all(axis=1) for lens in (dim, gone, off))
    np.testing.assert_allclose(found.weight[is_dim], 0.25 * expected.weight[is_dim], rtol=1e-12)
    others = ~(is_dim | is_gone | is_off)
    # Coordinates of some 2 mm.
    np.testing.assert_allclose(found.position[others], expected.position[others], atol=1e-14)
    # Flat glass: where the rays land without an array.
    straight = landing_points(bare_camera(plain.lens, plain.z_sensor), POINT)
    assert straight.index is None and straight.microlens is None
    away = found.position[is_gone][:, None] - straight.position
    assert np.hypot(away[..., 0], away[..., 1]).min(axis=1).max() < 1e-11
    # A thin lens that is shifted by s moves where all its rays land by s b / f.
    f = spoiled.microlenses.lenses((-4.0, -4.0), (4.0, 4.0))
    power = f.power[(f.index == off).all(axis=1)][0]
    step = found.position[is_off] - expected.position[is_off]
    np.testing.assert_allclose(step, np.tile([0.03 * 1.7 * power, -0.01 * 1.7 * power], (len(step), 1)), atol=1e-11)


@pytest.mark.parametrize("name", ["thin", "flat"])
def test_light_beside_the_openings_is_lost_or_not_bent(name):
    closed = camera_with(**PLATES[name], aperture=ROUND)
    opened = with_array(closed, aperture=dataclasses.replace(ROUND, gaps=Gaps.CLEAR))
    rays = 1 << 14
    lens, both = landing_points(closed, POINT, rays=rays), landing_points(opened, POINT, rays=rays)
    # 0.7 of the area of the array is open; a point's light covers some 60 cells.
    assert len(lens.position) / len(both.position) == pytest.approx(0.7, abs=0.03)
    mine = set(map(tuple, lens.position.tolist()))
    through = np.array([tuple(place) in mine for place in both.position.tolist()])
    assert through.sum() == len(lens.position)
    if name == "thin":
        straight = landing_points(bare_camera(closed.lens, closed.z_sensor), POINT, rays=rays)
        np.testing.assert_allclose(both.position[~through], straight.position[~through], atol=1e-11)
    lost = point_spread(closed, POINT, rays=rays).fraction_by_fate["outside_microlens"]
    assert lost == pytest.approx(0.3, abs=0.05)


def test_free_lenses_end_at_the_pitch():
    # One lens alone: light lands through the square of +- pitch around it, and nowhere else.
    camera = camera_with(lattice=pl.Lattice.FREE, centres=[(0.1, 0.0)], pitch=0.3)
    expected = landing_points(camera_with(), (0.0, 0.0, -404.0), rays=1 << 14)
    landed = landing_points(camera, (0.0, 0.0, -404.0), rays=1 << 14)
    # The disc of light on the array is some 1 mm wide.
    assert 0.05 < len(landed.position) / len(expected.position) < 1.0
    np.testing.assert_array_equal(landed.index, np.zeros_like(landed.index))
    np.testing.assert_array_equal(landed.microlens, np.tile([0.1, 0.0], (len(landed.index), 1)))

"""Reflection behind microlenses beside a trace of each ray from surface to surface, where light turns back."""

import dataclasses

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.camera.ghosts.array_reflection import Detour, fill_reflection
from plenoptic.camera.ghosts.ghost_camera import array_reflections, ghost_lens, ghost_record, opening_camera
from plenoptic.camera.ghosts.ghost_rays import fill_ghost_rays
from plenoptic.core.color.spectra import colour_tables
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.lens.lens_record import lens_record

PITCH, FOCAL, INDEX, THICKNESS, GAP = 0.2, 0.8, 1.5, 0.15, 0.7
SIDES = pl.optics.ConvexSide


def camera_of(model, side, **options):
    array = pl.MicrolensArray(
        PITCH,
        (FOCAL,),
        model=model,
        thickness=THICKNESS,
        index=INDEX,
        convex_side=side,
        lattice=pl.Lattice.SQUARE,
        **options,
    )
    return pl.PlenopticCamera(
        lens=pl.load_lens("singlet-100mm-f4"),
        microlenses=array,
        sensor=pl.Sensor((100, 100), pixel_pitch=0.05),
        stop_to_microlenses=100.0,
        microlenses_to_sensor=GAP,
    )


def bend(d, normal, before, behind):
    cos = np.sum(d * normal, axis=1, keepdims=True)
    normal = normal * np.sign(cos)
    cos, ratio = np.abs(cos), before / behind
    with np.errstate(invalid="ignore"):  # total reflection
        return ratio * d + (np.sqrt(1.0 - ratio**2 * (1.0 - cos**2)) - ratio * cos) * normal


def turn_back(d, normal):
    return d - 2.0 * np.sum(d * normal, axis=1, keepdims=True) * normal


def to_plane(p, d, z):
    return p + ((z - p[:, 2]) / d[:, 2])[:, None] * d


def to_sphere(p, d, vertex, side):
    """Points on the caps of all lenses, of which each ray meets that in whose cell it lies, and their normals."""
    radius = FOCAL * (INDEX - 1.0)
    depth = radius if side is SIDES.SCENE else -radius
    start = to_plane(p, d, vertex)
    found, normals = np.full(p.shape, np.nan), np.full(p.shape, np.nan)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            cell = np.round(start[:, :2] / PITCH) + np.array([i, j])
            centre = np.column_stack([PITCH * cell, np.full(len(p), vertex + depth)])
            offset = p - centre
            along = np.sum(offset * d, axis=1)
            root = np.sqrt(np.maximum(along**2 - np.sum(offset**2, axis=1) + radius**2, 0.0))
            for sign in (-1.0, 1.0):
                q = p + (-along + sign * root)[:, None] * d
                at_cap = (q[:, 2] - centre[:, 2]) * depth < 0
                in_cell = np.abs(q[:, :2] - centre[:, :2]).max(axis=1) <= 0.5 * PITCH
                meets = at_cap & in_cell & (root > 0)
                found[meets], normals[meets] = q[meets], ((q - centre) / radius)[meets]
    return found, normals


def by_surfaces(camera, mirror, p, d):
    """Points and directions in front of the array of rays that reach a mirror: "sensor", "curved" or "flat"."""
    array, z = camera.microlenses, camera.stop_to_microlenses
    sensor = np.eye(3) if camera.sensor_placement is None else camera.sensor_placement.rotation
    normal = sensor[:, 2]
    if array.model is pl.optics.MicrolensModel.THIN:
        for way in (1.0, -1.0):
            p = to_plane(p, d, z)
            slope = d[:, :2] / (way * d[:, 2:]) - (p[:, :2] - PITCH * np.round(p[:, :2] / PITCH)) / FOCAL
            d = np.column_stack([slope, np.full(len(p), way)]) / np.hypot(1.0, np.hypot(*slope.T))[:, None]
            if way > 0:
                p = p + (((0.0, 0.0, camera.z_sensor) - p) @ normal / (d @ normal))[:, None] * d
                d = turn_back(d, normal)
        return p, d
    first = z if array.convex_side is SIDES.SCENE else z - THICKNESS / INDEX
    kinds = ["curved", "flat"] if array.convex_side is SIDES.SCENE else ["flat", "curved"]
    vertices, axis = [first, first + THICKNESS], np.array([0.0, 0.0, 1.0])

    def meet(kind, p, d):
        if kind == "curved":
            return to_sphere(p, d, vertices[kinds.index(kind)], array.convex_side)
        return to_plane(p, d, vertices[kinds.index(kind)]), np.broadcast_to(axis, p.shape)

    turn = kinds.index(mirror) if mirror in kinds else 2
    indices = [1.0, INDEX, 1.0]
    for k in range(turn):
        p, n = meet(kinds[k], p, d)
        d = bend(d, n, indices[k], indices[k + 1])
    if turn == 2:
        p = p + (((0.0, 0.0, camera.z_sensor) - p) @ normal / (d @ normal))[:, None] * d
        d = turn_back(d, normal)
    else:
        p, n = meet(kinds[turn], p, d)
        d = turn_back(d, n)
    for k in range(turn - 1, -1, -1):
        p, n = meet(kinds[k], p, d)
        d = bend(d, n, indices[k + 1], indices[k])
    return p, d


def reflected(camera, mirror, p, d, direction):
    """The same by the unfolded passage: rays that arrive, and the ratio of their weights."""
    ghosts = pl.rendering.Ghosts(sensor=0.5) if mirror == "sensor" else pl.rendering.Ghosts(array=0.5)
    found = array_reflections(camera, ghosts, (camera.wavelength,))
    reflection = found[0] if mirror != "flat" else found[-1]
    assert (reflection.mirror is None) == (mirror == "curved")
    z, lens = 7.0, lens_record(camera.lens, camera.wavelength, reverse=direction < 0)
    axis = np.array([1.0, 1.0, direction])
    rows = np.column_stack([p * axis, d * axis, np.ones(len(p)), np.zeros(len(p))])
    rows[:, 2] += z - direction * camera.stop_to_microlenses
    blocks = np.ascontiguousarray(rows.reshape(-1, BLOCK, 8).transpose(0, 2, 1))
    fill_reflection(blocks.reshape(-1), Detour(reflection, z, lens), 0)
    rows = blocks.transpose(0, 2, 1).reshape(-1, 8)
    assert np.all(rows[:, 7][rows[:, 6] > 0] == 0)
    q, e = rows[:, :3].copy(), rows[:, 3:6]
    # The stack goes on in the mirror image for light that travels forwards.
    q[:, 2] = camera.stop_to_microlenses - direction * (q[:, 2] - z)
    return q, e * (1.0, 1.0, -direction), rows[:, 6]


CASES = [
    (pl.optics.MicrolensModel.THIN, SIDES.SCENE, "sensor", {}),
    (pl.optics.MicrolensModel.SPHERICAL, SIDES.SCENE, "sensor", {}),
    (pl.optics.MicrolensModel.SPHERICAL, SIDES.SENSOR, "sensor", {}),
    (pl.optics.MicrolensModel.SPHERICAL, SIDES.SCENE, "flat", {}),
    (pl.optics.MicrolensModel.SPHERICAL, SIDES.SCENE, "curved", {}),
    (pl.optics.MicrolensModel.SPHERICAL, SIDES.SENSOR, "curved", {}),
    # Lenses from a table, of no deviation.
    (
        pl.optics.MicrolensModel.SPHERICAL,
        SIDES.SENSOR,
        "curved",
        {"imperfections": pl.MicrolensImperfections(focal_length_spread=1e-15)},
    ),
]


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("model, side, mirror, options", CASES)
def test_rays_return_from_mirrors_behind_microlenses(model, side, mirror, options, direction):
    camera = camera_of(model, side, **options)
    if mirror == "sensor":
        camera = camera.moved(pl.CameraPart.SENSOR, tilt=(0.1, -0.05, 0.0))
    random, n = np.random.default_rng(2), 8 * BLOCK
    slope = random.uniform(-0.25, 0.25, (n, 2))
    d = np.column_stack([slope, np.ones(n)]) / np.hypot(1.0, np.hypot(*slope.T))[:, None]
    p = np.column_stack([random.uniform(-1.0, 1.0, (n, 2)), np.full(n, 100.0)]) - 20.0 * d
    expected, ahead = by_surfaces(camera, mirror, p, d)
    points, directions, weights = reflected(camera, mirror, p, d, direction)
    # Rays that miss their lens on one way are lost in both traces, but for those within rounding of an edge.
    lit = weights > 0
    assert np.count_nonzero(lit ^ (np.isfinite(ahead).all(axis=1) & (ahead[:, 2] < 0))) <= 0.01 * n
    both = lit & np.isfinite(ahead).all(axis=1)
    assert both.sum() > 0.6 * n
    np.testing.assert_allclose(directions[both], ahead[both], rtol=0, atol=1e-11)
    # Across the rays, of which some leave at grazing angles.
    beside = (points - to_plane(expected, ahead, 100.0)) * np.abs(ahead[:, 2:])
    np.testing.assert_allclose(beside[both], 0.0, rtol=0, atol=1e-11)
    if direction < 0 or model is not pl.optics.MicrolensModel.THIN:
        np.testing.assert_allclose(weights[both], 0.5, rtol=1e-10)


def test_walls_keep_light_in_the_cell_of_its_microlens():
    """On the way back rays are lost whose microlens is another one."""
    random, n = np.random.default_rng(4), 8 * BLOCK
    slope = random.uniform(-0.05, 0.05, (n, 2))
    d = np.column_stack([slope, np.ones(n)]) / np.hypot(1.0, np.hypot(*slope.T))[:, None]
    p = np.column_stack([random.uniform(-1.0, 1.0, (n, 2)), np.full(n, 100.0)])
    lit = []
    for walls in (pl.optics.Walls.NONE, pl.optics.Walls.OPAQUE):
        camera = camera_of(pl.optics.MicrolensModel.THIN, SIDES.SCENE, walls=walls)
        lit.append(reflected(camera, "sensor", p, d, 1.0)[2] > 0)
    cell = np.round(p[:, :2] / PITCH)
    at_lens = slope - (p[:, :2] - PITCH * cell) / FOCAL
    on_sensor, back = (np.round((p[:, :2] + k * GAP * at_lens) / PITCH) for k in (1, 2))
    assert lit[0].all()
    np.testing.assert_array_equal(lit[1], (on_sensor == cell).all(axis=1) & (back == cell).all(axis=1))


def test_paths_of_each_wavelength_meet_microlenses_of_its_index():
    """Rays of several wavelengths at once, and alone with a camera of that wavelength."""
    camera = camera_of(pl.optics.MicrolensModel.SPHERICAL, SIDES.SENSOR)
    array = dataclasses.replace(camera.microlenses, index=1.5, medium=pl.glass("N-SF6"))
    camera = dataclasses.replace(camera, microlenses=array)
    ghosts, colour = pl.rendering.Ghosts(sensor=0.5), pl.sensitivities.linear_srgb()
    colours = colour_tables(colour)
    record = ghost_record(ghost_lens(camera, ghosts), opening_camera(camera), colours)
    assert record.arrays == 1 + record.bands.max() > 2
    random, n = np.random.default_rng(5), 4 * BLOCK
    p = np.column_stack([random.uniform(-2.0, 2.0, (n, 2)), np.full(n, 95.0)])
    target = np.column_stack([random.uniform(-8.0, 8.0, (n, 2)), np.zeros(n)])
    d = (target - p) / np.linalg.norm(target - p, axis=1, keepdims=True)
    rows = np.column_stack([p, d, np.ones(n), np.zeros(n)])

    def traced(record, waves):
        blocks = np.ascontiguousarray(rows.reshape(-1, BLOCK, 8).transpose(0, 2, 1))
        fill_ghost_rays(blocks.reshape(-1), record, np.full(n, len(record.lenses) - 1), waves)
        return blocks.transpose(0, 2, 1).reshape(-1, 8)

    waves = random.integers(len(colours.wavelengths), size=n)
    both, drawn = (
        traced(record._replace(probability=np.ones(len(record.lenses)), aims=None), waves),
        record.bands[waves],
    )
    assert (both[:, 6] > 0).sum() > 100
    for band in (0, record.bands.max()):
        wavelength = float(np.median(colours.wavelengths[record.bands == band]))
        alone = dataclasses.replace(camera, wavelength=wavelength)
        single = ghost_record(ghost_lens(alone, ghosts), opening_camera(alone), None)
        expected = traced(single._replace(probability=np.ones(len(single.lenses)), aims=None), None)
        lit = (drawn == band) & (expected[:, 6] > 0)
        assert lit.sum() > 10
        np.testing.assert_allclose(both[lit, :6], expected[lit, :6], rtol=0, atol=1e-9)
        np.testing.assert_allclose(both[lit, 6], expected[lit, 6], rtol=1e-6)  # tables for one and for many


def test_coated_microlenses_take_light_on_both_ways():
    """Along the axis in closed form: four sides on the way to the sensor and back, the front one twice to the rear."""
    p, d = np.tile((0.0, 0.0, 100.0), (BLOCK, 1)), np.tile((0.0, 0.0, 1.0), (BLOCK, 1))
    side = 1.0 - ((INDEX - 1.0) / (INDEX + 1.0)) ** 2
    model = pl.optics.MicrolensModel.SPHERICAL
    for convex, mirror, sides in (
        (SIDES.SCENE, "sensor", 4),
        (SIDES.SENSOR, "sensor", 4),
        (SIDES.SCENE, "flat", 2),
        (SIDES.SENSOR, "curved", 2),
        (SIDES.SCENE, "curved", 0),
    ):
        camera = camera_of(model, convex, coating=pl.optics.Coating())
        _, _, weights = reflected(camera, mirror, p, d, -1.0)
        np.testing.assert_allclose(weights, 0.5 * side**sides, rtol=1e-6)
        # The glass takes light on both ways, too.
        medium = pl.optics.AbsorbingGlass(pl.ConstantMedium(INDEX), [400.0, 700.0], [0.7, 0.7], thickness=THICKNESS)
        array = dataclasses.replace(camera.microlenses, medium=medium)
        _, _, weights = reflected(dataclasses.replace(camera, microlenses=array), mirror, p, d, -1.0)
        np.testing.assert_allclose(weights, 0.5 * side**sides * 0.7 ** (2 if sides else 0), rtol=1e-6)

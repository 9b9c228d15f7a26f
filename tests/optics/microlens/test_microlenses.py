import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import plenoptic as pl
from plenoptic.core.kernels.ray_blocks import BLOCK
from plenoptic.optics.microlens.kernels.ideal_microlenses import fill_pinholes, fill_thin
from plenoptic.optics.microlens.kernels.plano_convex import fill_plano_convex
from plenoptic.optics.microlens.kernels.to_lens import fill_straight
from plenoptic.optics.microlens.microlens_record import SensorPlane, array_record, lone_lens
from plenoptic.optics.microlens.model_records import ArrayCrossing

EPS = np.finfo(float).eps
REGULAR = [pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR]
SPHERICAL, FLAT = pl.optics.MicrolensModel.SPHERICAL, pl.optics.MicrolensModel.FLAT_HIGH_INDEX
RECTANGULAR, FREE = pl.Lattice.RECTANGULAR, pl.Lattice.FREE


def array_of(pitch, lattice):
    """An array of thin lenses; rectangular ones are 1.25 times as wide as high."""
    both = (1.25 * pitch, pitch) if lattice is pl.Lattice.RECTANGULAR else pitch
    return pl.MicrolensArray(pitch=both, focal_lengths=(2.0,), lattice=lattice)


def fill_uncut(blocks, array, distance, z_array):
    """Plates of which each lens goes on for ever."""
    lens = lone_lens(array, 1.0 / array.focal_length, 587.6)
    array.model.refraction.to_lens(blocks, None, ArrayCrossing(lens, SensorPlane(distance, None), z_array), None)


def fill_cut(blocks, array, distance, z_array):
    """Plates whose lenses end at their cells."""
    record = array_record(array, turn=np.eye(2), origin=np.zeros(2), reach=1.0, margin=0.0)
    plane, power = SensorPlane(distance, None), 1.0 / array.focal_length
    fill_plano_convex(blocks, None, plane, record.model, power, record.edges, z_array, None)


def plano_convex(side, **changes):
    given_fields = {"pitch": 0.2, "focal_lengths": (2.0,), "thickness": 0.3, "index": 1.5} | changes
    return pl.MicrolensArray(model=SPHERICAL, convex_side=side, **given_fields)


def all_centres(array, around=4):
    i, j = np.mgrid[-around : around + 1, -around : around + 1]
    return np.stack([i.ravel(), j.ravel()], axis=1) @ array.basis


@settings(max_examples=20)
@given(lattice=st.sampled_from(REGULAR), seed=st.integers(0, 1000))
def test_cells_are_what_is_nearest(lattice, seed):
    array = array_of(0.217, lattice)
    area = {pl.Lattice.HEXAGONAL: math.sqrt(3) / 2, pl.Lattice.SQUARE: 1.0, RECTANGULAR: 1.25}[lattice]
    assert array.cell_area == pytest.approx(area * 0.217**2, rel=16 * EPS)
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (500, 2))
    centres = all_centres(array)
    distance = np.linalg.norm(points[:, None] - centres, axis=2)
    nearest = centres[distance.argmin(axis=1)]
    # Where two centres are equally near, rounding decides.
    clear = np.diff(np.sort(distance, axis=1)[:, :2], axis=1)[:, 0] > 1e-12
    assert array.nearest(points)[clear] == pytest.approx(nearest[clear], abs=1e-14)
    # The edges hold exactly the points that are nearer to the centre than to any other: the Voronoi cell.
    inside = np.all(points @ array.cell_edges[:, :2].T <= array.cell_edges[:, 2], axis=1)
    assert np.array_equal(inside[clear], (np.abs(nearest).max(axis=1) < 1e-12)[clear])


def test_impossible_arrays():
    model, centres = pl.optics.MicrolensModel, {"lattice": FREE, "centres": [(0, 1)]}
    clear = pl.optics.MicrolensAperture(fill_factor=0.5, gaps=pl.optics.Gaps.CLEAR)
    for changes, message in (
        ({"focal_lengths": ()}, "focal_lengths is ..; give one in mm for each type"),
        ({"lattice": RECTANGULAR, "pitch": (1.0, -2.0)}, "pitch along y is -2 mm; it must be above 0"),
        ({"lattice": FREE, "centres": np.zeros((0, 2))}, "centres is empty"),
        ({"lattice": FREE, "centres": [(0, 1), (2, 0), (0, 1)]}, "centres lists a place twice"),
        ({**centres, "pattern": [[0]]}, "pattern is given for the lattice FREE; list types"),
        ({**centres, "types": [0, 0]}, r"types has shape \(2,\); it must have shape \(1,\)"),
        ({**centres, "types": [1]}, "types holds types outside 0 to 0"),
        ({"types": [0]}, "types is given for the lattice HEXAGONAL"),
        ({"model": model.PINHOLE, "aperture": clear}, "light passes a PINHOLE only at its centre"),
        ({"model": model.FLAT_HIGH_INDEX, "index": 1.5}, "give index=100.0, or choose SPHERICAL"),
        ({"thickness": 0.0}, "thickness of the microlenses is 0 mm; it must be above 0"),
        ({"index": 1.0}, "index of the microlenses is 1.0; it must be above 1"),
        ({"model": SPHERICAL, "focal_lengths": (-2.0,)}, "focal length -2 mm: a plano-convex microlens collects light"),
        ({"model": SPHERICAL, "focal_lengths": (0.2,)}, "radius of curvature 0.1 mm is below the corner .* at 0.115"),
        ({"model": SPHERICAL, "focal_lengths": (0.3,), "thickness": 0.03}, "thickness 0.03 mm is below the sag"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            pl.MicrolensArray(**({"pitch": 0.2, "focal_lengths": (2.0,)} | changes))


def test_principal_planes():
    assert array_of(0.2, pl.Lattice.SQUARE).principal_separation == 0
    for side in pl.optics.ConvexSide:
        # d (1 - 1/n), two roundings.
        array = plano_convex(side)
        assert array.principal_separation == pytest.approx(0.3 / 3, rel=4 * EPS) and array.radius == 1.0
        assert array == plano_convex(side, focal_lengths=[2]) == plano_convex(side, focal_lengths=2.0)
    for item in (array.basis, array.cell_edges, array.cell_corners):
        assert not item.flags.writeable


def as_blocks(points, sensor, centres, weight):
    """Aimed samples as `to_lens` wants them."""
    n = len(points)
    rows = np.zeros((8, -(-n // BLOCK) * BLOCK))
    columns = points, centres[:, 0], points - sensor, centres[:, 1], np.full(n, weight), np.zeros(n)
    rows[:, :n] = np.column_stack(columns).T
    return np.ascontiguousarray(rows.reshape(8, -1, BLOCK).transpose(1, 0, 2)).reshape(-1)


def from_blocks(blocks, n):
    """Points, directions, weights and statuses."""
    rows = blocks.reshape(-1, 8, BLOCK).transpose(1, 0, 2).reshape(8, -1)[:, :n]
    return rows[:3].T, rows[3:6].T, rows[6], rows[7]


def aimed(array, n, *, height, slope, distance):
    """Random points of three cells and sensor points below them."""
    rng = np.random.default_rng(8)
    centres = (rng.integers(-2, 3, (n, 2)) @ array.basis) * 1.0
    points = centres + rng.uniform(-height, height, (n, 2))
    sensor = points + rng.uniform(-slope, slope, (n, 2)) * distance
    return points, sensor, centres


def test_exact_microlenses_are_lenses_of_two_surfaces():
    for side in pl.optics.ConvexSide:
        array = plano_convex(side)
        distance, z_array, n = 1.7, 123.3, 1000
        points, sensor, centres = aimed(array, n, height=0.1, slope=0.3, distance=distance)
        blocks = as_blocks(points, sensor, centres, 1.0)
        fill_uncut(blocks, array, distance, z_array)
        origins, along, _, status = from_blocks(blocks, n)

        glass = pl.ConstantMedium(array.index)
        wide = {"semi_diameter": 0.9}
        if side is pl.optics.ConvexSide.SCENE:
            z_first, z_rear = z_array, z_array + array.principal_separation
            surfaces = [pl.Surface(array.radius, array.thickness, glass, **wide), pl.Surface(math.inf, **wide)]
        else:
            z_first = z_array - array.thickness / array.index
            z_rear = z_first + array.thickness
            surfaces = [pl.Surface(math.inf, array.thickness, glass, **wide), pl.Surface(-array.radius, **wide)]
        # A lens's frame starts at its stop: 100 mm before the array.
        lens = pl.LensStack([pl.CircularStop(1e3, 100.0), *surfaces])
        start = np.column_stack([sensor - centres, np.full(n, z_rear - z_first + 100 + distance)])
        aim = np.column_stack([points - centres, np.full(n, z_rear - z_first + 100)])
        out = lens.trace_reverse(pl.RayBundle(start, aim - start))
        assert np.all(status == 0) and np.all(out.status == 0), side
        # Slopes are good to a few eps of what they are computed from: sensor points and aims of 1 mm, 1.7 mm apart;
        # heights on the stop, 100 mm on, to as much times 100 mm.
        assert np.abs(along - out.direction).max() <= 32 * EPS, side
        t = (z_first - 100 - origins[:, 2]) / along[:, 2]
        on_stop = origins[:, :2] + t[:, None] * along[:, :2] - centres
        assert np.abs(on_stop - out.origin[:, :2]).max() <= 32 * EPS * 100, side


def test_thin_microlenses_bend_by_height_over_focal_length():
    array = array_of(0.2, pl.Lattice.HEXAGONAL)
    points, sensor, centres = aimed(array, 300, height=0.1, slope=0.3, distance=1.7)
    blocks = as_blocks(points, sensor, centres, 2.5)
    fill_thin(blocks, None, SensorPlane(1.7, None), 1 / 2.0, 123.3, None, None)
    origins, along, weight, status = from_blocks(blocks, 300)
    assert np.array_equal(origins, np.column_stack([points, np.full(300, 123.3)])) and np.all(status == 0)
    bent = (points - sensor) / 1.7 - (points - centres) / 2.0
    assert np.abs(along[:, :2] / -along[:, 2:] - bent).max() <= 8 * EPS
    assert np.abs(np.linalg.norm(along, axis=1) - 1).max() <= 4 * EPS
    # Projected solid angle of an area A at distance r under cos: A cos^2 / r^2 = A cos^4 / b^2.
    cos = 1.7 / np.sqrt(((points - sensor) ** 2).sum(axis=1) + 1.7**2)
    assert weight == pytest.approx(2.5 * cos**4 / 1.7**2, rel=16 * EPS)
    # Pinholes let light through their centres, as bright as an open cell.
    blocks = as_blocks(points, sensor, centres, 2.5)
    fill_pinholes(blocks, SensorPlane(1.7, None), 123.3)
    origins, along, through, status = from_blocks(blocks, 300)
    assert np.array_equal(origins, np.column_stack([centres, np.full(300, 123.3)])) and np.all(status == 0)
    assert np.abs(along[:, :2] / -along[:, 2:] - (centres - sensor) / 1.7).max() <= 8 * EPS
    assert np.array_equal(through, weight)


def test_without_microlenses_rays_go_straight_on():
    points, sensor, centres = aimed(array_of(0.2, pl.Lattice.SQUARE), 300, height=2.0, slope=0.3, distance=90.0)
    blocks = as_blocks(points, sensor, centres, 1.0)
    fill_straight(blocks, SensorPlane(90.0, None), 30.3)
    origins, along, weight, _ = from_blocks(blocks, 300)
    assert np.array_equal(origins[:, :2], points) and np.all(origins[:, 2] == 30.3)
    vectors = np.column_stack([points - sensor, np.full(300, -90.0)])
    length = np.linalg.norm(vectors, axis=1)
    assert np.abs(along - vectors / length[:, None]).max() <= 4 * EPS
    assert weight == pytest.approx(90.0**2 / length**4, rel=16 * EPS)


def test_rays_beside_their_own_sphere_are_another_microlens_s():
    for side in pl.optics.ConvexSide:
        array = plano_convex(side, pitch=0.6, thickness=0.3, focal_lengths=(2.0,))
        points, sensor, centres = aimed(array, 2000, height=0.35, slope=0.3, distance=1.7)
        n = len(points)
        with_edges, without = (as_blocks(points, sensor, centres, 1.0) for _ in range(2))
        fill_cut(with_edges, array, 1.7, 40.0)
        fill_uncut(without, array, 1.7, 40.0)
        origins, along, _, status = from_blocks(with_edges, n)
        free_found, free_along, _, free_status = from_blocks(without, n)
        assert np.array_equal(origins, free_found) and np.array_equal(along, free_along), side
        assert np.all(free_status == 0), side
        assert set(status.tolist()) == {0.0, float(pl.RayStatus.OUTSIDE_MICROLENS)}, side
        if side is pl.optics.ConvexSide.SCENE:
            # The curved side is met last: rays end on it.
            on_sphere = origins[:, :2] - centres
        else:
            # It is met first, on the straight line from the sensor. A height w above its vertex, which is the aim's
            # plane, the line has moved by u w; the sphere bulges to the sensor: |start + u w|^2 + (w - R)^2 = R^2.
            u, start = (points - sensor) / 1.7, points - centres
            a, b, c = 1 + (u**2).sum(axis=1), array.radius - (start * u).sum(axis=1), (start**2).sum(axis=1)
            w = c / (b + np.sqrt(b * b - a * c))
            on_sphere = start + u * w[:, None]
        inside = np.all(on_sphere @ array.cell_edges[:, :2].T <= array.cell_edges[:, 2], axis=1)
        margin = np.abs((on_sphere @ array.cell_edges[:, :2].T - array.cell_edges[:, 2]).max(axis=1)) > 1e-12
        assert np.array_equal((status == 0)[margin], inside[margin]), side


def test_a_flat_plate_has_the_cells_of_its_curved_side():
    for side in pl.optics.ConvexSide:
        array = pl.MicrolensArray(0.2, (2.0,), model=FLAT, index=100.0, thickness=0.1, convex_side=side)
        points, sensor, centres = aimed(array, 4000, height=0.2, slope=0.1, distance=1.7)
        blocks = as_blocks(points, sensor, centres, 1.0)
        fill_cut(blocks, array, 1.7, 123.3)
        status = from_blocks(blocks, 4000)[3]
        inside = np.all((points - centres) @ array.cell_edges[:, :2].T <= array.cell_edges[:, 2], axis=1)
        # On the sensor's side the curved plane is the plane of aims; on the other, thickness / n = 1e-3 mm away.
        near = np.abs(((points - centres) @ array.cell_edges[:, :2].T).max(axis=1) - 0.1) < 2e-3
        assert np.array_equal((status == 0)[~near], inside[~near]), side
        assert np.all(status[~inside & ~near] == pl.RayStatus.OUTSIDE_MICROLENS), side

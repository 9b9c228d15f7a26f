from collections import Counter

import numpy as np
import pytest
from scene_helpers import area, area_vectors, corners_of

from plenoptic import targets
from plenoptic.errors import InvalidValueError
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.emissive import Emissive
from plenoptic.scene.shapes.targets.target import Target

EPS = np.finfo(np.float64).eps


def regular_polygon(sides, radius):
    return sides / 2 * np.sin(2 * np.pi / sides) * radius**2


USAF = targets.usaf_1951(range(-1, 5), scale=2.0, margin=3.0)


def with_areas(chart):
    """A chart, the area of its board and that of its bars: six of 5 w by w for each element."""
    return chart, np.prod(np.ptp(chart.meshes[1].bounds, axis=0)[:2]), np.sum(30 * (0.5 / chart.frequencies) ** 2)


MARKED = targets.marked_checkerboard(6, 5, square=2.0, margin=0.5)

CASES = {
    # target: area of all, area of what is dark
    "board": (targets.checkerboard(5, 4, square=1.5), 45.0, 22.5),
    "board with margin": (targets.checkerboard(5, 3, square=2.0, margin=0.7), 11.4 * 7.4, 8 * 4.0),
    # Nine marks lie in dark squares and five in bright ones; six and three.
    "marked board": (MARKED, 13.0 * 11.0, 60.0 - 4 * np.pi * 0.3**2),
    "marked board without margin": (targets.marked_checkerboard(4, 4, square=1.0), 16.0, 8.0 - 3 * np.pi * 0.15**2),
    "dots": (targets.point_grid(4, 3, pitch=1.7, radius=0.4, sides=30), 12 * 1.7**2, 12 * np.pi * 0.16),
    "square dots": (targets.point_grid(1, 2, pitch=2.0, radius=0.7, sides=4), 8.0, 2 * np.pi * 0.49),
    "dots of five sides": (targets.point_grid(2, 1, pitch=2.0, radius=0.7, sides=5), 8.0, 2 * np.pi * 0.49),
    "star": (targets.siemens_star(3.0, 7), regular_polygon(14, 3.0), regular_polygon(14, 3.0) / 2),
    "star on a square": (targets.siemens_star(3.0, 8, margin=0.5), 49.0, regular_polygon(16, 3.0) / 2),
    # Half of 3^2 - 1^2 is 2^2.
    "star with a hole": (targets.siemens_star(3.0, 9, inner_radius=1.0, margin=0.5), 49.0, regular_polygon(18, 2.0)),
    "edge": (targets.slanted_edge(10.0, angle_deg=-12.0), 100.0, 50.0),
    "USAF": with_areas(USAF),
    "USAF without margin": with_areas(targets.usaf_1951([-2, 0, 1, 9], margin=0.0)),
    "USAF, one group": with_areas(targets.usaf_1951([2])),
}
TARGETS = {name: case[0] for name, case in CASES.items()}


def counted(mesh, points):
    """How many triangles of a mesh each point (n, 2) lies in."""
    corner = corners_of(mesh)[:, :, :2]
    inside = np.ones((len(points), len(mesh.faces)), dtype=bool)
    for k in range(3):
        a, b = corner[:, k], corner[:, (k + 1) % 3]
        from_a = points[:, None] - a
        inside &= (b - a)[:, 0] * from_a[..., 1] - (b - a)[:, 1] * from_a[..., 0] >= 0
    return inside.sum(axis=1)


def is_dark(target, points):
    """Whether points (n, 2) lie on the first mesh; each must lie on exactly one."""
    dark, bright = (counted(mesh, np.atleast_2d(points)) > 0 for mesh in target.meshes)
    assert (dark ^ bright).all()
    return dark


def test_dark_and_bright_have_their_areas_and_triangles_face_the_camera_in_one_plane():
    for name, (target, whole, dark) in CASES.items():
        # Sums of less than 1e4 products, each rounded a few times.
        areas = [area(mesh) for mesh in target.meshes]
        assert (areas[0], sum(areas)) == pytest.approx((dark, whole), rel=1e4 * EPS), name
        for mesh in target.meshes:
            assert (area_vectors(mesh)[:, 2] > 0).all() and not mesh.vertices[:, 2].any(), name
            assert len(np.unique(mesh.faces)) == len(mesh.vertices), name


def test_triangles_share_whole_edges_so_that_nothing_can_crack():
    """With the areas: every point lies in exactly one triangle."""
    for name, (target, whole, _) in CASES.items():
        edges = Counter()
        for corners in np.concatenate([corners_of(mesh)[:, :, :2] for mesh in target.meshes]):
            a, b, c = map(tuple, corners)
            edges.update([(a, b), (b, c), (c, a)])
        assert set(edges.values()) == {1}, name
        rim = [edge for edge in edges if edge[::-1] not in edges]
        # What has no neighbour is the outline: a chain around everything, and no more.
        assert Counter(a for a, _ in rim) == Counter(b for _, b in rim), name
        corners = np.array(rim)
        enclosed = 0.5 * np.sum(corners[:, 0, 0] * corners[:, 1, 1] - corners[:, 1, 0] * corners[:, 0, 1])
        assert enclosed == pytest.approx(whole, rel=1e4 * EPS), name
        at_end = np.abs(corners).max(axis=2) >= np.abs(corners).max(axis=(0, 1)).min() - 1e-9
        assert name == "star" or at_end.all(), name


def test_corners_are_where_four_squares_meet():
    board = TARGETS["board"]
    assert len(board.points) == 12 and board.index.tolist()[:5] == [[0, 0], [0, 1], [0, 2], [0, 3], [1, 0]]
    np.testing.assert_array_equal(board.points[:, 0], 1.5 * (board.index[:, 1] - 1.5))
    np.testing.assert_array_equal(board.points[:, 1], 1.5 * (1.0 - board.index[:, 0]))
    assert set(map(tuple, board.points)) <= set(map(tuple, board.meshes[0].vertices))
    step = 1e-9
    # Upper left of the first corner lies the dark first square.
    for (x, y, _), parity in zip(board.points, board.index.sum(axis=1) % 2 == 0, strict=True):
        around = [(x - step, y + step), (x + step, y - step), (x + step, y + step), (x - step, y - step)]
        assert is_dark(board, around).tolist() == [parity, parity, not parity, not parity]


def test_marks_are_in_the_middle_of_squares():
    board = MARKED
    row, column = np.indices(board.marks.shape)
    middles = np.stack([2.0 * (column - 2.5), 2.0 * (2.0 - row)], axis=-1).reshape(-1, 2)
    colour = ((row + column) % 2 == 0).ravel()
    # The polygon of 16 sides lies within (pi / 16)^2 of its circle.
    for radius, is_mark in ((0.0, True), (0.95 * 0.3, True), (1.05 * 0.3, False)):
        for angle in (0.1, 1.3, 2.9, 4.4):
            points = middles + radius * np.array([np.cos(angle), np.sin(angle)])
            assert (is_dark(board, points) == colour ^ (is_mark & board.marks.ravel())).all()
    np.testing.assert_array_equal(board.points, targets.checkerboard(6, 5, square=2.0).points)
    assert (
        board.rotated_deg((0, 1, 0), 25).marks is board.marks and targets.checkerboard(6, 5, square=2.0).marks is None
    )


def test_any_four_by_four_squares_of_a_marked_board_differ_from_all_others():
    """In all turns that bring dark squares to dark ones: bits of neighbours differ in 1, of small boards in 2 and 3."""
    marks = targets.marked_checkerboard(64, 64, square=1.0).marks
    for size, least in ((15, 3), (29, 2), (64, 1)):
        windows = np.lib.stride_tricks.sliding_window_view(marks[:size, :size], (4, 4))
        dark = np.indices(windows.shape[:2]).sum(axis=0).ravel() % 2
        flat = windows.reshape(-1, 4, 4)
        assert flat.sum(axis=(1, 2)).min() >= 4 and flat.sum(axis=(1, 2)).max() <= 12
        # A quarter turn of an even window changes the colour of its upper left square.
        turns = [(np.rot90(flat, turn, (1, 2)).reshape(-1, 16), (dark + turn) % 2) for turn in range(4)]
        signs = [np.column_stack([1.0 - 2.0 * bits, 16.0 * (1.0 - 2.0 * colour)]) for bits, colour in turns]
        for turn, other in enumerate(signs):
            alike = signs[0].astype(np.float32) @ other.T.astype(np.float32)
            if turn == 0:
                np.fill_diagonal(alike, -np.inf)
            # Bits that agree less those that differ, 16 - 2 d; other colours are 512 less.
            assert alike.max() - 256 <= 16 - 2 * least, (size, turn)


def test_dots_are_round_their_points():
    dots = TARGETS["dots"]
    angle = np.linspace(0, 2 * np.pi, 17)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # The rim of a polygon of n sides of the area of a circle lies within (pi / n)^2 of it.
    near, far = 0.4 * (1 - (np.pi / 30) ** 2), 0.4 * (1 + (np.pi / 30) ** 2)
    for centre in dots.points[:, :2]:
        assert is_dark(dots, centre + near * ring).all() and not is_dark(dots, centre + far * ring).any()
    assert dots.points[0].tolist() == pytest.approx([-1.5 * 1.7, 1.7, 0]) and dots.index[-1].tolist() == [2, 3]


def test_spokes_change_at_their_known_edges():
    for name, inner in (("star", 0.0), ("star on a square", 0.0), ("star with a hole", 1.0)):
        star = TARGETS[name]
        assert star.points[0].tolist() == [0, 0, 0] and star.index[0].tolist() == [0, 0]
        ends = star.points[star.index[:, 0] == star.index[:, 0].max(), :2]
        np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 3.0, rtol=4 * EPS)
        sideways = ends[:, ::-1] * [-1, 1]
        for share in (max(inner / 3.0, 0.1) * 1.01, 0.6, 0.9):
            after, before = is_dark(star, share * ends + 1e-9 * sideways), is_dark(star, share * ends - 1e-9 * sideways)
            assert after[::2].all() and not after[1::2].any() and (before != after).all(), name
        if inner:
            np.testing.assert_allclose(star.points[star.index[:, 0] == 1, :2], ends / 3.0, atol=4 * EPS)
            assert not is_dark(star, 0.9 * inner / 3.0 * ends).any()


def test_an_edge_is_straight_from_end_to_end():
    for angle in (0.0, 5.0, -30.0):
        edge = targets.slanted_edge(8.0, angle_deg=angle)
        upper, lower = edge.points
        assert (upper[1], lower[1]) == (4.0, -4.0) and (upper + lower == 0).all()
        assert np.degrees(np.arctan2(-upper[0], upper[1])) == pytest.approx(angle, abs=1e-12)
        along = lower[:2] + np.linspace(0.01, 0.99, 50)[:, None] * (upper - lower)[:2]
        beside = np.array([1e-12, 0.0])
        assert is_dark(edge, along - beside).all() and not is_dark(edge, along + beside).any(), angle


def test_bars_are_as_wide_as_their_frequency_says():
    assert USAF.frequencies[0] == 0.25
    for (x, y, _), frequency in zip(USAF.points, USAF.frequencies, strict=True):
        w, near = 0.5 / frequency, 0.5 - 1e-6
        # A gap, three bars with gaps between them, a gap: just inside both ends of each.
        across = (np.arange(-3, 4)[:, None] + [-near, near]).ravel() * w
        bar = np.repeat([False, True, False, True, False, True, False], 2)
        along = np.array([-2.5 - 1e-6, -2.5 + 1e-6, 2.5 - 1e-6, 2.5 + 1e-6]) * w
        upright, lying = np.array([x - 3.5 * w, y]), np.array([x + 3.5 * w, y])
        for middle, turn in ((upright, np.eye(2)), (lying, np.eye(2)[::-1])):
            # Beside the middle, where triangles meet.
            assert (is_dark(USAF, middle + across[:, None] * turn[0] + 0.3 * w * turn[1]) == bar).all()
            for offset in (-2.2, 0.3, 2.1):
                ends = middle + along[:, None] * turn[1] + offset * w * turn[0]
                assert is_dark(USAF, ends).tolist() == [False, True, True, False]
    # From tables of the chart, rounded.
    for group, element, frequency in ((-2, 1, 0.250), (-1, 2, 0.561), (0, 4, 1.41), (1, 6, 3.56), (7, 6, 228.1)):
        chart = targets.usaf_1951([group])
        (row,) = np.flatnonzero((chart.index == [group, element]).all(axis=1))
        assert chart.frequencies[row] == pytest.approx(frequency, rel=3e-3), group
        assert targets.usaf_1951([group], scale=4.0).frequencies[row] == chart.frequencies[row] / 4


def test_random_dots_lie_where_their_points_say():
    board = targets.random_dots(40, 30, dot=0.25, density=0.3, seed=7, dark=(0.1, 0.0, 0.0), bright=0.9)
    (mesh,) = board.meshes
    texels = mesh.material.albedo.texels
    assert texels.shape == (30, 40, 3) and mesh.bounds.tolist() == [[-5, -3.75, 0], [5, 3.75, 0]]
    # The picture's corners: uv (0, 1), the upper left one, at -x, +y.
    (upper_left,) = np.flatnonzero((mesh.uv == [0, 1]).all(axis=1))
    assert mesh.vertices[upper_left].tolist() == [-5, 3.75, 0]
    column, row = ((board.points[:, 0] + 5) / 0.25, (3.75 - board.points[:, 1]) / 0.25)
    np.testing.assert_allclose(np.stack([row, column], axis=1), board.index + 0.5, atol=1e-12)
    dark = np.zeros((30, 40), dtype=bool)
    dark[tuple(board.index.T)] = True
    np.testing.assert_array_equal(texels, np.where(dark[..., None], [0.1, 0, 0], 0.9).astype(np.float32))
    # They have their density.
    n = 300
    dark = targets.random_dots(n, n, dot=0.1, density=0.3, seed=1).meshes[0].material.albedo.texels[..., 0] < 0.5
    # Four standard errors of n^2 draws, and of n (n - 1) products of neighbours.
    assert abs(dark.mean() - 0.3) < 4 * np.sqrt(0.3 * 0.7 / n**2)
    assert abs(np.mean((dark[1:] - 0.3) * (dark[:-1] - 0.3))) < 4 * 0.3 * 0.7 / n
    assert [len(targets.random_dots(4, 4, dot=1, density=density).points) for density in (0, 1)] == [0, 16]
    # Regression: PCG64 of seed 0, whose raw numbers NumPy promises to keep.
    expected = [[0, 1], [0, 2], [0, 3], [1, 3], [1, 5], [1, 7]]
    assert targets.random_dots(8, 2, dot=1.0).index.tolist() == expected


MOVES = [
    lambda t: t.translated(1.5, -2.0, -404.0),
    lambda t: t.rotated((1.0, 2.0, -0.5), 0.7),
    lambda t: t.rotated_deg((0, 1, 0), 25).translated(z=-404),
    lambda t: t.transformed([[0, -3, 0, 1], [3, 0, 0, 2], [0, 0, -3, 5], [0, 0, 0, 1]]),
]


def test_meshes_and_points_move_together():
    for name, moves in (("star with a hole", MOVES), ("USAF", MOVES[1:2]), ("edge", MOVES[3:])):
        target, n = TARGETS[name], len(TARGETS[name].points)
        # A body that has the points among its vertices, and what the target shows.
        bodies = [Mesh(np.vstack([target.points, np.eye(3)]), [[n, n + 1, n + 2]]), *target.meshes]
        for move in moves:
            moved = move(target)
            assert (moved.index is None and target.index is None) or (moved.index == target.index).all()
            expected = [move(body).vertices for body in bodies]
            found = [moved.points, expected[0][n:], *(mesh.vertices for mesh in moved.meshes)]
            np.testing.assert_allclose(np.concatenate(found), np.concatenate(expected), rtol=0, atol=404 * 100 * EPS)
    # Frequencies follow the scale and nothing else.
    chart = TARGETS["USAF, one group"]
    turned = chart.rotated_deg((1, 1, 0), 40).translated(z=-300)
    np.testing.assert_array_equal(turned.frequencies, chart.frequencies)
    matrix = np.eye(4)
    matrix[:3, :3] = 2.5 * np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, -1]])
    np.testing.assert_allclose(chart.transformed(matrix).frequencies, chart.frequencies / 2.5, rtol=1e-14)
    with pytest.raises(InvalidValueError, match="stretches or shears bars of known frequency"):
        chart.transformed(np.diag([1, 2, 1, 1]))
    assert TARGETS["board"].transformed(np.diag([1, 2, 1, 1])).points[0, 1] == 2 * TARGETS["board"].points[0, 1]


def test_materials_are_those_given():
    lamp, black = Emissive(3.0), Emissive(0.0)
    for target in (
        targets.checkerboard(3, 3, square=1.0, dark=lamp, bright=black),
        targets.marked_checkerboard(4, 4, square=1.0, dark=lamp, bright=black),
        targets.point_grid(3, 3, pitch=1.0, radius=0.2, dark=lamp, bright=black),
        targets.siemens_star(1.0, 5, dark=lamp, bright=black),
        targets.slanted_edge(1.0, dark=lamp, bright=black),
        targets.usaf_1951([0], dark=lamp, bright=black),
    ):
        assert [mesh.material for mesh in target.meshes] == [lamp, black]
    assert {mesh.material for mesh in TARGETS["board"].meshes} == {Lambertian(0.05), Lambertian(0.8)}


def test_impossible_targets_are_refused():
    meshes, origin = TARGETS["board"].meshes, [[0, 0, 0]]
    for make, sentence in (
        (lambda: targets.checkerboard(1, 4, square=1), "columns is 1; it must be at least 2"),
        (lambda: targets.checkerboard(4, 4, square=1, margin=-1), "margin is -1 mm; it must be at least 0"),
        (lambda: targets.marked_checkerboard(3, 4, square=1), "columns is 3; it must be at least 4"),
        (lambda: targets.marked_checkerboard(4, 65, square=1), "rows is 65; it must be at most 64"),
        (lambda: Target(meshes, origin, marks=[True]), "marks has shape"),
        (lambda: targets.point_grid(4, 4, pitch=1, radius=0.5), r"reduce radius 0\.5 mm until that is below half"),
        (lambda: targets.point_grid(4, 4, pitch=1, radius=0.1, sides=3), "sides is 3; it must be at least 4"),
        (lambda: targets.random_dots(4, 4, dot=1, density=1.5), "density is 1.5; it must be within 0 and 1"),
        (lambda: targets.siemens_star(1, 1), "spokes is 1; it must be at least 2"),
        (lambda: targets.siemens_star(1, 9, inner_radius=1), "inner_radius is 1 mm; it must be 0 or more, and below"),
        (lambda: targets.slanted_edge(1, angle_deg=45), "angle_deg is 45; it must be within -45 and 45"),
        (lambda: targets.usaf_1951([1, 1]), r"groups are \[1, 1\]; give one or more, each once"),
        (lambda: targets.usaf_1951([11]), "from -10 to 10"),
        (lambda: Target([], np.zeros((1, 3))), "it must be one Mesh or more"),
        (lambda: Target(meshes, origin, index=[[1, 2], [3, 4]]), "index has shape"),
        (lambda: Target(meshes, origin, frequencies=[0.0]), "frequencies hold numbers"),
    ):
        with pytest.raises(InvalidValueError, match=sentence):
            make()

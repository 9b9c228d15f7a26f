"""Scenes from three sides."""

import time

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import plenoptic as pl
from plenoptic.plots.scene import draw_shapes, shapes_of

CAMERA = pl.PlenopticCamera(pl.load_lens("double-gauss-100mm-f2"), pl.Sensor((64, 64), 0.1), 134.6)
X, Y, Z = np.eye(3)


def drawn(scene, camera=None):
    figure = pl.plots.plot_scene(scene, camera, figure=Figure())
    figure.canvas.draw()
    return figure.axes


def covered(scene, right, up):
    """(400, 400): True where a scene is drawn, of 100 mm around the origin."""
    figure = Figure((4.0, 4.0), dpi=100)
    ax = figure.add_axes((0, 0, 1, 1), xlim=(-50, 50), ylim=(-50, 50))
    ax.axis("off")
    draw_shapes(ax, shapes_of(scene), right, up, 1.0)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return (np.asarray(canvas.buffer_rgba())[..., :3] < 255).any(axis=2)


def test_silhouettes_have_the_area_of_what_they_show():
    for right, up, size in ((X, Y, (20, 40)), (-Z, Y, (20, 30)), (-Z, -X, (40, 30))):
        # Four pixels are 1 mm.
        rows, columns = np.ptp(np.argwhere(covered(pl.Scene([pl.box((40, 20, 30))]), right, up)), axis=0) + 1
        assert rows / 4 == pytest.approx(size[0], abs=0.6) and columns / 4 == pytest.approx(size[1], abs=0.6)
    # Fine meshes are as full as coarse ones.
    ball = pl.sphere(40.0)
    assert len(ball.faces) > 6000
    assert covered(pl.Scene([ball]), X, Y).sum() == pytest.approx(np.pi * 160**2, rel=0.03)
    # Up is up and right is right.
    row, column = np.argwhere(covered(pl.Scene([pl.box(10).translated(30, 20, 0)]), X, Y)).mean(axis=0)
    assert row == pytest.approx(119.5, abs=4) and column == pytest.approx(319.5, abs=4)


def test_instances_stand_in_their_places():
    places = np.tile(np.eye(4), (3, 1, 1))
    places[:, 0, 3] = -30.0, 0.0, 30.0
    (shape,) = shapes_of(pl.Scene([pl.scene.Instances(pl.box(4), places)]))
    assert shape.bounds[:, 0].tolist() == [-32.0, 32.0]
    many = np.tile(np.eye(4), (5000, 1, 1))
    assert len(shapes_of(pl.Scene([pl.scene.Instances(pl.sphere(1.0), many)]))[0].triangles) <= 12 * 400


def test_the_front_shows_the_field_of_a_camera():
    scene = pl.Scene([pl.box(600).translated(0, 0, -800)], background=1.0)
    front, right, _ = drawn(scene, CAMERA)
    field = np.ptp(CAMERA.frustum.in_focus[:, 0])
    assert np.ptp(front.get_xlim()) == pytest.approx(2.5 * field)
    low, high = right.get_ylim()
    assert high - low > 600
    for camera in (None, CAMERA):
        assert len(drawn(pl.Scene(background=0.5), camera)) == 3
    with pytest.raises(pl.errors.InvalidValueError, match="camera"):
        drawn(scene, "front")


def test_grounds_are_cut_and_groups_are_not_and_units_go_with_the_size():
    ground = pl.Mesh([[-1e4, 0, -1e4], [1e4, 0, -1e4], [0, 0, 1e4]], [[0, 1, 2]])
    assert np.ptp(drawn(pl.Scene([ground, pl.box(10), pl.box(20)]))[0].get_xlim()) < 50
    assert np.ptp(drawn(pl.Scene([pl.sphere(1000), pl.box(10)]))[0].get_xlim()) > 2000
    small, large = (drawn(pl.Scene([pl.box(size)]))[0] for size in (4.0, 4e6))
    assert small.get_xlabel() == "x / mm" and large.get_xlabel() == "x / km"


def test_a_million_triangles_are_quick():
    n = 708
    i = np.arange(n * n).reshape(n, n)
    corners = [i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[:-1, :-1], i[1:, 1:], i[1:, :-1]]
    faces = np.stack(corners, axis=-1).reshape(-1, 3)
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    scene = pl.Scene([pl.Mesh(np.stack([x, y, x * y], axis=-1).reshape(-1, 3), faces)])
    before = time.thread_time()
    drawn(scene)
    # About 0.5 s on an idle processor; rendering all triangles would take minutes.
    assert time.thread_time() - before < 10.0

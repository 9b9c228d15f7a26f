"""A lens with rays: where the rays run and end, and how it is drawn."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.analysis.layout import layout_fields, ray_paths
from plenoptic.optics.lens.pupil.iris_points import fan
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays
from plenoptic.plots.lens import plot_layout

LENS = pl.load_lens("double-gauss-100mm-f2")


def lines_of(ax, label):
    return next(line for line in ax.lines if line.get_label() == label)


def test_paths_lie_on_the_elements_and_end_where_rays_do():
    rays = aimed_rays(LENS, field=(0.0, 0.25), pupil=0.999 * fan(11))
    out = LENS.trace(rays)
    paths = ray_paths(LENS, rays, z_end=110.0)
    assert paths.shape == (11, len(LENS.elements) + 2, 3)
    for path, status, lost_at in zip(paths, out.status, out.lost_at, strict=True):
        reached = np.flatnonzero(np.isfinite(path[:, 0]))
        # The start, and the elements up to the one at which the ray was clipped, or all and the end.
        assert reached.tolist() == list(range(lost_at + 2 if status else len(LENS.elements) + 2))
        for element, z, point in zip(LENS.elements, LENS.vertices, path[1:], strict=False):
            if np.isfinite(point[0]) and isinstance(element, pl.Surface):
                assert point[2] - z == pytest.approx(element.sag(np.hypot(*point[:2])), abs=1e-12)
    assert paths[:, 0].tolist() == rays.origin.tolist()
    passed = out.status == 0
    assert passed.any() and not passed.all()
    assert paths[passed, -1] == pytest.approx(out.at_z(110.0)[passed], abs=1e-11)


def test_a_tilted_lens_is_drawn_through_its_surfaces():
    lens = pl.load_lens("singlet-100mm-f4").moved(slice(1, 3), tilt=(0.1, 0.0, 0.0))
    rays = pl.RayBundle([[0.0, 3.0, -10.0]], [[0.0, 0.0, 1.0]])
    path = ray_paths(lens, rays, z_end=50.0)[0]
    assert path[3] == pytest.approx(lens.trace(rays).origin[0], abs=1e-12)


def test_fields_that_are_worth_drawing():
    # The data sheets' fields within a few degrees: 42, 170 and 100 degrees in all.
    for name, half in (("double-gauss-100mm-f2", 21.8), ("fisheye-100mm-f8", 85.4), ("topogon-100mm-f6.3", 50.0)):
        lens = pl.load_lens(name)
        found = np.degrees(layout_fields(lens))
        assert found[0] == 0.0 and found[1] == pytest.approx(0.7 * found[2])
        assert found[2] == pytest.approx(half, abs=4.0)
        ax = lens.layout()
        assert len(ax.get_legend().get_texts()) == 3 and ax.get_aspect() == 1.0, name
        ax.figure.canvas.draw()


def test_one_colour_a_field_and_rays_up_to_the_image_plane():
    ax = LENS.layout(fields=[0.0, 0.2], rays=5)
    axis, tilted = lines_of(ax, "0°"), lines_of(ax, "11.5°")
    assert axis.get_color() != tilted.get_color()
    assert np.nanmax(axis.get_xdata()) == pytest.approx(pl.paraxial.image_position(LENS, -math.inf))
    # Parallel rays start on a plane across them.
    start = axis.get_xdata()[:: len(LENS.elements) + 3]
    assert len(start) == 5 and np.ptp(start) < 1e-9


def test_objects_near_and_far():
    # The object is shown where it is near; of one farther away, only the last part of the way.
    near = lines_of(LENS.layout(fields=[5.0], z_object=-45.0), "5 mm")
    assert np.nanmin(near.get_xdata()) == -45.0
    far = lines_of(LENS.layout(fields=[50.0], z_object=-404.0), "50 mm")
    assert -80.0 < np.nanmin(far.get_xdata()) < LENS.vertices[0]
    # Rays that pass beside the lens are not drawn.
    line = lines_of(LENS.layout(fields=[0.45], rays=9), "25.8°")
    assert 0 < len(line.get_xdata()) // (len(LENS.elements) + 3) < 9
    # Without an image plane, rays run on for the length of the lens.
    afocal = LENS.layout(fields=[0.0], z_object=pl.paraxial.cardinal_points(LENS).front_focus)
    assert np.nanmax(lines_of(afocal, "0 mm").get_xdata()) == pytest.approx(LENS.vertices[-1] + LENS.length)
    # The drawing shows the glass, and so the rays through it.
    LENS.with_model(pl.LensModel.PARAXIAL).layout(fields=[0.1])


def test_outlines_of_glass_are_closed():
    ax = plot_layout(LENS, [])
    outlines = [patch.get_path() for patch in ax.patches if patch.get_edgecolor()[3] > 0]
    assert len(outlines) == len(LENS.glasses)
    for path, (i, j) in zip(outlines, LENS.glasses, strict=True):
        top = max(LENS.elements[i].semi_diameter, LENS.elements[j].semi_diameter)
        assert path.vertices[:, 1].max() == top and path.vertices[:, 1].min() == -top
        assert path.vertices[0].tolist() == path.vertices[-1].tolist()


def test_given_axes_are_used_and_what_makes_no_sense_is_refused():
    lens = pl.load_lens("singlet-100mm-f4")
    _, ax = plt.subplots()
    assert lens.layout(fields=[0.0], ax=ax) is ax
    for draw, message in (
        (lambda: plot_layout(lens, [np.zeros((1, 2, 3))], labels=["a", "b"]), "2 labels for 1 fields"),
        (lambda: lens.layout(rays=1), "rays is 1"),
        (lambda: lens.layout(fields=[4.0]), "below pi"),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=message):
            draw()

"""A scene from three sides, with the camera that sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic.core.color.srgb import linear_to_srgb
from plenoptic.core.values import Floats, check_has
from plenoptic.plots.canvas import figure_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.core.rays import Frustum
    from plenoptic.scene.scene import Scene

SIZE = (10.0, 4.4)
"""Inches."""
_X, _Y, _Z = np.eye(3)

_TRIANGLES, _FEWEST = 12_000, 40
"""Triangles of a scene that are drawn, and the least of a mesh."""
_PLACES = 400
"""Instances that are drawn, as boxes where their triangles are too many."""
_BOX = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
                 [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]])  # fmt: skip
_SHADE = 0.5
"""Brightness of faces seen from the edge over that of faces seen from the front."""
_LIGHT, _GLASS = (1.0, 0.83, 0.23), (0.72, 0.90, 0.95)


class _Side(NamedTuple):
    title: str
    right: Floats
    up: Floats
    across: str
    along: str
    place: tuple[slice, int]
    """In a grid of two rows and columns."""


_SIDES = (
    _Side("from the front", _X, _Y, "x", "y", (slice(0, 2), 0)),
    _Side("from the right", -_Z, _Y, "z", "y", (slice(0, 1), 1)),
    _Side("from above", -_Z, -_X, "z", "x", (slice(1, 2), 1)),
)
_CAMERA, _FOCUS, _LAMP = "#1f5fbf", "#d1495b", "#b07a00"
_GROUND = "#eef1f4"
"""On which white and black things can be seen."""
_ROOM = 0.06
"""Margin around the scene, over its size."""
_HUGE, _FLAT = 10.0, 20
"""What is larger than all the rest by more, and has few triangles, is cut: grounds, backdrops, skies."""
_AROUND = 0.75
"""Margin of the front view around the field of the camera in the plane in focus, over its size."""
_UNITS = ((1e6, "km", 1e6), (1e4, "m", 1e3), (0.05, "mm", 1.0), (0.0, "µm", 1e-3))
"""Extent from which on a unit is used, its name, and its length, mm."""


def plot_scene(scene: Scene, camera: PlenopticCamera | None = None, *, figure: Figure | None = None) -> Figure:
    """Draw a scene from three sides, with the view of cameras.

    Parameters
    ----------
    scene : Scene
        Meshes in the colours of their materials, glass pale, lights yellow; the smaller is drawn over the larger. Of
        very many triangles the largest are drawn, and some of the others, enlarged.
    camera : PlenopticCamera, optional
        Its field is drawn to the plane in focus, which is red; those of the scene's `views` always.
    figure : matplotlib.figure.Figure, default: a new one

    Returns
    -------
    matplotlib.figure.Figure
        Three panels in the world's axes: from the front, where a camera is given around its field in the plane in
        focus, from the right and from above. Grounds and backdrops ten times as large as all the rest are cut.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [ax.get_title() for ax in pl.plots.plot_scene(pl.check_scene()).axes]
    ['from the front', 'from the right', 'from above']
    """
    check_has(scene, "scene", "Scene", "pl.Scene([...])", "meshes", "lights", "views")
    if camera is not None:
        check_has(camera, "camera", "PlenopticCamera", "pl.PlenopticCamera(...)", "frustum")
    figure = figure_or_new(figure, SIZE)
    shapes = shapes_of(scene)
    frustums = [view.frustum for view in scene.views] + ([] if camera is None else [camera.frustum])
    lamps = [light for light in scene.lights if hasattr(light, "position")]
    box = _shown(shapes, frustums, lamps)
    middle = (around([shape.bounds for shape in shapes]) if shapes else box).mean(axis=0)
    fields = [_ends(frustum, middle) for frustum in frustums]
    box = around([box, *fields])
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.35), hspace=0.1)
    for side in _SIDES:
        ax, part, drawn = figure.add_subplot(grid[side.place]), box, shapes
        if camera is not None and side.across == "x":
            part = _around_field(frustums[-1], box)
            drawn = shapes if part is box else shapes_of(scene, part[:, :2])
        size = np.ptp(part, axis=0).max()
        unit, scale = next((name, length) for extent, name, length in _UNITS if size >= extent)
        _draw_side(ax, side, drawn, part, scale)
        for frustum, ends in zip(frustums, fields, strict=True):
            _draw_frustum(ax, side, frustum, ends, scale)
        places = np.array([lamp.position for lamp in lamps]).reshape(-1, 3) / scale
        ax.plot(places @ side.right, places @ side.up, "*", color=_LAMP, markersize=9, markeredgecolor="white")
        _name_axes(ax, side, unit)
    return figure


def _shown(shapes: list[Shape], seen: list[Frustum], lamps: list[Any]) -> Floats:
    """(2, 3): box of the displayed part of the world, without the fields of cameras."""
    boxes = [shape.bounds for shape in shapes]
    sizes = np.array([np.ptp(box, axis=0).max() for box in boxes])
    order = np.argsort(sizes, kind="stable").tolist()
    while (
        len(order) > 1 and sizes[order[-1]] > _HUGE * sizes[order[-2]] > 0 and len(shapes[order[-1]].triangles) <= _FLAT
    ):
        del order[-1]
    points = [corner for frustum in seen for corner in (frustum.origins, frustum.in_focus) if corner is not None]
    points += [np.asarray(lamp.position)[None] for lamp in lamps] + [boxes[k] for k in order]
    low, high = around(points or [np.array([-np.ones(3), np.ones(3)])])
    room = _ROOM * (high - low).max() or 1.0
    return np.stack([low - room, high + room])


def _around_field(frustum: Frustum, box: Floats) -> Floats:
    """The box around the field of a camera in the plane in focus, or all of it where that is larger or unknown."""
    if frustum.in_focus is None:
        return box
    low, high = frustum.in_focus.min(axis=0), frustum.in_focus.max(axis=0)
    half = (0.5 + _AROUND) * (high - low).max()
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half]) if half < 0.5 * np.ptp(box, axis=0).max() else box


def _ends(frustum: Frustum, middle: Floats) -> Floats:
    """(4, 3): where rays of a frustum end in the picture: in focus, or as far away as the middle of the scene."""
    if frustum.in_focus is not None:
        return frustum.in_focus
    far = np.linalg.norm(middle - frustum.origins.mean(axis=0)) or 1.0
    return np.asarray(frustum.origins + far * frustum.directions)


def _draw_side(ax: Axes, side: _Side, shapes: list[Shape], box: Floats, unit: float) -> None:
    ends = np.sort(np.stack([box @ side.right, box @ side.up]), axis=1) / unit
    ax.set_facecolor(_GROUND)
    draw_shapes(ax, shapes, side.right, side.up, unit)
    ax.set(xlim=ends[0], ylim=ends[1], aspect="equal")


def _draw_frustum(ax: Axes, side: _Side, frustum: Frustum, far: Floats, unit: float) -> None:
    """Draw the edges of a frustum, the plane in focus, and the camera."""
    across = np.stack([side.right, side.up], axis=1)
    start, end = (corners @ across / unit for corners in (frustum.origins, far))
    edges = np.stack([start, end], axis=1)
    ax.plot(edges[:, :, 0].T, edges[:, :, 1].T, color=_CAMERA, linewidth=0.9)
    if frustum.in_focus is not None:
        ax.fill(*end.T, facecolor=_FOCUS, alpha=0.1, linewidth=0)
        ax.plot(*np.vstack([end, end[:1]]).T, color=_FOCUS, linewidth=1.4)
    ax.plot(*start.mean(axis=0), "s", color=_CAMERA, markersize=6, markeredgecolor="white")


def _name_axes(ax: Axes, side: _Side, unit: str) -> None:
    """Coordinates of the world at the ticks, where an axis runs against them too."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    for axis, direction, name in ((ax.xaxis, side.right, side.across), (ax.yaxis, side.up, side.along)):
        sign = float(direction.sum())
        axis.set_major_locator(MaxNLocator(3 if axis is ax.yaxis else 4))
        axis.set_major_formatter(FuncFormatter(lambda number, _, sign=sign: f"{sign * number + 0.0:g}"))
        axis.set_label_text(f"{name} / {unit}")
    ax.set_title(side.title, fontsize="medium")


class Shape(NamedTuple):
    """A part of a scene as it is drawn."""

    triangles: Floats
    """(n, 3, 3) corners, mm."""
    colour: Floats
    """(3,) sRGB, 0 to 1."""
    bounds: Floats
    """(2, 3): of all that is drawn."""


def around(points: list[Floats]) -> Floats:
    """(2, 3): the box around points (n, 3)."""
    return np.stack([np.min([p.min(axis=0) for p in points], axis=0), np.max([p.max(axis=0) for p in points], axis=0)])


def shapes_of(scene: Any, window: Floats | None = None) -> list[Shape]:
    """Meshes, instances and lights with a surface of a scene, or their parts that reach into a box.

    `window` is (2, 3), or (2, 2) for x and y alone.
    """
    shining = [light.mesh() for light in scene.lights if hasattr(light, "mesh")]
    parts = [*scene.meshes, *shining]
    most, shapes = max(_FEWEST, _TRIANGLES // max(1, len(parts))), []
    for k, part in enumerate(parts):
        mesh = getattr(part, "mesh", part)
        triangles = np.asarray(mesh.vertices, dtype=np.float32)[np.asarray(mesh.faces)]
        if hasattr(part, "matrices"):
            triangles = _places(part, triangles, most)
        else:
            if window is not None and len(triangles) > most:
                low, high = triangles.min(axis=1)[:, : window.shape[1]], triangles.max(axis=1)[:, : window.shape[1]]
                triangles = triangles[((high >= window[0]) & (low <= window[1])).all(axis=1)]
            triangles = _fewer(triangles, most)
        colour = np.array(_LIGHT) if k >= len(scene.meshes) else _colour(mesh.material.row())
        if len(triangles):
            shapes.append(Shape(triangles, colour, around([triangles.reshape(-1, 3)])))
    return shapes


def _fewer(triangles: Floats, most: int) -> Floats:
    """The largest triangles, and of the others every k-th, sqrt(k) times as large about its middle."""
    if len(triangles) <= most:
        return triangles
    order = np.argsort(np.ptp(triangles, axis=1).sum(axis=1), kind="stable")[::-1]
    large, small = order[: most // 2], order[most // 2 :]
    step = -(-len(small) // (most - len(large)))
    some = triangles[small[::step]]
    middle = some.mean(axis=1, keepdims=True)
    return np.concatenate([triangles[large], middle + np.sqrt(step) * (some - middle)])


def _places(part: Any, corners: Floats, most: int) -> Floats:
    """Triangles of instances at as many places as are drawn: those of the mesh, or of the box around it."""
    matrices = np.asarray(part.matrices)[:: -(-len(part.matrices) // _PLACES)]
    if len(corners) * len(matrices) > most:
        low, high = part.mesh.bounds
        box = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        corners = box[_BOX]
    moved = np.einsum("mij,nkj->mnki", matrices[:, :3, :3], corners) + matrices[:, None, None, :3, 3]
    return np.asarray(moved.reshape(-1, 3, 3))


def _colour(row: Any) -> Floats:
    """Colour of a material by its row, sRGB."""
    if np.any(np.asarray(row.glass_index)) or row.pane_index:
        return np.array(_GLASS)
    shines = hasattr(row.emission, "texels") or np.any(row.emission)
    colour = row.emission if shines else row.base_color
    if hasattr(colour, "texels"):
        colour = np.asarray(colour.texels).reshape(-1, np.shape(colour.texels)[-1]).mean(axis=0)
    full = np.broadcast_to(np.asarray(colour, dtype=np.float64).ravel(), (3,))
    return np.asarray(linear_to_srgb(np.clip(full, 0.0, 1.0)))


def draw_shapes(ax: Axes, shapes: list[Shape], right: Floats, up: Floats, unit: float) -> None:
    """Draw shapes seen with some directions to the right and up, the largest behind, lit from where they are seen.

    `unit` is that of the axes, mm.
    """
    from matplotlib.collections import PolyCollection

    across, towards = np.stack([right, up], axis=1), np.cross(right, up)
    spans = [np.prod(np.ptp(shape.bounds @ across, axis=0)) for shape in shapes]
    for k in np.argsort(spans, kind="stable")[::-1].tolist():
        shape = shapes[k]
        triangles = shape.triangles[np.argsort(shape.triangles.mean(axis=1) @ towards, kind="stable")]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        cosines = np.abs(normals @ towards) / np.where(lengths > 0, lengths, 1.0)
        colours, faces = shape.colour * (_SHADE + (1.0 - _SHADE) * cosines[:, None]), triangles @ across / unit
        style: dict[str, Any] = {"edgecolors": "face", "linewidths": 0.3, "antialiased": False, "rasterized": True}
        ax.add_collection(PolyCollection(faces, facecolors=colours, **style))

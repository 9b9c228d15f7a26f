"""Everything that the camera looks at."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plenoptic._values import set_field, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.environment import ConstantBackground
from plenoptic.scene.light import Light, QuadLight
from plenoptic.scene.loading import load_meshes
from plenoptic.scene.material import Colour, Material
from plenoptic.scene.mesh import Mesh
from plenoptic.scene.tables import SceneTables, build_tables


@value
class Scene:
    """Meshes, lights and a background.

    Parameters
    ----------
    meshes : sequence of Mesh
        Surfaces, in mm, in one frame: the world.
    lights : sequence of QuadLight
        Light sources besides emissive meshes.
    background : ConstantBackground, float, (float, float, float) or None
        What rays see that meet no surface; a bare number or (red, green, blue) becomes a `ConstantBackground`,
        None is a black world.

    Raises
    ------
    InvalidValueError
        Something that is not a mesh, a light or a background.
    SceneError
        No mesh, no light and no background.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ball = pl.sphere(2.0, material=pl.Lambertian((0.8, 0.3, 0.2)))
    >>> scene = pl.Scene([ball], background=0.1)
    >>> scene
    Scene(1 mesh, 16128 triangles, background 0.1)
    >>> scene.tables().albedo.tolist()
    [[0.8, 0.3, 0.2]]
    """

    meshes: tuple[Mesh, ...] = ()
    lights: tuple[Light, ...] = ()
    background: ConstantBackground | None = None

    if TYPE_CHECKING:

        def __init__(
            self,
            meshes: Iterable[Mesh] = (),
            lights: Iterable[Light] = (),
            background: ConstantBackground | Colour | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        set_field(self, "meshes", _tuple_of(self.meshes, Mesh, "meshes"))
        set_field(self, "lights", _tuple_of(self.lights, QuadLight, "lights"))
        if self.background is not None and not isinstance(self.background, ConstantBackground):
            set_field(self, "background", ConstantBackground(self.background))
        if not self.meshes and not self.lights and self.background is None:
            raise SceneError("the scene has no mesh, no light and no background; give it at least one of them")

    def __repr__(self) -> str:
        triangles = sum(len(mesh.faces) for mesh in self.meshes)
        parts = [f"{_count(len(self.meshes), 'mesh', 'meshes')}, {_count(triangles, 'triangle', 'triangles')}"]
        if not self.meshes:
            parts = ["no meshes"]
        if self.lights:
            parts.append(_count(len(self.lights), "light", "lights"))
        if self.background is not None:
            parts.append(f"background {self.background.radiance}")
        return f"Scene({', '.join(parts)})"

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        unit: str | None = None,
        material: Material | None = None,
        lights: Iterable[Light] = (),
        background: ConstantBackground | Colour | None = None,
    ) -> Scene:
        """Read a scene from a mesh file; see `load_meshes` for what is read.

        No light is invented: a file without emissive materials stays black unless `lights` or `background` are
        given.

        Parameters
        ----------
        path : str or path
            A .glb, .gltf, .obj, .ply or .stl file.
        unit : str, optional
            Length of one unit of the file: "um", "mm", "cm", "m", "km", "inch" or "foot". None: "m" for glTF files,
            whose standard says so, and "mm" for all others.
        material : Lambertian, Emissive or None
            Replaces all materials of the file.
        lights, background : sequence of QuadLight, ConstantBackground
            As in `Scene`.

        Raises
        ------
        FileError
            A file that is missing, damaged or of another kind.
        InvalidValueError
            An unknown unit.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Scene.load("duck.glb", unit="cm", background=1.0)  # doctest: +SKIP
        Scene(1 mesh, 4212 triangles, background 1.0)
        """
        return cls(load_meshes(path, unit=unit, material=material), lights, background)

    @property
    def bounds(self) -> NDArray[np.float64] | None:
        """(2, 3), mm: the lowest and the highest corner of all meshes and lights; None where there is neither.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.white_plane().bounds.tolist()
        [[-200.0, -200.0, -404.0], [200.0, 200.0, -404.0]]
        """
        boxes = [mesh.bounds for mesh in self._surfaces()]
        if not boxes:
            return None
        return np.array([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]])

    def merged(self, other: Scene) -> Scene:
        """This scene and another one in the same frame, together.

        Raises
        ------
        SceneError
            Both have a background, and not the same.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -404), (40, 40), radiance=10)
        >>> pl.Scene([pl.box(4)]).merged(pl.Scene(lights=[lamp], background=0.1))
        Scene(1 mesh, 12 triangles, 1 light, background 0.1)
        """
        if self.background is not None and other.background is not None and self.background != other.background:
            raise SceneError(
                f"the scenes have different backgrounds, {self.background.radiance} and {other.background.radiance}; "
                "remove one by dataclasses.replace(scene, background=None)"
            )
        background = other.background if self.background is None else self.background
        return Scene(self.meshes + other.meshes, self.lights + other.lights, background)

    def with_lights(self, lights: Iterable[Light]) -> Scene:
        """The same scene under other lights, which replace those it has; emissive meshes stay.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -404), (40, 40), radiance=10)
        >>> pl.Scene([pl.box(4)]).with_lights([lamp])
        Scene(1 mesh, 12 triangles, 1 light)
        """
        return dataclasses.replace(self, lights=_tuple_of(lights, QuadLight, "lights"))

    def tables(self) -> SceneTables:
        """The scene as plain arrays for the kernels; see `SceneTables`.

        Examples
        --------
        >>> import plenoptic as pl
        >>> tables = pl.Scene(background=0.5).tables()
        >>> tables.background.tolist(), tables.triangles is None
        ([0.5], True)
        """
        return build_tables(self._surfaces(), None if self.background is None else self.background.radiance)

    def _surfaces(self) -> tuple[Mesh, ...]:
        return self.meshes + tuple(light.mesh() for light in self.lights)


def _tuple_of(items: Any, kind: type, name: str) -> tuple[Any, ...]:
    if isinstance(items, Iterable) and not (isinstance(items, np.ndarray) and items.ndim == 0):
        items = list(items)
        wrong = [item for item in items if not isinstance(item, kind)]
        if not wrong:
            return tuple(items)
        raise InvalidValueError(f"{name} holds {type(wrong[0]).__name__}; it may hold {kind.__name__} only")
    raise InvalidValueError(f"{name} is {type(items).__name__}; it must be a sequence of {kind.__name__}, as in [item]")


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"

"""Everything that the camera looks at."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.display import picture_of
from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.values import Floats, Given, check_kind, numbers, set_field, value
from plenoptic.errors import InvalidValueError, SceneError
from plenoptic.scene.file_cameras import View
from plenoptic.scene.files.load import load_file
from plenoptic.scene.geometry.instance import Instances
from plenoptic.scene.geometry.mesh import Mesh
from plenoptic.scene.geometry.moves import similarity
from plenoptic.scene.lights.environment import Background, ConstantBackground, EnvironmentMap
from plenoptic.scene.lights.registry import LIGHTS, AreaLight, DistantLight, Light
from plenoptic.scene.lights.sheet import Sheet
from plenoptic.scene.materials.medium import Medium, as_medium
from plenoptic.scene.materials.registry import Material
from plenoptic.scene.points import Points
from plenoptic.scene.scene_record import SceneRecord, box_around, build_record
from plenoptic.scene.textures.color import Colour

_NAME_LENGTH = 100


@value
class Scene:
    """Meshes, lights and a background.

    Parameters
    ----------
    meshes : sequence of Mesh or Instances
        Surfaces, in mm, in one frame: the world.
    lights : sequence of QuadLight, SphereLight, PointLight, SpotLight, SunLight or Sheet
        Light sources besides emissive meshes.
    background : ConstantBackground, EnvironmentMap, float, (float, float, float) or None
        Background of rays that hit no surface; a bare colour becomes a `ConstantBackground`, None is a black world.
    views : sequence of View
        Cameras of the file that the scene comes from, for `camera.posed`. They are no part of the image.
    medium : Medium, optional
        Medium outside all bodies, from the lens on; lights from infinity do not shine through it.
    points : Points, optional
        Particles, whose light is added to the image; surfaces hide them, and are not lit by them.

    Raises
    ------
    InvalidValueError
        Something that is not a mesh, a light, a background or particles.
    SceneError
        No mesh, no light, no background and no points; a medium without bound under the sun, a background or a
        sheet without start.

    Examples
    --------
    >>> import plenoptic as pl
    >>> ball = pl.sphere(2.0, material=pl.Lambertian((0.8, 0.3, 0.2)))
    >>> scene = pl.Scene([ball], background=0.1)
    >>> scene
    Scene(1 mesh, 16128 triangles, background 0.1)
    >>> scene.tables().bsdf.base_color.tolist()
    [[0.8, 0.3, 0.2]]
    """

    meshes: Given[tuple[Mesh | Instances, ...], Iterable[Mesh | Instances]] = Given(default=())
    lights: Given[tuple[Light, ...], Iterable[Light]] = Given(default=())
    background: Given[Background | None, Background | Colour | None] = Given(default=None)
    views: Given[tuple[View, ...], Iterable[View]] = Given(default=())
    medium: Medium | None = None
    points: Points | None = None

    def __post_init__(self) -> None:
        set_field(self, "meshes", items_of(self.meshes, (Mesh, Instances), "meshes"))
        set_field(self, "lights", items_of(self.lights, LIGHTS, "lights"))
        set_field(self, "views", items_of(self.views, View, "views"))
        if self.background is not None and not isinstance(self.background, Background):
            if isinstance(self.background, np.ndarray | list) and numbers(self.background, "background").ndim > 1:
                raise InvalidValueError(
                    f"background is an array of shape {np.shape(self.background)}; give an image as pl.EnvironmentMap"
                )
            set_field(self, "background", ConstantBackground(self.background))
        if self.points is not None:
            check_kind(self.points, "points", Points, "pl.Points(positions, intensity=1.0)")
        elif not self.has_surfaces_or_light:
            raise SceneError("the scene has no mesh, no light and no background; give it at least one of them")
        as_medium(self.medium, "medium")
        dark = isinstance(self.background, ConstantBackground) and not np.any(self.background.radiance)
        sky = self.background is not None and not dark
        if self.medium is not None and (sky or any(isinstance(light, DistantLight) for light in self.lights)):
            raise SceneError(
                "the scene has a medium without bound under the sun or a background, of which no light arrives; "
                "bound it by a body of pl.Dielectric(1.0, medium=...), or light it by lamps"
            )
        sheets = [light for light in self.lights if isinstance(light, Sheet)]
        if self.points is not None and self.points.sheet is not None:
            sheets.append(self.points.sheet)
        if self.medium is not None and any(sheet.start is None for sheet in sheets):
            raise SceneError(
                "the scene has a medium without bound under a light sheet from infinity, of which no light arrives; "
                "give the sheet a start=, mm along its direction from its position"
            )

    @property
    def has_surfaces_or_light(self) -> bool:
        """True if the scene has a mesh, a light or a background, besides `points`."""
        return bool(self.meshes or self.lights) or self.background is not None

    def __repr__(self) -> str:
        triangles = sum(len(part.mesh.faces if isinstance(part, Instances) else part.faces) for part in self.meshes)
        instances = sum(len(part) for part in self.meshes if isinstance(part, Instances))
        world = "" if self.background is None else repr(self.background)
        if isinstance(self.background, ConstantBackground):
            world = f"background {self.background.radiance}"
        parts = [
            _count(len(self.meshes), "mesh", "meshes") or "no meshes",
            _count(triangles, "triangle", "triangles"),
            _count(instances, "instance", "instances"),
            _count(len(self.lights), "light", "lights"),
            world,
            _count(len(self.views), "view", "views"),
            "" if self.medium is None else "a medium",
            "" if self.points is None else _count(len(self.points), "particle", "particles"),
        ]
        return f"Scene({', '.join(part for part in parts if part)})"

    _repr_html_ = picture_of

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        unit: str | None = None,
        material: Material | None = None,
        lights: Iterable[Light] = (),
        background: Background | Colour | None = None,
        limits: FileLimits = DEFAULT,
    ) -> Scene:
        """Read a scene from a file, with its lights and its cameras as `views`; see `load_file` for details.

        No light is invented: a file without any stays black unless `lights` or `background` are given.

        Parameters
        ----------
        path, unit, material, limits
            As in `load_file`, whose errors are raised.
        lights, background
            As in `Scene`; lights are added to those of the file.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.Scene.load("duck.glb", unit="cm", background=1.0)  # doctest: +SKIP
        Scene(1 mesh, 4212 triangles, background 1.0)
        """
        contents = load_file(path, unit=unit, material=material, limits=limits)
        return cls(contents.meshes, (*contents.lights, *lights), background, contents.views)

    @property
    def bounds(self) -> Floats | None:
        """(2, 3), mm: the lowest and the highest corner of all meshes, lights and particles; None without any.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.shapes.white_plane().bounds.tolist()
        [[-200.0, -200.0, -404.0], [200.0, 200.0, -404.0]]
        """
        shapes = [light.mesh() for light in self.lights if isinstance(light, AreaLight)]
        points = () if self.points is None else (self.points,)
        return box_around([part.bounds for part in (*self.meshes, *shapes, *points)])

    @property
    def object_names(self) -> tuple[str, ...]:
        """The name of each number in `truth.object`: of meshes, then of lights that have a surface; '' at last, for -1.

        Objects without a name are called by their kind and their place in `meshes` or `lights`. Names are cut at 100
        characters.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -404), (40, 40), radiance=10)
        >>> flag = pl.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="flag")
        >>> pl.Scene([pl.box(4), flag], [lamp]).object_names
        ('Mesh 0', 'flag', 'QuadLight 0', '')
        """
        meshes = [part.mesh.name if isinstance(part, Instances) else part.name for part in self.meshes]
        names = [name or f"{type(self.meshes[k]).__name__} {k}" for k, name in enumerate(meshes)]
        shining = [(k, light) for k, light in enumerate(self.lights) if isinstance(light, AreaLight)]
        names += [f"{type(light).__name__} {k}" for k, light in shining]
        return (*(name[:_NAME_LENGTH] for name in names), "")

    def merged(self, other: Scene) -> Scene:
        """This scene and another one in the same frame, together.

        Raises
        ------
        SceneError
            Both have a background, and not the same; or both have particles.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -404), (40, 40), radiance=10)
        >>> pl.Scene([pl.box(4)]).merged(pl.Scene(lights=[lamp], background=0.1))
        Scene(1 mesh, 12 triangles, 1 light, background 0.1)
        """
        check_kind(other, "other", Scene, "pl.Scene(...)")
        if self.background is not None and other.background is not None and self.background != other.background:
            raise SceneError(
                f"the scenes have different backgrounds, {self.background!r} and {other.background!r}; "
                "remove one by dataclasses.replace(scene, background=None)"
            )
        if self.medium is not None and other.medium is not None and self.medium != other.medium:
            raise SceneError("the scenes have different media; remove one by dataclasses.replace(scene, medium=None)")
        if self.points is not None and other.points is not None:
            raise SceneError("both scenes have points; join their positions in one pl.Points")
        return Scene(
            self.meshes + other.meshes,
            self.lights + other.lights,
            other.background if self.background is None else self.background,
            self.views + other.views,
            other.medium if self.medium is None else self.medium,
            other.points if self.points is None else self.points,
        )

    def transformed(self, matrix: ArrayLike) -> Scene:
        """The scene moved by an affine map, p' = M p: meshes, lights, views, particles and the environment.

        Radiance and irradiance stay as they are: intensities of points and spots grow with the square of the scale.
        Coefficients of media and of glass stay, too: they are per mm, and a smaller scene is clearer.

        Parameters
        ----------
        matrix : (4, 4) array
            For column vectors, lengths in mm. With lights, views, particles or an environment map, it must not stretch
            or shear.

        Raises
        ------
        InvalidValueError
            Not 4 x 4.
        SceneError
            Not finite, projective or flattening; uneven or mirroring where there are lights, views or a map.

        Examples
        --------
        From a file in metres to a model 400 mm before the camera:

        >>> import numpy as np, plenoptic as pl
        >>> model = pl.Scene([pl.box(2000)], [pl.lights.PointLight((0, 5000, 0), intensity=4e6)])
        >>> low, high = model.bounds
        >>> size = 10.0 / (high - low).max()
        >>> matrix = np.diag([size, size, size, 1.0])
        >>> matrix[:3, 3] = np.array([0, 0, -400]) - size * (low + high) / 2
        >>> model.transformed(matrix).bounds.round(9).tolist(), model.transformed(matrix).lights[0].intensity
        ([[-5.0, -5.0, -405.0], [5.0, 5.0, -395.0]], 100.0)
        """
        meshes = tuple(mesh.transformed(matrix) for mesh in self.meshes)
        world = self.background
        points = None if self.points is None else self.points.under(matrix)
        if not self.lights and not self.views and points is None and not isinstance(world, EnvironmentMap):
            return dataclasses.replace(self, meshes=meshes)
        full, scale = similarity(matrix)
        return Scene(
            meshes,
            tuple(light.moved(full, scale) for light in self.lights),
            world.moved(full, scale) if isinstance(world, EnvironmentMap) else world,
            tuple(view.moved(full) for view in self.views),
            self.medium,
            points,
        )

    def with_lights(self, lights: Iterable[Light]) -> Scene:
        """The same scene under other lights, which replace those it has; emissive meshes stay.

        Examples
        --------
        >>> import plenoptic as pl
        >>> lamp = pl.QuadLight.facing((0, 60, -360), (0, 0, -404), (40, 40), radiance=10)
        >>> pl.Scene([pl.box(4)]).with_lights([lamp])
        Scene(1 mesh, 12 triangles, 1 light)
        """
        return dataclasses.replace(self, lights=items_of(lights, LIGHTS, "lights"))

    def tables(self) -> SceneRecord:
        """The scene as plain arrays for the kernels; see `SceneRecord`.

        Examples
        --------
        >>> import plenoptic as pl
        >>> record = pl.Scene(background=0.5).tables()
        >>> record.lights.sky.background.tolist(), record.geometry is None
        ([0.5], True)
        """
        return build_record(self.meshes, self.lights, self.background, medium=self.medium)[0]


def items_of(items: Any, kinds: type | tuple[type, ...], name: str) -> tuple[Any, ...]:
    """Items of a sequence, all of some kinds."""
    allowed = kinds if isinstance(kinds, tuple) else (kinds,)
    names = " or ".join(kind.__name__ for kind in allowed)
    if isinstance(items, Iterable) and not (isinstance(items, np.ndarray) and items.ndim == 0):
        items = list(items)
        wrong = [item for item in items if not isinstance(item, allowed)]
        if not wrong:
            return tuple(items)
        raise InvalidValueError(f"{name} holds {type(wrong[0]).__name__}; it may hold {names} only")
    raise InvalidValueError(f"{name} is {type(items).__name__}; it must be a sequence of {names}, as in [item]")


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}" if number else ""

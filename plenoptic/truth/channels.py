"""The channels of ground truth, in one list: the fields of `GroundTruth`.

A further channel is a flag of `Truth`, a field of `GroundTruth` that says all about it, and a function that fills its
array. Finding, choosing, keeping in files and the table in docs/conventions.md follow the list.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, frozen_array, set_field, value
from plenoptic.errors import InvalidValueError

NO_MICROLENS = -(2**31)
"""Both lattice indices of a pixel that no microlens lights; float32 holds it exactly."""


class Truth(enum.IntFlag):
    """What of the ground truth is wanted; joined by ``|``. `GroundTruth` says what each is, docs/conventions.md more.

    Examples
    --------
    >>> import plenoptic as pl
    >>> (pl.Truth.DEPTH | pl.Truth.NORMAL) in pl.Truth.ALL
    True
    """

    NONE = 0
    DEPTH = 1
    DISTANCE = 2
    POSITION = 4
    NORMAL = 8
    OBJECT = 16
    MATERIAL = 32
    MICROLENS = 64
    VIRTUAL_DEPTH = 128
    DISPARITY = 256
    INCIDENCE_ANGLE = 512
    ALL = 1023


class Needs(enum.Flag):
    """What a channel can only be had with."""

    NOTHING = 0
    MESHES = enum.auto()
    MICROLENSES = enum.auto()


class Channel(NamedTuple):
    """All about one array of the ground truth."""

    flag: Truth
    meaning: str
    """For files and documents: what its numbers are."""
    void: float
    """What stands for nothing there."""
    needs: Needs
    filled_by: str
    """The function below `plenoptic.truth` that fills the array. By name, since kernels are slow to import."""
    stage: str
    """What of `PixelStages` that function reads."""
    in_files: tuple[str, ...]
    """Names in EXR files, one for each number of a pixel."""
    unit: str = ""
    dtype: type[np.generic] = np.float64
    shape: tuple[int, ...] = ()
    """What follows (H, W)."""


def _channel(*described: Any, **more: Any) -> Any:
    return dataclasses.field(default=None, metadata={"channel": Channel(*described, **more)})


_OF_IMAGES = Needs.MESHES | Needs.MICROLENSES


@value
class GroundTruth:
    """What the pixels of a raw image show: of each, the point where *one ray* meets the scene.

    The ray starts at the centre of the pixel and passes the lit centroid of the microlens that gives the pixel most
    light (docs/conventions.md). What was not asked for is None.

    Parameters
    ----------
    depth : (H, W) array, optional
        -z of the point in the camera's frame in mm; inf where nothing is met.
    distance : (H, W) array, optional
        From the camera's origin, the centre of its iris as designed, to the point in mm; inf where nothing is met.
    position : (H, W, 3) array, optional
        The point in the world in mm; nan where nothing is met.
    normal : (H, W, 3) array, optional
        Unit normal of the triangle there, in the world, towards the side that is seen; nan where nothing is met.
        Vertex normals, with which smooth meshes are shaded, do not count.
    object : (H, W) array of int32, optional
        Number of the mesh in `scene.meshes`; lights count on after the last mesh; -1 where nothing is met.
    material : (H, W) array of int32, optional
        Number among the scene's different materials, in the order in which its meshes, then its lights, bring them; -1
        where nothing is met.
    microlens : (H, W, 2) array of int32, optional
        Lattice indices of the microlens that the ray passes; in FREE lattices (number, 0); `NO_MICROLENS`, -2^31, twice
        where no light reaches the pixel's centre.
    microlens_type : (H, W) array of int32, optional
        Its type: a row of the array's `focal_lengths`; -1 where no light reaches the pixel's centre.
    virtual_depth : (H, W) array, optional
        v = a / b. a is the distance along the array's normal from its front principal plane to the main lens's image of
        the point, positive for an image behind the array (Galilean: virtual) and negative for one in front of it
        (Keplerian: real); b that from its rear principal plane to the sensor at the pixel. nan where nothing is met,
        +-inf where the light of the point arrives parallel.
    disparity : (H, W) array, optional
        pitch / (v pixel_pitch): by how many pixels the image of the point moves between neighbouring microlenses,
        relative to their centres; see the notes. nan where nothing is met.
    incidence_angle : (H, W) array, optional
        Angle between the ray and the normal of the sensor, tilted or not, where the ray meets the pixel, in radians;
        nan where no light reaches the pixel's centre.

    Raises
    ------
    InvalidValueError
        Where shapes do not fit each other, or all is left out.

    Notes
    -----
    The image is that of rays near the pixel's own: for the rays that meet in the point, 1 / a is the mean over all
    directions of how much the slope falls for each mm across the array, found by tracing eight rays around the pixel's
    through the main lens; without aberrations they all meet at a. C. Perwass and L. Wietzke, Proc. SPIE 8291, 829108
    (2012), doi 10.1117/12.909882, call v the virtual depth; there it has no sign.

    Seen through the microlens with its centre at c, an image point at x falls at c + (x - c) / v, so that from one
    microlens to the next, dc away, it moves by -dc / v relative to the centre. A positive disparity therefore goes
    against the step. In a plenoptic 1.0 camera the same number counts the other way round: from one sub-aperture view
    to that of the next pixel, the point moves by `view_disparity` = 1 / disparity microlenses, with the same sign.
    Neighbours are as far apart as the array's pitch (RECTANGULAR: the smaller one).

    Examples
    --------
    >>> import numpy as np
    >>> import plenoptic as pl
    >>> truth = pl.GroundTruth(depth=[[400.0, np.inf]], object=[[0, -1]])
    >>> truth
    GroundTruth(1 x 2, depth, object)
    """

    _: dataclasses.KW_ONLY
    depth: Floats | None = _channel(
        Truth.DEPTH,
        "-z in the camera's frame",
        np.inf,
        Needs.MESHES,
        "kernels.points.fill_depth",
        "points",
        ("depth.Z",),
        unit="mm",
    )
    distance: Floats | None = _channel(
        Truth.DISTANCE,
        "from the camera's origin to the point",
        np.inf,
        Needs.MESHES,
        "kernels.points.fill_distance",
        "points",
        ("truth.distance",),
        unit="mm",
    )
    position: Floats | None = _channel(
        Truth.POSITION,
        "the point in the world",
        np.nan,
        Needs.MESHES,
        "kernels.points.fill_position",
        "points",
        ("truth.position.X", "truth.position.Y", "truth.position.Z"),
        unit="mm",
        shape=(3,),
    )
    normal: Floats | None = _channel(
        Truth.NORMAL,
        "unit normal of the triangle in the world, towards the side that is seen",
        np.nan,
        Needs.MESHES,
        "surfaces.fill_normal",
        "hits",
        ("truth.normal.X", "truth.normal.Y", "truth.normal.Z"),
        shape=(3,),
    )
    object: NDArray[np.int32] | None = _channel(
        Truth.OBJECT,
        "number of the mesh in `scene.meshes`; lights count on after the last",
        -1,
        Needs.MESHES,
        "surfaces.fill_object",
        "hits",
        ("truth.object",),
        dtype=np.int32,
    )
    material: NDArray[np.int32] | None = _channel(
        Truth.MATERIAL,
        "number among the scene's different materials, in the order in which meshes, then lights bring them",
        -1,
        Needs.MESHES,
        "surfaces.fill_material",
        "hits",
        ("truth.material",),
        dtype=np.int32,
    )
    microlens: NDArray[np.int32] | None = _channel(
        Truth.MICROLENS,
        "lattice indices i, j; in FREE lattices (number, 0)",
        NO_MICROLENS,
        Needs.MICROLENSES,
        "microlenses.fill_microlens",
        "cells",
        ("truth.microlens.I", "truth.microlens.J"),
        dtype=np.int32,
        shape=(2,),
    )
    microlens_type: NDArray[np.int32] | None = _channel(
        Truth.MICROLENS,
        "row of the array's `focal_lengths`",
        -1,
        Needs.MICROLENSES,
        "microlenses.fill_microlens_type",
        "cells",
        ("truth.microlens.type",),
        dtype=np.int32,
    )
    virtual_depth: Floats | None = _channel(
        Truth.VIRTUAL_DEPTH,
        "v = a / b, the image's distance behind the array over the sensor's",
        np.nan,
        _OF_IMAGES,
        "kernels.virtual_depth.fill_virtual_depth",
        "images",
        ("truth.virtual_depth",),
    )
    disparity: Floats | None = _channel(
        Truth.DISPARITY,
        "pitch / (v pixel pitch), between neighbouring microlenses",
        np.nan,
        _OF_IMAGES,
        "kernels.virtual_depth.fill_disparity",
        "images",
        ("truth.disparity",),
        unit="pixels",
    )
    incidence_angle: Floats | None = _channel(
        Truth.INCIDENCE_ANGLE,
        "angle of incidence on the sensor: between the ray and the sensor's normal",
        np.nan,
        Needs.NOTHING,
        "kernels.incidence.fill_incidence_angle",
        "sensor",
        ("truth.incidence_angle",),
        unit="rad",
    )

    if TYPE_CHECKING:

        def __init__(self, **arrays: ArrayLike | None) -> None: ...

    def __post_init__(self) -> None:
        shape: tuple[int | str, ...] = ("rows", "columns")
        for name, channel in CHANNELS.items():
            given = getattr(self, name)
            if given is not None:
                array = frozen_array(given, name=name, shape=(*shape, *channel.shape), dtype=channel.dtype)
                shape = array.shape[:2]
                set_field(self, name, array)
        if shape == ("rows", "columns"):
            raise InvalidValueError("a ground truth holds nothing; give it at least one array, such as depth")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = next(iter(self.arrays().values())).shape[:2]
        return rows, columns

    @property
    def kinds(self) -> Truth:
        """What it holds."""
        found = Truth.NONE
        for name in self.arrays():
            found |= CHANNELS[name].flag
        return found

    @property
    def view_disparity(self) -> Floats | None:
        """(H, W): microlenses by which the point moves from one sub-aperture view to the next pixel's; 0 in focus."""
        if self.disparity is None:
            return None
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.disparity)

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """The arrays that are there, by their names."""
        return {name: found for name in CHANNELS if (found := getattr(self, name)) is not None}

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"GroundTruth({rows} x {columns}, {truth_names(self.kinds)})"


CHANNELS: dict[str, Channel] = {field.name: field.metadata["channel"] for field in dataclasses.fields(GroundTruth)}


def truth_names(truth: Truth) -> str:
    """For a message: depth, virtual depth."""
    flags = dict.fromkeys(channel.flag for channel in CHANNELS.values() if channel.flag & truth)
    return ", ".join(str(flag.name).lower().replace("_", " ") for flag in flags)

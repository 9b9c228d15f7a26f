"""Channels of ground truth, in one list: the fields of `GroundTruth`.

A new channel is a flag of `Truth`, a field of `GroundTruth` with its metadata, and a `fill_...` of `PixelStages`.
Computation, selection, files and the table in docs/conventions.md follow the list.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import operator
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import Floats, frozen_array, set_field, value
from plenoptic.errors import InvalidValueError

NO_MICROLENS = -(2**31)
"""Both lattice indices of a pixel that no microlens illuminates; exact in float32."""


class Truth(enum.IntFlag):
    """Requested channels of ground truth, combined by ``|``. See `GroundTruth` and docs/conventions.md.

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
    STATE = 1024
    ALL = 2047
    """All channels of one ray."""
    OBJECT_SHARE = 2048
    """Takes many rays per pixel; computed only if requested by name: ``pl.Truth.ALL | pl.Truth.OBJECT_SHARE``."""
    CHORD_DISPARITY = 4096
    """Takes chief rays through all neighbouring microlenses; computed only if requested by name."""
    OPTICAL_DISTANCE = 8192
    """In air the length of the ray; computed only if requested by name."""
    TRANSMITTANCE = 16384
    """Of the media before the first hit; computed only if requested by name."""


class PixelState(enum.IntEnum):
    """State of a pixel: `GroundTruth.state`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(2, 2))
    >>> state = pl.ground_truth(pl.shapes.white_plane(), camera, truth=pl.Truth.STATE).state
    >>> bool((state == pl.images.PixelState.SEEN).all())
    True
    """

    UNKNOWN = 0
    """Not computed, or light may reach it but no ray was found."""
    DARK = 1
    """No light can reach it."""
    EMPTY = 2
    """Light reaches it, and its ray hits nothing."""
    SEEN = 3
    """Its ray hits a surface."""


class Needs(enum.Flag):
    """Requirements of a channel."""

    NOTHING = 0
    MESHES = enum.auto()
    MICROLENSES = enum.auto()


class Channel(NamedTuple):
    """Metadata of one array of ground truth."""

    flag: Truth
    needs: Needs
    void: float
    """Value for no hit; an int for integer arrays."""
    meaning: str
    """Meaning of its numbers, for files and documents."""
    numbers: str
    """A letter for each component; empty for scalars."""
    unit: str
    plane: str
    """Name in EXR files, before the letter."""

    @property
    def in_files(self) -> tuple[str, ...]:
        """Names in EXR files, one for each component."""
        return tuple(f"{self.plane}.{letter}" for letter in self.numbers) or (self.plane,)

    @property
    def dtype(self) -> type[np.generic]:
        """Data type of the array."""
        return np.int32 if isinstance(self.void, int) else np.float64

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a pixel's value, after (H, W)."""
        return (len(self.numbers),) if self.numbers else ()


_MESHES, _MICROLENSES = Needs.MESHES, Needs.MICROLENSES


def _channel(
    flag: Truth, needs: Needs, void: float, meaning: str, numbers: str = "", *, unit: str = "", plane: str = ""
) -> Any:
    """Dataclass field with a channel as metadata; its plane is "truth." and the field's name by default."""
    channel = Channel(flag, needs, void, meaning, numbers, unit, plane)
    return dataclasses.field(default=None, metadata={"channel": channel})


@value
class GroundTruth:
    """Ground truth of a raw image: properties of the scene point hit by *one ray* of each pixel.

    The ray starts at the centre of the pixel and passes the illuminated centroid of the microlens that gives the centre
    most light; if the centre is dark, it starts elsewhere on the pixel (docs/conventions.md). Channels that were not
    requested are None.

    Parameters
    ----------
    depth : (H, W) array, optional
        -z of the point in the camera's frame in mm; inf without a hit.
    distance : (H, W) array, optional
        Distance in mm from the camera's origin, the centre of its iris as designed, to the point; inf without a hit.
    optical_distance : (H, W) array, optional
        n l: refractive index of the lens's `front_medium` times the length in mm of the ray from the first element of
        the lens, such as the window of a housing, to the point; inf without a hit. With LensModel.THIN and PARAXIAL
        from the plane at which rays leave the lens.
    position : (H, W, 3) array, optional
        The point in the world in mm; nan without a hit.
    normal : (H, W, 3) array, optional
        Unit normal of the triangle in the world, towards the visible side; nan without a hit. Vertex normals, which
        shade smooth meshes, are ignored.
    object : (H, W) array of int32, optional
        Index of the mesh in `scene.meshes`; lights follow after the last mesh; -1 without a hit.
    material : (H, W) array of int32, optional
        Index among the scene's unique materials, in the order of its meshes, then its lights; -1 without a hit.
    microlens : (H, W, 2) array of int32, optional
        Lattice indices of the microlens that the ray passes; in FREE lattices (number, 0); `NO_MICROLENS`, -2^31, twice
        if no light reaches the pixel.
    microlens_type : (H, W) array of int32, optional
        Its type: a row of the array's `focal_lengths`; -1 if no light reaches the pixel.
    virtual_depth : (H, W) array, optional
        v = a / b. a is the distance along the array's normal from its front principal plane to the main lens's image of
        the point, positive for an image behind the array (Galilean: virtual) and negative for one in front of it
        (Keplerian: real); b that from its rear principal plane to the sensor at the start of the ray. nan without a
        hit, +-inf if the light of the point arrives collimated.
    disparity : (H, W) array, optional
        pitch / (v pixel_pitch): displacement in pixels of the image of the point between neighbouring microlenses,
        relative to their centres; see the notes. nan without a hit.
    chord_disparity : (H, W) array, optional
        Disparity between the pixel's microlens and its neighbours, by the chief rays of the point (see `project`): the
        quantity that matching of micro images measures, and the reference for algorithms. nan without a hit and in
        FREE lattices.
    incidence_angle : (H, W) array, optional
        Angle between the ray and the normal of the sensor, tilted or not, at the pixel, in radians; nan if no light
        reaches the pixel.
    state : (H, W) array of int32, optional
        A `PixelState`: dark, illuminated without a hit, with a hit, or unknown.
    object_share : (H, W) array, optional
        Fraction of the pixel's light that comes from `object` in a scene of uniform radiance: less than 1 at edges, out
        of focus, and behind layers of low opacity. From 64 paths or more, to within about 0.06; nan without a hit, or
        if none of 4096 paths arrives.
    transmittance : (H, W, 3) array, optional
        exp(-(absorption + scattering) t) in red, green and blue of the medium around the camera along the ray to the
        first hit; 1 without a medium, nan without a hit.

    Raises
    ------
    InvalidValueError
        If shapes do not match, or there is no array.

    Notes
    -----
    The image is that of rays close to the pixel's ray. For rays through the point, 1 / a is the mean over
    all directions of the decrease of slope per mm across the array, by tracing eight rays around the pixel's ray
    through the main lens; without aberrations they all intersect at a. C. Perwass and L. Wietzke, Proc. SPIE 8291,
    829108 (2012), doi 10.1117/12.909882, call v the virtual depth; there it has no sign.

    With aberrations it depends on the separation of the rays. `virtual_depth` and `disparity` are for rays close to the
    pixel's ray, at its part of the pupil; `chord_disparity` is for rays through microlenses a pitch apart.

    A microlens with its centre at c images the image point x to c + (x - c) / v, so that from one microlens to the
    next, dc away, it moves by -dc / v relative to the centre. A positive disparity is therefore opposite to the step.
    In a plenoptic 1.0 camera the inverse is used: from one sub-aperture view to that of the next pixel, the point moves
    by `view_disparity` = 1 / disparity microlenses, with the same sign. Neighbours are one pitch of the array apart
    (RECTANGULAR: the smaller one).

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> truth = pl.GroundTruth(depth=[[400.0, np.inf]], object=[[0, -1]])
    >>> truth
    GroundTruth(1 x 2, depth, object)
    """

    _: dataclasses.KW_ONLY
    depth: Floats | None = _channel(
        Truth.DEPTH, _MESHES, np.inf, "-z in the camera's frame", unit="mm", plane="depth.Z"
    )
    distance: Floats | None = _channel(
        Truth.DISTANCE, _MESHES, np.inf, "from the camera's origin to the point", unit="mm"
    )
    optical_distance: Floats | None = _channel(
        Truth.OPTICAL_DISTANCE, _MESHES, np.inf, "index times length of the ray from the lens to the point", unit="mm"
    )
    position: Floats | None = _channel(Truth.POSITION, _MESHES, np.nan, "the point in the world", "XYZ", unit="mm")
    normal: Floats | None = _channel(
        Truth.NORMAL, _MESHES, np.nan, "unit normal of the triangle in the world, towards the side that is seen", "XYZ"
    )
    object: NDArray[np.int32] | None = _channel(
        Truth.OBJECT, _MESHES, -1, "number of the mesh in `scene.meshes`; lights count on after the last"
    )
    material: NDArray[np.int32] | None = _channel(
        Truth.MATERIAL,
        _MESHES,
        -1,
        "number among the scene's different materials, in the order in which meshes, then lights bring them",
    )
    microlens: NDArray[np.int32] | None = _channel(
        Truth.MICROLENS, _MICROLENSES, NO_MICROLENS, "lattice indices i, j; in FREE lattices (number, 0)", "IJ"
    )
    microlens_type: NDArray[np.int32] | None = _channel(
        Truth.MICROLENS, _MICROLENSES, -1, "row of the array's `focal_lengths`", plane="truth.microlens.type"
    )
    virtual_depth: Floats | None = _channel(
        Truth.VIRTUAL_DEPTH,
        _MESHES | _MICROLENSES,
        np.nan,
        "v = a / b, the image's distance behind the array over the sensor's",
    )
    disparity: Floats | None = _channel(
        Truth.DISPARITY,
        _MESHES | _MICROLENSES,
        np.nan,
        "pitch / (v pixel pitch), between neighbouring microlenses",
        unit="pixels",
    )
    chord_disparity: Floats | None = _channel(
        Truth.CHORD_DISPARITY,
        _MESHES | _MICROLENSES,
        np.nan,
        "disparity by chief rays of the point through neighbouring microlenses",
        unit="pixels",
    )
    incidence_angle: Floats | None = _channel(
        Truth.INCIDENCE_ANGLE,
        Needs.NOTHING,
        np.nan,
        "angle of incidence on the sensor: between the ray and the sensor's normal",
        unit="rad",
    )
    state: NDArray[np.int32] | None = _channel(
        Truth.STATE, Needs.NOTHING, int(PixelState.UNKNOWN), "0 unknown, 1 dark, 2 lit but meeting nothing, 3 seen"
    )
    object_share: Floats | None = _channel(
        Truth.OBJECT_SHARE, _MESHES, np.nan, "share of the pixel's light that comes from its object"
    )

    transmittance: Floats | None = _channel(
        Truth.TRANSMITTANCE, _MESHES, np.nan, "share of light that the medium leaves up to the first hit", "RGB"
    )

    if TYPE_CHECKING:

        def __init__(self, **arrays: ArrayLike | None) -> None: ...

    def __post_init__(self) -> None:
        shape: tuple[int | str, ...] = ("rows", "columns")
        for name, channel in CHANNELS.items():
            argument = getattr(self, name)
            if argument is not None:
                array = frozen_array(argument, name=name, shape=(*shape, *channel.shape), dtype=channel.dtype)
                shape = array.shape[:2]
                set_field(self, name, array)
        if shape == ("rows", "columns"):
            raise InvalidValueError("a ground truth has no array; give it at least one, such as depth")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = next(iter(self.arrays().values())).shape[:2]
        return rows, columns

    @property
    def kinds(self) -> Truth:
        """Flags of its channels."""
        return functools.reduce(operator.or_, (CHANNELS[name].flag for name in self.arrays()))

    @property
    def view_disparity(self) -> Floats | None:
        """Displacement (H, W) of the point in microlenses between views of neighbouring pixels; 0 in focus."""
        if self.disparity is None:
            return None
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.disparity)

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """The arrays that are not None, by their names."""
        return {name: array for name in CHANNELS if (array := getattr(self, name)) is not None}

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"GroundTruth({rows} x {columns}, {truth_names(self.kinds)})"


CHANNELS: dict[str, Channel] = {
    field.name: (channel := field.metadata["channel"])._replace(plane=channel.plane or f"truth.{field.name}")
    for field in dataclasses.fields(GroundTruth)
}


def channels_of(truth: Truth) -> dict[str, Channel]:
    """Channels of the requested flags, by their names."""
    return {name: channel for name, channel in CHANNELS.items() if channel.flag & truth}


def truth_names(truth: Truth) -> str:
    """Names of the flags for messages: depth, virtual depth."""
    flags = dict.fromkeys(channel.flag for channel in channels_of(truth).values())
    return ", ".join(str(flag.name).lower().replace("_", " ") for flag in flags)

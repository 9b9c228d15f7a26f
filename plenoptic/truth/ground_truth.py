"""Ground truth of raw pixels: what can be known of the point that a pixel shows."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.values import frozen_array, set_field, value, wrong_kind
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
    ALL = 511


class _Kind(NamedTuple):
    """An array of a ground truth: its flag, what follows (H, W) in its shape, its type, and what stands for nothing."""

    flag: Truth
    shape: tuple[int, ...]
    dtype: Any
    void: float


KINDS = {
    "depth": _Kind(Truth.DEPTH, (), np.float64, np.inf),
    "distance": _Kind(Truth.DISTANCE, (), np.float64, np.inf),
    "position": _Kind(Truth.POSITION, (3,), np.float64, np.nan),
    "normal": _Kind(Truth.NORMAL, (3,), np.float64, np.nan),
    "object": _Kind(Truth.OBJECT, (), np.int32, -1),
    "material": _Kind(Truth.MATERIAL, (), np.int32, -1),
    "microlens": _Kind(Truth.MICROLENS, (2,), np.int32, NO_MICROLENS),
    "microlens_type": _Kind(Truth.MICROLENS, (), np.int32, -1),
    "virtual_depth": _Kind(Truth.VIRTUAL_DEPTH, (), np.float64, np.nan),
    "disparity": _Kind(Truth.DISPARITY, (), np.float64, np.nan),
}

OF_IMAGES = Truth.VIRTUAL_DEPTH | Truth.DISPARITY
"""What is about the main lens's image of the point."""


def checked_truth(truth: Truth) -> Truth:
    """`truth`, or an error where it is something else."""
    if not isinstance(truth, Truth):
        raise wrong_kind(truth, "truth", "Truth", "pl.Truth.DEPTH | pl.Truth.NORMAL")
    return truth & Truth.ALL


def available_truth(truth: Truth, *, meshes: bool, microlenses: bool) -> Truth:
    """What of it there can be in a scene with or without meshes, for a camera with or without microlenses."""
    if not meshes:
        truth &= Truth.MICROLENS
    if not microlenses:
        truth &= ~(Truth.MICROLENS | OF_IMAGES)
    return truth


def truth_names(truth: Truth) -> str:
    """For a message: depth, virtual depth."""
    flags = dict.fromkeys(kind.flag for kind in KINDS.values() if kind.flag & truth)  # itself it can tell from 3.11 on
    return ", ".join(str(flag.name).lower().replace("_", " ") for flag in flags)


def empty_truth(truth: Truth, shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Arrays for what is wanted of pixels of a shape, holding what stands for nothing."""
    return {
        name: np.full((*shape, *kind.shape), kind.void, dtype=kind.dtype)
        for name, kind in KINDS.items()
        if kind.flag & truth
    }


def forget_truth(found: Mapping[str, NDArray[Any]], where: NDArray[np.bool_]) -> None:
    """Put what stands for unknown into pixels that have not been looked at: nan, and numbers that are no number."""
    for name, array in found.items():
        array[where] = np.nan if array.dtype.kind == "f" else KINDS[name].void


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

    depth: NDArray[np.float64] | None = None
    distance: NDArray[np.float64] | None = None
    position: NDArray[np.float64] | None = None
    normal: NDArray[np.float64] | None = None
    object: NDArray[np.int32] | None = None
    material: NDArray[np.int32] | None = None
    microlens: NDArray[np.int32] | None = None
    microlens_type: NDArray[np.int32] | None = None
    virtual_depth: NDArray[np.float64] | None = None
    disparity: NDArray[np.float64] | None = None

    if TYPE_CHECKING:

        def __init__(  # noqa: PLR0913
            self,
            depth: ArrayLike | None = None,
            distance: ArrayLike | None = None,
            position: ArrayLike | None = None,
            normal: ArrayLike | None = None,
            object: ArrayLike | None = None,
            material: ArrayLike | None = None,
            microlens: ArrayLike | None = None,
            microlens_type: ArrayLike | None = None,
            virtual_depth: ArrayLike | None = None,
            disparity: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        shape: tuple[int | str, ...] = ("rows", "columns")
        for name, kind in KINDS.items():
            given = getattr(self, name)
            if given is not None:
                array = frozen_array(given, name=name, shape=(*shape, *kind.shape), dtype=kind.dtype)
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
            found |= KINDS[name].flag
        return found

    @property
    def view_disparity(self) -> NDArray[np.float64] | None:
        """(H, W): microlenses by which the point moves from one sub-aperture view to the next pixel's; 0 in focus."""
        if self.disparity is None:
            return None
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.disparity)

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """The arrays that are there, by their names."""
        return {name: found for name in KINDS if (found := getattr(self, name)) is not None}

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"GroundTruth({rows} x {columns}, {truth_names(self.kinds)})"

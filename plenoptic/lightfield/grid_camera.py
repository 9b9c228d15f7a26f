"""Light fields by a `MicroImageGrid` alone: a camera of ideal parts takes the place of the unknown one.

Its lengths are pixels of the raw image, and its exit pupil is so far away that microlenses stand in front of the
centres of their images.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import MicrolensCentres, microlens_centres
from plenoptic.camera.points.micro_image_grid import MicroImageGrid
from plenoptic.camera.points.micro_image_models import to_complex
from plenoptic.camera.points.white_fit import has_contrast, lattice_shift
from plenoptic.core.values import Floats, check_has
from plenoptic.errors import InvalidValueError
from plenoptic.lightfield.raw_arrays import camera_of, check_white
from plenoptic.optics.glass.media import ConstantMedium
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement, rotation_about_axes
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.imperfections import MicrolensDeviations
from plenoptic.optics.microlens.lattice import Lattice, lattice_basis, rows_of
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.optics.stops.circle import CircularStop
from plenoptic.optics.surfaces.surface import Surface
from plenoptic.rendering.exposure import Exposure

NO_DISTANCES = "a MicroImageGrid tells no distances; give disparity=, or calibrate the camera by pl.calibrate"
_GAP, _PUPIL_DISTANCE = 4.0, 1e6
"""Distance from array to sensor in pitches, which is arbitrary, and from the exit pupil to the array, over that."""
_MARGIN = 2
"""Microlenses beyond the sensor on each side."""
_BORDERS = 1e-3, 0.8
"""Least and largest border of a micro image, over the pitch."""
_MIN_TURN, _MIN_SHIFT = 0.5, 0.03
"""Least displacement in pixels, of the ends of a side of the sensor and of microlenses, with which a lattice counts as
turned and uneven: views of others are not interpolated."""
_PIXELS = 1 << 22
"""Pixels of micro images that are drawn at a time."""
_MAX_SHIFT = 0.15
"""Largest displacement of micro images from their grid, in pitches."""


class CameraAndWhite(NamedTuple):
    """Camera and white image of a shot, or ideal ones in their place."""

    camera: PlenopticCamera
    white: Exposure
    grid: MicroImageGrid | None = None
    """The grid of which camera, or white image and camera, are made."""

    def check(self, shot: Exposure, centres: MicrolensCentres | None = None) -> None:
        """Raise InvalidValueError if the images are not those of the camera; `centres` are its CHIEF_RAY ones."""
        if self.grid is None:
            check_white(self.camera, self.white, centres)
        elif self.white is _even_white(self.grid):
            _check_grid(self.camera, shot, "shot", centres)
        else:
            _check_grid(self.camera, self.white, "white image", centres)


def grid_argument(
    white: Exposure | MicroImageGrid, camera: PlenopticCamera | MicroImageGrid | None
) -> MicroImageGrid | None:
    """The grid in place of a white image or of a camera; None without one."""
    if not isinstance(white, MicroImageGrid):
        return camera if isinstance(camera, MicroImageGrid) else None
    if camera is not None:
        raise InvalidValueError(
            "white is a MicroImageGrid, which takes the place of the camera, too; leave camera= out"
        )
    return white


def camera_and_white(
    shot: Exposure, white: Exposure | MicroImageGrid, camera: PlenopticCamera | MicroImageGrid | None, side: float = 0.0
) -> CameraAndWhite:
    """Camera and white image of a shot, or those of a grid.

    Microlenses of a grid are focused at images in front of the array (`side` -1), behind it (1), or at infinity (0).
    """
    check_has(shot, "shot", "Exposure", "pl.render(scene, camera)", "white", "camera", "region")
    grid = grid_argument(white, camera)
    if grid is None:
        assert not isinstance(white, MicroImageGrid) and not isinstance(camera, MicroImageGrid)
        return CameraAndWhite(camera_of(shot, camera), white)
    even = _even_white(grid)
    chosen = even if isinstance(white, MicroImageGrid) else white
    check_has(chosen, "white", "Exposure", "pl.render_white(camera)", "white", "image", "region")
    for image, name in ((shot, "shot"), (chosen, "white image")):
        shape, region = image.image.shape[:2], image.region
        if shape != grid.shape if region is None else region[1] > grid.shape[0] or region[3] > grid.shape[1]:
            raise InvalidValueError(
                f"the grid is of an image of {grid.shape[0]} x {grid.shape[1]} pixels, and the {name} is {shape[0]} x "
                f"{shape[1]}, its region {region}; give the grid of a white image of the same sensor"
            )
    return CameraAndWhite(_ideal_camera(grid, side), chosen, grid)


def _check_grid(camera: PlenopticCamera, image: Exposure, name: str, centres: MicrolensCentres | None) -> None:
    """Raise InvalidValueError if the micro images of an image are not those of the camera of a grid."""
    centres = microlens_centres(camera, progress=False) if centres is None else centres
    unnamed = dataclasses.replace(image, camera=None)
    shift = lattice_shift(camera, unnamed, centres)
    if shift is None and not has_contrast(camera, unnamed, centres):
        return
    if shift is None or shift.largest > _MAX_SHIFT * shift.pitch:
        distance = "do not lie on it" if shift is None else f"lie up to {shift.largest:.3g} pixels from it"
        raise InvalidValueError(
            f"the grid is of another camera: the micro images of the {name} {distance}; give that of a white image "
            "taken with the same focus, pl.calibration.find_micro_images(white)"
        )


@functools.lru_cache(maxsize=4)
def _ideal_camera(grid: MicroImageGrid, side: float) -> PlenopticCamera:
    """Camera of ideal parts with the micro images of a grid; its lengths are pixels."""
    gap = _GAP * grid.pitch
    distance, border = _PUPIL_DISTANCE * gap, np.zeros(int(grid.type_pattern.max()) + 1)
    border = np.clip(border if grid.border is None else grid.border / grid.pitch, *_BORDERS)
    position, turn, pitches, index, shift = _on_lattice(grid)
    is_rectangular = grid.lattice is Lattice.RECTANGULAR
    array = MicrolensArray(
        pitch=pitches if is_rectangular else pitches[0],
        focal_lengths=tuple((gap / (1.0 - side * border)).tolist()),
        lattice=grid.lattice,
        pattern=grid.type_pattern,
        imperfections=MicrolensDeviations(index=index, shift=shift) if np.abs(shift).max() > _MIN_SHIFT else None,
    )
    iris = _PUPIL_DISTANCE * _radius(grid)
    front = Surface(0.5 * distance, medium=ConstantMedium(2.0), semi_diameter=2.0 * iris)
    surfaces = (front, Surface(math.inf, semi_diameter=2.0 * iris))
    return PlenopticCamera(
        lens=LensStack((CircularStop(iris), *surfaces), name="ideal lens", model=LensModel.THIN),
        sensor=Sensor(grid.shape, 1.0),
        stop_to_microlenses=distance,
        microlenses=array,
        microlenses_to_sensor=gap,
        microlenses_placement=Placement((*position, 0.0), rotation_about_axes((0.0, 0.0, turn))),
    )


class _Places(NamedTuple):
    """Best fit of an ideal lattice to a grid, on the sensor, and the deviations of microlenses from it."""

    position: Floats
    """(2,): x and y of the microlens (0, 0)."""
    turn: float
    pitches: tuple[float, float]
    nodes: NDArray[np.int64]
    """(n, 2): indices of microlenses."""
    shift: Floats
    """(n, 2): their deviations in the axes of the lattice."""


def _on_lattice(grid: MicroImageGrid) -> _Places:
    index = _indices_around(grid)
    centre = grid.centres_of(index) + _measured_deviations(grid, index)
    place = to_complex(centre - 0.5 * (np.array(grid.shape) - 1.0))
    is_rectangular = grid.lattice is Lattice.RECTANGULAR
    pitches = grid.pitches if is_rectangular else (grid.pitch, grid.pitch)
    ideal = index @ lattice_basis(grid.lattice, pitches) @ (1.0, 1j)
    similarity, position = np.linalg.lstsq(np.column_stack([ideal, np.ones(len(ideal))]), place, rcond=None)[0]
    turn, scale = np.angle(similarity), abs(similarity)
    if abs(turn) * max(grid.shape) < _MIN_TURN:
        turn = 0.0
    shift = (place - position) * np.exp(-1j * turn) - scale * ideal
    return _Places(
        np.array([position.real, position.imag]),
        float(turn),
        (scale * pitches[0], scale * pitches[1]),
        index,
        np.column_stack([shift.real, shift.imag]),
    )


def _indices_around(grid: MicroImageGrid) -> NDArray[np.int64]:
    """Indices (n, 2) of all micro images of which a part may be on the sensor."""
    nodes = grid.on_sensor
    low, high = nodes.min(axis=0) - _MARGIN, nodes.max(axis=0) + _MARGIN
    index = np.stack(np.meshgrid(*map(np.arange, low, high + 1), indexing="ij"), axis=-1).reshape(-1, 2)
    centre, reach = grid.centres_of(index), max(grid.pitches)
    return np.asarray(index[((centre > -reach) & (centre < np.array(grid.shape) + reach)).all(axis=1)])


def _measured_deviations(grid: MicroImageGrid, index: NDArray[np.int64]) -> Floats:
    """Displacements (n, 2) of single micro images from the smooth grid, of which the measured ones contain noise."""
    displacement = np.zeros(index.shape)
    if grid.index is not None and grid.centre is not None and grid.standard_error is not None:
        measured, noise = grid.centre - grid.centres_of(grid.index), grid.standard_error**2
        variance = np.maximum((measured**2 - noise).mean(axis=0), 0.0)
        row = rows_of(grid.index, index)
        # Wiener's filter.
        likely = measured * variance / np.maximum(variance + noise, 1e-30)
        displacement = np.where(row[:, None] >= 0, likely[row], 0.0)
    return displacement


def _radius(grid: MicroImageGrid) -> float:
    """Radius of the pupil's image, by the sharpest type of micro images; half the pitch where it is not measured."""
    if grid.radius is None or grid.index is None:
        return 0.5 * min(grid.pitches)
    types = grid.types_of(grid.index)
    present = np.unique(types)
    sharpest = present[0 if grid.border is None else grid.border[present].argmin()]
    return float(np.median(grid.radius[types == sharpest]))


@functools.lru_cache(maxsize=4)
def _even_white(grid: MicroImageGrid) -> Exposure:
    """White image of evenly lit micro images: discs whose light fades out over their borders."""
    index = _indices_around(grid)
    centre, types, radius = grid.centres_of(index), grid.types_of(index), _radius(grid)
    border = np.ones(int(grid.type_pattern.max()) + 1) if grid.border is None else np.maximum(grid.border, 1.0)
    light = np.zeros(grid.shape)
    for kind in np.unique(types).tolist():
        reach = math.ceil(radius + 0.5 * border[kind] + 0.5)
        steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
        for part in np.array_split(centre[types == kind], math.ceil(len(index) * len(steps) / _PIXELS)):
            pixel = np.rint(part).astype(np.int64)[:, None] + steps
            distance = np.hypot(*np.moveaxis(pixel - part[:, None], -1, 0))
            value = np.clip(0.5 + (radius - distance) / border[kind], 0.0, 1.0)
            is_inside = ((pixel >= 0) & (pixel < grid.shape)).all(axis=-1) & (value > 0)
            np.add.at(light, tuple(pixel[is_inside].T), value[is_inside])
    return Exposure(np.minimum(light, 1.0)[..., None].astype(np.float32), white=True)

"""Placements and distances of a camera as built, compared with its design."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from plenoptic.camera.assembly import assembly, sensor_corners
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import Floats, check_kind, value
from plenoptic.optics.lens.placement import Placement


@value
class BuiltValue:
    """Length or angle of a camera, as designed and as built.

    Parameters
    ----------
    name : str
    design, built : float
    unit : str
        "mm" or "mrad".

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.camera.BuiltValue("sensor: shift x", 0.0, 0.02, "mm")
    sensor: shift x: 0 mm designed, 0.02 mm built
    """

    name: str
    design: float
    built: float
    unit: str

    def __repr__(self) -> str:
        return f"{self.name}: {self.design:.6g} {self.unit} designed, {self.built:.6g} {self.unit} built"


@value
class AsBuilt:
    """Lengths and angles of a camera as built; printed as a table. See `as_built`.

    Parameters
    ----------
    values : tuple of BuiltValue

    Examples
    --------
    See `as_built`.
    """

    values: tuple[BuiltValue, ...]

    def __getitem__(self, name: str) -> BuiltValue:
        """Value of a name; KeyError if there is none."""
        for each in self.values:
            if each.name == name:
                return each
        raise KeyError(f"there is no value {name!r}; there are {', '.join(each.name for each in self.values)}")

    def __repr__(self) -> str:
        rows = [f"{'':<44}{'design':>12}{'as built':>12}"]
        rows += [f"{each.name + ', ' + each.unit:<44}{each.design:>12.6g}{each.built:>12.6g}" for each in self.values]
        return "\n".join(rows)


def as_built(camera: PlenopticCamera) -> AsBuilt:
    """Compare the placements and distances of a camera as built with its design.

    Parameters
    ----------
    camera : PlenopticCamera

    Returns
    -------
    AsBuilt
        For each displaced part its shift in mm, its tilt about x and about y (signs as in `PlenopticCamera.moved`) and
        its rotation about the axis in mrad (1 degree is 17.5 mrad). The distance in mm between array and sensor, or
        last lens vertex and sensor, at the sensor's centre, and its least and largest value at the sensor's corners,
        along the array's normal.

    Examples
    --------
    >>> import math, plenoptic as pl
    >>> camera = pl.camera.example_camera()
    >>> print(pl.camera.as_built(camera.moved(pl.CameraPart.SENSOR, tilt=(0.0, 0.01, 0.0))))
                                                      design    as built
    sensor: tilt about y, mrad                             0          10
    array to sensor, mm                                  1.7         1.7
    array to sensor, least at a corner, mm               1.7      1.6744
    array to sensor, largest at a corner, mm             1.7      1.7256
    """
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    placements = (camera.lens_placement, camera.microlenses_placement, camera.sensor_placement)
    parts = zip(("lens", "array", "sensor"), placements, strict=True)
    values = [
        each for name, placement in parts if placement is not None for each in _placement_changes(name, placement)
    ]
    behind = "lens to sensor" if camera.microlenses is None else "array to sensor"
    design, built = (_distances(each) for each in (camera.design, camera))
    for k, label in enumerate(("", ", least at a corner", ", largest at a corner")):
        values.append(BuiltValue(behind + label, design[k], built[k], "mm"))
    return AsBuilt(tuple(values))


def _placement_changes(name: str, placement: Placement) -> list[BuiltValue]:
    """Shifts and rotations of a placement that are not zero."""
    shift, turn = np.asarray(placement.shift), np.asarray(placement.rotation)
    changes = [(f"{name}: shift {axis}", float(step), "mm") for axis, step in zip("xyz", shift, strict=True)]
    # The axis of the part is the third column; the rotation about it follows from the x axis.
    changes.append((f"{name}: tilt about x", 1e3 * math.atan2(-turn[1, 2], turn[2, 2]), "mrad"))
    changes.append((f"{name}: tilt about y", 1e3 * math.atan2(turn[0, 2], turn[2, 2]), "mrad"))
    changes.append((f"{name}: turn about the axis", 1e3 * math.atan2(turn[1, 0], turn[0, 0]), "mrad"))
    return [BuiltValue(label, 0.0, amount, unit) for label, amount, unit in changes if abs(amount) > 1e-12]


def _distances(camera: PlenopticCamera) -> Floats:
    """Distances (3,) in mm to the sensor's centre, and the least and largest to its corners."""
    parts = assembly(camera)
    corners = sensor_corners(camera, parts)[:, 2]
    return np.array([float(parts.sensor_to_local.shift[2]), corners.min(), corners.max()])


def with_true_distances(camera: PlenopticCamera) -> PlenopticCamera:
    """The same camera with distances from lens to array and from there to the sensor as built, not as designed."""
    parts = camera.lens_placement, camera.microlenses_placement, camera.sensor_placement
    lens, array, sensor = (0.0 if part is None else float(part.shift[2]) for part in parts)
    if camera.microlenses is None or lens == array == sensor:
        return camera
    # What array and sensor share with the lens stays in their placements.
    array_placement, sensor_placement = (
        Placement((*part.shift[:2], lens), part.rotation) for part in (each or Placement() for each in parts[1:])
    )
    return dataclasses.replace(
        camera,
        stop_to_microlenses=camera.stop_to_microlenses + array - lens,
        microlenses_to_sensor=camera.microlenses_to_sensor + sensor - array,
        microlenses_placement=array_placement,
        sensor_placement=sensor_placement,
    )

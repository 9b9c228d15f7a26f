"""The camera of the examples: the paper's double Gauss lens and microlens array."""

from __future__ import annotations

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.gaussian import CameraKind
from plenoptic.core.values import choice
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.files.library import load_lens
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.optics.stops.circle import CircularStop

_IMAGE = 134.624
"""Paraxial image of the plane z = -404 mm, mm behind the stop."""


def example_camera(
    kind: CameraKind = CameraKind.GALILEAN, *, shape: tuple[int, int] = (512, 512), lattice: Lattice = Lattice.HEXAGONAL
) -> PlenopticCamera:
    """Camera of Michels et al. (2018) focused on the plane z = -404 mm.

    The main lens is Tronnier's double Gauss (US 2673491), focal length 100.7 mm; the microlenses have a focal length of
    2 mm and a pitch of 0.217 mm, the pixels a pitch of 0.01 mm.

    Parameters
    ----------
    kind : CameraKind
        GALILEAN, plenoptic 2.0: microlenses 123.3 mm behind the stop (semi-diameter 5 mm) and 1.7 mm before the sensor.
        PLENOPTIC_1: microlenses in the image of the plane, 2 mm before the sensor; stop 4.25 mm. CONVENTIONAL: sensor
        in the image of the plane, without microlenses; stop 5 mm.
    shape : (int, int)
        Rows and columns of the sensor.
    lattice : Lattice
        HEXAGONAL or SQUARE.

    Raises
    ------
    InvalidValueError
        If the kind is another one.

    Examples
    --------
    >>> import plenoptic as pl
    >>> round(pl.camera.example_camera(shape=(64, 96)).report().focus[0].disparity, 3)
    3.255
    """
    choice(kind, CameraKind, "kind")
    if kind not in (CameraKind.GALILEAN, CameraKind.PLENOPTIC_1, CameraKind.CONVENTIONAL):
        raise InvalidValueError(f"kind is {kind.name}; it must be GALILEAN, PLENOPTIC_1 or CONVENTIONAL")
    unfocused = kind is CameraKind.PLENOPTIC_1
    lens = load_lens("double-gauss-100mm-f2").with_stop(CircularStop(4.25 if unfocused else 5.0))
    sensor = Sensor(shape=shape, pixel_pitch=0.010)
    if kind is CameraKind.CONVENTIONAL:
        return PlenopticCamera(lens, sensor, _IMAGE)
    array = MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=lattice)
    return PlenopticCamera(lens, sensor, _IMAGE if unfocused else 123.3, array, 2.0 if unfocused else 1.7)

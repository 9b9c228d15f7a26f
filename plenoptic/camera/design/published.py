"""Published cameras by name, with their sources."""

from __future__ import annotations

import difflib
import importlib.resources
import json
from typing import Any

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import result
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.files.library import load_lens
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.placement import Placement
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.sensor.dual_pixel_sensor import dual_pixel
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.optics.stops.circle import CircularStop

_QUARTER_TURN = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""Rotation about the axis that puts nearest neighbours along x."""


@result
class PublishedCamera:
    """A camera after a publication, and the origin of its numbers; made by `published_camera`.

    Parameters
    ----------
    name : str
    camera : PlenopticCamera
    source : str
        Publication, DOI or address.
    published, assumed : tuple of str
        Numbers that the source states, and those that it leaves open or the model replaces.
    """

    name: str
    camera: PlenopticCamera
    source: str
    published: tuple[str, ...]
    assumed: tuple[str, ...]

    def __repr__(self) -> str:
        lists = [("published", self.published), ("assumed", self.assumed)]
        lines = [f"  {title}: {entry}" for title, entries in lists for entry in entries]
        return "\n".join([f"PublishedCamera {self.name!r}", f"  source: {self.source}", *lines])


def camera_names() -> tuple[str, ...]:
    """Names of the published cameras, in alphabetical order, for `load_camera`.

    Examples
    --------
    >>> import plenoptic as pl
    >>> "raytrix-r12-like" in pl.camera_names()
    True
    """
    return tuple(sorted(_cameras()))


def load_camera(name: str) -> PlenopticCamera:
    """Load a camera after a publication, with its whole sensor; a `region` renders a part.

    Microlens arrays and sensors are those of the publication. Main lenses are bundled ones, scaled to the focal length
    and stopped down to the f-number, since the prescriptions are not public. See `published_camera`.

    Parameters
    ----------
    name : str
        One of `camera_names()`.

    Raises
    ------
    InvalidValueError
        If there is no such camera.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.load_camera("raytrix-r12-like")
    >>> camera.sensor.shape, round(camera.report().image_pitch_pixels, 2)
    ((3068, 4080), 23.3)
    """
    return published_camera(name).camera


def published_camera(name: str) -> PublishedCamera:
    """Camera after a publication, with its source and the published and assumed numbers.

    Parameters
    ----------
    name : str
        One of `camera_names()`.

    Raises
    ------
    InvalidValueError
        If there is no such camera.

    Examples
    --------
    >>> import plenoptic as pl
    >>> published = pl.camera.published_camera("michels-2018-plenoptic-2")
    >>> published.camera == pl.camera.example_camera()
    True
    >>> published.assumed[0]
    'stop of 10 mm'
    """
    cameras = _cameras()
    if not isinstance(name, str) or name not in cameras:
        close = difflib.get_close_matches(str(name), cameras, n=3, cutoff=0.3) or sorted(cameras)
        raise InvalidValueError(
            f"there is no camera {name!r:.40}; pl.camera_names() lists them, among them {', '.join(close)}"
        )
    entry = cameras[name]
    return PublishedCamera(name, _camera_of(entry), entry["source"], tuple(entry["published"]), tuple(entry["assumed"]))


def _cameras() -> dict[str, Any]:
    file = importlib.resources.files("plenoptic.camera.design") / "data" / "published_cameras.json"
    cameras: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return cameras


def _camera_of(entry: dict[str, Any]) -> PlenopticCamera:
    lens = load_lens(entry["lens"]["name"])
    if "focal_length" in entry["lens"]:
        lens = lens.scaled(focal_length=entry["lens"]["focal_length"])
    lens = lens.with_stop(CircularStop(entry["lens"]["stop"])).with_model(
        LensModel[entry["lens"].get("model", "EXACT")]
    )
    shape, pitch = tuple(entry["sensor"]["shape"]), entry["sensor"]["pixel_pitch"]
    if "microlenses" not in entry:
        return PlenopticCamera(lens, dual_pixel(pitch, shape, **entry["sensor"]["dual"]), entry["stop_to_microlenses"])
    array = entry["microlenses"]
    lattice = Lattice[array.get("lattice", "HEXAGONAL")]
    return PlenopticCamera(
        lens,
        Sensor(shape, pitch),
        entry["stop_to_microlenses"],
        MicrolensArray(array["pitch"], tuple(array["focal_lengths"]), lattice, extent=array.get("extent")),
        entry["microlenses_to_sensor"],
        microlenses_placement=Placement(rotation=_QUARTER_TURN) if entry.get("rows_along_x") else None,
    )

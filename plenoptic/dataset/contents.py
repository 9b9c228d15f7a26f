"""Data sets: opening them, and readers of their contents."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, content_errors, read_file
from plenoptic.core.files.serialization import from_tree
from plenoptic.core.files.zarr_files import EXTRA, read_arrays
from plenoptic.core.values import file_path, result, whole
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.exposure_files import MOTION_NAMES
from plenoptic.rendering.exposure_metadata import EXPOSURE_NAMES, fields_of
from plenoptic.sequences.point_motion import MotionTruth
from plenoptic.truth.channels import CHANNELS

if TYPE_CHECKING:
    import xarray

FORMAT = "plenoptic-dataset-1"
MANIFEST, STATISTICS, CONTACT_SHEET, LOG = "manifest.json", "statistics.csv", "contact_sheet.png", "frames.log"
NAME = re.compile(r"[A-Za-z0-9_-]{1,60}")
"""Pattern of the names of cameras: they become names of folders."""


@result
class DataSet:
    """The frames of a sequence as one camera or several see them. See `write`, which makes it, and `read`.

    Attributes
    ----------
    path : Path
        The folder.
    manifest : mapping
        Content of `manifest.json`.
    """

    path: Path
    manifest: Mapping[str, Any]

    def __len__(self) -> int:
        return int(self.manifest["frames"])

    def __repr__(self) -> str:
        state = "" if self.complete else f", {len(self.manifest['images'])} of {len(self) * len(self.cameras)} images"
        return f"DataSet({len(self)} frames{state}, camera{'s' * (len(self.cameras) > 1)} {', '.join(self.cameras)})"

    @property
    def cameras(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(self.manifest["cameras"])

    @property
    def complete(self) -> bool:
        """True if all frames are present; `write` renders the missing ones."""
        return bool(self.manifest["complete"])

    def open(self, camera: str | None = None) -> xarray.Dataset:
        """All frames of a camera as xarray opens them: with dimensions, units and coordinates, read as they are used.

        `camera` is its name; None: the only one. Needs the package xarray.
        """
        module: Any = extra_package("xarray", "DataSet.open", EXTRA)
        dataset: xarray.Dataset = module.open_zarr(self._store(self._camera_name(camera)))
        return dataset

    def frame(self, number: int, camera: str | None = None, *, limits: FileLimits = DEFAULT) -> Exposure:
        """A frame as `render` gave it, without its statistics; grey ones among others of colour have three channels.

        Parameters
        ----------
        number : int
            Number of the frame: 0 for the first one, -1 for the last one.
        camera : str, optional
            Its name; None: the only one.
        limits : FileLimits
            The memory that it may take.

        Raises
        ------
        InvalidValueError
            If there is no such frame or camera.
        FileError
            If files cannot be read.
        """
        name, k = self._camera_name(camera), self._frame_number(number)
        about = self._about(name, k)
        with content_errors(self.path, f"holds no possible frame {k}"):
            recorded = about["parts"][0]["arrays"]  # others of its store belong to other frames
            names = tuple(key for key in (*EXPOSURE_NAMES, *CHANNELS) if key in recorded)
            arrays = read_arrays(self._store(name), names, limits, frame=k)
            counts = arrays.get("sample_counts")
            if counts is not None and (counts == about["samples"]).all():
                del arrays["sample_counts"]
            return Exposure(
                **fields_of(arrays),
                **{key: about[key] for key in ("samples", "replicates", "seed")},
                camera=self._camera(about),
                settings=from_tree(self.manifest["made_with"]["settings"]),
                white=False,
                object_names=self.manifest["object_names"][about["object_names"]] if "object" in arrays else None,
            )

    def motion(self, number: int, camera: str | None = None, *, limits: FileLimits = DEFAULT) -> MotionTruth:
        """Positions in the next frame of the points that a frame shows, as `motion_truth` found them; parameters as for
        `frame`.
        """
        name, k = self._camera_name(camera), self._frame_number(number)
        if not self._about(name, k)["motion"]:
            raise InvalidValueError(f"frame {k} of {name!r} has no motion: it is the last one, or none was asked for")
        with content_errors(self.path, f"holds no possible motion of frame {k}"):
            arrays = read_arrays(self._store(name), MOTION_NAMES, limits, frame=k)
            return MotionTruth(*(arrays[key] for key in MOTION_NAMES))

    def _camera_name(self, camera: str | None) -> str:
        if camera is None and len(self.cameras) == 1:
            return self.cameras[0]
        if camera not in self.cameras:
            raise InvalidValueError(f"camera is {camera!r}; it must be one of {', '.join(self.cameras)}")
        return camera

    def _frame_number(self, number: int) -> int:
        n = len(self)
        return whole(number, "the number of a frame", at_least=-n, at_most=n - 1) % n

    def _store(self, name: str) -> Path:
        return self.path / f"{name}.zarr"

    def _about(self, name: str, k: int) -> Mapping[str, Any]:
        for image in self.manifest["images"]:
            if (image["camera"], image["frame"]) == (name, k):
                facts: Mapping[str, Any] = image
                return facts
        raise InvalidValueError(f"frame {k} of {name!r} is not there yet; `write` goes on with what is missing")

    def _camera(self, about: Mapping[str, Any]) -> PlenopticCamera:
        camera = from_tree(self.manifest["cameras"][about["camera"]][about["camera_value"]])
        if not isinstance(camera, PlenopticCamera):
            raise FileError(f"{str(self.path / MANIFEST)!r} holds a {type(camera).__name__} where a camera must be")
        return dataclasses.replace(camera, pose=from_tree(about["pose"]), shutter=from_tree(about["shutter"]))


def read(folder: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> DataSet:
    """Open a data set that `write` wrote, or has begun.

    Parameters
    ----------
    folder : path-like
    limits : FileLimits
        The size of the manifest.

    Raises
    ------
    FileError
        If there is no data set, or its manifest is damaged.

    Examples
    --------
    See `write`.
    """
    source = file_path(folder)
    path = source / MANIFEST
    if not path.is_file():
        begun = "is begun and has no manifest yet: call `write` again" if (source / LOG).is_file() else "is no data set"
        raise FileError(f"{str(source)!r} {begun}; `write` makes {MANIFEST} at its end")
    with content_errors(path, "is no manifest of a data set"):
        content = json.loads(read_file(path, limits))
        _check(content)
    return DataSet(source, MappingProxyType(content))


def _check(content: Any) -> None:
    """Raise an error if something is missing that `DataSet` looks up."""
    if content["format"] != FORMAT:
        raise ValueError(f"its format is {content['format']!r:.40}, not {FORMAT!r}")
    count, complete, cameras = content["frames"], content["complete"], content["cameras"]
    if type(count) is not int or count < 1 or type(complete) is not bool:
        raise ValueError("it does not say how many frames there are")
    if not isinstance(cameras, dict) or not cameras:
        raise ValueError("it does not say which cameras there are")
    for name in cameras:
        if not NAME.fullmatch(name):
            raise ValueError(f"{name!r:.80} is no name of a camera")
    origin = content["made_with"]
    keys = {"camera", "frame", "camera_value", "pose", "shutter", "samples", "replicates", "seed", "motion", "parts"}
    for image in content["images"]:
        if missing := keys - image.keys():
            raise ValueError(f"an image lacks {', '.join(sorted(missing))}")
        cameras[image["camera"]][image["camera_value"]]
        content["object_names"][image["object_names"]]
        if "image" not in image["parts"][0]["arrays"]:
            raise ValueError("an image does not say which arrays it has")
    origin["settings"]

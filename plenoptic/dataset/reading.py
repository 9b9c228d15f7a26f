"""Opening data sets."""

from __future__ import annotations

import json
import os
import re
from types import MappingProxyType
from typing import Any

from plenoptic.core.files.file_limits import DEFAULT, FileLimits, read_file
from plenoptic.core.values import file_path
from plenoptic.dataset.contents import FORMAT, LOG, MANIFEST, DataSet
from plenoptic.errors import FileError

NAME = re.compile(r"[A-Za-z0-9_-]{1,60}")
"""Of cameras: they become names of folders."""


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
        Where there is no data set, or its manifest is damaged.

    Examples
    --------
    See `write`.
    """
    source = file_path(folder)
    path = source / MANIFEST
    if not path.is_file():
        begun = "is begun and has no manifest yet: call `write` again" if (source / LOG).is_file() else "is no data set"
        raise FileError(f"{str(source)!r} {begun}; `write` makes {MANIFEST} at its end")
    try:
        content = json.loads(read_file(path, limits))
        _check(content)
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise FileError(f"{str(path)!r} is no manifest of a data set: {error}; restore it from its origin") from None
    return DataSet(source, MappingProxyType(content))


def _check(content: Any) -> None:
    """An error where something is missing that `DataSet` looks up."""
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

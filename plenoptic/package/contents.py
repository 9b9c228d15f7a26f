"""Contents of a package, with their names."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.points.centres import CentreMethod, MicrolensCentres
from plenoptic.core.values import result
from plenoptic.package.calibration import CalibrationPoints
from plenoptic.readout.raw import RawImage
from plenoptic.rendering.exposure import Exposure

PROVENANCE, CAMERA, TRUTH, POINTS = "provenance.json", "camera.json", "truth.npz", "points.csv"
PROVENANCE_FORMAT = "plenoptic-package-1"


@result
class Package:
    """A picture of a plenoptic camera with all that belongs to it. See `write` and `read`.

    Parameters
    ----------
    exposure : Exposure
        The picture as light, with its standard error and truth.
    raw : RawImage
        The same as its sensor reads it out.
    camera : PlenopticCamera
        That took it.
    white : Exposure or None
        Its white image.
    white_raw : RawImage or None
        The same as the sensor reads it out, lit so that its brightest pixels reach 0.8 of the white level.
    other_whites : tuple of (Exposure, RawImage)
        White images at other stops; each exposure names its camera.
    dark : RawImage
        Raw image without light.
    centres : mapping from CentreMethod to MicrolensCentres
        Centres of the microlens images, where they are defined; empty without microlenses.
    points : CalibrationPoints or None
        Of calibration targets.
    provenance : mapping
        Versions, seeds, samples, error, plan, and the SHA-256 of every file.
    """

    exposure: Exposure
    raw: RawImage
    camera: PlenopticCamera
    white: Exposure | None
    white_raw: RawImage | None
    other_whites: tuple[tuple[Exposure, RawImage], ...]
    dark: RawImage
    centres: Mapping[CentreMethod, MicrolensCentres]
    points: CalibrationPoints | None
    provenance: Mapping[str, Any]

    def __repr__(self) -> str:
        whites = (self.white is not None) + len(self.other_whites)
        parts = [
            f"{whites} white image{'s' * (whites != 1)}",
            f"{max(map(len, self.centres.values()), default=0)} microlenses",
        ]
        parts += [] if self.points is None else [repr(self.points)]
        return f"Package({self.exposure!r}, {', '.join(parts)})"


def centre_arrays(centres: Mapping[CentreMethod, MicrolensCentres]) -> dict[str, Any]:
    """All centres as arrays: `index`, `type` and `on_array` of all microlenses, and pixels and mm by each method."""
    index = np.unique(np.concatenate([listed.index for listed in centres.values()]), axis=0)
    order = {tuple(pair): row for row, pair in enumerate(index.tolist())}
    arrays: dict[str, Any] = {"index": index, "type": np.zeros(len(index), dtype=np.int64)}
    arrays["on_array"] = np.full((len(index), 2), np.nan)
    for method, listed in centres.items():
        rows = [order[tuple(pair)] for pair in listed.index.tolist()]
        arrays["type"][rows], arrays["on_array"][rows] = listed.type, listed.on_array
        for name in ("position", "pixel"):
            arrays[f"{method.name.lower()}_{name}"] = places = np.full((len(index), 2), np.nan)
            places[rows] = getattr(listed, name)
    return arrays


def centres_from(arrays: Mapping[str, Any]) -> Mapping[CentreMethod, MicrolensCentres]:
    """The way back; a KeyError where something is missing."""
    by_method = {}
    for method in CentreMethod:
        position = arrays.get(f"{method.name.lower()}_position")
        if position is not None:
            finite = np.isfinite(position).all(axis=1)
            parts = {name: arrays[name][finite] for name in ("index", "type", "on_array")}
            pixel = arrays[f"{method.name.lower()}_pixel"][finite]
            by_method[method] = MicrolensCentres(**parts, position=position[finite], pixel=pixel, method=method)
    return MappingProxyType(by_method)


def centre_table(arrays: Mapping[str, Any]) -> str:
    """The same as text: k, l, type, and row and column by each method."""
    methods = [name.removesuffix("_pixel") for name in arrays if name.endswith("_pixel")]
    head = ["k", "l", "type", *(f"{name}_{axis}" for name in methods for axis in ("row", "column"))]
    rows = [",".join(head)]
    pixels = np.concatenate([arrays[f"{name}_pixel"] for name in methods], axis=1)
    for (k, l), kind, places in zip(arrays["index"].tolist(), arrays["type"].tolist(), pixels.tolist(), strict=True):
        rows.append(",".join(map(repr, (k, l, kind, *places))))
    return "\n".join([*rows, ""])

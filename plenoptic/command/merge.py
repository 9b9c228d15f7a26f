"""Make one image of its parts, and of renders with other seeds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plenoptic.command.open_file import exposure_of, open_file
from plenoptic.command.render_options import add_output, parse_region
from plenoptic.command.tiles import missing_tiles
from plenoptic.errors import FileError, InvalidValueError

if TYPE_CHECKING:
    from plenoptic.core.files.zarr_files import Region
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.rendering.exposure_metadata import ExposureMetadata
    from plenoptic.rendering.merging.merge_plan import Part

_NAMED = 8
"""Missing parts that a message names."""


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    text = "images (EXR, zarr) or packages: regions beside each other, and the same region with other seeds"
    parser.add_argument("parts", metavar="PART", nargs="+", help=text)
    add_output(parser)
    text = "region that the parts make up, if not the whole sensor; not needed if all are of the same region"
    parser.add_argument("--region", type=parse_region, metavar="R0:R1,C0:C1", help=text)


def run(options: argparse.Namespace) -> None:
    """Merge, save and print the exposure; a store is written while parts are read."""
    from plenoptic.rendering.exposure_files import check_target, checked_ending
    from plenoptic.rendering.merging.merge import merge_parts, merge_to_store

    check_target(options.output)
    parts = [_part(name) for name in options.parts]
    _check_complete([part.metadata for part in parts], options.region)
    merged: Exposure | ExposureMetadata
    if checked_ending(options.output) == ".zarr":
        merged = merge_to_store(parts, options.output)
    else:
        merged = merge_parts(parts)
        merged.save(options.output)
    print(f"{options.output}: {merged}")
    if merged.stats is not None:
        print(merged.stats)


def _part(name: str) -> Part:
    """A file or folder, of which only the metadata has been read if that is possible."""
    from plenoptic.core.files.zarr_files import attributes_of
    from plenoptic.rendering.exposure_files import metadata_of_image
    from plenoptic.rendering.exposure_metadata import metadata_of
    from plenoptic.rendering.merging.merge_plan import FilePart, StorePart

    def load() -> Exposure:
        file = open_file(name)
        if (exposure := exposure_of(file)) is None:
            raise FileError(f"{name!r} is {file.kind}; give an image that `plenoptic render` wrote")
        return exposure

    path = Path(name)
    if path.is_file() and path.suffix.lower() == ".exr":
        return FilePart(name, metadata_of_image(path), load)
    if attributes_of(path) is not None:
        return StorePart(name)
    return FilePart(name, metadata_of(load()), load)


def _check_complete(heads: list[ExposureMetadata], region: tuple[slice, slice] | None) -> None:
    """Raise if parts of a region, or of the sensor, are missing; the error names them."""
    from plenoptic.camera.checks import sensor_region
    from plenoptic.rendering.crop import region_text
    from plenoptic.rendering.merging.merge_plan import missing_regions

    regions = {head.sensor_region for head in heads}
    camera = heads[0].camera
    if camera is None or (region is None and len(regions) == 1):
        return
    shape = camera.sensor.shape
    missing: list[Region] = missing_regions(sensor_region(shape, region), regions)
    if not missing:
        return
    tiles = [] if region is not None else missing_tiles(shape, regions)
    names = [f"{tile.k}/{tile.n}" for tile in tiles] or [region_text(part) for part in missing]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    kind, are = ("tile" if tiles else "region"), ("are" if len(names) > 1 else "is")
    raise InvalidValueError(
        f"{kind} {'; '.join(names[:_NAMED])}{more} {are} missing; render the missing parts, or give the region that "
        "the parts make up by --region"
    )

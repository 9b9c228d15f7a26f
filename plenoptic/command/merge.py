"""Make one image of parts of it, and of renders with other seeds."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from plenoptic.command.files import exposure_of, opened
from plenoptic.command.render_options import region_of
from plenoptic.command.tiles import missing_tiles
from plenoptic.errors import FileError, InvalidValueError

if TYPE_CHECKING:
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.rendering.exposure_metadata import ExposureMetadata
    from plenoptic.rendering.merging.parts import Part
    from plenoptic.rendering.merging.regions import Region

_NAMED = 8
"""Missing parts whose names fit into a line."""


def fill_parser(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    text = "images (EXR, zarr) or packages: regions beside each other, and the same region with other seeds"
    parser.add_argument("parts", metavar="PART", nargs="+", help=text)
    text = "image to write: .exr or .zarr keep everything, .tif and .png the picture"
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help=text)
    text = "what parts make up, if not the whole sensor; it need not be given where all are of the same region"
    parser.add_argument("--region", type=region_of, metavar="R0:R1,C0:C1", help=text)


def run(options: argparse.Namespace) -> None:
    """Merge, save, and print what came of it; a store is written while parts are read."""
    from plenoptic.rendering.exposure_files import check_target, checked_ending
    from plenoptic.rendering.merging.merge import merge_parts, merge_to_store

    check_target(options.output)
    parts = [_part(name) for name in options.parts]
    _check_complete([part.metadata for part in parts], options.region)
    made: Exposure | ExposureMetadata
    if checked_ending(options.output) == ".zarr":
        made = merge_to_store(parts, options.output)
    else:
        made = merge_parts(parts)
        made.save(options.output)
    print(f"{options.output}: {made}")
    if made.stats is not None:
        print(made.stats)


def _part(name: str) -> Part:
    """A file or folder, of which no more has been read than it takes to know what it is."""
    from plenoptic.core.files.zarr_reading import attributes_of
    from plenoptic.rendering.exposure_files import metadata_of_image
    from plenoptic.rendering.exposure_metadata import metadata_of
    from plenoptic.rendering.merging.parts import FilePart, StorePart

    def load() -> Exposure:
        found = opened(name)
        if (shot := exposure_of(found)) is None:
            raise FileError(f"{name!r} is {found.kind}; give an image that `plenoptic render` wrote")
        return shot

    path = Path(name)
    if path.is_file() and path.suffix.lower() == ".exr":
        return FilePart(name, metadata_of_image(path), load)
    if attributes_of(path) is not None:
        return StorePart(name)
    return FilePart(name, metadata_of(load()), load)


def _check_complete(heads: list[ExposureMetadata], wanted: tuple[slice, slice] | None) -> None:
    """An error that names what is missing of a region, or of the sensor."""
    from plenoptic.camera.checks import sensor_region
    from plenoptic.rendering.crop import region_text
    from plenoptic.rendering.merging.regions import missing_regions

    regions = {head.sensor_region for head in heads}
    camera = heads[0].camera
    if camera is None or (wanted is None and len(regions) == 1):
        return
    shape = camera.sensor.shape
    missing: list[Region] = missing_regions(sensor_region(shape, wanted), regions)
    if not missing:
        return
    tiles = [] if wanted is not None else missing_tiles(shape, regions)
    names = [f"{tile.k}/{tile.n}" for tile in tiles] or [region_text(region) for region in missing]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    what, are = ("tile" if tiles else "region"), ("are" if len(names) > 1 else "is")
    raise InvalidValueError(
        f"{what} {'; '.join(names[:_NAMED])}{more} {are} missing; render what is missing, or say by --region what "
        "parts make up"
    )

"""For plenpy (M. Schambach and F. Puente Leon, plenpy: a Python package for light field cameras, 2020)."""

from __future__ import annotations

import os

import numpy as np

from plenoptic.camera.gaussian import object_plane
from plenoptic.core.files.atomic_file import write_json
from plenoptic.core.files.codes import brightest
from plenoptic.core.values import check_kind
from plenoptic.export.lattice import lens_rows
from plenoptic.export.pictures import folder_at, plain_name, write_picture, write_readme
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.rendering.exposure import Exposure

_WHITE = "Calibration/WhiteImages"


def plenpy(folder: str | os.PathLike[str], shot: Exposure, white: Exposure, *, name: str = "shot") -> None:
    """Write a raw image and its white image as a camera's folder of plenpy, which its `RayTracerLF` opens.

    Images are linear, 16 bits, and turned by a quarter where rows of lenses run along columns. README.txt has the call.

    Parameters
    ----------
    folder, shot, white, name
        As for `plenopticam`, with the same errors; `name` is that of the raw image.

    Notes
    -----
    Not expressed: errors, truth, focal types; where the lenses are, which it finds in the white image. Square
    lattices raise an error there.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.plenpy(folder, white, white)
    ...     sorted(path.name for path in pathlib.Path(folder).rglob("*.*"))
    ['README.txt', 'shot.json', 'shot.png', 'white.json', 'white.png']
    """
    check_kind(white, "white", Exposure, "pl.render_white(camera)")
    light = white.image[crop_in_white_image(shot, white)[0]]
    target, name = folder_at(folder, "Images", "Calibration", _WHITE), plain_name(name)
    lens = lens_rows(shot, turn=True)
    camera, scale = lens.camera, brightest(light)
    # Ratio of the full codes, so that the raw image over the white one is 1 for a white scene.
    ratio = max(brightest(shot.image) / scale, 1e-30)
    write_picture(target / "Images" / f"{name}.png", lens.turn_image(shot.image), scale=scale * max(ratio, 1.0))
    write_picture(target / _WHITE / "white.png", lens.turn_image(light), scale=scale)
    z = object_plane(camera.lens, camera.stop_to_microlenses, camera.wavelength)
    said = {"camera": {"imageDistance": camera.stop_to_microlenses, "focusDistance": -z if np.isfinite(z) else 1e9}}
    for file in (target / "Images" / f"{name}.json", target / _WHITE / "white.json"):
        write_json(file, said)
    call = f"RayTracerLF(folder, grid_type={'hex' if lens.hexagonal else 'rect'!r}, ml_size={lens.pitch[0]:.6g}, "
    write_readme(
        target,
        "plenpy",
        "from plenpy.cameras.raytracer_lightfield_camera import RayTracerLF\n"
        f'camera = {call}ml_focal_length={1e-3 * lens.array.focal_lengths[0]:.6g}, format="PNG-PIL")\n'
        "camera.calibrate()\ncamera.load_sensor_image(0)\ncamera.decode_sensor_image(0)",
        "errors, truth, focal types, centres.",
        {"quarters turned, counter-clockwise": lens.turns, "full code over that of the white image": max(ratio, 1.0)},
    )

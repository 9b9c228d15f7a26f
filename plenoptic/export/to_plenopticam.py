"""For PlenoptiCam (C. Hahne and A. Aggoun, IEEE Trans. Image Process. 30 (2021), doi:10.1109/TIP.2021.3095671)."""

from __future__ import annotations

import os

import numpy as np

from plenoptic.camera.points.centres import CentreMethod
from plenoptic.core.files.atomic_file import write_json
from plenoptic.core.files.codes import brightest
from plenoptic.export.lattice import lens_rows
from plenoptic.export.pictures import folder_at, plain_name, write_picture, write_readme
from plenoptic.lightfield.raw_arrays import crop_in_white_image
from plenoptic.rendering.exposure import Exposure


def plenopticam(
    folder: str | os.PathLike[str],
    shot: Exposure,
    white: Exposure,
    *,
    name: str = "shot",
    method: CentreMethod = CentreMethod.CENTROID,
) -> None:
    """Write a raw image, its white image and the centres of the micro images for PlenoptiCam.

    The raw image is sRGB-encoded and the white one linear, as it reads them; both are turned by a quarter where rows of
    lenses run along columns. With the centres it need not search; README.txt has the commands.

    Parameters
    ----------
    folder : path-like
        Folder, made if it is missing; files of the same name are replaced.
    shot, white : Exposure
        Images of the same pixels, `shot` with its camera.
    name : str, optional
        Name of the files.
    method : CentreMethod, optional
        Definition of the centres.

    Raises
    ------
    InvalidValueError
        Without microlenses on a lattice, or if the white image has other pixels.
    FileError
        If a file cannot be written.

    Notes
    -----
    Not expressed: errors and truth; focal types; microlenses out of place one by one, of which it only needs
    the centres. It takes rows that run along those of the image within some degrees.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154))
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.plenopticam(folder, white, white, name="flat")
    ...     sorted(path.name for path in pathlib.Path(folder).iterdir())
    ['README.txt', 'flat.tiff', 'flat_centres.json', 'flat_white.tiff']
    """
    target, name, light = folder_at(folder), plain_name(name), white.image[crop_in_white_image(shot, white)[0]]
    lens = lens_rows(shot, turn=True, method=method).whole(shot.image.shape[:2]).rectangle()
    scale = brightest(shot.image)
    write_picture(target / f"{name}.tiff", lens.turn_image(shot.image), scale=scale, encoded=True)
    write_picture(target / f"{name}_white.tiff", lens.turn_image(light), scale=brightest(light))
    listed = np.column_stack([lens.centre, lens.row, lens.place]).tolist()
    across, row_pitch = lens.pitch
    content = {
        "mic_list": [[y, x, int(row), int(place)] for y, x, row, place in listed],
        "pat_type": "hex" if lens.hexagonal else "rec",
        "ptc_mean": [row_pitch, across],
    }
    write_json(target / f"{name}_centres.json", content)
    patch = max(int(across) // 2 * 2 - 1, 3)
    command = f"plenopticam --file={name}.tiff --cali={name}_white.tiff --patch={patch} --smpl=local"
    write_readme(
        target,
        "PlenoptiCam",
        f"pip install plenopticam; views and refocused pictures appear in {name}/.\n"
        f"with these centres:   {command} --meta={name}_centres.json\n"
        f"with its own search:  {command} --meth=grid-fit   (images of less than 0.7 of their distance)\n"
        "Its global resampling, the default, fails for some numbers of lenses.",
        "errors, truth, focal types; cameras whose microlenses are not focused at infinity give it no sharp views.",
        {
            "quarters turned, counter-clockwise": lens.turns,
            "rows of lenses against rows of pixels, degrees": f"{np.degrees(lens.angle):.4f}",
            "full code, in the units of the exposure": scale,
        },
    )

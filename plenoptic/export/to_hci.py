"""For the HCI 4D Light Field Benchmark (K. Honauer et al., ACCV 2016, doi:10.1007/978-3-319-54187-7_2)."""

from __future__ import annotations

import configparser
import io
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from plenoptic import __version__
from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.codes import white_point
from plenoptic.core.files.float_maps import write_pfm
from plenoptic.core.values import Floats, check_kind
from plenoptic.errors import InvalidValueError
from plenoptic.export.pictures import check_no_others, folder_at, write_picture, write_readme
from plenoptic.lightfield.views import LightField
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points
from plenoptic.optics.lens.models import LensModel
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene


def hci(folder: str | os.PathLike[str], field: LightField, *, scene: Scene | None = None) -> None:
    """Write a light field as a folder of the HCI 4D Light Field Benchmark, with truth for every view.

    Parameters
    ----------
    folder : path-like
        The scene's folder, made if it is missing; files of the same name are replaced.
    field : LightField
        From `decode`: of a camera with a plane in focus, as many views along u as along v, 3 or more.
    scene : Scene, optional
        The rendered scene: depth and disparity are traced for every view. None: none are written.

    Raises
    ------
    InvalidValueError
        If the light field has other views, no plane in focus, or no pupil at a finite distance.
    FileError
        If a file cannot be written, or the folder holds views of another light field.

    Notes
    -----
    Pictures are 8-bit sRGB with one scale for all, the 99.9th percentile; pixels without light are black there and in
    `valid_mask.png`. Depth is in metres before the lens's entrance pupil, where the views' centres lie; disparity is
    `LightField.disparity_at` of that depth, which is the benchmark's formula with the numbers of `parameters.cfg`:
    sensor_size_mm is that of a thin lens of the same focal length at the entrance pupil. `highres` maps are the
    same as `lowres` ones.

    Not expressed: errors, views that are not on a square grid of the pupil, how the real lens departs from
    Gaussian optics.

    Examples
    --------
    >>> import pathlib, tempfile, plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(110, 154), lattice=pl.Lattice.SQUARE)
    >>> white = pl.render_white(camera, samples=16, progress=False)
    >>> field = pl.lightfield.decode(white, white, views=3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pl.export.hci(folder, field, scene=pl.shapes.white_plane())
    ...     names = sorted(path.name for path in pathlib.Path(folder).iterdir())
    >>> len(names), names[:3]
    (34, ['README.txt', 'gt_depth_highres.pfm', 'gt_depth_lowres.pfm'])
    """
    check_kind(field, "field", LightField, "pl.lightfield.decode(shot, white)")
    across, down = field.views.shape[:2]
    if across != down or across < 3:
        raise InvalidValueError(
            f"there are {across} x {down} views; the benchmark needs as many along u as along v, 3 or more"
        )
    numbers = _thin_lens(field)
    target = folder_at(folder)
    scale, names = white_point(field.views), [f"input_Cam{number:03d}.png" for number in range(across * down)]
    check_no_others(target, "input_Cam*.png", names)
    for v in range(down):
        for u in range(across):
            view = field.views[u, v]
            write_picture(target / names[v * across + u], view, scale=scale, bits=8, encoded=True)
    valid = np.asarray(np.isfinite(field.views).all(axis=(0, 1, 4)))
    write_picture(target / "valid_mask.png", valid[:, :, np.newaxis].astype(float), scale=1.0, bits=8)
    disparities = np.zeros(1) if scene is None else _write_truth(target, field, scene, numbers)
    write_file(target / "parameters.cfg", _parameters(field, numbers, disparities).encode("utf-8"))
    rows, columns = field.views.shape[2:4]
    write_readme(
        target,
        "the HCI 4D Light Field Benchmark",
        f"input_CamNNN.png: {across} x {down} views of {columns} x {rows} pixels, row by row, Cam000 upper left.\n"
        "gt_depth_*.pfm: metres before the entrance pupil. gt_disp_*.pfm: pixels from view to view, positive before\n"
        "the plane in focus. Files without Cam are of the central view, highres ones the same as lowres.\n"
        "valid_mask.png: white where all views have light.\n"
        "Many loaders expect 9 x 9 views of 512 x 512 pixels: decode with views=9, and have 512 x 512 microlenses.",
        "errors; how the real lens departs from Gaussian optics; another resolution of depth maps.",
        {"full code, in the units of the light field": scale},
    )


class _ThinLens(NamedTuple):
    """The shifted thin lenses whose views look the same, in mm."""

    pupil: float
    """z of the entrance pupil, where the views' centres lie."""
    baseline: float
    focal_length: float
    focus: float
    """Distance from the pupil to the plane in focus."""
    sensor: float
    """Its larger side."""
    pixels: int
    """Along it."""

    def disparity(self, distance: Floats) -> Floats:
        """The benchmark's formula, in pixels."""
        beta = self.baseline * self.focal_length * self.pixels
        return np.asarray((beta * self.focus / distance - beta) / (self.focus * self.sensor))


def _thin_lens(field: LightField) -> _ThinLens:
    camera = field.camera
    if camera is None:
        raise InvalidValueError("the light field names no camera; export one that decode made")
    points = cardinal_points(camera.lens, camera.wavelength)
    pupil = points.rear_principal if camera.lens.model is LensModel.THIN else points.entrance_pupil
    step = float(np.abs(np.diff(field.pupil[:, 0, 0])).mean()) * points.entrance_pupil_semi_diameter
    focus, pixels = pupil - field.z_focus, max(field.views.shape[2:4])
    sensor = abs(points.efl) * pixels * field.object_spacing[0] / focus
    numbers = _ThinLens(pupil, step, abs(points.efl), focus, sensor, pixels)
    if not all(map(math.isfinite, numbers)) or not field.spacing[0] == field.spacing[1]:
        raise InvalidValueError(
            "the benchmark needs a plane in focus, a pupil at a finite distance and square pixels: focus the camera, "
            "or decode with spacing="
        )
    # Traced disparities grow with the inverse distance at another rate than those of Gaussian optics.
    traced = field.disparity_at(pupil - 2.0 * focus)[0] / float(numbers.disparity(np.array(2.0 * focus)))
    return numbers._replace(baseline=traced * step)


def _write_truth(target: Path, field: LightField, scene: Scene, numbers: _ThinLens) -> Floats:
    """Depth and disparity of all views; the finite disparities of the central one."""
    count, half = field.views.shape[0], field.views.shape[0] // 2
    middle = np.zeros(1)
    for v in range(count):
        for u in range(count):
            depth = field.truth(scene, u - half, v - half, truth=Truth.DEPTH).depth
            assert depth is not None
            distance = depth + numbers.pupil
            maps = {"depth": 1e-3 * distance, "disp": numbers.disparity(distance)}
            for name, plane in maps.items():
                write_pfm(target / f"gt_{name}_lowres_Cam{v * count + u:03d}.pfm", plane)
                if u == v == half:
                    write_pfm(target / f"gt_{name}_lowres.pfm", plane)
                    write_pfm(target / f"gt_{name}_highres.pfm", plane)
                    middle = maps["disp"][np.isfinite(maps["disp"])]
    return middle if middle.size else np.zeros(1)


def _parameters(field: LightField, numbers: _ThinLens, disparities: Floats) -> str:
    rows, columns = field.views.shape[2:4]
    low, high = math.floor(10 * float(disparities.min())) / 10, math.ceil(10 * float(disparities.max())) / 10
    content: dict[str, dict[str, Any]] = {
        "intrinsics": {
            "focal_length_mm": numbers.focal_length,
            "image_resolution_x_px": columns,
            "image_resolution_y_px": rows,
            "sensor_size_mm": numbers.sensor,
            "fstop": 100,
        },
        "extrinsics": {
            "num_cams_x": field.views.shape[0],
            "num_cams_y": field.views.shape[1],
            "baseline_mm": numbers.baseline,
            "focus_distance_m": 1e-3 * numbers.focus,
            **{f"center_cam_{axis}": 0.0 for axis in ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")},
        },
        "meta": {
            "scene": "plenoptic",
            "category": "additional",
            "date": "",
            "version": __version__,
            "authors": "",
            "contact": "",
            "cycles_seed": 0,
            "disp_min": low,
            "disp_max": high,
            "frustum_disp_min": low,
            "frustum_disp_max": high,
            "depth_map_scale": 1.0,
        },
    }
    parser, text = configparser.ConfigParser(), io.StringIO()
    parser.read_dict(content)
    parser.write(text)
    return text.getvalue()

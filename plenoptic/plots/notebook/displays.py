"""Registry of the values that show themselves in notebooks, and of those with a method that draws them.

A picture is made once for the value that was shown last of each class. Keys are names of classes, for
`core.display`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from plenoptic.camera.report.layout import section_rays
from plenoptic.core.last_result import LastResultCache
from plenoptic.optics.lens.analysis.layout import lens_layout
from plenoptic.optics.stops.stop_registry import STOPS
from plenoptic.plots import (
    aberrations,
    calibration,
    camera,
    contrast,
    error_time,
    exposure,
    fields,
    lens,
    lightfield,
    points,
    scene,
    sensor,
    spots,
)
from plenoptic.plots.camera_layout import SIZES, plot_camera_layout
from plenoptic.plots.notebook import components
from plenoptic.plots.notebook.camera_html import key_numbers, report_html, title_of
from plenoptic.plots.notebook.html import heading_html, picture_html, table_html, text_html

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.lens.stack import LensStack
    from plenoptic.rendering.plan.stages import Plan
    from plenoptic.scene.scene import Scene

_Size = tuple[float, float]


def _figure(
    plot: Callable[..., Any], size: _Size | Callable[[Any], _Size], alt: str, *, has_caption: bool = True
) -> LastResultCache[Any, str]:
    """Function that shows a value as a figure, of some inches, above its repr."""

    def picture(value: Any) -> str:
        text, inches = repr(value), size(value) if callable(size) else size
        described = f"{alt}: {text}" if has_caption else alt
        return picture_html(
            lambda figure: plot(value, figure=figure), size=inches, alt=described, text=text, has_caption=has_caption
        )

    return LastResultCache(picture)


def _axes(plot: Callable[..., Any], size: _Size, alt: str, *, has_caption: bool = True) -> LastResultCache[Any, str]:
    return _figure(lambda value, figure: plot(value, figure.subplots()), size, alt, has_caption=has_caption)


_curves = partial(_axes, has_caption=False)
"""Curves name their field and planes; the repr would add columns of numbers."""


_scene_figure = _figure(scene.plot_scene, scene.SIZE, "A scene from three sides")


def _scene_html(shown: Scene) -> str:
    """Picture of a scene; its repr where it has neither meshes nor lights nor views with a place."""
    placed = any(hasattr(light, "position") or hasattr(light, "mesh") for light in shown.lights)
    return _scene_figure(shown) if shown.meshes or shown.views or placed else text_html(repr(shown))


def _plan_html(plan: Plan) -> str:
    """Pictures of the scene from three sides, and tables of the stages that run and that are left out."""
    parts = []
    if plan.subject is not None and plan.subject.scene is not None:
        shown, camera = plan.subject.scene, plan.subject.camera
        text = repr(shown)
        alt = f"A scene from three sides and the field of a camera: {text}"
        parts.append(
            picture_html(
                lambda figure: scene.plot_scene(shown, camera, figure=figure), size=scene.SIZE, alt=alt, text=text
            )
        )
    for runs, caption in ((True, "runs"), (False, "left out")):
        rows = [(d.name, d.reason) for d in plan.decisions if d.runs is runs]
        parts.append(table_html(("stage", "because"), rows, caption=f"{caption}: {len(rows)}"))
    return "".join(parts)


def _camera_html(camera: PlenopticCamera) -> str:
    """Picture and key numbers of a camera, by Gaussian optics, without compilation."""
    title = title_of(camera)
    alt, size = f"Section of a camera with the rays of one pixel: {title}", SIZES[camera.microlenses is not None]
    picture = picture_html(lambda figure: _camera_layout(camera, figure), size=size, alt=alt, text="")
    return heading_html(title) + picture + table_html((), key_numbers(camera))


def _camera_layout(camera: PlenopticCamera, figure: Figure | None) -> Figure:
    return plot_camera_layout(camera, section_rays(camera), figure)


def _lens_layout(stack: LensStack, ax: Axes | None, **rays: Any) -> Axes:
    paths, labels, z_image = lens_layout(stack, **rays)
    return lens.plot_layout(stack, paths, labels=labels, z_image=z_image, ax=ax)


_MAPS, _FIELDS, _CURVES = (11.0, 3.4), (3.6, 4.6), (6.4, 4.2)
_stop_picture = _axes(lens.plot_stop, (4.0, 4.0), "The hole of a stop")

_corners_picture = _axes(lambda corners, ax: calibration.plot_corners(corners, ax=ax), (6.0, 4.6), "Corners")

PICTURES: dict[str, Callable[[Any], str]] = {
    **{kind.stop.__name__: _stop_picture for kind in STOPS.values()},
    "BoardCorners": _corners_picture,
    "Calibration": _figure(calibration.plot_calibration, calibration.SIZE, "Errors of a calibration"),
    "CameraReport": report_html,
    "CameraSpread": _axes(camera.plot_camera_spread, (6.2, 5.0), "The light of a point on the sensor"),
    "ChromaticShift": _curves(aberrations.plot_chromatic_shift, (5.0, 4.0), "Focus against the wavelength"),
    "Coma": _curves(fields.plot_coma, _FIELDS, "Coma against the field"),
    "DepthDistortion": _curves(fields.plot_depth_distortion, _CURVES, "Sharp distance against the height"),
    "Distortion": _curves(fields.plot_distortion, _FIELDS, "Distortion against the field"),
    "DepthMap": _figure(lightfield.plot_depth_map, _MAPS, "Depth, disparity and confidence"),
    "Exposure": _figure(exposure.plot_exposure, exposure.notebook_size, "An exposure"),
    "FieldCurvature": _curves(fields.plot_field_curvature, _FIELDS, "Foci against the field"),
    "GhostTable": _axes(spots.plot_ghosts, (6.4, 4.4), "Light of ghosts against their size"),
    "LensStack": _axes(lens.plot_lens, (6.0, 3.6), "Section of a lens"),
    "LightField": _figure(
        lightfield.plot_light_field,
        lightfield.light_field_size,
        "The central view of a light field with epipolar slices",
    ),
    "MicroImageGrid": _figure(calibration.plot_grid, calibration.SIZE, "A lattice of micro images"),
    "MicrolensArray": _axes(components.draw_array, components.ARRAY_SIZE, "Microlenses around the centre of an array"),
    "MicrolensCentres": _figure(points.plot_centres, (9.6, 4.4), "Centres of micro images"),
    "Mtf": _curves(contrast.plot_mtf, _CURVES, "Modulation against the spatial frequency"),
    "Observations": _corners_picture,
    "PhotonTransfer": _curves(sensor.plot_photon_transfer, _CURVES, "Variance against the signal"),
    "Plan": LastResultCache(_plan_html),
    "PlenopticCamera": LastResultCache(_camera_html),
    "PointSpread": _curves(contrast.plot_point_spread, aberrations.MAP_SIZE, "The picture of a point by rays"),
    "Projection": _axes(points.plot_projection, (6.0, 4.6), "Points on the sensor"),
    "RawImage": _figure(exposure.plot_raw, exposure.RAW_SIZE, "A raw image"),
    "RayFan": _figure(
        lambda fan, figure: spots.plot_ray_fan(fan, figure=figure), (7.6, 3.9), "Ray fans of a point", has_caption=False
    ),
    "RelativeIllumination": _curves(fields.plot_relative_illumination, _CURVES, "Illumination against the field"),
    "Scene": _scene_html,
    "SeidelSums": _axes(aberrations.plot_seidel, (8.0, 4.0), "Seidel sums of the elements"),
    "Sensitivity": _curves(sensor.plot_sensitivity, (6.0, 3.6), "Response against the wavelength"),
    "Sensor": _figure(components.draw_sensor, components.SENSOR_SIZE, "A sensor and some of its pixels"),
    "SpotDiagram": _figure(spots.plot_spots, (4.0, 4.2), "A spot diagram"),
    "ThroughFocus": _curves(spots.plot_through_focus, (6.0, 4.0), "Radius of the spot against the image plane"),
    "View": _figure(lightfield.plot_view, _MAPS, "A picture from a focused camera, disparity and coverage"),
    "Vignetting": _curves(fields.plot_vignetting, _CURVES, "Part of the iris that is filled, against the field"),
    "WaveMtf": _curves(contrast.plot_mtf, _CURVES, "Modulation against the spatial frequency, with diffraction"),
    "WaveSpread": _axes(contrast.plot_point_spread, aberrations.MAP_SIZE, "The picture of a point with diffraction"),
    "Wavefront": _axes(aberrations.plot_wavefront, aberrations.MAP_SIZE, "Optical path differences over the iris"),
    "ZernikeFit": _axes(aberrations.plot_zernike, aberrations.BARS_SIZE, "Coefficients of Zernike polynomials"),
}

DRAWINGS: dict[str, Callable[..., Any]] = {
    "ErrorTable": error_time.plot_error_against_time,
    "LensStack": _lens_layout,
    "PlenopticCamera": _camera_layout,
}

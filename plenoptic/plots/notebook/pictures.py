"""Values of the package as pictures for notebooks, made once for the value that was shown last of each kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from plenoptic.core.last_result import LastResult
from plenoptic.plots import aberrations, contrast, exposure, lightfield, points, scene
from plenoptic.plots.notebook.html import picture_html, text_html


def _picture(plot: Callable[..., Any], size: Callable[[Any], tuple[float, float]], alt: str) -> LastResult[Any, str]:
    def made(shown: Any) -> str:
        text = repr(shown)
        return picture_html(
            lambda figure: plot(shown, figure=figure), size=size(shown), alt=f"{alt}: {text}", text=text
        )

    return LastResult(made)


_scene_picture = _picture(scene.plot_scene, lambda _: scene.SIZE, "A scene from three sides")


def scene_html(shown: Any) -> str:
    """A scene; as a text where it has neither meshes nor lights nor views with a place."""
    placed = (
        shown.meshes
        or shown.views
        or any(hasattr(light, "position") or hasattr(light, "mesh") for light in shown.lights)
    )
    return _scene_picture(shown) if placed else text_html(repr(shown))


def plan_picture(plan: Any) -> str:
    """The scene and the camera of a plan; nothing for one without."""
    if plan.subject is None or plan.subject.scene is None:
        return ""
    return _plan_picture(plan)


def _both(plan: Any) -> str:
    scene_, camera = plan.subject.scene, plan.subject.camera
    return picture_html(
        lambda figure: scene.plot_scene(scene_, camera, figure=figure),
        size=scene.SIZE,
        alt=f"A scene from three sides and the field of a camera: {scene_!r}",
        text=repr(scene_),
    )


_plan_picture: LastResult[Any, str] = LastResult(_both)

exposure_html = _picture(
    exposure.plot_exposure,
    lambda shot: (exposure.PANEL[0] * exposure.panels_of(shot), exposure.PANEL[1]),
    "An exposure",
)
raw_html = _picture(exposure.plot_raw, lambda _: (2.2 * exposure.PANEL[0], exposure.PANEL[1]), "A raw image")
_MAPS = (11.0, 3.4)
centres_html = _picture(points.plot_centres, lambda _: (9.6, 4.4), "Centres of microlens images")
projection_html = _picture(
    lambda found, figure: points.plot_projection(found, figure.subplots()), lambda _: (6.0, 4.6), "Points on the sensor"
)
light_field_html = _picture(
    lightfield.plot_light_field, lightfield.light_field_size, "The central view of a light field with epipolar slices"
)
view_html = _picture(lightfield.plot_view, lambda _: _MAPS, "A picture from a focused camera, disparity and coverage")
depth_map_html = _picture(lightfield.plot_depth_map, lambda _: _MAPS, "Depth, disparity and confidence")
wavefront_html = _picture(
    lambda found, figure: aberrations.plot_wavefront(found, figure.subplots()),
    lambda _: aberrations.MAP_SIZE,
    "Optical path differences over the iris",
)
zernike_html = _picture(
    lambda fit, figure: aberrations.plot_zernike(fit, figure.subplots()),
    lambda _: aberrations.BARS_SIZE,
    "Coefficients of Zernike polynomials",
)
spread_html = _picture(
    lambda spread, figure: contrast.plot_point_spread(spread, figure.subplots()),
    lambda _: aberrations.MAP_SIZE,
    "The picture of a point with diffraction",
)

"""Plenoptic cameras, simulated physically: rays from sensor pixels through microlenses and a real lens into a scene.

Names are loaded on first use (PEP 562), so that importing the package imports nothing else.
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from plenoptic import images as images
    from plenoptic import sampling as sampling
    from plenoptic import study as study
    from plenoptic.camera.camera import PlenopticCamera as PlenopticCamera
    from plenoptic.camera.forward import landing_points as landing_points
    from plenoptic.camera.forward import point_spread as point_spread
    from plenoptic.camera.pose import Pose as Pose
    from plenoptic.camera.spread import CameraSpread as CameraSpread
    from plenoptic.camera.spread import LandingPoints as LandingPoints
    from plenoptic.errors import FileError as FileError
    from plenoptic.errors import InvalidValueError as InvalidValueError
    from plenoptic.errors import PlenopticError as PlenopticError
    from plenoptic.errors import PrescriptionError as PrescriptionError
    from plenoptic.errors import SceneError as SceneError
    from plenoptic.exposure import Exposure as Exposure
    from plenoptic.exposure import RenderStats as RenderStats
    from plenoptic.film import Film as Film
    from plenoptic.optics import aberrations as aberrations
    from plenoptic.optics import paraxial as paraxial
    from plenoptic.optics.air import Absolute as Absolute
    from plenoptic.optics.air import Air as Air
    from plenoptic.optics.air import AirFormula as AirFormula
    from plenoptic.optics.analysis import aiming as aiming
    from plenoptic.optics.analysis.focusing import FocusCriterion as FocusCriterion
    from plenoptic.optics.dispersion import DispersionFormula as DispersionFormula
    from plenoptic.optics.dispersion import Formula as Formula
    from plenoptic.optics.finding import Finding as Finding
    from plenoptic.optics.finding import FindingKind as FindingKind
    from plenoptic.optics.glasses import GlassCatalogue as GlassCatalogue
    from plenoptic.optics.glasses import glass as glass
    from plenoptic.optics.glasses import glass_names as glass_names
    from plenoptic.optics.glasses import load_glasses as load_glasses
    from plenoptic.optics.lens import LensStack as LensStack
    from plenoptic.optics.media import AIR as AIR
    from plenoptic.optics.media import VACUUM as VACUUM
    from plenoptic.optics.media import ConstantMedium as ConstantMedium
    from plenoptic.optics.media import Medium as Medium
    from plenoptic.optics.media import ModelGlass as ModelGlass
    from plenoptic.optics.media import Schott as Schott
    from plenoptic.optics.media import Sellmeier as Sellmeier
    from plenoptic.optics.media import abbe_number as abbe_number
    from plenoptic.optics.microlenses import ConvexSide as ConvexSide
    from plenoptic.optics.microlenses import Lattice as Lattice
    from plenoptic.optics.microlenses import MicrolensArray as MicrolensArray
    from plenoptic.optics.microlenses import MicrolensModel as MicrolensModel
    from plenoptic.optics.models import LensModel as LensModel
    from plenoptic.optics.paraxial import CardinalPoints as CardinalPoints
    from plenoptic.optics.placement import Placement as Placement
    from plenoptic.optics.prescriptions import lens_names as lens_names
    from plenoptic.optics.prescriptions import load_lens as load_lens
    from plenoptic.optics.prescriptions import save_lens as save_lens
    from plenoptic.optics.sensor import Sensor as Sensor
    from plenoptic.optics.stops import CircularStop as CircularStop
    from plenoptic.optics.stops import PolygonStop as PolygonStop
    from plenoptic.optics.surface import Surface as Surface
    from plenoptic.planning import Decision as Decision
    from plenoptic.planning import Plan as Plan
    from plenoptic.planning import Stage as Stage
    from plenoptic.planning import plan as plan
    from plenoptic.plots.contrast import plot_mtf as plot_mtf
    from plenoptic.plots.contrast import plot_point_spread as plot_point_spread
    from plenoptic.plots.exposure import plot_exposure as plot_exposure
    from plenoptic.plots.fields import plot_coma as plot_coma
    from plenoptic.plots.fields import plot_depth_distortion as plot_depth_distortion
    from plenoptic.plots.fields import plot_distortion as plot_distortion
    from plenoptic.plots.fields import plot_field_curvature as plot_field_curvature
    from plenoptic.plots.fields import plot_relative_illumination as plot_relative_illumination
    from plenoptic.plots.fields import plot_vignetting as plot_vignetting
    from plenoptic.plots.forward import plot_camera_spread as plot_camera_spread
    from plenoptic.plots.lens import plot_lens as plot_lens
    from plenoptic.plots.seidel import plot_chromatic_shift as plot_chromatic_shift
    from plenoptic.plots.seidel import plot_seidel as plot_seidel
    from plenoptic.plots.spots import plot_ray_fan as plot_ray_fan
    from plenoptic.plots.spots import plot_spots as plot_spots
    from plenoptic.plots.spots import plot_through_focus as plot_through_focus
    from plenoptic.rays import RayBundle as RayBundle
    from plenoptic.rays import RayStatus as RayStatus
    from plenoptic.rendering import render as render
    from plenoptic.rendering import render_white as render_white
    from plenoptic.scene.environment import ConstantBackground as ConstantBackground
    from plenoptic.scene.light import QuadLight as QuadLight
    from plenoptic.scene.loading import load_meshes as load_meshes
    from plenoptic.scene.material import Emissive as Emissive
    from plenoptic.scene.material import Lambertian as Lambertian
    from plenoptic.scene.mesh import Mesh as Mesh
    from plenoptic.scene.procedural import box as box
    from plenoptic.scene.procedural import check_scene as check_scene
    from plenoptic.scene.procedural import checkerboard as checkerboard
    from plenoptic.scene.procedural import objects_scene as objects_scene
    from plenoptic.scene.procedural import quad as quad
    from plenoptic.scene.procedural import sphere as sphere
    from plenoptic.scene.procedural import still_life as still_life
    from plenoptic.scene.procedural import turned as turned
    from plenoptic.scene.procedural import white_plane as white_plane
    from plenoptic.scene.scene import Scene as Scene
    from plenoptic.scene.texture import Texture as Texture
else:
    import importlib

    _MODULES = {
        "aberrations": "plenoptic.optics.aberrations",
        "aiming": "plenoptic.optics.analysis.aiming",
        "images": "plenoptic.images",
        "paraxial": "plenoptic.optics.paraxial",
        "sampling": "plenoptic.sampling",
        "study": "plenoptic.study",
    }
    _NAMES = {
        "plenoptic.camera.camera": ("PlenopticCamera",),
        "plenoptic.camera.forward": ("landing_points", "point_spread"),
        "plenoptic.camera.pose": ("Pose",),
        "plenoptic.camera.spread": ("CameraSpread", "LandingPoints"),
        "plenoptic.errors": ("FileError", "InvalidValueError", "PlenopticError", "PrescriptionError", "SceneError"),
        "plenoptic.exposure": ("Exposure", "RenderStats"),
        "plenoptic.film": ("Film",),
        "plenoptic.optics.air": ("Absolute", "Air", "AirFormula"),
        "plenoptic.optics.dispersion": ("DispersionFormula", "Formula"),
        "plenoptic.optics.finding": ("Finding", "FindingKind"),
        "plenoptic.optics.analysis.focusing": ("FocusCriterion",),
        "plenoptic.optics.glasses": ("GlassCatalogue", "glass", "glass_names", "load_glasses"),
        "plenoptic.optics.lens": ("LensStack",),
        "plenoptic.optics.media": (
            "AIR",
            "VACUUM",
            "ConstantMedium",
            "Medium",
            "ModelGlass",
            "Schott",
            "Sellmeier",
            "abbe_number",
        ),
        "plenoptic.optics.microlenses": ("ConvexSide", "Lattice", "MicrolensArray", "MicrolensModel"),
        "plenoptic.optics.models": ("LensModel",),
        "plenoptic.optics.paraxial": ("CardinalPoints",),
        "plenoptic.optics.placement": ("Placement",),
        "plenoptic.optics.prescriptions": ("lens_names", "load_lens", "save_lens"),
        "plenoptic.optics.sensor": ("Sensor",),
        "plenoptic.optics.stops": ("CircularStop", "PolygonStop"),
        "plenoptic.optics.surface": ("Surface",),
        "plenoptic.planning": ("Decision", "Plan", "Stage", "plan"),
        "plenoptic.plots.exposure": ("plot_exposure",),
        "plenoptic.plots.fields": (
            "plot_coma",
            "plot_depth_distortion",
            "plot_distortion",
            "plot_field_curvature",
            "plot_relative_illumination",
            "plot_vignetting",
        ),
        "plenoptic.plots.forward": ("plot_camera_spread",),
        "plenoptic.plots.lens": ("plot_lens",),
        "plenoptic.plots.seidel": ("plot_chromatic_shift", "plot_seidel"),
        "plenoptic.plots.contrast": ("plot_mtf", "plot_point_spread"),
        "plenoptic.plots.spots": ("plot_ray_fan", "plot_spots", "plot_through_focus"),
        "plenoptic.rays": ("RayBundle", "RayStatus"),
        "plenoptic.rendering": ("render", "render_white"),
        "plenoptic.scene.environment": ("ConstantBackground",),
        "plenoptic.scene.light": ("QuadLight",),
        "plenoptic.scene.loading": ("load_meshes",),
        "plenoptic.scene.material": ("Emissive", "Lambertian"),
        "plenoptic.scene.mesh": ("Mesh",),
        "plenoptic.scene.procedural": (
            "box",
            "check_scene",
            "checkerboard",
            "objects_scene",
            "quad",
            "sphere",
            "still_life",
            "turned",
            "white_plane",
        ),
        "plenoptic.scene.scene": ("Scene",),
        "plenoptic.scene.texture": ("Texture",),
    }
    _HOMES = {name: module for module, names in _NAMES.items() for name in names}

    def __getattr__(name):
        if name in _MODULES:
            found = importlib.import_module(_MODULES[name])
        elif name in _HOMES:
            found = getattr(importlib.import_module(_HOMES[name]), name)
        else:
            raise AttributeError(f"module 'plenoptic' has no attribute {name!r}")
        globals()[name] = found
        return found

    def __dir__():
        return sorted([*_MODULES, *_HOMES])

    __all__ = [*_MODULES, *_HOMES]  # noqa: PLE0604

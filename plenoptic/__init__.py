"""Plenoptic cameras, simulated physically: rays from sensor pixels through microlenses and a real lens into a scene.

Names are loaded on first use (PEP 562), so that importing the package imports nothing else.
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from plenoptic import images as images
    from plenoptic import lightfield as lightfield
    from plenoptic import sampling as sampling
    from plenoptic import sensitivities as sensitivities
    from plenoptic import study as study
    from plenoptic.camera.as_built import AsBuilt as AsBuilt
    from plenoptic.camera.as_built import BuiltValue as BuiltValue
    from plenoptic.camera.as_built import as_built as as_built
    from plenoptic.camera.camera import CameraPart as CameraPart
    from plenoptic.camera.camera import PlenopticCamera as PlenopticCamera
    from plenoptic.camera.centres import CentreMethod as CentreMethod
    from plenoptic.camera.centres import MicrolensCentres as MicrolensCentres
    from plenoptic.camera.centres import microlens_centres as microlens_centres
    from plenoptic.camera.design import design_camera as design_camera
    from plenoptic.camera.design_search import CameraDesign as CameraDesign
    from plenoptic.camera.design_search import DesignStep as DesignStep
    from plenoptic.camera.forward import landing_points as landing_points
    from plenoptic.camera.forward import point_spread as point_spread
    from plenoptic.camera.pose import Pose as Pose
    from plenoptic.camera.projection import Projection as Projection
    from plenoptic.camera.projection import project as project
    from plenoptic.camera.report import CameraReport as CameraReport
    from plenoptic.camera.report import camera_report as camera_report
    from plenoptic.camera.report_findings import CameraFinding as CameraFinding
    from plenoptic.camera.report_findings import CameraFindingKind as CameraFindingKind
    from plenoptic.camera.report_focus import CameraKind as CameraKind
    from plenoptic.camera.report_focus import MicrolensFocus as MicrolensFocus
    from plenoptic.camera.spread import CameraSpread as CameraSpread
    from plenoptic.camera.spread import LandingPoints as LandingPoints
    from plenoptic.camera.truth import GroundTruth as GroundTruth
    from plenoptic.camera.truth import Truth as Truth
    from plenoptic.errors import FileError as FileError
    from plenoptic.errors import InvalidValueError as InvalidValueError
    from plenoptic.errors import PlenopticError as PlenopticError
    from plenoptic.errors import PrescriptionError as PrescriptionError
    from plenoptic.errors import SceneError as SceneError
    from plenoptic.exposure import Exposure as Exposure
    from plenoptic.film import Film as Film
    from plenoptic.lit import lit_pixels as lit_pixels
    from plenoptic.optics import aberrations as aberrations
    from plenoptic.optics import paraxial as paraxial
    from plenoptic.optics.air import Absolute as Absolute
    from plenoptic.optics.air import Air as Air
    from plenoptic.optics.air import AirFormula as AirFormula
    from plenoptic.optics.analysis import aiming as aiming
    from plenoptic.optics.analysis.focusing import FocusCriterion as FocusCriterion
    from plenoptic.optics.angular import AngularResponse as AngularResponse
    from plenoptic.optics.apertures import ApertureShape as ApertureShape
    from plenoptic.optics.apertures import Gaps as Gaps
    from plenoptic.optics.apertures import MicrolensAperture as MicrolensAperture
    from plenoptic.optics.apertures import Opening as Opening
    from plenoptic.optics.apertures import Walls as Walls
    from plenoptic.optics.blemishes import Blemishes as Blemishes
    from plenoptic.optics.blemishes import BlemishSite as BlemishSite
    from plenoptic.optics.conditioning import Condition as Condition
    from plenoptic.optics.conditioning import Conditioning as Conditioning
    from plenoptic.optics.conditioning import conditioning as conditioning
    from plenoptic.optics.dispersion import DispersionFormula as DispersionFormula
    from plenoptic.optics.dispersion import Formula as Formula
    from plenoptic.optics.finding import Finding as Finding
    from plenoptic.optics.finding import FindingKind as FindingKind
    from plenoptic.optics.glasses import GlassCatalogue as GlassCatalogue
    from plenoptic.optics.glasses import glass as glass
    from plenoptic.optics.glasses import glass_names as glass_names
    from plenoptic.optics.glasses import load_glasses as load_glasses
    from plenoptic.optics.imperfections import MicrolensDeviations as MicrolensDeviations
    from plenoptic.optics.imperfections import MicrolensImperfections as MicrolensImperfections
    from plenoptic.optics.lattices import Lattice as Lattice
    from plenoptic.optics.lens import LensStack as LensStack
    from plenoptic.optics.lenslets import Lenslets as Lenslets
    from plenoptic.optics.media import AIR as AIR
    from plenoptic.optics.media import VACUUM as VACUUM
    from plenoptic.optics.media import ConstantMedium as ConstantMedium
    from plenoptic.optics.media import Medium as Medium
    from plenoptic.optics.media import ModelGlass as ModelGlass
    from plenoptic.optics.media import Schott as Schott
    from plenoptic.optics.media import Sellmeier as Sellmeier
    from plenoptic.optics.media import abbe_number as abbe_number
    from plenoptic.optics.microlenses import ConvexSide as ConvexSide
    from plenoptic.optics.microlenses import MicrolensArray as MicrolensArray
    from plenoptic.optics.microlenses import MicrolensModel as MicrolensModel
    from plenoptic.optics.models import LensModel as LensModel
    from plenoptic.optics.no_lens import no_lens as no_lens
    from plenoptic.optics.paraxial import CardinalPoints as CardinalPoints
    from plenoptic.optics.placement import Placement as Placement
    from plenoptic.optics.prescriptions import lens_names as lens_names
    from plenoptic.optics.prescriptions import load_lens as load_lens
    from plenoptic.optics.prescriptions import save_lens as save_lens
    from plenoptic.optics.sensor import Sensor as Sensor
    from plenoptic.optics.stop_shapes import MaskStop as MaskStop
    from plenoptic.optics.stop_shapes import StarStop as StarStop
    from plenoptic.optics.stops import CircularStop as CircularStop
    from plenoptic.optics.stops import PolygonStop as PolygonStop
    from plenoptic.optics.surface import Surface as Surface
    from plenoptic.planning.plan import plan as plan
    from plenoptic.planning.stages import Decision as Decision
    from plenoptic.planning.stages import Plan as Plan
    from plenoptic.planning.stages import Stage as Stage
    from plenoptic.plots.camera import plot_camera as plot_camera
    from plenoptic.plots.contrast import plot_mtf as plot_mtf
    from plenoptic.plots.contrast import plot_point_spread as plot_point_spread
    from plenoptic.plots.error_time import plot_error_against_time as plot_error_against_time
    from plenoptic.plots.error_time import plot_error_studies as plot_error_studies
    from plenoptic.plots.exposure import plot_exposure as plot_exposure
    from plenoptic.plots.fields import plot_coma as plot_coma
    from plenoptic.plots.fields import plot_depth_distortion as plot_depth_distortion
    from plenoptic.plots.fields import plot_distortion as plot_distortion
    from plenoptic.plots.fields import plot_field_curvature as plot_field_curvature
    from plenoptic.plots.fields import plot_relative_illumination as plot_relative_illumination
    from plenoptic.plots.fields import plot_vignetting as plot_vignetting
    from plenoptic.plots.forward import plot_camera_spread as plot_camera_spread
    from plenoptic.plots.lens import plot_lens as plot_lens
    from plenoptic.plots.lens import plot_stop as plot_stop
    from plenoptic.plots.lightfield import plot_views as plot_views
    from plenoptic.plots.seidel import plot_chromatic_shift as plot_chromatic_shift
    from plenoptic.plots.seidel import plot_seidel as plot_seidel
    from plenoptic.plots.sensing import plot_photon_transfer as plot_photon_transfer
    from plenoptic.plots.spectra import plot_sensitivity as plot_sensitivity
    from plenoptic.plots.spots import plot_ray_fan as plot_ray_fan
    from plenoptic.plots.spots import plot_spots as plot_spots
    from plenoptic.plots.spots import plot_through_focus as plot_through_focus
    from plenoptic.rays import RayBundle as RayBundle
    from plenoptic.rays import RayStatus as RayStatus
    from plenoptic.render_settings import Caustics as Caustics
    from plenoptic.render_settings import RenderSettings as RenderSettings
    from plenoptic.render_settings import Sampler as Sampler
    from plenoptic.render_stats import RenderStats as RenderStats
    from plenoptic.render_stats import StopReason as StopReason
    from plenoptic.rendering.render import render as render
    from plenoptic.rendering.render import render_white as render_white
    from plenoptic.rendering.truth import ground_truth as ground_truth
    from plenoptic.replaying.ending import PathEnding as PathEnding
    from plenoptic.replaying.replay import Replay as Replay
    from plenoptic.replaying.retracing import replay as replay
    from plenoptic.replaying.retracing import replay_all as replay_all
    from plenoptic.scene import bsdf as bsdf
    from plenoptic.scene import targets as targets
    from plenoptic.scene.diffuse import Lambertian as Lambertian
    from plenoptic.scene.diffuse import RoughDiffuse as RoughDiffuse
    from plenoptic.scene.emissive import Emissive as Emissive
    from plenoptic.scene.environment import ConstantBackground as ConstantBackground
    from plenoptic.scene.environment import EnvironmentMap as EnvironmentMap
    from plenoptic.scene.glass import Dielectric as Dielectric
    from plenoptic.scene.glass import ThinGlass as ThinGlass
    from plenoptic.scene.instance import Instances as Instances
    from plenoptic.scene.loading import FileContents as FileContents
    from plenoptic.scene.loading import load_file as load_file
    from plenoptic.scene.loading import load_meshes as load_meshes
    from plenoptic.scene.mesh import Mesh as Mesh
    from plenoptic.scene.metal import Conductor as Conductor
    from plenoptic.scene.metallic_roughness import MetallicRoughness as MetallicRoughness
    from plenoptic.scene.point_light import PointLight as PointLight
    from plenoptic.scene.procedural import box as box
    from plenoptic.scene.procedural import check_scene as check_scene
    from plenoptic.scene.procedural import checkerboard as checkerboard
    from plenoptic.scene.procedural import objects_scene as objects_scene
    from plenoptic.scene.procedural import quad as quad
    from plenoptic.scene.procedural import sphere as sphere
    from plenoptic.scene.procedural import turned as turned
    from plenoptic.scene.procedural import white_plane as white_plane
    from plenoptic.scene.quad_light import QuadLight as QuadLight
    from plenoptic.scene.scene import Scene as Scene
    from plenoptic.scene.sphere_light import SphereLight as SphereLight
    from plenoptic.scene.spot_light import SpotLight as SpotLight
    from plenoptic.scene.still_life import still_life as still_life
    from plenoptic.scene.sun_light import SunLight as SunLight
    from plenoptic.scene.target import Target as Target
    from plenoptic.scene.texture import Texture as Texture
    from plenoptic.scene.texture import TextureFilter as TextureFilter
    from plenoptic.scene.texture import Wrap as Wrap
    from plenoptic.scene.view import View as View
    from plenoptic.sensing.demosaicing import DemosaicMethod as DemosaicMethod
    from plenoptic.sensing.filters import BayerPattern as BayerPattern
    from plenoptic.sensing.model import SensorModel as SensorModel
    from plenoptic.sensing.model import ShotNoise as ShotNoise
    from plenoptic.sensing.radiometry import dark_current_at as dark_current_at
    from plenoptic.sensing.radiometry import photon_rate as photon_rate
    from plenoptic.sensing.raw import RawImage as RawImage
    from plenoptic.sensing.transfer import PhotonTransfer as PhotonTransfer
    from plenoptic.sensing.transfer import photon_transfer as photon_transfer
    from plenoptic.spectra import Sensitivity as Sensitivity
    from plenoptic.spectra import rgb_basis as rgb_basis
    from plenoptic.spectra import rgb_to_spectrum as rgb_to_spectrum
    from plenoptic.srgb import Encoding as Encoding
else:
    import importlib

    _MODULES = {
        "targets": "plenoptic.scene.targets",
        "bsdf": "plenoptic.scene.bsdf",
        "sensitivities": "plenoptic.sensitivities",
        "lightfield": "plenoptic.lightfield",
        "aberrations": "plenoptic.optics.aberrations",
        "aiming": "plenoptic.optics.analysis.aiming",
        "images": "plenoptic.images",
        "paraxial": "plenoptic.optics.paraxial",
        "sampling": "plenoptic.sampling",
        "study": "plenoptic.study",
    }
    _NAMES = {
        "plenoptic.plots.error_time": ("plot_error_against_time", "plot_error_studies"),
        "plenoptic.optics.conditioning": ("Condition", "Conditioning", "conditioning"),
        "plenoptic.replaying.ending": ("PathEnding",),
        "plenoptic.replaying.replay": ("Replay",),
        "plenoptic.replaying.retracing": ("replay", "replay_all"),
        "plenoptic.lit": ("lit_pixels",),
        "plenoptic.render_settings": ("Caustics", "RenderSettings", "Sampler"),
        "plenoptic.scene.view": ("View",),
        "plenoptic.scene.still_life": ("still_life",),
        "plenoptic.scene.target": ("Target",),
        "plenoptic.srgb": ("Encoding",),
        "plenoptic.scene.sphere_light": ("SphereLight",),
        "plenoptic.scene.sun_light": ("SunLight",),
        "plenoptic.scene.spot_light": ("SpotLight",),
        "plenoptic.scene.point_light": ("PointLight",),
        "plenoptic.scene.quad_light": ("QuadLight",),
        "plenoptic.scene.instance": ("Instances",),
        "plenoptic.scene.metallic_roughness": ("MetallicRoughness",),
        "plenoptic.scene.glass": ("Dielectric", "ThinGlass"),
        "plenoptic.scene.metal": ("Conductor",),
        "plenoptic.scene.emissive": ("Emissive",),
        "plenoptic.scene.diffuse": ("Lambertian", "RoughDiffuse"),
        "plenoptic.render_stats": ("RenderStats", "StopReason"),
        "plenoptic.optics.no_lens": ("no_lens",),
        "plenoptic.optics.stop_shapes": ("MaskStop", "StarStop"),
        "plenoptic.camera.as_built": ("AsBuilt", "BuiltValue", "as_built"),
        "plenoptic.camera.projection": ("Projection", "project"),
        "plenoptic.rendering.truth": ("ground_truth",),
        "plenoptic.camera.truth": ("GroundTruth", "Truth"),
        "plenoptic.plots.spectra": ("plot_sensitivity",),
        "plenoptic.camera.report_focus": ("CameraKind", "MicrolensFocus"),
        "plenoptic.camera.report_findings": ("CameraFinding", "CameraFindingKind"),
        "plenoptic.camera.design_search": ("CameraDesign", "DesignStep"),
        "plenoptic.plots.camera": ("plot_camera",),
        "plenoptic.camera.design": ("design_camera",),
        "plenoptic.camera.report": (
            "CameraFinding",
            "CameraFindingKind",
            "CameraKind",
            "CameraReport",
            "MicrolensFocus",
            "camera_report",
        ),
        "plenoptic.spectra": ("Sensitivity", "rgb_basis", "rgb_to_spectrum"),
        "plenoptic.plots.lightfield": ("plot_views",),
        "plenoptic.camera.centres": ("CentreMethod", "MicrolensCentres", "microlens_centres"),
        "plenoptic.plots.sensing": ("plot_photon_transfer",),
        "plenoptic.sensing.transfer": ("PhotonTransfer", "photon_transfer"),
        "plenoptic.sensing.demosaicing": ("DemosaicMethod",),
        "plenoptic.sensing.raw": ("RawImage",),
        "plenoptic.sensing.radiometry": ("dark_current_at", "photon_rate"),
        "plenoptic.sensing.filters": ("BayerPattern",),
        "plenoptic.sensing.model": ("SensorModel", "ShotNoise"),
        "plenoptic.optics.blemishes": ("BlemishSite", "Blemishes"),
        "plenoptic.planning.stages": ("Decision", "Plan", "Stage"),
        "plenoptic.optics.angular": ("AngularResponse",),
        "plenoptic.optics.lenslets": ("Lenslets",),
        "plenoptic.optics.imperfections": ("MicrolensDeviations", "MicrolensImperfections"),
        "plenoptic.optics.apertures": ("ApertureShape", "Gaps", "MicrolensAperture", "Opening", "Walls"),
        "plenoptic.optics.lattices": ("Lattice",),
        "plenoptic.camera.camera": ("CameraPart", "PlenopticCamera"),
        "plenoptic.camera.forward": ("landing_points", "point_spread"),
        "plenoptic.camera.pose": ("Pose",),
        "plenoptic.camera.spread": ("CameraSpread", "LandingPoints"),
        "plenoptic.errors": ("FileError", "InvalidValueError", "PlenopticError", "PrescriptionError", "SceneError"),
        "plenoptic.exposure": ("Exposure",),
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
        "plenoptic.optics.microlenses": ("ConvexSide", "MicrolensArray", "MicrolensModel"),
        "plenoptic.optics.models": ("LensModel",),
        "plenoptic.optics.paraxial": ("CardinalPoints",),
        "plenoptic.optics.placement": ("Placement",),
        "plenoptic.optics.prescriptions": ("lens_names", "load_lens", "save_lens"),
        "plenoptic.optics.sensor": ("Sensor",),
        "plenoptic.optics.stops": ("CircularStop", "PolygonStop"),
        "plenoptic.optics.surface": ("Surface",),
        "plenoptic.planning.plan": ("plan",),
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
        "plenoptic.plots.lens": ("plot_lens", "plot_stop"),
        "plenoptic.plots.seidel": ("plot_chromatic_shift", "plot_seidel"),
        "plenoptic.plots.contrast": ("plot_mtf", "plot_point_spread"),
        "plenoptic.plots.spots": ("plot_ray_fan", "plot_spots", "plot_through_focus"),
        "plenoptic.rays": ("RayBundle", "RayStatus"),
        "plenoptic.rendering.render": ("render", "render_white"),
        "plenoptic.scene.environment": ("ConstantBackground", "EnvironmentMap"),
        "plenoptic.scene.loading": ("FileContents", "load_file", "load_meshes"),
        "plenoptic.scene.mesh": ("Mesh",),
        "plenoptic.scene.procedural": (
            "box",
            "check_scene",
            "checkerboard",
            "objects_scene",
            "quad",
            "sphere",
            "turned",
            "white_plane",
        ),
        "plenoptic.scene.scene": ("Scene",),
        "plenoptic.scene.texture": ("Texture", "TextureFilter", "Wrap"),
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

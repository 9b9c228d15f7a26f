"""Plenoptic cameras, simulated physically: rays from sensor pixels through microlenses and a real lens into a scene.

Names are loaded on first use (PEP 562), so that importing the package imports nothing else.
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from plenoptic import lightfield as lightfield
    from plenoptic import study as study
    from plenoptic.camera.as_built import AsBuilt as AsBuilt
    from plenoptic.camera.as_built import BuiltValue as BuiltValue
    from plenoptic.camera.as_built import as_built as as_built
    from plenoptic.camera.camera import CameraPart as CameraPart
    from plenoptic.camera.camera import PlenopticCamera as PlenopticCamera
    from plenoptic.camera.design.design import design_camera as design_camera
    from plenoptic.camera.design.search import CameraDesign as CameraDesign
    from plenoptic.camera.design.search import DesignStep as DesignStep
    from plenoptic.camera.points.centres import CentreMethod as CentreMethod
    from plenoptic.camera.points.centres import MicrolensCentres as MicrolensCentres
    from plenoptic.camera.points.centres import microlens_centres as microlens_centres
    from plenoptic.camera.points.projection import Projection as Projection
    from plenoptic.camera.points.projection import project as project
    from plenoptic.camera.pose import Pose as Pose
    from plenoptic.camera.psf.point_spread import landing_points as landing_points
    from plenoptic.camera.psf.point_spread import point_spread as point_spread
    from plenoptic.camera.psf.spread import CameraSpread as CameraSpread
    from plenoptic.camera.psf.spread import LandingPoints as LandingPoints
    from plenoptic.camera.report.findings import CameraFinding as CameraFinding
    from plenoptic.camera.report.findings import CameraFindingKind as CameraFindingKind
    from plenoptic.camera.report.focus import CameraKind as CameraKind
    from plenoptic.camera.report.focus import MicrolensFocus as MicrolensFocus
    from plenoptic.camera.report.report import CameraReport as CameraReport
    from plenoptic.camera.report.report import camera_report as camera_report
    from plenoptic.core import sampling as sampling
    from plenoptic.core.color import sensitivities as sensitivities
    from plenoptic.core.color.spectra import Sensitivity as Sensitivity
    from plenoptic.core.color.spectra import rgb_basis as rgb_basis
    from plenoptic.core.color.spectra import rgb_to_spectrum as rgb_to_spectrum
    from plenoptic.core.color.srgb import Encoding as Encoding
    from plenoptic.core.files import images as images
    from plenoptic.core.rays import RayBundle as RayBundle
    from plenoptic.core.rays import RayStatus as RayStatus
    from plenoptic.core.relative_error import lit_pixels as lit_pixels
    from plenoptic.errors import FileError as FileError
    from plenoptic.errors import InvalidValueError as InvalidValueError
    from plenoptic.errors import PlenopticError as PlenopticError
    from plenoptic.errors import PrescriptionError as PrescriptionError
    from plenoptic.errors import SceneError as SceneError
    from plenoptic.optics.glass.air import Absolute as Absolute
    from plenoptic.optics.glass.air import Air as Air
    from plenoptic.optics.glass.air import AirFormula as AirFormula
    from plenoptic.optics.glass.catalogue import GlassCatalogue as GlassCatalogue
    from plenoptic.optics.glass.catalogue import glass as glass
    from plenoptic.optics.glass.catalogue import glass_names as glass_names
    from plenoptic.optics.glass.catalogue import load_glasses as load_glasses
    from plenoptic.optics.glass.dispersion import DispersionFormula as DispersionFormula
    from plenoptic.optics.glass.dispersion import Formula as Formula
    from plenoptic.optics.glass.media import AIR as AIR
    from plenoptic.optics.glass.media import VACUUM as VACUUM
    from plenoptic.optics.glass.media import ConstantMedium as ConstantMedium
    from plenoptic.optics.glass.media import Medium as Medium
    from plenoptic.optics.glass.media import ModelGlass as ModelGlass
    from plenoptic.optics.glass.media import Schott as Schott
    from plenoptic.optics.glass.media import Sellmeier as Sellmeier
    from plenoptic.optics.glass.media import abbe_number as abbe_number
    from plenoptic.optics.lens.analysis import aberrations as aberrations
    from plenoptic.optics.lens.analysis.conditioning import Condition as Condition
    from plenoptic.optics.lens.analysis.conditioning import Conditioning as Conditioning
    from plenoptic.optics.lens.analysis.conditioning import conditioning as conditioning
    from plenoptic.optics.lens.analysis.focus import FocusCriterion as FocusCriterion
    from plenoptic.optics.lens.checks.finding import Finding as Finding
    from plenoptic.optics.lens.checks.finding import FindingKind as FindingKind
    from plenoptic.optics.lens.files.library import lens_names as lens_names
    from plenoptic.optics.lens.files.library import load_lens as load_lens
    from plenoptic.optics.lens.files.library import save_lens as save_lens
    from plenoptic.optics.lens.gaussian import paraxial as paraxial
    from plenoptic.optics.lens.gaussian.paraxial import CardinalPoints as CardinalPoints
    from plenoptic.optics.lens.models import LensModel as LensModel
    from plenoptic.optics.lens.no_lens import no_lens as no_lens
    from plenoptic.optics.lens.placement import Placement as Placement
    from plenoptic.optics.lens.pupil import ray_aiming as aiming  # noqa: F401
    from plenoptic.optics.lens.stack import LensStack as LensStack
    from plenoptic.optics.microlens.aperture import ApertureShape as ApertureShape
    from plenoptic.optics.microlens.aperture import Gaps as Gaps
    from plenoptic.optics.microlens.aperture import MicrolensAperture as MicrolensAperture
    from plenoptic.optics.microlens.aperture import Opening as Opening
    from plenoptic.optics.microlens.aperture import Walls as Walls
    from plenoptic.optics.microlens.array import ConvexSide as ConvexSide
    from plenoptic.optics.microlens.array import MicrolensArray as MicrolensArray
    from plenoptic.optics.microlens.array import MicrolensModel as MicrolensModel
    from plenoptic.optics.microlens.dust import Blemishes as Blemishes
    from plenoptic.optics.microlens.dust import BlemishSite as BlemishSite
    from plenoptic.optics.microlens.imperfections import MicrolensDeviations as MicrolensDeviations
    from plenoptic.optics.microlens.imperfections import MicrolensImperfections as MicrolensImperfections
    from plenoptic.optics.microlens.lattice import Lattice as Lattice
    from plenoptic.optics.microlens.listed import Lenslets as Lenslets
    from plenoptic.optics.sensor.angular_response import AngularResponse as AngularResponse
    from plenoptic.optics.sensor.color_filter import BayerPattern as BayerPattern
    from plenoptic.optics.sensor.demosaic import DemosaicMethod as DemosaicMethod
    from plenoptic.optics.sensor.model import SensorModel as SensorModel
    from plenoptic.optics.sensor.model import ShotNoise as ShotNoise
    from plenoptic.optics.sensor.radiometry import dark_current_at as dark_current_at
    from plenoptic.optics.sensor.radiometry import photon_rate as photon_rate
    from plenoptic.optics.sensor.sensor import Sensor as Sensor
    from plenoptic.optics.stops.circle import CircularStop as CircularStop
    from plenoptic.optics.stops.mask import MaskStop as MaskStop
    from plenoptic.optics.stops.polygon import PolygonStop as PolygonStop
    from plenoptic.optics.stops.star import StarStop as StarStop
    from plenoptic.optics.surfaces.surface import Surface as Surface
    from plenoptic.optics.surfaces.zernike import ZernikeSag as ZernikeSag
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
    from plenoptic.plots.photon_transfer import plot_photon_transfer as plot_photon_transfer
    from plenoptic.plots.seidel import plot_chromatic_shift as plot_chromatic_shift
    from plenoptic.plots.seidel import plot_seidel as plot_seidel
    from plenoptic.plots.spectra import plot_sensitivity as plot_sensitivity
    from plenoptic.plots.spots import plot_ray_fan as plot_ray_fan
    from plenoptic.plots.spots import plot_spots as plot_spots
    from plenoptic.plots.spots import plot_through_focus as plot_through_focus
    from plenoptic.readout.photon_transfer import PhotonTransfer as PhotonTransfer
    from plenoptic.readout.photon_transfer import photon_transfer as photon_transfer
    from plenoptic.readout.raw import RawImage as RawImage
    from plenoptic.rendering.exposure import Exposure as Exposure
    from plenoptic.rendering.film import Film as Film
    from plenoptic.rendering.plan.plan import plan as plan
    from plenoptic.rendering.plan.stages import Decision as Decision
    from plenoptic.rendering.plan.stages import Plan as Plan
    from plenoptic.rendering.plan.stages import Stage as Stage
    from plenoptic.rendering.render import render as render
    from plenoptic.rendering.render import render_white as render_white
    from plenoptic.rendering.settings import Caustics as Caustics
    from plenoptic.rendering.settings import RenderSettings as RenderSettings
    from plenoptic.rendering.settings import Sampler as Sampler
    from plenoptic.rendering.stats import RenderStats as RenderStats
    from plenoptic.rendering.stats import StopReason as StopReason
    from plenoptic.replaying.ending import PathEnding as PathEnding
    from plenoptic.replaying.replay import Replay as Replay
    from plenoptic.replaying.retracing import replay as replay
    from plenoptic.replaying.retracing import replay_all as replay_all
    from plenoptic.scene.file_cameras import View as View
    from plenoptic.scene.files.load import FileContents as FileContents
    from plenoptic.scene.files.load import load_file as load_file
    from plenoptic.scene.files.load import load_meshes as load_meshes
    from plenoptic.scene.geometry.instance import Instances as Instances
    from plenoptic.scene.geometry.mesh import Mesh as Mesh
    from plenoptic.scene.lights.environment import ConstantBackground as ConstantBackground
    from plenoptic.scene.lights.environment import EnvironmentMap as EnvironmentMap
    from plenoptic.scene.lights.point import PointLight as PointLight
    from plenoptic.scene.lights.quad import QuadLight as QuadLight
    from plenoptic.scene.lights.sphere import SphereLight as SphereLight
    from plenoptic.scene.lights.spot import SpotLight as SpotLight
    from plenoptic.scene.lights.sun import SunLight as SunLight
    from plenoptic.scene.materials import bsdf as bsdf
    from plenoptic.scene.materials.conductor import Conductor as Conductor
    from plenoptic.scene.materials.dielectric import Dielectric as Dielectric
    from plenoptic.scene.materials.diffuse import Lambertian as Lambertian
    from plenoptic.scene.materials.diffuse import RoughDiffuse as RoughDiffuse
    from plenoptic.scene.materials.emissive import Emissive as Emissive
    from plenoptic.scene.materials.metallic_roughness import MetallicRoughness as MetallicRoughness
    from plenoptic.scene.materials.thin_dielectric import ThinGlass as ThinGlass
    from plenoptic.scene.scene import Scene as Scene
    from plenoptic.scene.shapes.procedural import box as box
    from plenoptic.scene.shapes.procedural import check_scene as check_scene
    from plenoptic.scene.shapes.procedural import checkerboard as checkerboard
    from plenoptic.scene.shapes.procedural import objects_scene as objects_scene
    from plenoptic.scene.shapes.procedural import quad as quad
    from plenoptic.scene.shapes.procedural import sphere as sphere
    from plenoptic.scene.shapes.procedural import turned as turned
    from plenoptic.scene.shapes.procedural import white_plane as white_plane
    from plenoptic.scene.shapes.still_life import still_life as still_life
    from plenoptic.scene.shapes.targets import targets as targets
    from plenoptic.scene.shapes.targets.target import Target as Target
    from plenoptic.scene.textures.texture import Texture as Texture
    from plenoptic.scene.textures.texture import TextureFilter as TextureFilter
    from plenoptic.scene.textures.texture import Wrap as Wrap
    from plenoptic.truth.channels import GroundTruth as GroundTruth
    from plenoptic.truth.channels import Truth as Truth
    from plenoptic.truth.compute import ground_truth as ground_truth
else:
    import importlib

    _MODULES = {
        "targets": "plenoptic.scene.shapes.targets.targets",
        "bsdf": "plenoptic.scene.materials.bsdf",
        "sensitivities": "plenoptic.core.color.sensitivities",
        "lightfield": "plenoptic.lightfield",
        "aberrations": "plenoptic.optics.lens.analysis.aberrations",
        "aiming": "plenoptic.optics.lens.pupil.ray_aiming",
        "images": "plenoptic.core.files.images",
        "paraxial": "plenoptic.optics.lens.gaussian.paraxial",
        "sampling": "plenoptic.core.sampling",
        "study": "plenoptic.study",
    }
    _NAMES = {
        "plenoptic.plots.error_time": ("plot_error_against_time", "plot_error_studies"),
        "plenoptic.optics.lens.analysis.conditioning": ("Condition", "Conditioning", "conditioning"),
        "plenoptic.replaying.ending": ("PathEnding",),
        "plenoptic.replaying.replay": ("Replay",),
        "plenoptic.replaying.retracing": ("replay", "replay_all"),
        "plenoptic.core.relative_error": ("lit_pixels",),
        "plenoptic.rendering.settings": ("Caustics", "RenderSettings", "Sampler"),
        "plenoptic.scene.file_cameras": ("View",),
        "plenoptic.scene.shapes.still_life": ("still_life",),
        "plenoptic.scene.shapes.targets.target": ("Target",),
        "plenoptic.core.color.srgb": ("Encoding",),
        "plenoptic.scene.lights.sphere": ("SphereLight",),
        "plenoptic.scene.lights.sun": ("SunLight",),
        "plenoptic.scene.lights.spot": ("SpotLight",),
        "plenoptic.scene.lights.point": ("PointLight",),
        "plenoptic.scene.lights.quad": ("QuadLight",),
        "plenoptic.scene.geometry.instance": ("Instances",),
        "plenoptic.scene.materials.metallic_roughness": ("MetallicRoughness",),
        "plenoptic.scene.materials.dielectric": ("Dielectric",),
        "plenoptic.scene.materials.thin_dielectric": ("ThinGlass",),
        "plenoptic.scene.materials.conductor": ("Conductor",),
        "plenoptic.scene.materials.emissive": ("Emissive",),
        "plenoptic.scene.materials.diffuse": ("Lambertian", "RoughDiffuse"),
        "plenoptic.rendering.stats": ("RenderStats", "StopReason"),
        "plenoptic.optics.lens.no_lens": ("no_lens",),
        "plenoptic.optics.stops.mask": ("MaskStop",),
        "plenoptic.optics.stops.star": ("StarStop",),
        "plenoptic.camera.as_built": ("AsBuilt", "BuiltValue", "as_built"),
        "plenoptic.camera.points.projection": ("Projection", "project"),
        "plenoptic.truth.compute": ("ground_truth",),
        "plenoptic.truth.channels": ("GroundTruth", "Truth"),
        "plenoptic.plots.spectra": ("plot_sensitivity",),
        "plenoptic.camera.report.focus": ("CameraKind", "MicrolensFocus"),
        "plenoptic.camera.report.findings": ("CameraFinding", "CameraFindingKind"),
        "plenoptic.camera.design.search": ("CameraDesign", "DesignStep"),
        "plenoptic.plots.camera": ("plot_camera",),
        "plenoptic.camera.design.design": ("design_camera",),
        "plenoptic.camera.report.report": (
            "CameraFinding",
            "CameraFindingKind",
            "CameraKind",
            "CameraReport",
            "MicrolensFocus",
            "camera_report",
        ),
        "plenoptic.core.color.spectra": ("Sensitivity", "rgb_basis", "rgb_to_spectrum"),
        "plenoptic.plots.lightfield": ("plot_views",),
        "plenoptic.camera.points.centres": ("CentreMethod", "MicrolensCentres", "microlens_centres"),
        "plenoptic.plots.photon_transfer": ("plot_photon_transfer",),
        "plenoptic.readout.photon_transfer": ("PhotonTransfer", "photon_transfer"),
        "plenoptic.optics.sensor.demosaic": ("DemosaicMethod",),
        "plenoptic.readout.raw": ("RawImage",),
        "plenoptic.optics.sensor.radiometry": ("dark_current_at", "photon_rate"),
        "plenoptic.optics.sensor.color_filter": ("BayerPattern",),
        "plenoptic.optics.sensor.model": ("SensorModel", "ShotNoise"),
        "plenoptic.optics.microlens.dust": ("BlemishSite", "Blemishes"),
        "plenoptic.rendering.plan.stages": ("Decision", "Plan", "Stage"),
        "plenoptic.optics.sensor.angular_response": ("AngularResponse",),
        "plenoptic.optics.microlens.listed": ("Lenslets",),
        "plenoptic.optics.microlens.imperfections": ("MicrolensDeviations", "MicrolensImperfections"),
        "plenoptic.optics.microlens.aperture": ("ApertureShape", "Gaps", "MicrolensAperture", "Opening", "Walls"),
        "plenoptic.optics.microlens.lattice": ("Lattice",),
        "plenoptic.camera.camera": ("CameraPart", "PlenopticCamera"),
        "plenoptic.camera.psf.point_spread": ("landing_points", "point_spread"),
        "plenoptic.camera.pose": ("Pose",),
        "plenoptic.camera.psf.spread": ("CameraSpread", "LandingPoints"),
        "plenoptic.errors": ("FileError", "InvalidValueError", "PlenopticError", "PrescriptionError", "SceneError"),
        "plenoptic.rendering.exposure": ("Exposure",),
        "plenoptic.rendering.film": ("Film",),
        "plenoptic.optics.glass.air": ("Absolute", "Air", "AirFormula"),
        "plenoptic.optics.glass.dispersion": ("DispersionFormula", "Formula"),
        "plenoptic.optics.lens.checks.finding": ("Finding", "FindingKind"),
        "plenoptic.optics.lens.analysis.focus": ("FocusCriterion",),
        "plenoptic.optics.glass.catalogue": ("GlassCatalogue", "glass", "glass_names", "load_glasses"),
        "plenoptic.optics.lens.stack": ("LensStack",),
        "plenoptic.optics.glass.media": (
            "AIR",
            "VACUUM",
            "ConstantMedium",
            "Medium",
            "ModelGlass",
            "Schott",
            "Sellmeier",
            "abbe_number",
        ),
        "plenoptic.optics.microlens.array": ("ConvexSide", "MicrolensArray", "MicrolensModel"),
        "plenoptic.optics.lens.models": ("LensModel",),
        "plenoptic.optics.lens.gaussian.paraxial": ("CardinalPoints",),
        "plenoptic.optics.lens.placement": ("Placement",),
        "plenoptic.optics.lens.files.library": ("lens_names", "load_lens", "save_lens"),
        "plenoptic.optics.sensor.sensor": ("Sensor",),
        "plenoptic.optics.stops.circle": ("CircularStop",),
        "plenoptic.optics.stops.polygon": ("PolygonStop",),
        "plenoptic.optics.surfaces.surface": ("Surface",),
        "plenoptic.optics.surfaces.zernike": ("ZernikeSag",),
        "plenoptic.rendering.plan.plan": ("plan",),
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
        "plenoptic.core.rays": ("RayBundle", "RayStatus"),
        "plenoptic.rendering.render": ("render", "render_white"),
        "plenoptic.scene.lights.environment": ("ConstantBackground", "EnvironmentMap"),
        "plenoptic.scene.files.load": ("FileContents", "load_file", "load_meshes"),
        "plenoptic.scene.geometry.mesh": ("Mesh",),
        "plenoptic.scene.shapes.procedural": (
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
        "plenoptic.scene.textures.texture": ("Texture", "TextureFilter", "Wrap"),
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

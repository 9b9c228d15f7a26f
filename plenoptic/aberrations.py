"""Aberrations of a lens: third-order sums, and spots, fans, fields and contrast by exact rays."""

from plenoptic.optics.lens.analysis.astigmatic import Foci, foci
from plenoptic.optics.lens.analysis.best_focus import ThroughFocus, best_focus, through_focus
from plenoptic.optics.lens.analysis.field_aberrations import (
    Coma,
    DepthDistortion,
    Distortion,
    FieldCurvature,
    Projection,
    coma,
    depth_distortion,
    distortion,
    field_curvature,
)
from plenoptic.optics.lens.analysis.illumination import (
    RelativeIllumination,
    Vignetting,
    largest_field,
    relative_illumination,
    vignetting,
)
from plenoptic.optics.lens.analysis.mtf import Mtf, PointSpread, diffraction_mtf, mtf, point_spread
from plenoptic.optics.lens.analysis.seidel import ChromaticShift, SeidelSums, chromatic_shift, colour_sums, seidel_sums
from plenoptic.optics.lens.analysis.spot_diagram import RayFan, SpotDiagram, ray_fan, spot_diagram
from plenoptic.optics.lens.analysis.transmission import transmission
from plenoptic.optics.lens.ghosts.ghost_table import GhostTable
from plenoptic.optics.lens.ghosts.veiling_glare import VeilingGlare, veiling_glare
from plenoptic.optics.lens.models import FocusCriterion
from plenoptic.optics.lens.optical_path import optical_path
from plenoptic.optics.lens.waves.wave_mtf import WaveMtf, wave_mtf
from plenoptic.optics.lens.waves.wave_spread import SpreadMethod, WaveSpread, wave_spread
from plenoptic.optics.lens.waves.wavefront import Wavefront, wavefront
from plenoptic.optics.lens.waves.zernike_fit import ZernikeFit, ZernikeOrder, zernike
from plenoptic.optics.microlens.optical_path import microlens_path

__all__ = [
    "ChromaticShift",
    "Coma",
    "DepthDistortion",
    "Distortion",
    "FieldCurvature",
    "Foci",
    "FocusCriterion",
    "GhostTable",
    "Mtf",
    "PointSpread",
    "Projection",
    "RayFan",
    "RelativeIllumination",
    "SeidelSums",
    "SpotDiagram",
    "SpreadMethod",
    "ThroughFocus",
    "VeilingGlare",
    "Vignetting",
    "WaveMtf",
    "WaveSpread",
    "Wavefront",
    "ZernikeFit",
    "ZernikeOrder",
    "best_focus",
    "chromatic_shift",
    "colour_sums",
    "coma",
    "depth_distortion",
    "diffraction_mtf",
    "distortion",
    "field_curvature",
    "foci",
    "largest_field",
    "microlens_path",
    "mtf",
    "optical_path",
    "point_spread",
    "ray_fan",
    "relative_illumination",
    "seidel_sums",
    "spot_diagram",
    "through_focus",
    "transmission",
    "veiling_glare",
    "vignetting",
    "wave_mtf",
    "wave_spread",
    "wavefront",
    "zernike",
]

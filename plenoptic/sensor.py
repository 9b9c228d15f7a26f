"""Sensors: colours, noise, raw images."""

from plenoptic.core.color.spectra import Sensitivity, rgb_basis, rgb_to_spectrum
from plenoptic.optics.sensor.angular_response import AngularResponse
from plenoptic.optics.sensor.color_filter import BayerPattern
from plenoptic.optics.sensor.demosaic import DemosaicMethod
from plenoptic.optics.sensor.dual_pixel_sensor import dual_pixel
from plenoptic.optics.sensor.dual_pixels import DualPixels
from plenoptic.optics.sensor.model import SensorModel, ShotNoise
from plenoptic.optics.sensor.radiometry import dark_current_at, photon_rate
from plenoptic.optics.sensor.sensor import Sensor
from plenoptic.optics.sensor.silicon import silicon_reflectance
from plenoptic.readout.photon_transfer import PhotonTransfer, photon_transfer
from plenoptic.readout.raw import RawImage
from plenoptic.readout.well_images import WellImages, read_wells, well_cameras
from plenoptic.truth.pair_geometry import PairGeometry, pair_geometry

__all__ = [
    "AngularResponse",
    "BayerPattern",
    "DemosaicMethod",
    "DualPixels",
    "PairGeometry",
    "PhotonTransfer",
    "RawImage",
    "Sensitivity",
    "Sensor",
    "SensorModel",
    "ShotNoise",
    "WellImages",
    "dark_current_at",
    "dual_pixel",
    "pair_geometry",
    "photon_rate",
    "photon_transfer",
    "read_wells",
    "rgb_basis",
    "rgb_to_spectrum",
    "silicon_reflectance",
    "well_cameras",
]

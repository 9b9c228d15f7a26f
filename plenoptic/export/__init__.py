"""Raw images and light fields in the forms that other programs read; each says what its program cannot express."""

from plenoptic.export.to_compote import compote
from plenoptic.export.to_hci import hci
from plenoptic.export.to_plenoptic_toolbox import plenoptic_toolbox
from plenoptic.export.to_plenopticam import plenopticam
from plenoptic.export.to_plenpy import plenpy

__all__ = ["compote", "hci", "plenopticam", "plenoptic_toolbox", "plenpy"]

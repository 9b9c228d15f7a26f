"""Raw images and light fields in the forms that other programs read; each says what its program cannot express."""

from plenoptic.export.hci import hci
from plenoptic.export.plenopticam import plenopticam
from plenoptic.export.plenpy import plenpy
from plenoptic.export.toolbox import plenoptic_toolbox

__all__ = ["hci", "plenopticam", "plenoptic_toolbox", "plenpy"]

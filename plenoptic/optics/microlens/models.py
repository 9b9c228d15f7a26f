"""Registry of microlens models."""

from __future__ import annotations

import enum

from plenoptic.optics.microlens.ideal_microlenses import IdealMicrolenses
from plenoptic.optics.microlens.plano_convex import PlanoConvexMicrolenses


class MicrolensModel(enum.IntEnum):
    """Model of the refraction by a microlens. See `MicrolensArray`.

    PINHOLE: all light of a cell passes its centre, undeviated. THIN: an ideal thin lens in one plane. FLAT_HIGH_INDEX:
    two planes of high index, one with the normals of a sphere, as published Blender models have it. SPHERICAL: an
    exact plano-convex lens of glass.
    """

    PINHOLE = 0
    """All light that reaches the cell passes its centre, undeviated: every depth is sharp. It counts as if the whole
    cell were open, so that images are as bright as with the other models."""
    THIN = 1
    """Ideal thin lens in one plane."""
    FLAT_HIGH_INDEX = 2
    """Two planes of a medium of high index; on one of them light is refracted by the normals of the sphere of radius
    f (index - 1), as if the lens had its curvature but no height (Michels et al. 2018, section 4)."""
    SPHERICAL = 3
    """Exact plano-convex lens: a sphere and a plane of glass."""

    @property
    def refraction(self) -> IdealMicrolenses | PlanoConvexMicrolenses:
        """Methods that describe and trace the model; no other code distinguishes models."""
        return _REFRACTION[self]

    @property
    def focuses(self) -> bool:
        """True if lenses have a power."""
        return self.refraction.focuses

    @property
    def is_plate(self) -> bool:
        """True if rays pass two surfaces of glass."""
        return self.refraction.is_plate

    @property
    def is_flat(self) -> bool:
        """True if a plane with the normals of a sphere stands for the sphere."""
        return self.refraction.is_flat


_REFRACTION: dict[MicrolensModel, IdealMicrolenses | PlanoConvexMicrolenses] = {
    MicrolensModel.PINHOLE: IdealMicrolenses(focuses=False),
    MicrolensModel.THIN: IdealMicrolenses(focuses=True),
    MicrolensModel.FLAT_HIGH_INDEX: PlanoConvexMicrolenses(is_flat=True),
    MicrolensModel.SPHERICAL: PlanoConvexMicrolenses(is_flat=False),
}

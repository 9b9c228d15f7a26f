"""Light that the sides of plano-convex microlenses and their glass take from rays: device functions.

`losses` is the `LossRecord` of a `PlateRecord`, and `workspace` (LOSS_ROWS, BLOCK) holds the rows of `losses` kernels.
"""

from __future__ import annotations

from plenoptic.core.kernels.ray_blocks import BLOCK, N, Z
from plenoptic.core.numba.jit import device
from plenoptic.optics.coatings.kernels.losses import DEPTH, absorb, add_depth, transmit, transmit_dispersed
from plenoptic.optics.lens.kernels.spherical_refraction import COS2, DISTANCE

LOSS_ROWS = DEPTH + 1


@device
def weaken_at_side(ray, losses, waves, first, workspace):
    """Multiply weights by the transmittance of a side, at the squared cosines of its refraction."""
    if waves is None:
        transmit(ray, workspace[COS2], losses.transmittance[0])
    else:
        transmit_dispersed(ray, workspace[COS2], losses.dispersed[0], waves, first)


@device
def store_distance_to_plane(ray, z, workspace):
    """Store distances in mm to a plane before rays are moved there."""
    for i in range(BLOCK):
        workspace[DEPTH, i] = (z - ray[Z + i]) / ray[N + i]


@device
def add_distance_to_plane(workspace):
    """Add the stored distances to those from the plane to the side."""
    for i in range(BLOCK):
        workspace[DISTANCE, i] += workspace[DEPTH, i]


@device
def absorb_in_plate(ray, losses, waves, first, workspace):
    """Multiply weights by the internal transmittance of the glass, through which rays went the stored distances."""
    for i in range(BLOCK):
        workspace[DEPTH, i] = 0.0
    if waves is None:
        add_depth(workspace, losses.attenuation[0], None, 0)
    else:
        add_depth(workspace, losses.attenuation[0, 1:], waves, first)
    absorb(ray, workspace)

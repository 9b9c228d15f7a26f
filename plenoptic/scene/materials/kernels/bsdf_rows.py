"""What one material does with many directions: the kernels."""

from __future__ import annotations

import numpy as np

from plenoptic.core.jit import kernel
from plenoptic.scene.materials.kernels.bsdf import draw, evaluate


@kernel
def fill_evaluated(
    values,
    densities,
    to_viewer,
    to_light,
    front,
    kind,
    base,
    roughness,
    metallic,
    metal_index,
    glass_index,
    coupling,
    coupling_mean,
):
    """F |cos| and density of pairs of directions in the frame of the surface."""
    for i in range(densities.size):
        o, d = to_viewer[i], to_light[i]
        densities[i] = evaluate(
            values[i],
            kind,
            base,
            0,
            roughness,
            metallic,
            front,
            0,
            o[0],
            o[1],
            o[2],
            d[0],
            d[1],
            d[2],
            None,
            0,
            metal_index,
            glass_index,
            coupling,
            coupling_mean,
        )
        if glass_index is not None and d[2] < 0.0:
            eta = glass_index[0, 0] / glass_index[0, 1] if front else glass_index[0, 1] / glass_index[0, 0]
            for c in range(values.shape[1]):
                values[i, c] /= eta * eta


@kernel
def fill_drawn(
    directions,
    weights,
    densities,
    to_viewer,
    points,
    front,
    kind,
    base,
    roughness,
    metallic,
    metal_index,
    glass_index,
    pane_index,
    coupling,
    coupling_mean,
):
    """Directions drawn for each viewer by three numbers, their weights and densities."""
    for i in range(densities.size):
        o, u = to_viewer[i], points[i]
        x, y, z, density, spread = draw(
            weights[i],
            kind,
            base,
            0,
            roughness,
            metallic,
            front,
            0,
            o[0],
            o[1],
            o[2],
            u[0],
            u[1],
            u[2],
            None,
            0,
            metal_index,
            glass_index,
            pane_index,
            coupling,
            coupling_mean,
        )
        directions[i, 0], directions[i, 1], directions[i, 2] = x, y, z
        densities[i] = np.inf if density < 0.0 else density
        for c in range(weights.shape[1]):
            weights[i, c] = weights[i, c] * spread if density != 0.0 else 0.0

"""BSDF in a frame whose z is the shading normal: one function for all kinds of materials.

o is the unit direction to the viewer, z above 0; i that to the light, z below 0 behind the surface. `f` (channels,)
holds the base colour before, and f |cos i| afterwards; densities are per steradian. Columns are those of
`materials.material_records.Bsdf`; a member that no material of a scene needs is None.
"""

from __future__ import annotations

import numpy as np

from plenoptic.core.kernels.vectors import fill_vector, row_vector
from plenoptic.core.numba.jit import device, kernel
from plenoptic.scene.geometry.geometry_records import FRONT, INTERACTION_COLUMNS, METALLIC, ROUGHNESS
from plenoptic.scene.materials.kernels import conductor, dielectric, diffuse, metallic_roughness
from plenoptic.scene.materials.kernels.microfacets import nothing
from plenoptic.scene.materials.material_records import SurfaceMaterial
from plenoptic.scene.materials.registry import (
    CONDUCTOR,
    DIELECTRIC,
    LAMBERTIAN,
    METALLIC_ROUGHNESS,
    OREN_NAYAR,
    THIN_DIELECTRIC,
)


@device
def surface_at(rows, i, material, wave, kind, glass_index, pane_index, extra_shares):
    """Material of an interaction."""
    if kind is None:
        return SurfaceMaterial(None, 0.0, 0.0, None, None, None, material, wave)
    eta = None if glass_index is None else dielectric.relative_index(glass_index, material, rows[i, FRONT] > 0.0)
    pane = None if pane_index is None else pane_index[material]
    extra = None if extra_shares is None else rows[i, INTERACTION_COLUMNS:]
    return SurfaceMaterial(kind[material], rows[i, ROUGHNESS], rows[i, METALLIC], eta, pane, extra, material, wave)


@device
def evaluate(f, surface, o, i, metal_index, coupling, basis):
    """Fill f with f |cos i| and return the density by which `sample` would draw i; 0 for exact directions."""
    if surface.kind is None:
        return diffuse.eval_lambertian(f, i)
    if surface.kind == LAMBERTIAN:
        return diffuse.eval_lambertian(f, i)
    if surface.kind == OREN_NAYAR:
        return diffuse.eval_oren_nayar(f, o, i, surface.roughness)
    if metal_index is not None and surface.kind == CONDUCTOR:
        return conductor.eval_conductor(f, surface, o, i, metal_index, basis)
    if surface.eta is not None and surface.kind == DIELECTRIC:
        return dielectric.eval_dielectric(f, surface.roughness, surface.eta, o, i)
    if coupling is not None and surface.kind == METALLIC_ROUGHNESS:
        return metallic_roughness.eval_metallic_roughness(f, surface, o, i, coupling)
    return nothing(f)


@device
def sample(f, surface, o, u, metal_index, coupling, basis):
    """Draw a direction i by three numbers u; fills f with f |cos i| / density.

    Returns i, its density (DELTA for a mirror's direction, 0 where the path ends), and 1 / eta^2 where light changes
    into another medium (1 otherwise), by which radiance is to be multiplied besides.
    """
    if surface.kind is None:
        return diffuse.sample_lambertian(u[0], u[1])
    if surface.eta is not None and surface.kind == DIELECTRIC:
        return dielectric.sample_dielectric(f, surface.roughness, surface.eta, o, u)
    if surface.pane_index is not None and surface.kind == THIN_DIELECTRIC:
        return dielectric.sample_thin_dielectric(f, surface.pane_index, o, u[0])
    if metal_index is not None and surface.kind == CONDUCTOR:
        return conductor.sample_conductor(f, surface, o, u, metal_index, basis)
    if coupling is not None and surface.kind == METALLIC_ROUGHNESS:
        return metallic_roughness.sample_metallic_roughness(f, surface, o, u, coupling)
    if surface.kind == OREN_NAYAR:
        return diffuse.sample_oren_nayar(f, o, surface.roughness, u[0], u[1])
    return diffuse.sample_lambertian(u[0], u[1])


@device
def _only_surface(bsdf, front):
    """The only material of a record."""
    if bsdf.kind is None:
        return SurfaceMaterial(None, 0.0, 0.0, None, None, None, 0, 0)
    roughness = 0.0 if bsdf.roughness is None else bsdf.roughness[0]
    metallic = 0.0 if bsdf.metallic is None else bsdf.metallic[0]
    eta = None if bsdf.glass_index is None else dielectric.relative_index(bsdf.glass_index, 0, front)
    pane = None if bsdf.pane_index is None else bsdf.pane_index[0]
    extra = None if bsdf.extra_shares is None else bsdf.extra_shares[0]
    return SurfaceMaterial(bsdf.kind[0], roughness, metallic, eta, pane, extra, 0, 0)


@kernel
def fill_bsdf_values(values, pdf, to_viewer, to_light, front, bsdf):
    """F |cos| and density of pairs of directions in the frame of the surface of the only material of a record."""
    surface = _only_surface(bsdf, front)
    for i in range(pdf.size):
        values[i] = bsdf.base_color[0]
        light = row_vector(to_light, i, 0)
        pdf[i] = evaluate(values[i], surface, row_vector(to_viewer, i, 0), light, bsdf.metal_index, bsdf.coupling, None)
        if bsdf.glass_index is not None:
            if light[2] < 0.0:
                for c in range(values.shape[1]):
                    values[i, c] /= surface.eta * surface.eta


@kernel
def fill_bsdf_samples(directions, weights, pdf, to_viewer, points, front, bsdf):
    """Directions drawn for each viewer by three numbers, their weights and densities."""
    surface = _only_surface(bsdf, front)
    for i in range(pdf.size):
        weights[i] = bsdf.base_color[0]
        viewer, point = row_vector(to_viewer, i, 0), row_vector(points, i, 0)
        direction, density, spread = sample(weights[i], surface, viewer, point, bsdf.metal_index, bsdf.coupling, None)
        fill_vector(directions, i, 0, direction)
        pdf[i] = np.inf if density < 0.0 else density
        for c in range(weights.shape[1]):
            weights[i, c] = weights[i, c] * spread if density != 0.0 else 0.0

"""Colours at the wavelength of a path: device functions. See `rendering.integrator.record.Wavelengths`."""

from __future__ import annotations

from plenoptic.core.numba.jit import device


@device
def wavelength_index(waves, path):
    """Index of a path's wavelength; 0 if paths have none."""
    return 0 if waves is None else waves[path]


@device
def row_channel(colors, k, c, basis, wave):
    """Channel c of row k of the scene's colours; see `one_channel`."""
    if basis is None or colors.shape[1] == 1:
        return colors[k, c]
    return colors[k, 0] * basis[wave, 0] + colors[k, 1] * basis[wave, 1] + colors[k, 2] * basis[wave, 2]


@device
def one_channel(color, c, basis, wave):
    """Channel c of a colour of the scene or, with a basis (wavelengths, 3), its spectral value at a wavelength."""
    if basis is None or color.size == 1:
        return color[c]
    return color[0] * basis[wave, 0] + color[1] * basis[wave, 1] + color[2] * basis[wave, 2]

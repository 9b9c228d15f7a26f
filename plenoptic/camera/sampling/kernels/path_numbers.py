"""Numbers of a path: its pixel, replicate and index in the replicate, and the sets of its sampling points."""

from __future__ import annotations

from plenoptic.core.numba.jit import device

WAVELENGTH_SET = 1 << 20
"""Set of sampling points for wavelengths: above those of all bounces."""
SHUTTER_SET = WAVELENGTH_SET + 1
"""Set of sampling points for times during the exposure."""
DEFLECTION_SET = WAVELENGTH_SET + 2
"""Set of sampling points for diffraction deflections."""


@device
def path_indices(path, samples, replicates):
    """Pixel, replicate and index in the replicate of path `path` of a tile.

    Paths run over pixels, in a pixel over replicates, in a replicate over its samples; the first
    `samples % replicates` replicates have one sample more than the others.
    """
    pixel = path // samples
    index = path - pixel * samples
    short_size, n_long = samples // replicates, samples % replicates
    end_of_long = n_long * (short_size + 1)
    if index < end_of_long:
        replicate = index // (short_size + 1)
        return pixel, replicate, index - replicate * (short_size + 1)
    replicate = n_long + (index - end_of_long) // short_size
    return pixel, replicate, index - end_of_long - (replicate - n_long) * short_size


@device
def replicate_size(replicate, samples, replicates):
    """Number of samples of a replicate of a pixel."""
    return samples // replicates + (1 if replicate < samples % replicates else 0)

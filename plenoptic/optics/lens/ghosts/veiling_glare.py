"""Veiling glare: light that reflections of a bright field throw onto the image of a black patch."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from plenoptic.core.rays import RayBundle
from plenoptic.core.sampling import sobol_points
from plenoptic.core.values import MAX_POINTS, Floats, check_kind, positive, result, seed_number, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.ghosts.ghost_rays import (
    REPLICATES,
    check_light,
    covering_rays,
    ghost_setting,
    relative_light,
)
from plenoptic.optics.lens.ghosts.unfolded import ghost_stack, pairs_of, reflecting_lens
from plenoptic.optics.lens.pupil.object_point import directions_of, field_text
from plenoptic.optics.lens.pupil.ray_aiming import chief_ray
from plenoptic.optics.lens.stack import LensStack


@result
class VeilingGlare:
    """Veiling glare of a lens. Made by `veiling_glare`.

    Attributes
    ----------
    index, standard_error : float
        Veiling glare index as a fraction, not in percent, and its standard error.

    Examples
    --------
    See `veiling_glare`.
    """

    index: float
    standard_error: float


def veiling_glare(  # noqa: PLR0913
    lens: LensStack,
    patch: float,
    *,
    field: Sequence[float] = (0.0, 0.0),
    z_object: float = -math.inf,
    z_image: float | None = None,
    wavelength: float = 587.6,
    sensor: float | None = None,
    rays: int = 4096,
    seed: int = 0,
) -> VeilingGlare:
    """Veiling glare index of a lens: light in the middle of the image of a black patch, over that without the patch.

    The patch is a disc in a field that is uniformly bright over all directions from which light arrives. Rays are
    traced in reverse from the image point, which is that of the chief ray: those of the image light and of all pairs of
    reflecting surfaces count as dark where they end on the patch. Reflections of ground edges, the barrel and the
    inside of a camera are left out, and so are four reflections.

    Parameters
    ----------
    lens : LensStack
        Traced exactly; surfaces without coating are bare.
    patch : float
        Radius of the patch: an angle in radians for an object at infinity, otherwise mm. Make it larger than the blur
        of the image.
    field : (2,) sequence of float, optional
        Centre of the patch; see `spot_diagram`.
    z_object, z_image, wavelength, sensor
        See `LensStack.ghosts`.
    rays : int, optional
        Rays of the image light and of each pair.
    seed : int, optional
        Seed of the rays.

    Raises
    ------
    InvalidValueError
        If a number is out of range, or no chief ray of the field arrives; a PrescriptionError for a lens with mirrors.

    References
    ----------
    ISO 9358:1994, Optics and optical instruments, Veiling glare of image forming systems, Definitions and methods of
    measurement: the integral method, for a source that fills all directions.

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2")
    >>> bare = pl.aberrations.veiling_glare(lens, patch=0.02)
    >>> coated = pl.aberrations.veiling_glare(pl.optics.coated(lens, pl.optics.SingleLayer()), patch=0.02)
    >>> 0.045 < bare.index < 0.05, 0.001 < coated.index < 0.002, bare.standard_error < 0.001
    (True, True, True)
    """
    check_kind(lens, "lens", LensStack, "camera.lens")
    setting, radius = ghost_setting(lens, (field, z_object, z_image, wavelength), sensor), positive(patch, "patch")
    if math.isinf(setting.z_object) and radius >= math.pi / 2:
        raise InvalidValueError(
            f"patch is {radius:g} rad; for an object at infinity it must be below pi/2: give radians"
        )
    plane, nm = setting.z_image, (setting.wavelength,)
    exact, last = reflecting_lens(lens), len(lens.elements) - 1
    lens_and_sensor = reflecting_lens(lens, None if setting.sensor is None else (plane, setting.sensor))
    chief = chief_ray(exact, field=setting.field, z_object=setting.z_object, wavelength=nm[0])
    point = exact.trace(chief).at_z(plane)[0]
    if not np.isfinite(point).all():
        raise InvalidValueError(
            f"no chief ray of {field_text(setting.field, setting.z_object)} arrives; choose a smaller field"
        )
    each, key = -(-whole(rays, "rays", at_least=1, at_most=MAX_POINTS) // REPLICATES), seed_number(seed)
    uniform = np.concatenate([sobol_points(each, seed=key, replicate=k)[:, :2] for k in range(REPLICATES)])
    beam = covering_rays(lens.elements[-1], float(lens.vertices[-1]), point, uniform, nm[0])
    white, black = np.zeros((2, len(beam)))
    pairs = [ghost_stack(lens_and_sensor, pair, last, nm) for pair in pairs_of(lens_and_sensor)]
    for stack in (exact, *pairs):
        behind, front = (float(stack.vertices[k] - lens.vertices[k]) for k in (-1, 0))
        start = RayBundle(beam.origin + np.array([0.0, 0.0, behind]), beam.direction, beam.wavelength)
        out = stack.trace_reverse(start)
        if stack is exact:
            check_light(lens, out)
        dark = _on_patch(out, setting.field, setting.z_object, radius, front)
        white += out.weight
        black += np.where(dark, 0.0, out.weight)
    index, error = relative_light([white, black])
    return VeilingGlare(float(index[0]), float(error[0]))


def _on_patch(rays: RayBundle, field: Floats, z_object: float, radius: float, shift: float) -> Floats:
    """True (n,) for rays towards the scene that end on the patch; `shift` is the shift of the lens frame in mm."""
    with np.errstate(invalid="ignore"):
        if math.isinf(z_object):
            towards = directions_of(field[None], -1.0)[0]
            # 1 - cos without cancellation: half the squared chord.
            chord = np.square(rays.direction - towards).sum(axis=1)
            return np.asarray(chord <= 4.0 * math.sin(0.5 * radius) ** 2)
        return np.asarray(np.hypot(*(rays.at_z(z_object + shift)[:, :2] - field).T) <= radius)

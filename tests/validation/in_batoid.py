"""Lenses as batoid (M. Jarvis, J. Meyers et al.) has them, which was written independently."""

import batoid
import numpy as np

import plenoptic as pl

TOLERANCE = 1e-9
"""mm. Both programs err by some 1e-12 mm; batoid's sphere formula loses digits on flat surfaces."""


def optic_of(lens, *, clips=True):
    """The same surfaces and places, in mm; unless `clips` is false also semi-diameters and round stops."""
    indices = lens.indices(587.6)
    items = []
    for i, (z, element) in enumerate(zip(lens.vertices, lens.elements, strict=True)):
        about = {
            "obscuration": batoid.ObscNegation(batoid.ObscCircle(element.semi_diameter)) if clips else None,
            "name": str(i),
            "coordSys": _coordinates(element, float(z)),
            "inMedium": batoid.ConstMedium(float(indices[i])),
            "outMedium": batoid.ConstMedium(float(indices[i + 1])),
        }
        if isinstance(element, pl.Surface):
            items.append(batoid.RefractiveInterface(_shape_of(element), **about))
        elif clips:
            items.append(batoid.Baffle(batoid.Plane(), **about))
    return batoid.CompoundOptic(items, name="lens")


def _coordinates(element, z):
    placed = element.placement or pl.optics.Placement()
    return batoid.CoordSys(np.array([0.0, 0.0, z]) + placed.shift, np.ascontiguousarray(placed.rotation))


def _shape_of(surface):
    if surface.aspheric:
        assert surface.aspheric[0] == 0, "batoid's coefficients begin with r^4"
        conic = surface.conic if surface.conic != -1 else -1 + 1e-12  # it begins at the conic, and divides by 1 + k
        return batoid.Asphere(surface.radius, conic, np.array(surface.aspheric[1:]))
    if surface.conic == -1:  # batoid's Quadric divides by 1 + k
        return batoid.Paraboloid(surface.radius)
    if surface.conic:
        return batoid.Quadric(surface.radius, surface.conic)
    return batoid.Plane() if np.isinf(surface.radius) else batoid.Sphere(surface.radius)


def rays_of(rays, index=1.0):
    """New ones in a medium, which batoid overwrites; its velocities have the length 1 / n."""
    wavelength = 1e-9 * rays.wavelength
    return batoid.RayVector(*rays.origin.T.copy(), *(rays.direction / index).T.copy(), wavelength=wavelength)


def assert_same(lens, rays, *, at_least, tolerance=TOLERANCE):
    """Both programs' rays end in the same places, and the same ones are clipped; so much of them is not."""
    before, *_, behind = lens.indices(587.6).tolist()
    ours, theirs = lens.trace(rays), optic_of(lens).trace(rays_of(rays, before))
    arrived = ours.status == pl.RayStatus.OK
    assert arrived.mean() > at_least
    lost = np.asarray(theirs.vignetted | theirs.failed)
    # A ray within rounding of a rim may be judged either way.
    assert np.mean(lost == arrived) < 1e-3
    both = arrived & ~lost
    # Their rays end in the axes of the last element.
    place = theirs.coordSys
    last = np.column_stack([theirs.x, theirs.y, theirs.z])[both] @ place.rot.T + place.origin
    np.testing.assert_allclose(ours.origin[both], last, atol=tolerance, rtol=0)
    velocity = behind * np.column_stack([theirs.vx, theirs.vy, theirs.vz])[both] @ place.rot.T
    np.testing.assert_allclose(ours.direction[both], velocity, atol=tolerance / 10, rtol=0)

"""What the cases render and trace, as arrays by name."""

import dataclasses

import numpy as np

import plenoptic as pl


def shot(exposure, name="shot"):
    """Image, error, ground truth and counts of paths."""
    stats = exposure.stats
    found = {"image": exposure.image, "standard_error": exposure.standard_error}
    found |= {} if exposure.truth is None else dict(exposure.truth.arrays())
    found["paths"] = np.array([stats.paths, stats.paths_through_lens, stats.nonfinite, stats.zero_variance])
    found["lost"] = np.array([count for *_, count in stats.lost], dtype=np.int64)
    found["clamped"] = np.array(stats.clamped)
    return {f"{name}.{key}": array for key, array in found.items()}


def numbers(result, name):
    """All numbers and arrays among the fields of a result; no text, no descriptions of lenses or cameras."""
    if hasattr(result, "_asdict"):
        fields = result._asdict()
    else:
        fields = {field.name: getattr(result, field.name) for field in dataclasses.fields(result)}
    return {
        f"{name}.{key}": np.asarray(value)
        for key, value in fields.items()
        if isinstance(value, int | float | np.number | np.ndarray)
    }


def merged(*parts):
    whole = {}
    for part in parts:
        assert not whole.keys() & part.keys()
        whole |= part
    return whole


def white(camera, name="white", **settings):
    return shot(pl.render_white(camera, progress=False, **({"samples": 16} | settings)), name)


def seen(scene, camera, name="seen", **settings):
    return shot(pl.render(scene, camera, progress=False, **({"samples": 16} | settings)), name)


def rays_towards_iris(lens, start, *, seed, wavelength, n=160):
    """Rays from a square of 40 mm (in the scene) or 6 mm (behind the lens) to the iris and its surroundings."""
    rng = np.random.default_rng(seed)
    half = 20.0 if start < 0 else 3.0
    origin, target = np.full((n, 3), start), np.zeros((n, 3))
    origin[:, :2] = rng.uniform(-half, half, (n, 2))
    target[:, :2] = rng.uniform(-1.5, 1.5, (n, 2)) * lens.stop.semi_diameter
    return pl.RayBundle(origin, target - origin, wavelength)


def traced(lens, name, wavelength=587.6):
    """Rays through a lens in both directions."""
    forward = lens.trace(rays_towards_iris(lens, -404.0, seed=0, wavelength=wavelength))
    back = lens.trace_reverse(rays_towards_iris(lens, 134.0, seed=1, wavelength=wavelength))
    return merged(rays(forward, f"{name}.forward"), rays(back, f"{name}.reverse"))


def rays(bundle, name):
    return {f"{name}.{key}": getattr(bundle, key) for key in ("origin", "direction", "weight", "status", "lost_at")}

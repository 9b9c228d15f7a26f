"""Golden cases: functions that return arrays by name. Each is small, and together they call every kind of kernel."""

import dataclasses

import golden_cameras
import golden_names as pl
import golden_scenes
import numpy as np

CASES = {}
QUICK = ("white_images", "traces", "truth", "point_spread")
"""Those in the normal run: few kernels to compile."""


def case(function):
    CASES[function.__name__] = function
    return function


# ---- arrays of results ----


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
    found = {}
    fields = result._asdict() if hasattr(result, "_asdict") else vars(result)
    for key, value in fields.items():
        if isinstance(value, bool | int | float | np.number | np.ndarray):
            found[f"{name}.{key}"] = np.asarray(value)
    return found


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


# ---- cases ----


@case
def white_images():
    """The reference camera in both modes."""
    region = np.s_[240:272, 230:262]
    unfocused = golden_cameras.reference(to_sensor=2.0, semi_diameter=4.25)
    return merged(
        white(golden_cameras.reference(), "2.0", region=region, samples=32),
        white(unfocused, "1.0", region=region, samples=32),
        white(golden_cameras.reference(), "corner", region=np.s_[:16, :16], seed=3, replicates=4),
        white(golden_cameras.reference(), "random", region=np.s_[250:258, 250:258], sampler=pl.Sampler.RANDOM),
    )


@case
def objects():
    """The reference scene with its metal and its glass."""
    camera, region = golden_cameras.reference(), np.s_[280:304, 230:254]
    return seen(pl.objects_scene(), camera, region=region, samples=32, truth=pl.Truth.ALL)


@case
def traces():
    """Spheres, conics, aspheres, elements out of place, stops, ideal lenses, a fisheye; several wavelengths."""
    spheres, aspheres = pl.load_lens("double-gauss-100mm-f2"), golden_cameras.aspheric_lens()
    surfaces = [
        dataclasses.replace(part, aspheric=()) if isinstance(part, pl.Surface) else part for part in aspheres.elements
    ]
    lenses = {
        "conics": pl.LensStack(surfaces),
        "aspheres": aspheres,
        "moved": aspheres.moved(0, shift=(0.1, -0.2, 0.05), tilt=(0.01, 0.02, 0.3)).moved([1, 2], tilt=(-0.02, 0, 0.1)),
        "blades": spheres.with_stop(pl.PolygonStop(7, 9.0, 0.1, blade_radius=12.0)),
        "mask": spheres.with_stop(pl.MaskStop([[0.2, 1.0], [0.5, 0.0], [0.9, 0.7]], 9.0)),
        "star": spheres.with_stop(pl.StarStop(7, 9.0, 5.0, 0.1)).moved(slice(0, 2), tilt=(0.01, -0.01, 0.2)),
        "thin": spheres.with_model(pl.LensModel.THIN),
        "paraxial": spheres.with_model(pl.LensModel.PARAXIAL),
    }
    found = [traced(spheres, f"spheres {wave:g}", wave) for wave in (450.0, 587.6, 650.0)]
    return merged(*found, *(traced(lens, name) for name, lens in lenses.items()), fisheye())


def fisheye():
    """Surfaces met far from their axis: rays that have come through backwards, and once more forwards."""
    lens = pl.load_lens("fisheye-100mm-f8")
    wide = np.random.default_rng(2).uniform(-1.0, 1.0, (300, 2)) * (100.0, 10.0)
    behind = np.full((300, 3), float(lens.vertices[-1]) + 90.0)
    behind[:, :2] = wide
    towards = np.append(np.random.default_rng(3).uniform(-5.0, 5.0, (300, 2)), np.zeros((300, 1)), axis=1) - behind
    out = lens.trace_reverse(pl.RayBundle(behind, towards))
    through = out.status == 0
    scene = pl.RayBundle(out.origin[through] + 300.0 * out.direction[through], -out.direction[through])
    return merged(rays(out, "fisheye.reverse"), rays(lens.trace(scene), "fisheye.forward"))


@case
def out_of_place():
    """Images and light of points of the camera in which nothing is as designed."""
    camera = golden_cameras.out_of_place()
    return merged(white(camera), seen(golden_scenes.bodies(), camera, truth=pl.Truth.ALL))


@case
def truth():
    """Each kind of ground truth by itself."""
    cameras = {
        "reference": (golden_cameras.reference(), np.s_[240:264, 236:260]),
        "out of place": (golden_cameras.out_of_place(), None),
        "free": (golden_cameras.free(), None),
    }
    scene, found = golden_scenes.bodies(), {}
    for name, (camera, region) in cameras.items():
        for kind in pl.Truth:
            if kind.name not in ("NONE", "ALL"):
                arrays = pl.ground_truth(scene, camera, truth=kind, region=region).arrays()
                found |= {f"{name}.{key}": array for key, array in arrays.items()}
    return found


@case
def point_spread():
    """Light of points, forwards to the sensor."""
    points = [(0.0, 0.0, -404.0), (0.4, -0.3, -395.0)]
    found = []
    for name in ("reference", "out_of_place", "free", "spherical", "conventional"):
        camera = getattr(golden_cameras, name)()
        found.append(numbers(pl.point_spread(camera, points, rays=4096), f"{name}.spread"))
        found.append(numbers(pl.landing_points(camera, points, rays=256), f"{name}.landing"))
    return merged(*found)

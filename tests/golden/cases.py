"""Golden cases: functions that return arrays by name. Each is small, and together they call every kind of kernel."""

import dataclasses
import math

import golden_cameras
import golden_names as pl
import golden_scenes
import numpy as np
from golden_results import merged, numbers, rays, rays_towards_iris, seen, shot, traced, white

CASES = {}
QUICK = ("white_images", "objects", "traces", "truth")
"""Those in the normal run: few kernels to compile."""


def case(function):
    CASES[function.__name__] = function
    return function


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
    hyper_hemisphere = [
        pl.CircularStop(4.5, 3.0),
        pl.Surface(5.0, 8.0, pl.glass("N-SF11"), semi_diameter=5.0, depth=8.0),
        pl.Surface(math.inf, semi_diameter=4.0),
    ]
    lenses = {
        "hyper-hemisphere": pl.LensStack(hyper_hemisphere),
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


@case
def other_arrays():
    """Listed, exact, flat and walled microlenses, pinholes; a camera without; ideal lenses, a mask, a star."""
    found = []
    for name in ("free", "spherical", "flat_high_index", "pinholes", "walled", "conventional"):
        camera = getattr(golden_cameras, name)()
        found += [
            white(camera, f"{name}.white"),
            seen(golden_scenes.bodies(), camera, f"{name}.seen", samples=8, max_bounces=3, truth=pl.Truth.ALL),
        ]
    return merged(*found)


@case
def spectral():
    """Wavelength by wavelength through lenses that disperse: a colour camera, and one line for each channel."""
    colour = golden_cameras.conventional(pl.sensitivities.colour_camera())
    lines = golden_cameras.conventional(pl.Sensitivity.lines((620.0, 540.0, 450.0)))
    reference = golden_cameras.reference(sensitivity=pl.sensitivities.cie_1931())
    return merged(
        white(colour, "colour.white"),
        seen(golden_scenes.textured(), colour, "colour.textured"),
        seen(golden_scenes.metals(), colour, "colour.metals", samples=8),
        seen(golden_scenes.sky(), lines, "lines.sky"),
        seen(golden_scenes.glasses(), reference, "reference.glasses", region=np.s_[240:264, 240:264]),
    )


def in_both(scene, **settings):
    """The scene by the reference camera and, all of it, by the conventional one."""
    region = np.s_[250:274, 240:264]
    return merged(
        seen(scene, golden_cameras.reference(), "reference", region=region, **settings),
        seen(scene, golden_cameras.conventional(), "conventional", **settings),
    )


@case
def still_life():
    return in_both(pl.still_life(), truth=pl.Truth.ALL)


@case
def textured():
    """glTF's material: textures, normal map, emission, opacity blended and cut."""
    return in_both(golden_scenes.textured(), truth=pl.Truth.ALL)


@case
def glasses():
    """Absorbing, rough and thin glass; caustics left out, light clamped."""
    scene, camera = golden_scenes.glasses(), golden_cameras.conventional()
    return merged(
        in_both(scene),
        seen(scene, camera, "without caustics", caustics=pl.Caustics.LEFT_OUT),
        seen(scene, camera, "clamped", clamp=0.5),
        seen(scene, camera, "few bounces", max_bounces=2),
    )


@case
def metals():
    return in_both(golden_scenes.metals())


@case
def sky():
    """An environment map, and a sample of independent points."""
    camera = golden_cameras.conventional()
    return merged(in_both(golden_scenes.sky()), seen(golden_scenes.sky(), camera, "random", sampler=pl.Sampler.RANDOM))


@case
def all_lights():
    return in_both(golden_scenes.all_lights())


@case
def repeated():
    """Instances."""
    return in_both(golden_scenes.repeated(), truth=pl.Truth.ALL)


@case
def target_error():
    """Tiles that end by themselves, and the conditioning of some paths."""
    camera = golden_cameras.conventional()
    exposure = pl.render(
        golden_scenes.metals(), camera, samples=256, target_error=0.1, tile_side=8, conditioning=64, progress=False
    )
    return merged(
        shot(exposure),
        {"sample_counts": exposure.sample_counts, "relative_error": np.array(exposure.relative_error)},
        numbers(exposure.stats.conditioning, "conditioning"),
    )


@case
def projection():
    """Places of points in microlens images, some of them hidden."""
    points = [(0.0, 0.0, -404.0), (0.4, -0.3, -395.0), (-2.0, 0.3, -418.0)]
    found = []
    for name in ("reference", "out_of_place", "free", "spherical", "pinholes", "conventional"):
        camera = getattr(golden_cameras, name)()
        found.append(numbers(camera.project(points, golden_scenes.bodies()), name))
    return merged(*found)


@case
def centres():
    """Centres of microlens images by all methods."""
    cameras = {
        "1.0": golden_cameras.reference(to_sensor=2.0, semi_diameter=4.25, shape=(128, 128)),
        "out of place": golden_cameras.out_of_place(),
        "spherical": golden_cameras.spherical(),
    }
    found = [
        numbers(pl.microlens_centres(camera, method), f"{name}.{method.name}")
        for name, camera in cameras.items()
        for method in pl.CentreMethod
    ]
    camera = cameras["1.0"]
    image = pl.render_white(camera, samples=16, progress=False)
    found.append(numbers(pl.microlens_centres(camera, pl.CentreMethod.CENTROID, white=image), "1.0.by white image"))
    return merged(*found)


@case
def analyses():
    """What a lens design program says."""
    gauss = pl.load_lens("double-gauss-100mm-f2")
    lenses = {
        "double gauss": gauss,
        "aspheric": golden_cameras.aspheric_lens(),
        "moved": gauss.moved(slice(0, 2), shift=(0.05, -0.03, 0.0), tilt=(0.004, -0.003, 0.0)),
    }
    return merged(*(of_lens(lens, name) for name, lens in lenses.items()), *map(of_bundled_lens, pl.lens_names()))


def of_lens(lens, name):
    look = pl.aberrations
    off_axis, fields = {"field": (0.03, 0.1), "z_object": -404.0}, [0.0, 0.05, 0.1]
    colours = (486.1, 587.6, 656.3)
    results = {
        "spots": look.spot_diagram(lens, **off_axis, wavelength=colours),
        "fan": look.ray_fan(lens, **off_axis, points=17),
        "spread": look.point_spread(lens, **off_axis, rays=4096, shape=(24, 24)),
        "mtf": look.mtf(lens, [5.0, 20.0, 40.0], **off_axis, rays=2048),
        "focus": look.through_focus(lens, **off_axis, rays=1024),
    }
    found = [numbers(result, f"{name}.{key}") for key, result in results.items()]
    criteria = [look.best_focus(lens, rays=1024, criterion=criterion) for criterion in pl.FocusCriterion]
    found.append({f"{name}.best_focus": np.array(criteria)})
    if all(part.placement is None for part in lens.elements):
        results = {
            "distortion": look.distortion(lens, fields),
            "curvature": look.field_curvature(lens, fields),
            "coma": look.coma(lens, fields[1:]),
            "vignetting": look.vignetting(lens, fields),
            "illumination": look.relative_illumination(lens, fields),
            "seidel": look.seidel_sums(lens, field=0.1),
            "colour": look.chromatic_shift(lens, field=0.1),
        }
        found += [numbers(result, f"{name}.{key}") for key, result in results.items()]
        found.append({f"{name}.colour_sums": look.colour_sums(lens, field=0.1)})
    condition = pl.conditioning(lens, rays_towards_iris(lens, -404.0, seed=0, wavelength=587.6))
    return merged(*found, numbers(condition, f"{name}.conditioning"))


def of_bundled_lens(name):
    lens = pl.load_lens(name)
    return merged(
        numbers(pl.paraxial.cardinal_points(lens), f"{name}.cardinal"),
        {f"{name}.vertices": lens.vertices, f"{name}.indices": lens.indices(486.1)},
    )


@case
def reports():
    """Numbers of camera reports, and cameras that are focused."""
    found = []
    for name in ("reference", "out_of_place", "spherical", "walled", "conventional"):
        camera = getattr(golden_cameras, name)()
        report = camera.report()
        found.append(numbers(report, name))
        found += [numbers(focus, f"{name}.focus {focus.type}") for focus in report.focus]
    camera = golden_cameras.reference()
    places = [camera.focused_at(-404.0, criterion=how).stop_to_microlenses for how in pl.FocusCriterion]
    return merged(*found, {"focused_at": np.array(places)})


@case
def sensing():
    """Noise by seed, filters, saturation; demosaicing."""
    image = pl.render(golden_scenes.metals(), golden_cameras.conventional(), samples=8, progress=False)
    plain = {"exposure_time": 0.5, "read_noise": 3.0, "full_well": 15000}
    models = {
        "plain": pl.SensorModel(2e4, **plain),
        "unquantised": pl.SensorModel(2e4, bits=None, shot_noise=pl.ShotNoise.NONE, read_noise=2.0),
        "bayer": pl.SensorModel(
            (2e4, 3e4, 2.5e4),
            **plain,
            quantum_efficiency=(0.4, 0.55, 0.45),
            gain=0.25,
            black_level=64,
            colour_filters=pl.BayerPattern.GRBG,
            row_noise=1.0,
            dark_current=20.0,
            prnu=0.01,
            dsnu=2.0,
            column_dsnu=1.0,
            dead=0.01,
            hot=0.01,
            hot_current=5e4,
            pattern_seed=4,
        ),
    }
    raws = {name: image.develop(model, seed=7) for name, model in models.items()}
    found = {f"{name}.data": raw.data for name, raw in raws.items()}
    found |= {f"{name}.electrons": raw.electrons() for name, raw in raws.items()}
    for method in pl.DemosaicMethod:
        found[f"bayer.{method.name}"] = raws["bayer"].demosaic(method).image
    return merged(found, numbers(pl.photon_transfer(models["bayer"], [0.0, 0.1, 0.3], shape=(32, 32)), "transfer"))


@case
def light_fields():
    """Views of plenoptic 1.0 images, and refocusing."""
    found = []
    for lattice in (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE):
        camera = golden_cameras.reference(to_sensor=2.0, semi_diameter=4.25, shape=(110, 132), lattice=lattice)
        camera = camera.focused_at(z=-404.0)
        image = pl.render(golden_scenes.metals(), camera, samples=8, max_bounces=2, progress=False)
        field = pl.lightfield.decode(image, pl.render_white(camera, samples=8, seed=1, progress=False), views=5)
        found.append(numbers(field, lattice.name))
        found.append({f"{lattice.name}.{z:g}": pl.lightfield.refocus(field, z) for z in (-404.0, -390.0)})
    return merged(*found)


@case
def scattering():
    """Distributions of materials by themselves."""
    materials = {
        "matt": pl.Lambertian((0.8, 0.3, 0.2)),
        "grooves": pl.RoughDiffuse(0.6, 0.7),
        "metal": pl.Conductor(alpha=0.3, index=0.2 + 3.4j),
        "mirror": pl.Conductor((0.9, 0.8, 0.7)),
        "glass": pl.Dielectric(1.5),
        "rough glass": pl.Dielectric(1.5, 0.3),
        "pane": pl.ThinGlass(1.5, 0.9),
        "paint": pl.MetallicRoughness((0.8, 0.4, 0.2), 0.3, 0.4),
    }
    points = pl.sampling.sobol_points(64)
    viewers = np.column_stack([points[:, 0] - 0.5, points[:, 1] - 0.5, 0.05 + points[:, 2]])
    found = [
        {"points": points, "other points": pl.sampling.sobol_points(32, seed=5, pixel=77, replicate=2, set_number=3)}
    ]
    for name, material in materials.items():
        for front in (True, False):
            drawn = pl.bsdf.draw(material, viewers, points[:, :3], front=front)
            side = f"{name}.{'front' if front else 'back'}"
            found.append(numbers(drawn, f"{side}.drawn"))
            found.append(numbers(pl.bsdf.evaluate(material, viewers, drawn.to_light, front=front), f"{side}.evaluated"))
    return merged(*found)

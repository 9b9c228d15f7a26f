"""Cases that are images, and what is made of them."""

import golden_cameras
import golden_scenes
import numpy as np
from golden_results import merged, numbers, seen, shot, white

import plenoptic as pl


def white_images():
    """The reference camera in both modes."""
    region = np.s_[240:272, 230:262]
    unfocused = golden_cameras.reference(to_sensor=2.0, semi_diameter=4.25)
    plain, small = golden_cameras.reference(), np.s_[250:258, 250:258]
    return merged(
        white(plain, "2.0", region=region, samples=32),
        white(unfocused, "1.0", region=region, samples=32),
        white(plain, "corner", region=np.s_[:16, :16], seed=3, replicates=4),
        white(plain, "random", region=small, sampler=pl.rendering.Sampler.RANDOM),
    )


def objects():
    """The reference scene with its metal and its glass."""
    camera, region = golden_cameras.reference(), np.s_[280:304, 230:254]
    return seen(pl.objects_scene(), camera, region=region, samples=32, truth=pl.Truth.ALL)


def out_of_place():
    """Images and light of points of the camera in which nothing is as designed."""
    camera = golden_cameras.out_of_place()
    places = np.random.default_rng(6).uniform(-1.0, 1.0, (200, 2))
    dust = {f"dust.{part.site.name}": part.at(places * (0.5 if part.site < 2 else 5.0)) for part in camera.blemishes}
    return merged(white(camera), seen(golden_scenes.bodies(), camera, truth=pl.Truth.ALL), dust)


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


def spectral():
    """Wavelength by wavelength through lenses that disperse: a colour camera, and one line for each channel."""
    colour = golden_cameras.conventional(pl.sensitivities.colour_camera())
    lines = golden_cameras.conventional(pl.sensor.Sensitivity.lines((620.0, 540.0, 450.0)))
    reference = golden_cameras.reference(sensitivity=pl.sensitivities.cie_1931())
    white_shot = pl.render_white(colour, samples=8, conditioning=64, progress=False)
    return merged(
        white(colour, "colour.white"),
        seen(golden_scenes.textured(), colour, "colour.textured"),
        seen(golden_scenes.metals(), colour, "colour.metals", samples=8),
        numbers(white_shot.stats.conditioning, "colour.conditioning"),
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


def still_life():
    return in_both(pl.still_life(), truth=pl.Truth.ALL)


def textured():
    """glTF's material: textures, normal map, emission, opacity blended and cut."""
    return in_both(golden_scenes.textured(), truth=pl.Truth.ALL)


def glasses():
    """Absorbing, rough and thin glass; caustics left out, light clamped."""
    scene, camera = golden_scenes.glasses(), golden_cameras.conventional()
    return merged(
        in_both(scene),
        seen(scene, camera, "without caustics", caustics=pl.rendering.Caustics.EXCLUDE),
        seen(scene, camera, "clamped", clamp=0.5),
        seen(scene, camera, "few bounces", max_bounces=2),
        seen(golden_scenes.under_water(), camera, "under water"),
    )


def metals():
    return in_both(golden_scenes.metals())


def sky():
    """An environment map, and a sample of independent points."""
    camera = golden_cameras.conventional()
    return merged(
        in_both(golden_scenes.sky()), seen(golden_scenes.sky(), camera, "random", sampler=pl.rendering.Sampler.RANDOM)
    )


def all_lights():
    return in_both(golden_scenes.all_lights())


def repeated():
    """Instances."""
    return in_both(golden_scenes.repeated(), truth=pl.Truth.ALL)


def target_error():
    """Tiles that end by themselves, and the conditioning of some paths."""
    camera = golden_cameras.conventional()
    how = {"samples": 256, "target_error": 0.1, "tile_side": 8, "conditioning": 64, "progress": False}
    exposure = pl.render(golden_scenes.metals(), camera, **how)
    return merged(
        shot(exposure),
        {"sample_counts": exposure.sample_counts, "relative_error": np.array(exposure.relative_error)},
        numbers(exposure.stats.conditioning, "conditioning"),
    )


def sensing():
    """Noise by seed, filters, saturation; demosaicing."""
    image = pl.render(golden_scenes.metals(), golden_cameras.conventional(), samples=8, progress=False)
    plain = {"exposure_time": 0.5, "read_noise": 3.0, "full_well": 15000}
    patterns = {"quantum_efficiency": (0.4, 0.55, 0.45), "gain": 0.25, "black_level": 64, "row_noise": 1.0}
    patterns |= {"colour_filters": pl.BayerPattern.GRBG, "dark_current": 20.0, "prnu": 0.01, "dsnu": 2.0}
    patterns |= {"column_dsnu": 1.0, "dead": 0.01, "hot": 0.01, "hot_current": 5e4, "pattern_seed": 4}
    models = {
        "plain": pl.SensorModel(2e4, **plain),
        "unquantised": pl.SensorModel(2e4, bits=None, shot_noise=pl.ShotNoise.NONE, read_noise=2.0),
        "bayer": pl.SensorModel((2e4, 3e4, 2.5e4), **plain, **patterns),
    }
    raws = {name: image.develop(model, seed=7) for name, model in models.items()}
    found = {f"{name}.data": raw.data for name, raw in raws.items()}
    found |= {f"{name}.electrons": raw.electrons() for name, raw in raws.items()}
    for method in pl.DemosaicMethod:
        found[f"bayer.{method.name}"] = raws["bayer"].demosaic(method).image
    return merged(
        found, numbers(pl.sensor.photon_transfer(models["bayer"], [0.0, 0.1, 0.3], shape=(32, 32)), "transfer")
    )


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


RENDERINGS = (
    *(white_images, objects, out_of_place, truth, other_arrays, spectral, still_life, textured, glasses, metals, sky),
    *(all_lights, repeated, target_error, sensing, light_fields),
)

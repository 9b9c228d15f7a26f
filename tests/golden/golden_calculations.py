"""Cases that are rays, and numbers about lenses, cameras and materials."""

import dataclasses
import math

import golden_cameras
import golden_scenes
import numpy as np
from golden_results import merged, numbers, rays, rays_towards_iris, traced

import plenoptic as pl


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
        "mask": spheres.with_stop(pl.optics.MaskStop([[0.2, 1.0], [0.5, 0.0], [0.9, 0.7]], 9.0)),
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


def point_spread():
    """Light of points, forwards to the sensor."""
    points = [(0.0, 0.0, -404.0), (0.4, -0.3, -395.0)]
    found = []
    for name in ("reference", "out_of_place", "free", "spherical", "conventional"):
        camera = getattr(golden_cameras, name)()
        found.append(numbers(pl.point_spread(camera, points, rays=4096), f"{name}.spread"))
        found.append(numbers(pl.camera.landing_points(camera, points, rays=256), f"{name}.landing"))
    return merged(*found)


def projection():
    """Places of points in micro images, some of them hidden."""
    points = [(0.0, 0.0, -404.0), (0.4, -0.3, -395.0), (-2.0, 0.3, -418.0)]
    found = []
    for name in ("reference", "out_of_place", "free", "spherical", "pinholes", "conventional"):
        camera = getattr(golden_cameras, name)()
        found.append(numbers(camera.project(points, golden_scenes.bodies()), name))
    return merged(*found)


def centres():
    """Centres of micro images by all methods."""
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


BUNDLED = (
    *("achromat-100mm-f4.4", "double-gauss-100mm-f2", "double-gauss-105mm-f1.4", "fisheye-100mm-f8"),
    *("singlet-100mm-f4", "telephoto-100mm-f2.8", "topogon-100mm-f6.3"),
)
"""Lenses whose analyses are kept; there are more in the package."""


def analyses():
    """What a lens design program says."""
    gauss = pl.load_lens("double-gauss-100mm-f2")
    lenses = {
        "double gauss": gauss,
        "aspheric": golden_cameras.aspheric_lens(),
        "moved": gauss.moved(slice(0, 2), shift=(0.05, -0.03, 0.0), tilt=(0.004, -0.003, 0.0)),
    }
    return merged(*(of_lens(lens, name) for name, lens in lenses.items()), *map(of_bundled_lens, BUNDLED))


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
        results = {"distortion": look.distortion(lens, fields), "curvature": look.field_curvature(lens, fields)}
        results |= {"coma": look.coma(lens, fields[1:]), "vignetting": look.vignetting(lens, fields)}
        results |= {"illumination": look.relative_illumination(lens, fields)}
        results |= {"seidel": look.seidel_sums(lens, field=0.1), "colour": look.chromatic_shift(lens, field=0.1)}
        found += [numbers(result, f"{name}.{key}") for key, result in results.items()]
        found.append({f"{name}.colour_sums": look.colour_sums(lens, field=0.1)})
    condition = pl.optics.conditioning(lens, rays_towards_iris(lens, -404.0, seed=0, wavelength=587.6))
    return merged(*found, numbers(condition, f"{name}.conditioning"))


def of_bundled_lens(name):
    lens = pl.load_lens(name)
    return merged(
        numbers(pl.paraxial.cardinal_points(lens), f"{name}.cardinal"),
        {f"{name}.vertices": lens.vertices, f"{name}.indices": lens.indices(486.1)},
    )


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


def targets():
    """Calibration targets: triangles and points."""
    kinds = {
        "checkerboard": pl.targets.checkerboard(5, 4, square=2.0, margin=0.5),
        "grid": pl.targets.point_grid(3, 4, pitch=2.0, radius=0.5, sides=12),
        "dots": pl.targets.random_dots(12, 9, dot=0.3, seed=2),
        "star": pl.targets.siemens_star(4.0, 12, inner_radius=0.3),
        "edge": pl.targets.slanted_edge(8.0),
        "usaf": pl.targets.usaf_1951(range(0, 2)),
    }
    found = []
    for name, target in kinds.items():
        found.append({f"{name}.points": target.points})
        for k, mesh in enumerate(target.meshes):
            found.append({f"{name}.{k}.vertices": mesh.vertices, f"{name}.{k}.faces": mesh.faces})
    return merged(*found)


def scattering():
    """Distributions of materials by themselves."""
    materials = {"matt": pl.Lambertian((0.8, 0.3, 0.2)), "grooves": pl.materials.RoughDiffuse(0.6, 0.7)}
    materials |= {"metal": pl.Conductor(alpha=0.3, index=0.2 + 3.4j), "mirror": pl.Conductor((0.9, 0.8, 0.7))}
    materials |= {"glass": pl.Dielectric(1.5), "rough glass": pl.Dielectric(1.5, 0.3)}
    materials |= {"pane": pl.materials.ThinGlass(1.5, 0.9), "paint": pl.MetallicRoughness((0.8, 0.4, 0.2), 0.3, 0.4)}
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


CALCULATIONS = (traces, point_spread, projection, centres, analyses, reports, targets, scattering)

"""Calls of the public API with valid arguments: what fuzzing starts from."""

import functools
import inspect
import math

import numpy as np
from valid_scene_calls import call, scene, scene_calls

import plenoptic as pl
from plenoptic import aberrations, aiming, images, lightfield, optics, paraxial, sensor, targets


@functools.cache
def lens():
    return pl.load_lens("singlet-100mm-f4")


@functools.cache
def camera(**changes):
    array = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
    built = {"stop_to_microlenses": 100.0, "microlenses": array, "microlenses_to_sensor": 1.7}
    return pl.PlenopticCamera(lens(), pl.Sensor(shape=(16, 16), pixel_pitch=0.05), **built | changes)


@functools.cache
def shot():
    return pl.render_white(camera(), samples=16, progress=False, threads=1)


@functools.cache
def rays():
    return pl.RayBundle(np.array([[0, 0, -50.0], [0, 1, -50.0]]), np.array([[0, 0, 1.0], [0, 0, 1.0]]))


def calls():
    """Name, function and valid arguments of each call."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    grey = pl.SensorModel(1000.0, exposure_time=1.0)
    z, wave, field = -400.0, 550.0, (0.01, 0.02)
    quick = {"samples": 4, "region": (slice(2, 6), slice(0, 4)), "seed": 1, "replicates": 2, "threads": 1}
    quick |= {"progress": False, "sampler": pl.rendering.Sampler.SOBOL, "conditioning": 8, "tile_side": 4}
    quick |= {"time_limit": 1.0}  # samples are accepted up to billions
    full = quick | {"max_bounces": 2, "clamp": 10.0, "truth": pl.Truth.DEPTH, "caustics": pl.rendering.Caustics.KEPT}
    grid = np.linspace(400.0, 700.0, 7)
    made = {
        "Sensor": call(pl.Sensor, shape=(4, 4), pixel_pitch=0.05, pixel_aperture=(0.9, 0.8)),
        "Sensor.centre_of": call(camera().sensor.centre_of, row=3, column=4),
        "Sensor.pixel_of": call(camera().sensor.pixel_of, points=[[0.0, 0.0]]),
        "AngularResponse": call(sensor.AngularResponse, well_depth=0.01, index=1.5, pupil_distance=9.0, exponent=1.0),
        "Pose": call(pl.Pose, rotation=np.eye(3), position=(0.0, 0.0, 5.0)),
        "Pose.look_at": call(pl.Pose.look_at, position=(0, 0, 9.0), target=(0, 0, 0.0), up=(0.0, 1, 0)),
        "to_world": call(pl.Pose(np.eye(3), (0, 0, 0)).to_world, points=square),
        "to_camera": call(pl.Pose(np.eye(3), (0, 0, 0)).to_camera, points=square),
        "CircularStop": call(pl.CircularStop, semi_diameter=5.0, thickness=1.0),
        "PolygonStop": call(pl.PolygonStop, blades=6, semi_diameter=5.0, rotation=0.1, thickness=1.0, blade_radius=8.0),
        "StarStop": call(pl.StarStop, points=5, semi_diameter=5.0, inner_semi_diameter=2.0, rotation=0.1),
        "MaskStop": call(optics.MaskStop, transmission=[[0.0, 1.0], [0.5, 1.0]], semi_diameter=5.0, thickness=1.0),
        "of_cells": call(optics.MaskStop.of_cells, transmission=[[0.0, 1.0]], cell_size=1.0, thickness=1.0),
        "outline": call(pl.PolygonStop(6, 5.0).outline, n=64),
        "image": call(pl.PolygonStop(6, 5.0).image, scale=2.0),
        "contains": call(pl.PolygonStop(6, 5.0).contains, x=[1.0], y=[2.0]),
        "transmission_at": call(pl.StarStop(6, 5.0, 2.0).transmission_at, x=[1.0], y=[2.0]),
        "Surface": call(
            pl.Surface,
            radius=50.0,
            thickness=3.0,
            medium=optics.AIR,
            semi_diameter=9.0,
            conic=-0.5,
            aspheric=[0.0, 1e-7],
        ),
        "Surface.flat": call(pl.Surface, radius=math.inf, thickness=3.0, semi_diameter=9.0, aspheric=[1e-4]),
        "Surface.zernike": call(
            pl.Surface, radius=50.0, thickness=3.0, semi_diameter=9.0, departure=optics.ZernikeSag([0.0, 1e-3], 10.0)
        ),
        "sag": call(pl.Surface(50.0, semi_diameter=9.0).sag, r=[1.0, 2.0], y=[0.0, 1.0]),
        "slope": call(pl.Surface(50.0, semi_diameter=9.0).slope, r=[1.0, 2.0]),
        "gradient": call(pl.Surface(50.0, semi_diameter=9.0).gradient, x=[1.0, 2.0], y=[0.0, 1.0]),
        "ZernikeSag": call(optics.ZernikeSag, coefficients=[0.0, 0.0, 1e-3], norm_radius=10.0),
        "Placement": call(optics.Placement, shift=(0.1, 0.0, 0.0), rotation=np.eye(3)),
        "LensStack": call(
            pl.LensStack,
            elements=list(lens().elements),
            iris=lens().iris,
            name="a",
            ambient=optics.AIR,
            model=pl.LensModel.EXACT,
        ),
        "moved": call(lens().moved, which=1, shift=(0.1, 0.0, 0.0), tilt=(0.01, 0.0, 0.0), pivot=2.0),
        "with_stop": call(lens().with_stop, stop=pl.CircularStop(3.0)),
        "with_model": call(lens().with_model, model=pl.LensModel.THIN),
        "inserted": call(lens().inserted, stop=pl.CircularStop(3.0), z=30.0),
        "profiles": call(lens().profiles, points=5),
        "indices": call(lens().indices, wavelength=wave),
        "check": call(lens().check, wavelength=wave),
        "trace": call(lens().trace, rays=rays(), threads=1),
        "RayBundle": call(
            pl.RayBundle,
            origin=square - [0, 0, 50.0],
            direction=square * 0 + [0, 0, 1.0],
            wavelength=wave,
            weight=np.ones(3),
        ),
        "RayBundle.at": call(rays().at, distance=[1.0, 2.0]),
        "RayBundle.at_z": call(rays().at_z, z=1.0),
        "RayBundle.selected": call(rays().selected, mask=[True, False]),
        "conditioning": call(pl.optics.conditioning, lens=lens(), rays=rays(), reverse=False),
        "no_lens": call(pl.no_lens, semi_diameter=5.0),
        "ConstantMedium": call(pl.ConstantMedium, refractive_index=1.5),
        "ModelGlass": call(pl.ModelGlass, nd=1.5, vd=60.0, name="x"),
        "Sellmeier": call(pl.Sellmeier, b=(1.0, 0.2, 1.0), c=(0.006, 0.02, 100.0), wavelength_range=(365.0, 2325.0)),
        "Air": call(optics.Air, temperature=20.0, pressure=101.0, humidity=0.5, co2=450.0),
        "index": call(pl.glass("N-BK7").index, wavelength=wave),
        "glass": call(pl.glass, name="N-BK7"),
        "abbe_number": call(optics.abbe_number, medium=pl.glass("N-BK7")),
        "MicrolensArray": call(
            pl.MicrolensArray,
            pitch=0.217,
            focal_lengths=(2.0, 3.0),
            lattice=pl.Lattice.SQUARE,
            thickness=0.1,
            index=1.5,
            pattern=[[0, 1]],
        ),
        "MicrolensArray.free": call(
            pl.MicrolensArray,
            pitch=0.2,
            focal_lengths=(2.0,),
            lattice=pl.Lattice.FREE,
            centres=[[0.0, 0.0], [0.2, 0.0]],
            types=[0, 0],
        ),
        "MicrolensArray.model": call(
            pl.MicrolensArray,
            pitch=(0.2, 0.3),
            focal_lengths=2.0,
            lattice=pl.Lattice.RECTANGULAR,
            model=optics.MicrolensModel.SPHERICAL,
            thickness=0.1,
            index=1.6,
        ),
        "MicrolensAperture": call(
            optics.MicrolensAperture, shape=optics.ApertureShape.CIRCLE, fill_factor=0.7, gaps=optics.Gaps.OPAQUE
        ),
        "lenses": call(camera().microlenses.lenses, low=(-1.0, -1.0), high=(1.0, 1.0)),
        "nearest": call(camera().microlenses.nearest, points=[[0.0, 0.0]]),
        "MicrolensImperfections": call(
            pl.MicrolensImperfections,
            pitch_jitter=1e-3,
            decentre=1e-3,
            focal_length_spread=0.01,
            missing=0.1,
            dark=0.1,
            seed=3,
        ),
        "MicrolensDeviations": call(
            optics.MicrolensDeviations, index=[[0, 0]], shift=[[0.001, 0.0]], decentre=[[0.0, 0.0]], transmission=[0.5]
        ),
        "deviations": call(pl.MicrolensImperfections(0.001).deviations, index=[[0, 0], [1, 2]]),
        "Blemishes": call(
            pl.Blemishes,
            site=pl.BlemishSite.SENSOR,
            start=[[0.0, 0.0]],
            end=[[0.1, 0.0]],
            radius=[0.01],
            transmission=[0.5],
            height=0.1,
        ),
        "scattered": call(
            pl.Blemishes.scattered,
            site=pl.BlemishSite.SENSOR,
            half_size=(0.5, 0.5),
            dust_per_mm2=10.0,
            dust_radius=0.005,
            dust_spread=0.5,
            scratches=2,
            scratch_length=0.1,
            scratch_width=0.01,
            seed=1,
        ),
        "PlenopticCamera": call(
            pl.PlenopticCamera,
            lens=lens(),
            sensor=camera().sensor,
            stop_to_microlenses=100.0,
            microlenses=camera().microlenses,
            microlenses_to_sensor=1.7,
            pose=None,
            wavelength=wave,
        ),
        "camera.moved": call(camera().moved, part=pl.CameraPart.SENSOR, shift=(0.01, 0.0, 0.0), tilt=(0.0, 0.001, 0.0)),
        "posed": call(camera().posed, position=(0.0, 0.0, 100.0), look_at=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)),
        "focused_at": call(camera().focused_at, z=z, criterion=pl.FocusCriterion.PARAXIAL, microlens_type=0),
        "design_camera": call(
            pl.design_camera, lens=lens(), sensor=camera().sensor, kind=pl.CameraKind.PLENOPTIC_1, z=z, pitch=0.2
        ),
        "project": call(pl.project, camera=camera(), points=[[0.0, 0.0, z]], rays=64, threads=1),
        "point_spread": call(
            pl.point_spread, camera=camera(), points=[[0.0, 0.0, z]], rays=64, seed=1, replicates=4, threads=1
        ),
        "landing_points": call(
            pl.camera.landing_points, camera=camera(), points=[[0.0, 0.0, z]], rays=64, seed=1, threads=1
        ),
        "microlens_centres": call(pl.microlens_centres, camera=camera(), method=pl.CentreMethod.CHIEF_RAY, margin=1.0),
        "as_built": call(pl.camera.as_built, camera=camera()),
        "report": call(pl.camera.camera_report, camera=camera()),
        "render": call(pl.render, scene=scene(), camera=camera(), **full),
        "render.target": call(
            pl.render, scene=scene(), camera=camera(), samples=16, target_error=0.5, time_limit=1.0, progress=False
        ),
        "render_white": call(pl.render_white, camera=camera(), **quick),
        "ground_truth": call(
            pl.ground_truth, scene=scene(), camera=camera(), truth=pl.Truth.DEPTH, region=quick["region"], threads=1
        ),
        "warm_up": call(pl.warm_up, scene=None, camera=camera(), truth=pl.Truth.DEPTH, progress=False),
        "estimate": call(
            pl.estimate, scene=scene(), camera=camera(), samples=4, target_error=0.5, threads=1, progress=False
        ),
        "Diffraction": call(pl.Diffraction, iris=True),
        "Motion": call(pl.Motion, times=(0.0, 1.0), poses=[pl.Pose(np.eye(3), (x, 0.0, 0.0)) for x in (0.0, 1.0)]),
        "Sequence": call(pl.Sequence, scene=scene(), camera=camera(), times=(0.0, 1.0)),
        "plan": call(pl.plan, scene=scene(), camera=camera(), samples=4, replicates=2, max_bounces=2, clamp=1.0),
        "replay": call(pl.replay, exposure=shot(), scene=None, pixel=(3, 4), sample=2),
        "replay_all": call(pl.replaying.replay_all, exposure=shot(), scene=None, paths=[(3, 4, 2)]),
        "Exposure": call(
            pl.Exposure,
            image=np.ones((2, 3, 1)),
            standard_error=np.ones((2, 3, 1)),
            samples=4,
            replicates=2,
            seed=0,
            region=(0, 2, 0, 3),
            sample_counts=np.full((2, 3), 4),
        ),
        "develop": call(shot().develop, sensor=grey, seed=1),
        "SensorModel": call(
            pl.SensorModel,
            photon_rate=1000.0,
            exposure_time=1.0,
            quantum_efficiency=0.5,
            gain=1.0,
            black_level=10.0,
            bits=12,
            full_well=1e4,
        ),
        "RawImage": call(sensor.RawImage, data=np.ones((2, 3), np.uint16), model=grey, seed=1, samples=3),
        "photon_transfer": call(
            pl.sensor.photon_transfer, model=grey, levels=[1.0, 2.0], shape=(8, 8), channel=0, seed=0
        ),
        "photon_rate": call(sensor.photon_rate, radiance=1.0, pixel_pitch=0.01, wavelength=wave),
        "dark_current_at": call(
            sensor.dark_current_at, temperature=20.0, rate=1.0, reference_temperature=10.0, doubling_temperature=7.0
        ),
        "rgb_to_spectrum": call(sensor.rgb_to_spectrum, rgb=(0.1, 0.2, 0.3), wavelengths=grid),
        "Sensitivity": call(sensor.Sensitivity, wavelengths=grid, response=np.ones((7, 3))),
        "silicon": call(pl.sensitivities.silicon, depth=0.005, band=(400.0, 700.0)),
        "colour_camera": call(
            pl.sensitivities.colour_camera, peaks=(600.0, 530.0, 460.0), widths=(75.0, 90.0, 75.0), band=(400.0, 700.0)
        ),
        "lit_pixels": call(pl.lit_pixels, image=np.ones((2, 3, 1))),
        "decode": call(lightfield.decode, shot=shot(), white=shot(), views=3, step=1.0, least_light=0.05),
        "linear_to_srgb": call(images.linear_to_srgb, linear=[0.1, 0.5]),
        "sobol_points": call(pl.sampling.sobol_points, n=5, seed=1, pixel=2, replicate=3, set_number=4),
        "fan": call(aiming.fan, n=5),
        "hexapolar": call(aiming.hexapolar, rings=3),
        "square_grid": call(aiming.square_grid, n=5),
        "aimed_rays": call(
            aiming.aimed_rays, lens=lens(), field=field, pupil=[[0.0, 0.5]], z_object=z, wavelength=wave
        ),
        "aimed_rays_reverse": call(
            aiming.aimed_rays_reverse,
            lens=lens(),
            image_point=(1.0, 0.0),
            z_image=100.0,
            pupil=[[0.0, 0.5]],
            wavelength=wave,
        ),
        "chief_ray": call(aiming.chief_ray, lens=lens(), field=field, z_object=z, wavelength=wave),
        "targets.checkerboard": call(targets.checkerboard, columns=4, rows=3, square=2.0, margin=1.0),
        "point_grid": call(targets.point_grid, columns=3, rows=2, pitch=5.0, radius=1.0, sides=8),
        "random_dots": call(targets.random_dots, columns=4, rows=3, dot=1.0, density=0.5, seed=1),
        "siemens_star": call(targets.siemens_star, radius=9.0, spokes=8, inner_radius=1.0, margin=1.0),
        "slanted_edge": call(targets.slanted_edge, size=9.0, angle_deg=5.0),
        "usaf_1951": call(targets.usaf_1951, groups=(0, 1), scale=1.0, margin=2.0),
        "Film": call(pl.rendering.Film, shape=(2, 2, 1), counts=np.array([2, 2])),
        "RenderSettings": call(pl.rendering.RenderSettings, max_bounces=3, clamp=1.0),
        "RenderStats": call(
            pl.rendering.RenderStats,
            seconds=1.0,
            paths=5,
            paths_through_lens=3,
            lost=(("clipped", 0, 2),),
            clamped=0.1,
            nonfinite_paths=((0, 1, 2),),
        ),
    }
    made |= scene_calls()
    seen = {"field": (1.0, 2.0), "z_object": z, "wavelength": wave}
    over = {"fields": [1.0, 2.0], "z_object": z, "wavelength": wave}
    for name, more in {
        "spot_diagram": seen | {"rays": 64, "seed": 1, "z_image": 110.0},
        "mtf": seen | {"frequencies": [0.0, 10.0], "rays": 64, "seed": 1},
        "point_spread": seen | {"rays": 64, "shape": (8, 8), "pixel_size": 0.01},
        "through_focus": seen | {"z": [109.0, 110.0], "rays": 64},
        "best_focus": seen | {"rays": 64, "criterion": pl.FocusCriterion.RMS_SPOT},
        "ray_fan": seen | {"points": 5},
        "coma": over | {"zone": 1.0},
        "distortion": over,
        "field_curvature": over,
        "vignetting": over | {"grid": 8},
        "relative_illumination": over | {"grid": 8},
        "depth_distortion": {"heights": [1.0], "z_image": [110.0], "wavelength": wave},
        "largest_field": {"z_object": z, "wavelength": wave},
        "seidel_sums": {"field": 1.0, "z_object": z, "wavelength": wave},
        "chromatic_shift": {"wavelengths": (486.0, 587.0), "reference": 587.0, "field": 1.0, "z_object": z},
    }.items():
        made[f"aberrations.{name}"] = (getattr(aberrations, name), {"lens": lens()} | more)
    made["diffraction_mtf"] = (aberrations.diffraction_mtf, {"frequencies": [1.0], "f_number": 4.0, "wavelength": wave})
    for name in ("cardinal_points", "conjugates", "image_position", "magnification", "marginal_ray", "object_position"):
        given = {p: z for p in inspect.signature(getattr(paraxial, name)).parameters}
        given |= {"lens": lens(), "wavelength": wave}
        made[f"paraxial.{name}"] = (getattr(paraxial, name), given)
    made["paraxial_ray"] = (paraxial.paraxial_ray, {"lens": lens(), "height": 1.0, "angle": 0.1, "wavelength": wave})
    made["working_f_number"] = (paraxial.working_f_number, {"lens": lens(), "z_object": z, "wavelength": wave})
    return made

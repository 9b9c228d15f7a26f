"""Calls of the public API with valid arguments: what fuzzing starts from."""

import ast
import functools
import inspect
import math
import re

import numpy as np

import plenoptic as pl
from plenoptic import aberrations, paraxial, sensor

CALLS = """
pl.Sensor(shape=(4, 4), pixel_pitch=0.05, pixel_aperture=(0.9, 0.8))
Sensor.centre_of: camera().sensor.centre_of(row=3, column=4)
Sensor.pixel_of: camera().sensor.pixel_of(points=[[0.0, 0.0]])
sensor.AngularResponse(well_depth=0.01, index=1.5, pupil_distance=9.0, exponent=1.0)
sensor.dual_pixel(pitch=0.05, shape=(4, 4), split=(1, 2), cra=0.1, height=0.1, gap=0.001, crosstalk=0.02)
dual_pixel.table: sensor.dual_pixel(pitch=0.05, shape=(4, 4), crosstalk=np.full((3, 3), 1 / 9),
    table=[[-0.3, 0.6, 0.2], [0.3, 0.2, 0.6]])
sensor.DualPixels(split=(2, 2), depth=2.0, gap=0.01, pupil_distance=9.0, crosstalk=0.1, table=None, well=(0, 1))
sensor.well_cameras(camera=pair().camera)
sensor.read_wells(exposures=list(pair().exposures))
sensor.pair_geometry(camera=pair().camera)
PairGeometry.disparity: geometry().disparity(depth=[400.0], region=(2, 6, 0, 4))
PairGeometry.depth: geometry().depth(disparity=[0.5], region=(2, 6, 0, 4))
PairGeometry.defocus: geometry().defocus(depth=400.0)
PairGeometry.asymmetry: geometry().asymmetry(region=(2, 6, 0, 4))
PairGeometry.blur: geometry().blur(disparity=0.5)
depth.pair: lightfield.depth(image=pair(), disparity_range=(-1.0, 1.0), window_radius=1)
pl.Pose(rotation=np.eye(3), position=(0.0, 0.0, 5.0))
Pose.look_at: pl.Pose.look_at(position=(0, 0, 9.0), target=(0, 0, 0.0), up=(0.0, 1, 0))
pl.Pose(np.eye(3), (0, 0, 0)).to_world(points=square)
pl.Pose(np.eye(3), (0, 0, 0)).to_camera(points=square)
pl.CircularStop(semi_diameter=5.0, thickness=1.0)
pl.PolygonStop(blades=6, semi_diameter=5.0, rotation=0.1, thickness=1.0, blade_radius=8.0)
pl.StarStop(points=5, semi_diameter=5.0, inner_semi_diameter=2.0, rotation=0.1)
optics.MaskStop(transmission=[[0.0, 1.0], [0.5, 1.0]], semi_diameter=5.0, thickness=1.0)
optics.MaskStop.of_cells(transmission=[[0.0, 1.0]], cell_size=1.0, thickness=1.0)
pl.PolygonStop(6, 5.0).outline(n=64)
pl.PolygonStop(6, 5.0).image(scale=2.0)
pl.PolygonStop(6, 5.0).contains(x=[1.0], y=[2.0])
pl.StarStop(6, 5.0, 2.0).transmission_at(x=[1.0], y=[2.0])
pl.Surface(radius=50.0, thickness=3.0, medium=optics.AIR, semi_diameter=9.0, conic=-0.5, aspheric=[0.0, 1e-07])
Surface.flat: pl.Surface(radius=math.inf, thickness=3.0, semi_diameter=9.0, aspheric=[0.0001])
Surface.zernike: pl.Surface(radius=50.0, thickness=3.0, semi_diameter=9.0, freeform=optics.ZernikeSag([0.0, 0.001],
    10.0))
pl.Surface(50.0, semi_diameter=9.0).sag(r=[1.0, 2.0], y=[0.0, 1.0])
pl.Surface(50.0, semi_diameter=9.0).slope(r=[1.0, 2.0])
pl.Surface(50.0, semi_diameter=9.0).gradient(x=[1.0, 2.0], y=[0.0, 1.0])
Surface.biconic: pl.Surface(radius=math.inf, thickness=3.0, semi_diameter=9.0, freeform=optics.BiconicSag(50.0, -90.0))
optics.BiconicSag(radius_x=math.inf, radius_y=20.0, conic_x=0.5, conic_y=-1.0)
optics.OddPowerSag(coefficients=[1e-05, 0.0, 1e-09])
optics.ZernikeSag(coefficients=[0.0, 0.0, 0.001], norm_radius=10.0)
optics.Placement(shift=(0.1, 0.0, 0.0), rotation=np.eye(3))
pl.LensStack(elements=list(lens().elements), iris=lens().iris, name="a", model=pl.LensModel.EXACT)
LensStack.media: pl.LensStack(elements=lens().elements, front_medium=optics.AIR, rear_medium=optics.AIR)
optics.window(lens=lens(), thickness=5.0, medium=pl.glass("N-BK7"), distance=20.0, tilt=(0.1, 0.0),
    outside=pl.glass("water"), semi_diameter=60.0)
Window.dome: optics.window(lens=lens(), thickness=5.0, medium=pl.glass("N-BK7"), radius=120.0)
optics.coated(lens=lens(), coating=optics.SingleLayer())
optics.SingleLayer(medium=pl.glass("MgF2"), wavelength=550.0)
optics.Coating(layers=[(pl.glass("MgF2"), 100.0)])
optics.Reflectance(reflectance=[[0.1, 0.2]], wavelengths=[500.0], angles=[0.0, 0.5])
optics.FilmMaterial(index=[1.4, 1.5], extinction=[0.0, 0.1], wavelengths=[400.0, 700.0])
optics.FilmMaterial(1.4).complex_index(wavelength=wave)
optics.AbsorbingGlass(medium=pl.glass("N-BK7"), wavelengths=[400.0, 700.0], transmittance=[0.9, 0.99], thickness=10.0)
optics.AbsorbingGlass(optics.AIR, [400.0, 700.0], [0.9, 0.9]).internal_transmittance(wavelength=wave, thickness=5.0)
optics.surface_powers(coating=optics.SingleLayer(), n_from=1.0, n_to=[1.5, 1.6], cosine=0.9, wavelength=wave)
LensStack.transmission: lens().transmission(field=0.1, wavelength=wave)
aberrations.transmission(lens=lens(), fields=[0.0, 0.1], z_object=-400.0, wavelength=wave, grid=16)
Surface.coated: pl.Surface(radius=50.0, semi_diameter=9.0, coating=optics.Coating([(optics.AIR, 100.0)]))
lens().moved(which=1, shift=(0.1, 0.0, 0.0), tilt=(0.01, 0.0, 0.0), pivot=2.0)
lens().with_stop(stop=pl.CircularStop(3.0))
lens().with_model(model=pl.LensModel.THIN)
lens().scaled(0.5)
lens().scaled(focal_length=50.0)
lens().inserted(stop=pl.CircularStop(3.0), z=30.0)
lens().profiles(points=5)
lens().indices(wavelength=wave)
lens().check(wavelength=wave)
lens().trace(rays=rays(), threads=1)
pl.RayBundle(origin=square - [0, 0, 50.0], direction=square * 0 + [0, 0, 1.0], wavelength=wave, weight=np.ones(3))
RayBundle.at: rays().at(distance=[1.0, 2.0])
RayBundle.at_z: rays().at_z(z=1.0)
RayBundle.selected: rays().selected(mask=[True, False])
pl.optics.conditioning(lens=lens(), rays=rays(), reverse=False)
pl.no_lens(semi_diameter=5.0)
pl.load_camera(name="raytrix-r12-like")
pl.camera.published_camera(name="raytrix-r12-like")
pl.ConstantMedium(refractive_index=1.5)
pl.ModelGlass(nd=1.5, vd=60.0, name="x")
pl.Sellmeier(b=(1.0, 0.2, 1.0), c=(0.006, 0.02, 100.0), wavelength_range=(365.0, 2325.0))
optics.Air(temperature=20.0, pressure=101.0, humidity=0.5, co2=450.0)
pl.glass("N-BK7").index(wavelength=wave)
pl.glass(name="N-BK7")
optics.abbe_number(medium=pl.glass("N-BK7"))
pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0, 3.0), lattice=pl.Lattice.SQUARE, thickness=0.1, index=1.5,
    pattern=[[0, 1]], extent=(3.0, 2.0))
MicrolensArray.free: pl.MicrolensArray(pitch=0.2, focal_lengths=(2.0,), lattice=pl.Lattice.FREE, centres=[[0.0, 0.0],
    [0.2, 0.0]], types=[0, 0])
MicrolensArray.model: pl.MicrolensArray(pitch=(0.2, 0.3), focal_lengths=2.0, lattice=pl.Lattice.RECTANGULAR,
    model=optics.MicrolensModel.SPHERICAL, thickness=0.1, index=1.6)
optics.MicrolensAperture(shape=optics.ApertureShape.CIRCLE, fill_factor=0.7, gaps=optics.Gaps.OPAQUE)
camera().microlenses.lenses(low=(-1.0, -1.0), high=(1.0, 1.0))
camera().microlenses.nearest(points=[[0.0, 0.0]])
pl.MicrolensImperfections(pitch_jitter=0.001, decentre=0.001, focal_length_spread=0.01, missing=0.1, dark=0.1, seed=3)
optics.MicrolensDeviations(index=[[0, 0]], shift=[[0.001, 0.0]], decentre=[[0.0, 0.0]], transmission=[0.5])
pl.MicrolensImperfections(0.001).deviations(index=[[0, 0], [1, 2]])
pl.Blemishes(site=pl.BlemishSite.SENSOR, start=[[0.0, 0.0]], end=[[0.1, 0.0]], radius=[0.01], transmission=[0.5],
    height=0.1)
pl.Blemishes.scattered(site=pl.BlemishSite.SENSOR, half_size=(0.5, 0.5), dust_per_mm2=10.0, dust_radius=0.005,
    dust_spread=0.5, scratches=2, scratch_length=0.1, scratch_width=0.01, seed=1)
pl.PlenopticCamera(lens=lens(), sensor=camera().sensor, stop_to_microlenses=100.0, microlenses=camera().microlenses,
    microlenses_to_sensor=1.7, pose=None, wavelength=wave)
camera.moved: camera().moved(part=pl.CameraPart.SENSOR, shift=(0.01, 0.0, 0.0), tilt=(0.0, 0.001, 0.0))
camera().posed(position=(0.0, 0.0, 100.0), look_at=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
camera().focused_at(z=z, criterion=pl.FocusCriterion.PARAXIAL, microlens_type=0)
pl.design_camera(lens=lens(), sensor=camera().sensor, kind=pl.CameraKind.PLENOPTIC_1, z=z, pitch=0.2)
pl.project(camera=camera(), points=[[0.0, 0.0, z]], rays=64, threads=1)
pl.point_spread(camera=camera(), points=[[0.0, 0.0, z]], rays=64, seed=1, replicates=4, threads=1)
pl.rendering.point_weights(points=pl.Points([[0.0, 0.0, z]], intensity=1.0), camera=camera(), rays=64,
    target_error=0.1, seed=1, threads=1)
pl.camera.landing_points(camera=camera(), points=[[0.0, 0.0, z]], rays=64, seed=1, threads=1)
pl.microlens_centres(camera=camera(), method=pl.CentreMethod.CHIEF_RAY, margin=1.0)
pl.camera.as_built(camera=camera())
report: pl.camera.camera_report(camera=camera())
pl.render(scene=scene(), camera=camera(), **full)
render.target: pl.render(scene=scene(), camera=camera(), samples=16, target_error=0.5, time_limit=1.0, progress=False)
pl.render_white(camera=camera(), **quick)
pl.ground_truth(scene=scene(), camera=camera(), truth=pl.Truth.DEPTH, region=quick["region"], threads=1)
pl.warm_up(scene=None, camera=camera(), truth=pl.Truth.DEPTH, depth=False, progress=False)
pl.estimate(scene=scene(), camera=camera(), samples=4, target_error=0.5, ghosts=pl.rendering.Ghosts(samples=2),
    threads=1, progress=False)
pl.Diffraction(iris=True)
pl.Motion(times=(0.0, 1.0), poses=[pl.Pose(np.eye(3), (x, 0.0, 0.0)) for x in (0.0, 1.0)])
pl.Sequence(scene=scene(), camera=camera(), times=(0.0, 1.0))
pl.plan(scene=scene(), camera=camera(), samples=4, replicates=2, max_bounces=2, clamp=1.0)
pl.replay(exposure=shot(), scene=None, pixel=(3, 4), sample=2)
pl.replaying.replay_all(exposure=shot(), scene=None, paths=[(3, 4, 2)])
pl.Exposure(image=np.ones((2, 3, 1)), standard_error=np.ones((2, 3, 1)), samples=4, replicates=2, seed=0, region=(0, 2,
    0, 3), sample_counts=np.full((2, 3), 4))
shot().develop(sensor=grey, seed=1)
pl.SensorModel(photon_rate=1000.0, exposure_time=1.0, quantum_efficiency=0.5, gain=1.0, black_level=10.0, bits=12,
    full_well=10000.0)
sensor.RawImage(data=np.ones((2, 3), np.uint16), model=grey, seed=1, samples=3)
pl.sensor.photon_transfer(model=grey, levels=[1.0, 2.0], shape=(8, 8), channel=0, seed=0)
sensor.silicon_reflectance(wavelength=wave)
sensor.photon_rate(radiance=1.0, pixel_pitch=0.01, wavelength=wave)
sensor.dark_current_at(temperature=20.0, rate=1.0, reference_temperature=10.0, doubling_temperature=7.0)
sensor.rgb_to_spectrum(rgb=(0.1, 0.2, 0.3), wavelengths=grid)
sensor.Sensitivity(wavelengths=grid, response=np.ones((7, 3)))
pl.sensitivities.silicon(depth=0.005, band=(400.0, 700.0))
pl.sensitivities.colour_camera(peaks=(600.0, 530.0, 460.0), widths=(75.0, 90.0, 75.0), band=(400.0, 700.0))
pl.lit_pixels(image=np.ones((2, 3, 1)))
lightfield.decode(shot=shot(), white=shot(), views=3, step=1.0, least_light=0.05)
images.linear_to_srgb(linear=[0.1, 0.5])
pl.sampling.sobol_points(n=5, seed=1, pixel=2, replicate=3, set_number=4)
aiming.fan(n=5)
aiming.hexapolar(rings=3)
aiming.square_grid(n=5)
aiming.aimed_rays(lens=lens(), field=field, pupil=[[0.0, 0.5]], z_object=z, wavelength=wave)
aiming.aimed_rays_reverse(lens=lens(), image_point=(1.0, 0.0), z_image=100.0, pupil=[[0.0, 0.5]], wavelength=wave)
aiming.chief_ray(lens=lens(), field=field, z_object=z, wavelength=wave)
targets.checkerboard: targets.checkerboard(columns=4, rows=3, square=2.0, margin=1.0)
targets.marked_checkerboard(columns=5, rows=4, square=2.0, margin=1.0)
targets.point_grid(columns=3, rows=2, pitch=5.0, radius=1.0, sides=8)
targets.random_dots(columns=4, rows=3, dot=1.0, density=0.5, seed=1)
targets.siemens_star(radius=9.0, spokes=8, inner_radius=1.0, margin=1.0)
targets.slanted_edge(size=9.0, angle_deg=5.0)
targets.usaf_1951(groups=(0, 1), scale=1.0, margin=2.0)
pl.rendering.Film(shape=(2, 2, 1), counts=np.array([2, 2]))
pl.rendering.RenderSettings(max_bounces=3, clamp=1.0)
pl.rendering.Ghosts(orders=2, sensor=0.3, array=0.04, samples=4)
pl.rendering.RenderStats(seconds=1.0, paths=5, paths_through_lens=3, lost=(("clipped", 0, 2),), clamped=0.1,
    nonfinite_paths=((0, 1, 2),))
pl.box(size=(1.0, 2.0, 3.0), center=(0.0, 0.0, 0.0))
pl.sphere(radius=2.0, center=(0.0, 0.0, 0.0), segments=(8, 4), material=pl.Lambertian())
pl.quad(corner=(0.0, 0, 0), edge_u=(1.0, 0, 0), edge_v=(0, 1.0, 0))
pl.shapes.turned(profile=[[1.0, 0.0], [0.0, 2.0]], segments=8)
pl.checkerboard(size=(4.0, 4.0), square=1.0, offset=(0.1, 0.2))
pl.Mesh(vertices=square, faces=[[0, 1, 2]], normals=square * 0 + [0, 0, 1.0], uv=square[:, :2], name="m")
mesh.transformed(matrix=eye)
mesh.translated(x=1.0, y=2.0, z=3.0)
mesh.rotated(axis=(0.0, 0.0, 1.0), angle=0.5)
mesh.rotated_deg(axis=(0.0, 0.0, 1.0), angle_deg=5.0)
mesh.scaled(factor=2.0)
pl.scene.Instances(mesh=mesh, matrices=np.tile(eye, (2, 1, 1)))
pl.scene.View(name="v", position=(0.0, 0, 0), look_at=(0.0, 0, -1), up=(0.0, 1, 0), vertical_field_of_view=0.5,
    aspect_ratio=1.5)
pl.Scene(meshes=[mesh], lights=[lights.PointLight((0, 0, 9))], background=(0.1, 0.2, 0.3))
Scene.medium: pl.Scene(meshes=[mesh], medium=materials.Medium(scattering=0.1))
Scene.transformed: pl.Scene([mesh], [lights.PointLight((0, 0, 9))]).transformed(matrix=eye)
scene().with_lights(lights=[lights.PointLight((0, 0, 9))])
scene().merged(other=scene())
pl.Lambertian(albedo=(0.1, 0.2, 0.3))
materials.RoughDiffuse(albedo=0.5, roughness=0.4)
pl.Conductor(reflectance=0.9, alpha=0.2)
Conductor.index: pl.Conductor(alpha=0.2, index=(1.0 + 2j, 0.5 + 2j, 0.2 + 3j))
pl.Dielectric(index=1.5, alpha=0.1, absorption=0.01, exterior=1.0)
materials.Medium(absorption=(0.1, 0.2, 0.3), scattering=0.1, phase=materials.HenyeyGreenstein(0.5))
materials.HenyeyGreenstein(g=0.5)
materials.fog(visibility=1e4, g=0.8)
materials.jerlov_water(water_type="1C")
materials.ThinGlass(index=1.5, transmittance=0.9)
pl.Emissive(radiance=2.0, two_sided=False)
pl.MetallicRoughness(base=0.5, metallic=0.2, roughness=0.4, emission=0.1, opacity=0.9, cutoff=0.5)
pl.Texture(texels=texels)
bsdf.evaluate: bsdf.evaluate(material=pl.Lambertian(), to_viewer=(0.0, 0, 1.0), to_light=[[0.0, 0.6, 0.8]])
bsdf.draw: bsdf.draw(material=pl.Lambertian(), to_viewer=(0.0, 0, 1.0), points=[[0.1, 0.2, 0.3]])
lights.PointLight(position=(0.0, 0, 0), intensity=100.0)
pl.Points(positions=[[0.0, 0, z]], intensity=[2.0], diameter=0.1)
Points.sheet: pl.Points(positions=[[0.0, 0, z]], sheet=sheet, cross_section=0.1, phase=[[0.0, 0.1], [3.0, 0.1]])
pl.Points([[0.0, 0, z]], intensity=1.0).moved(velocity=(1.0, 0, 0), dt=0.1)
pl.Points([[0.0, 0, z]], intensity=1.0).under(matrix=eye)
lights.Sheet(position=(0.0, 0, z), direction=(1.0, 0, 0), normal=(0.0, 0, 1.0), thickness=1.0, irradiance=2.0,
    divergence=0.01, start=-50.0)
sheet.irradiance_at(points=[[0.0, 0, z]])
sheet.directions_at(points=[[0.0, 0, z]])
sheet.lengths_at(points=[[0.0, 0, z]])
lights.SphereLight(center=(0.0, 100.0, 0), radius=5.0, radiance=1.0)
lights.SpotLight(position=(0.0, 0, 0), direction=(0.0, 0, -1.0), intensity=9.0, inner_angle=0.2, outer_angle=0.5)
SpotLight.facing: lights.SpotLight.facing(position=(0.0, 0, 0), target=(0.0, 0, -1.0), intensity=9.0)
pl.QuadLight(center=(0.0, 100.0, 0), edge_u=(9.0, 0, 0), edge_v=(0, 0, 9.0), radiance=2.0)
QuadLight.facing: pl.QuadLight.facing(center=(0.0, 100.0, 0), target=(0.0, 0, -400.0), size=(9.0, 9.0))
pl.SunLight(direction=(0.0, 1.0, 1.0), irradiance=2.0, angular_radius=0.005)
pl.SunLight.from_angles(azimuth=0.1, elevation=0.5, irradiance=2.0)
pl.EnvironmentMap(texels=texels, rotation=np.eye(3))
pl.EnvironmentMap(texels).radiance(directions=[[0.0, 0.0, 1.0]])
"""
"""Name, where it is not the function's, function and arguments; what is indented goes on."""


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
def pair():
    dual = pl.PlenopticCamera(lens(), sensor.dual_pixel(0.05, (16, 16), crosstalk=0.02), 134.0)
    shots = [pl.render_white(each, samples=4, progress=False, threads=1) for each in sensor.well_cameras(dual)]
    return sensor.read_wells(shots)


@functools.cache
def geometry():
    return sensor.pair_geometry(pair().camera)


@functools.cache
def rays():
    return pl.RayBundle(np.array([[0, 0, -50.0], [0, 1, -50.0]]), np.array([[0, 0, 1.0], [0, 0, 1.0]]))


@functools.cache
def scene():
    return pl.Scene([pl.box(50.0).translated(z=-400.0)], [pl.lights.PointLight((0, 100, 0), 1e4)], background=0.1)


def calls():
    """Name, function and valid arguments of each call."""
    z, wave, field = -400.0, 550.0, (0.01, 0.02)
    quick = {"samples": 4, "region": (slice(2, 6), slice(0, 4)), "seed": 1, "replicates": 2, "threads": 1}
    quick |= {"progress": False, "sampler": pl.rendering.Sampler.SOBOL, "conditioning": 8, "tile_side": 4}
    quick |= {"time_limit": 1.0}  # samples are accepted up to billions
    full = quick | {"max_bounces": 2, "clamp": 10.0, "truth": pl.Truth.DEPTH, "caustics": pl.rendering.Caustics.INCLUDE}
    known = globals() | {"z": z, "wave": wave, "field": field, "quick": quick, "full": full}
    known |= {"square": np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]), "grid": np.linspace(400.0, 700.0, 7)}
    known |= {
        "grey": pl.SensorModel(1000.0, exposure_time=1.0),
        "mesh": pl.box(2.0),
        "sheet": pl.lights.Sheet((0, 0, -400), (1, 0, 0), (0, 0, 1), thickness=1.0),
        "eye": np.eye(4),
    }
    known |= {"texels": np.full((2, 2, 3), 0.5), "math": math}
    spaces = ("aiming", "bsdf", "images", "lightfield", "lights", "materials", "optics", "sensor", "targets")
    known |= {name: getattr(pl, name) for name in spaces}
    made = {}
    for line in re.sub(r"\n +", " ", CALLS).strip().splitlines():
        name, typed = re.match(r"(?:([\w.]+): )?(.*)", line).groups()
        call = ast.parse(typed, mode="eval").body
        name = name or ast.unparse(call.func).rpartition(".")[2]
        given = [(keyword.arg, eval(ast.unparse(keyword.value), known)) for keyword in call.keywords]
        made[name] = eval(ast.unparse(call.func), known), {}
        for argument, value in given:
            made[name][1].update({argument: value} if argument else value)
    seen = {"field": (1.0, 2.0), "z_object": z, "wavelength": wave}
    over = {"fields": [1.0, 2.0], "z_object": z, "wavelength": wave}
    for name, more in {
        "spot_diagram": seen | {"rays": 64, "seed": 1, "z_image": 110.0},
        "veiling_glare": seen | {"patch": 2.0, "z_image": 110.0, "sensor": 0.3, "rays": 64, "seed": 1},
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
    made["ghosts"] = (lens().ghosts, seen | {"z_image": 110.0, "sensor": 0.3, "rays": 64})
    made["diffraction_mtf"] = (aberrations.diffraction_mtf, {"frequencies": [1.0], "f_number": 4.0, "wavelength": wave})
    for name in ("cardinal_points", "conjugates", "image_position", "magnification", "marginal_ray", "object_position"):
        given = {p: z for p in inspect.signature(getattr(paraxial, name)).parameters}
        given |= {"lens": lens(), "wavelength": wave}
        made[f"paraxial.{name}"] = (getattr(paraxial, name), given)
    made["paraxial_ray"] = (paraxial.paraxial_ray, {"lens": lens(), "height": 1.0, "angle": 0.1, "wavelength": wave})
    made["working_f_number"] = (paraxial.working_f_number, {"lens": lens(), "z_object": z, "wavelength": wave})
    return made

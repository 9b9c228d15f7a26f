"""Mistakes of a newcomer: what is typed, and what the library says. None is silent, and each names the remedy."""

import pathlib
import pickle
import re
import warnings

import numpy as np
import pytest

import plenoptic as pl

LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
ARRAY = pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
SENSOR = pl.Sensor(shape=(32, 32), pixel_pitch=0.01)
GLASS = pl.ConstantMedium(1.5)
FRONT, BACK = pl.Surface(50.0, 4.0, GLASS, semi_diameter=12.0), pl.Surface(-50.0, semi_diameter=12.0)
WALL = pl.quad((-100, -100, -404), (200, 0, 0), (0, 200, 0))
LAMP = pl.QuadLight.facing((0, 60, -300), (0, 0, -404), (40, 40), radiance=10)
SCENE = pl.Scene([WALL], [LAMP])
SHOT = pl.Exposure(np.ones((4, 4, 3)))


def array(**changes):
    return pl.MicrolensArray(**({"pitch": 0.217, "focal_lengths": (2.0,)} | changes))


def camera(**changes):
    usual = {"lens": LENS, "sensor": SENSOR, "microlenses": ARRAY, "stop_to_microlenses": 123.3}
    return pl.PlenopticCamera(**(usual | {"microlenses_to_sensor": 1.7} | changes))


CAMERA = camera()


def render(scene=SCENE, camera=CAMERA, **settings):
    return pl.render(scene, camera, **({"samples": 8, "progress": False, "threads": 1} | settings))


def white(camera=CAMERA, **settings):
    return pl.render_white(camera, **({"samples": 8, "progress": False, "threads": 1} | settings))


def decode(**settings):
    seen = white(camera(microlenses_to_sensor=2.0))
    return pl.lightfield.decode(seen, seen, **settings)


def file(name, text="hello"):
    pathlib.Path(name).write_text(text, encoding="utf-8")
    return name


INVALID, LENS_ERROR = pl.errors.InvalidValueError, pl.errors.PrescriptionError
SCENE_ERROR, FILE = pl.errors.SceneError, pl.errors.FileError
BLACK, ODD, UNSEEN = (pl.errors.BlackImageWarning, pl.errors.ImplausibleCameraWarning, pl.errors.UnseenSceneWarning)
ODD_SCENE, BALL = pl.errors.ImplausibleSceneWarning, pl.sphere(20.0)
TURNED = pl.Mesh(BALL.vertices, BALL.faces[:, ::-1], pl.Dielectric(1.5))
SMALL_BALL, LARGE_BALL = (pl.Mesh(size * BALL.vertices, BALL.faces) for size in (1e-5, 1e3))

MISTAKES = [
    ("pl.Surface(0, semi_diameter=5.0)", LENS_ERROR, "for a plane use math.inf"),
    ('pl.Surface("inf", semi_diameter=5.0)', LENS_ERROR, "math.inf for a plane"),
    ("pl.Surface(51.68, 4.0, 1.5168, semi_diameter=12.0)", LENS_ERROR, "pl.ConstantMedium(1.5)"),
    ('pl.Surface(51.68, 4.0, "BK7", semi_diameter=12.0)', LENS_ERROR, 'pl.glass("N-BK7")'),
    ("pl.Surface(51.68, -4.0, GLASS, semi_diameter=12.0)", LENS_ERROR, "in the order of the light path"),
    ("pl.Surface(10.0, 4.0, GLASS, semi_diameter=12.0)", LENS_ERROR, "reduce it to 10 or less"),
    ("pl.Surface(51.68, semi_diameter=12.0, aspheric=1e-8)", LENS_ERROR, "a sequence of coefficients, of r^2 first"),
    ('pl.glass("N-BK77")', INVALID, "near to it are N-BK7"),
    ("pl.ModelGlass(64.2, 1.5168)", INVALID, "give the index first and the Abbe number second"),
    ("pl.ConstantMedium(0.0)", INVALID, "use 1 or more"),
    ("pl.LensStack([FRONT, BACK])", LENS_ERROR, "no stop; add one"),
    ("pl.LensStack([pl.CircularStop(5.0)])", LENS_ERROR, "add at least one Surface"),
    ("pl.LensStack([pl.CircularStop(5.0), FRONT])", LENS_ERROR, "its medium must be pl.optics.AIR"),
    ("pl.LensStack([pl.CircularStop(5.0), FRONT, BACK], iris=1)", LENS_ERROR, "the stops are elements [0]"),
    ("pl.LensStack(FRONT)", LENS_ERROR, "it must be a sequence of surfaces and stops"),
    ("pl.LensStack([(50.0, 4.0, 1.5), pl.CircularStop(5.0)])", LENS_ERROR, "describe it as one of these"),
    ('pl.LensStack([pl.CircularStop(5.0), FRONT, BACK], model="thin")', INVALID, "LensModel.THIN"),
    ("LENS.with_stop(5.0)", LENS_ERROR, "such as a CircularStop"),
    ("pl.RayBundle([0, 0, -100], [0, 0, 1])", INVALID, "origin has shape (3,); it must have shape (n, 3)"),
    ("pl.paraxial.cardinal_points(LENS, 0.5876)", INVALID, "choose one inside, in nanometres"),
    ("pl.aberrations.spot_diagram(LENS, field=20)", INVALID, "give radians"),
    ("pl.aberrations.spot_diagram(LENS, field=0.9)", pl.errors.PlenopticWarning, "(rad, not degrees)"),
    ("pl.aberrations.mtf(LENS, frequencies=[-1])", INVALID, "give cycles per mm"),
    ("pl.CircularStop(0)", INVALID, "semi_diameter is 0 mm; it must be above 0"),
    ('pl.CircularStop("5 mm")', INVALID, "semi_diameter is '5 mm'; it must be a number"),
    ("pl.PolygonStop(semi_diameter=5.0, blades=2)", INVALID, "blades is 2; it must be at least 3"),
    ("pl.PolygonStop(semi_diameter=5.0, blades=6, rotation=30)", INVALID, "give radians, such as math.radians(30)"),
    ("pl.StarStop(semi_diameter=5.0, points=5, inner_semi_diameter=6.0)", INVALID, "reduce it, or use a PolygonStop"),
    ("pl.optics.MaskStop(np.full((8, 8), 255), semi_diameter=5.0)", INVALID, "from 0, opaque, to 1, clear: scale it"),
    ("array(pitch=0)", INVALID, "pitch is 0 mm; it must be above 0"),
    ("array(pitch=(0.2, 0.2))", INVALID, "give one number in mm"),
    ("array(focal_lengths=(0.0,))", INVALID, "give one in mm for each type, not 0"),
    ("array(lattice=pl.optics.MicrolensModel.THIN)", INVALID, "it must be Lattice.HEXAGONAL or"),
    ("array(lattice=pl.Lattice.RECTANGULAR)", INVALID, "needs two in mm"),
    ("array(lattice=pl.Lattice.FREE)", INVALID, "give centres, an (n, 2) array in mm"),
    ("array(centres=np.zeros((3, 2)))", INVALID, "leave it out"),
    ("array(focal_lengths=(2.0, 2.4), pattern=[[0, 2]])", INVALID, "types outside 0 to 1; give each a focal length"),
    ("array(model=pl.optics.MicrolensModel.SPHERICAL, focal_lengths=(0.1,))", INVALID, "increase the focal length"),
    ("pl.Sensor(shape=512, pixel_pitch=0.01)", INVALID, "it must be (rows, columns)"),
    ("pl.Sensor(shape=(32, 32), pixel_pitch=0)", INVALID, "pixel_pitch is 0 mm; it must be above 0"),
    ("pl.Sensor(shape=(32, 32), pixel_pitch=0.01, pixel_aperture=80)", INVALID, "(width, height) over the pitch"),
    ("camera(stop_to_microlenses=0.1233)", INVALID, "so it must be above 30.31; 0.1233 looks like metres: give 123.3"),
    ("camera(microlenses_to_sensor=-1.7)", INVALID, "where the sensor touches the array"),
    ("camera(microlenses=None)", INVALID, "give the distance from stop to sensor as stop_to_microlenses"),
    ("camera(wavelength=0.5876)", INVALID, "wavelengths are in nanometres"),
    ("camera(pose=np.eye(4))", INVALID, "it must be a Pose or None"),
    ('CAMERA.moved("sensor", shift=(1, 0, 0))', INVALID, "CameraPart.SENSOR"),
    ("CAMERA.moved(pl.CameraPart.SENSOR, tilt=(2, 0, 0))", LENS_ERROR, "give radians, such as math.radians(2.0)"),
    ("CAMERA.moved(pl.CameraPart.SENSOR, tilt=(0, 0, 90))", INVALID, "give radians, such as math.radians(90)"),
    ("CAMERA.focused_at(404.0)", INVALID, "the plane must lie in front of the camera, at z below 0"),
    ("CAMERA.focused_at(-0.404)", INVALID, "front focus at z = -88.015 mm; -0.404 looks like metres: give -404"),
    ("CAMERA.focused_at(-80)", INVALID, "it must lie beyond the front focus at z = -88.015 mm"),
    ("CAMERA.posed((0, 0, 0), (0, 0, 0))", INVALID, "give distinct finite points"),
    ("CAMERA.posed((0, 500, 0), (0, 0, 0))", INVALID, "lies along the view; choose another direction"),
    ("pl.Pose(np.diag([1, 1, -1]), (0, 0, 0))", INVALID, "scaling and mirroring belong to the scene"),
    ("pl.design_camera(LENS, sensor=SENSOR, kind=pl.CameraKind.GALILEAN, z=-404.0)", INVALID, "too few; give 2 more"),
    ("white(camera(sensor=pl.Sensor((32, 32), 1e-5)))", ODD, "give it in mm, as 0.005 for 5 micrometres"),
    ("white(camera(microlenses=array(pitch=2.17e-7)))", INVALID, "check the units"),
    ("pl.Scene()", SCENE_ERROR, "give it at least one of them"),
    ("pl.Scene(WALL)", INVALID, "it must be a sequence of Mesh or Instances, as in [item]"),
    ("pl.Scene([LAMP])", INVALID, "meshes holds QuadLight; it may hold Mesh or Instances only"),
    ('pl.Scene([WALL], background="white")', INVALID, "it must be a number"),
    ("pl.Scene([WALL], background=np.ones((4, 8, 3)))", INVALID, "give an image as pl.EnvironmentMap"),
    ("SCENE.transformed(np.eye(3))", INVALID, "it must have shape (4, 4)"),
    ("SCENE.transformed(np.diag([2, 1, 1, 1]))", SCENE_ERROR, "scale equally in all directions"),
    ("pl.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 2, 3]])", SCENE_ERROR, "it must be within 0 and 2"),
    ("pl.Mesh(np.eye(3), [[0, 1, 2]], (0.8, 0.1, 0.1))", INVALID, "it must be one of Lambertian,"),
    ("pl.Mesh(np.eye(3), [[0, 1, 2]], pl.Lambertian(pl.Texture(np.ones((2, 2, 3)))))", SCENE_ERROR, "give uv"),
    ("pl.quad((0, 0, 0), (1, 0, 0), (2, 0, 0))", SCENE_ERROR, "spread the vertices or leave the mesh out"),
    ("pl.box((1, 2))", INVALID, "it must be one edge or (x, y, z) in mm"),
    ("pl.Lambertian((255, 0, 0))", SCENE_ERROR, "it must be within 0 and 1"),
    ("pl.Lambertian((0.8, 0.1, 0.1, 1.0))", INVALID, "it must be one number or (red, green, blue)"),
    ('pl.Texture("wood.png")', INVALID, "use Texture.load for files"),
    ("pl.Texture(np.ones((4, 4)))", INVALID, "(rows, columns, channels): give texels[..., np.newaxis], which has one"),
    ("pl.Texture(np.full((4, 4, 3), 128, dtype=np.uint8))", INVALID, "use Texture.from_image for image codes"),
    ("pl.Emissive(-1.0)", SCENE_ERROR, "it must be 0 or more"),
    ("pl.EnvironmentMap(np.ones((8, 8)))", INVALID, "it must have shape (rows, columns, channels)"),
    ("pl.QuadLight((0, 0, 0), 40, 40)", INVALID, "edge_u has shape (); it must have shape (3,)"),
    ("pl.QuadLight.facing((0, 60, 0), (0, 0, 0), 40)", SCENE_ERROR, "it must be (width, height) in mm"),
    ("pl.lights.SpotLight((0, 9, -404), (0, -1, 0), outer_angle=30)", INVALID, "it must be above 0 and at most pi"),
    ("pl.SunLight.from_angles(0, 45)", INVALID, "45 rad; it must be within -pi/2 and pi/2"),
    ("pl.SunLight.from_angles(180, 0.5)", INVALID, "give radians, such as math.radians(180)"),
    ("pl.Exposure.merged(None)", INVALID, "parts is a NoneType"),
    ('SHOT.save("a.exr", scale="large")', INVALID, "scale is 'large', but .exr"),
    ('SHOT.develop(pl.SensorModel(100.0)).demosaic(white_balance="warm")', INVALID, "white_balance"),
    ('LENS.layout(z_image="sensor")', INVALID, "z_image is 'sensor'"),
    ("pl.plots.plot_lens(LENS, 3)", INVALID, "ax is an int"),
    ('pl.Texture.load(file("a.png"), limits=3)', INVALID, "limits is an int"),
    ('pl.export.plenpy("folder", None, None)', INVALID, "white is a NoneType"),
    ("pl.aberrations.colour_sums(None, field=0.1)", INVALID, "lens is a NoneType"),
    ("pl.paraxial.lagrange_invariant(LENS, LENS)", INVALID, "marginal is a LensStack"),
    ("pl.package.CalibrationPoints.from_csv(None)", INVALID, "text is a NoneType"),
    ("pl.optics.bundled_glasses(np.ones(2))", INVALID, "it must be one of"),
    ("pl.lightfield.plane_sweep(None, 0, 1)", INVALID, "stack is a NoneType"),
    ("pl.lightfield.semi_global(np.ones(3), np.ones(3))", INVALID, "cost has 1 axes"),
    ("render(pl.Scene([WALL]))", BLACK, "give it lights=[...]"),
    ("render(pl.Scene([SMALL_BALL.translated(z=-404)], [LAMP]))", BLACK, 'its numbers: pl.Scene.load(path, unit="m")'),
    ("render(pl.Scene([BALL], [LAMP]))", BLACK, "is inside of the lens or behind it; move it"),
    ("render(pl.Scene([LARGE_BALL], background=1.0))", ODD_SCENE, 'its numbers: pl.Scene.load(path, unit="mm")'),
    ("render(pl.Scene([TURNED], background=1.0))", ODD_SCENE, "the faces of the glass Mesh 0 wind inwards; turn them"),
    (
        "render(pl.Scene([WALL], [pl.lights.PointLight((0, 0, -500), 1e5)]))",
        BLACK,
        "PointLight 0 shines from behind them",
    ),
    ("render(pl.Scene([WALL.with_material(pl.Lambertian(0))], [LAMP]))", BLACK, "give matt materials"),
    ("render(pl.Scene([WALL.scaled(0.001)], background=1.0))", UNSEEN, "between [-0.1, -0.1, -0.404] and"),
    ("render(samples=None)", INVALID, "give one of them, such as samples=64"),
    ("render(samples=64.5)", INVALID, "samples is 64.5; it must be a whole number"),
    ("render(target_error=2)", INVALID, "0.02 is 2 %"),
    ("white(samples=None, time_limit=1e-9)", pl.errors.BudgetWarning, "give more time"),
    ("render(region=(0, 8, 0, 8))", INVALID, "it must be two slices, such as np.s_[0:64, 0:64]"),
    ("render(region=np.s_[40:50, 0:8])", INVALID, "of the sensor's 32 rows it must take at least one"),
    ("render(seed=None)", INVALID, "seed is None; it must be a whole number"),
    ('render(truth="depth")', INVALID, "give a Truth, such as pl.Truth.DEPTH | pl.Truth.NORMAL"),
    ("render(truth=pl.Truth.DEPTH + pl.Truth.NORMAL)", INVALID, "pl.Truth.DEPTH | pl.Truth.NORMAL"),
    ("pl.render(CAMERA, SCENE, samples=8)", INVALID, "scene is a PlenopticCamera; it must be a Scene"),
    ('render(checkpoint="nowhere/state.ckpt")', FILE, "does not exist; make it first"),
    ("pl.ground_truth(CAMERA, SCENE)", INVALID, "scene is a PlenopticCamera; it must be a Scene"),
    ("CAMERA.project([(0, 0, 404)])", INVALID, "points must lie in front of it, at smaller z"),
    ("CAMERA.project([(0, 0, -0.404)])", INVALID, "-0.404 looks like metres: give -404, and all other lengths in mm"),
    ("CAMERA.project([(0, 0)])", INVALID, "it must have shape (n, 3)"),
    ("pl.microlens_centres(camera(microlenses=None, microlenses_to_sensor=0))", INVALID, "give it a MicrolensArray"),
    ('SHOT.save("shot.jpg")', FILE, "it must end in .exr, .zarr, .tif, .tiff or .png"),
    ('SHOT.save("shot.exr", scale=2.0)', INVALID, "leave it out"),
    ('pl.Exposure.load("missing.exr")', FILE, "does not exist; check the path"),
    ('pl.Exposure.load(file("a.exr"))', FILE, "give an image file"),
    ('pl.Scene.load(file("a.obj"))', FILE, "export a mesh"),
    ('pl.Scene.load("missing.obj", unit="inches")', INVALID, "it must be one of um, mm, cm, m, km, inch, foot"),
    ('pl.load_lens("double-gauss")', FILE, "pl.lens_names() lists them"),
    ('pl.save_lens(LENS, "lens.txt")', FILE, "give it that ending"),
    ("pl.SensorModel(photon_rate=1000, bits=32)", INVALID, "bits is 32; it must be at most 16"),
    ('pl.SensorModel(photon_rate=1000, colour_filters="RGGB")', INVALID, "it must be BayerPattern.RGGB or"),
    ("SHOT.develop(1000)", INVALID, "give a SensorModel, such as pl.SensorModel(photon_rate=1e6)"),
    ("pl.Exposure(np.ones((4, 4)))", INVALID, "it must have shape (rows, columns, channels)"),
    ("pl.lightfield.decode(white(), white())", INVALID, "use pl.lightfield.render_view(shot, white, disparity), or a"),
    ("decode(views=4)", INVALID, "it must be odd, so that one is central: take 5"),
    ("decode(views=55)", pl.errors.PlenopticWarning, "views is 55, and micro images hold 25 at this step"),
    ("pl.lightfield.refocus(SHOT, -404.0)", INVALID, "give a LightField"),
    ("pl.study.error_against_time(SCENE, CAMERA, samples=64)", INVALID, "give a sequence of whole numbers"),
    ("pl.study.error_against_time(SCENE, CAMERA, seeds=1)", INVALID, "seeds is 1; it must be at least 2"),
    ("pl.study.cost_of(SCENE)", INVALID, "give a Plan, such as pl.plan(scene, camera)"),
]
"""What is typed, the kind of error or warning, and words of it; from lenses to cameras, scenes, renders and files."""
REMEDY = re.compile(
    r"\b(must|give|use|add|take|choose|reduce|increase|close|move|turn|aim|reverse|look at|make|check|leave|list|render"
    r"|export|describe|belongs?|needs|missing|unexpected|takes|in front|lists|were they swapped"
    r"|or None|may hold|elements)\b"
)


def test_a_mistake_is_told_with_its_remedy(tmp_path, monkeypatch):
    assert len({typed for typed, _, _ in MISTAKES}) == len(MISTAKES) >= 100
    monkeypatch.chdir(tmp_path)
    for typed, kind, words in MISTAKES:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            try:
                eval(typed, globals())  # noqa: S307
            except Exception as error:
                said = [(type(error), str(error))]
            else:
                said = [(warning.category, str(warning.message)) for warning in found]
        told = [message for category, message in said if category is kind]
        assert len(told) == 1, f"{typed} said {said}"
        assert words in told[0] and REMEDY.search(told[0]), f"{typed} said {told[0]}"


def test_every_error_is_the_packages_own_and_pythons_and_survives_pickling():
    for kind, base in ((INVALID, ValueError), (LENS_ERROR, ValueError), (SCENE_ERROR, ValueError), (FILE, OSError)):
        assert issubclass(kind, pl.errors.PlenopticError) and issubclass(kind, base)
        assert str(pickle.loads(pickle.dumps(kind("radius is 0 mm")))) == "radius is 0 mm"


def test_what_is_no_path_no_flag_and_no_number_is_refused():
    for typed, kind in (
        ("pl.Exposure.load(None)", FILE),
        ("SHOT.save(5)", FILE),
        ("pl.images.read_linear(None)", FILE),
        ('pl.Emissive(1.0, two_sided="no")', INVALID),
        ("pl.QuadLight((0, 0, 0), (1, 0, 0), (0, 1, 0), two_sided=[1])", INVALID),
        ("pl.Mesh(np.eye(3), [[0, 1, 2]], name=[])", INVALID),
        ("pl.Scene(meshes=np.array(1.0))", INVALID),
        ("pl.RayBundle(np.zeros((1, 3)), [[0, 0, 1.0]], weight=[np.nan])", INVALID),
        ('array(index="x")', INVALID),
        ("array(index=None)", INVALID),
    ):
        with pytest.raises(kind):
            eval(typed)  # noqa: S307

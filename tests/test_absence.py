"""Absence is free: a kernel without a feature is the kernel that it would be without the feature's source.

Kernels are taken as source, the branches of one feature are cut out of it and of all functions that it calls, with the
arguments that they were for, and both are compiled alike. What counts is the number of machine instructions.
"""

import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
import textwrap

import numba
import numpy as np
import pytest
from numba.core.caching import NullCache

import plenoptic as pl
from plenoptic.camera.diffraction import DeflectionRecord
from plenoptic.camera.sampling.sampling_records import DeflectedSamples, KernelTable, SourcePixels
from plenoptic.core.numba.jit import device, kernel
from plenoptic.optics.diffraction.far_field import far_field
from plenoptic.optics.microlens.aperture import Opening
from plenoptic.optics.microlens.microlens_record import MICROLENS, SensorPlane
from plenoptic.scene.lights.light_records import POINT_LIGHT, SUN_LIGHT, Environment
from plenoptic.scene.materials.material_records import Alpha
from plenoptic.scene.textures.texture_records import TEXTURE, TextureColumn

TOLERANCE = 0.02
"""Of the number of instructions: registers that are assigned otherwise cost a few moves."""

UNKNOWN = object()


def _chain(node):
    """A chain of names such as lens.masks as text; None for other expressions."""
    return ast.unparse(node) if isinstance(node, ast.Name | ast.Attribute) else None


class _Cut(ast.NodeTransformer):
    """Removes what is not reached where some arguments are None, and hands on to callees which of theirs are."""

    def __init__(self, absent, scope):
        self.absent, self.scope = set(absent), scope

    def is_absent(self, node):
        """Whether an expression is one of the names that are None, or a member of one."""
        chain = _chain(node)
        return chain is not None and any(chain == name or chain.startswith(name + ".") for name in self.absent)

    def visit_Assign(self, node):
        """What is given a name is absent by that name too."""
        self.generic_visit(node)
        nothing = isinstance(node.value, ast.Constant) and node.value.value is None
        if not isinstance(node.targets[0], ast.Name):
            return node
        name, chain = node.targets[0].id, _chain(node.value)
        if nothing or self.is_absent(node.value):
            self.absent.add(name)
            return []
        self.absent |= {
            name + gone.removeprefix(chain) for gone in self.absent if chain and gone.startswith(chain + ".")
        }
        return node

    def _known(self, test):
        """The value that a condition must have, or UNKNOWN."""
        if isinstance(test, ast.Compare) and isinstance(test.ops[0], ast.Is | ast.IsNot):
            right = test.comparators[0]
            if isinstance(right, ast.Constant) and right.value is None:
                return isinstance(test.ops[0], ast.Is) if self.is_absent(test.left) else UNKNOWN
        if isinstance(test, ast.BoolOp):
            decisive = isinstance(test.op, ast.Or)
            values = [self._known(part) for part in test.values]
            if decisive in values:
                return decisive
            return UNKNOWN if UNKNOWN in values else not decisive
        return UNKNOWN

    def _rest(self, test):
        """A condition without the parts whose values are known."""
        if isinstance(test, ast.BoolOp):
            parts = [part for part in test.values if self._known(part) is UNKNOWN]
            return parts[0] if len(parts) == 1 else ast.BoolOp(test.op, parts)
        return test

    def visit_If(self, node):
        known = self._known(node.test)
        if known is not UNKNOWN:
            return self._call_tree(node.body if known else node.orelse)
        node.test = self._rest(node.test)
        return self._block(node)

    def _block(self, node):
        """Whatever holds statements."""
        for name, field in ast.iter_fields(node):
            if name in ("body", "orelse"):
                setattr(node, name, self._call_tree(field) or ([ast.Pass()] if name == "body" else []))
            elif isinstance(field, ast.AST):
                setattr(node, name, self.visit(field))
        return node

    visit_FunctionDef = visit_For = visit_While = _block

    def _call_tree(self, statements):
        """Statements up to the first that leaves: what is behind a branch that was always taken is not reached."""
        kept = []
        for statement in statements:
            made = self.visit(statement)
            kept += made if isinstance(made, list) else [made]
            if kept and isinstance(kept[-1], ast.Return | ast.Continue):
                break
        return kept

    def visit_IfExp(self, node):
        known = self._known(node.test)
        return self.generic_visit(node) if known is UNKNOWN else self.visit(node.body if known else node.orelse)

    def visit_Call(self, node):
        called = self.scope.get(node.func.id) if isinstance(node.func, ast.Name) else None
        if hasattr(called, "py_func"):
            names = list(inspect.signature(called.py_func).parameters)
            gone = {k for k, a in enumerate(node.args) if self.is_absent(a)}
            assert not any(isinstance(a, ast.Starred) for a in node.args[: max(gone, default=0)])
            within = {
                names[k] + member.removeprefix(_chain(a))
                for k, a in enumerate(node.args)
                for member in self.absent
                if _chain(a) is not None and member.startswith(_chain(a) + ".")
            }
            if gone or within:
                cut = without(called, frozenset({names[k] for k in gone} | within))
                self.scope[cut.__name__] = cut
                node.func = ast.Name(cut.__name__, ast.Load())
                node.args = [a for k, a in enumerate(node.args) if k not in gone]
        else:  # a record is made
            node.args = [ast.Constant(None) if self.is_absent(a) else a for a in node.args]
        return self.generic_visit(node)


_MADE = {}


def without(function, absent):
    """A compiled function without some of its arguments or members of these, which are None, and what they were for."""
    if (function, absent) in _MADE:
        return _MADE[function, absent]
    python = function.py_func
    tree = ast.parse(textwrap.dedent(inspect.getsource(python)))
    (definition,) = tree.body
    definition.name = f"{python.__name__}_without_{len(_MADE)}"
    definition.decorator_list = []
    definition.args.args = [argument for argument in definition.args.args if argument.arg not in absent]
    scope = dict(python.__globals__)
    cut = _Cut(absent, scope)
    made = cut.visit(tree)
    left = {_chain(node) for node in ast.walk(made) if cut.is_absent(node)}
    assert not left, f"{python.__name__} still uses {left}"
    exec(compile(ast.fix_missing_locations(made), f"<{definition.name}>", "exec"), scope)
    _MADE[function, absent] = device(scope[definition.name])
    return _MADE[function, absent]


_LABEL, _FUNCTION = re.compile(r"^(\"[^\"]*\"|[^\s:]+):"), re.compile(r"\.type\s+(\S+),\s*[@%]function")


def instructions(function, types):
    """Machine instructions of a function and of what it calls; not those of Python's and C's ways into it."""
    fresh = kernel(function.py_func)
    fresh.dispatcher._cache = NullCache()
    fresh.compile(types)
    (signature,) = fresh.signatures
    text = fresh.inspect_asm(signature)
    names = set(_FUNCTION.findall(text))
    assert names, "no function in the assembly: is it in another format?"
    bodies, inside = {}, None
    for line in text.splitlines():
        label = _LABEL.match(line)
        if label:
            name = label.group(1)
            inside = bodies.setdefault(name, []) if name in names else inside
        elif line.lstrip().startswith(".size"):
            inside = None
        elif inside is not None and line.startswith("\t") and not line.lstrip().startswith((".", "#")):
            inside.append(line)
    way_in = fresh.overloads[signature].fndesc.llvm_func_name
    reached, waiting = set(), [way_in]
    while waiting:
        name = waiting.pop()
        reached.add(name)
        mentioned = {word for line in bodies[name] for word in re.findall(r"[\w.]+", line)}
        waiting += [other for other in mentioned & set(bodies) - reached if not other.startswith("NRT_")]
    return sum(len(bodies[name]) for name in reached)


def _example(text):
    """An array of a type such as f8[:,::1]."""
    return np.empty((1,) * (text.count(",") + 1), text[:2])


COLUMN, ROWS, CUBE, BYTES = map(_example, ("f8[::1]", "f8[:,::1]", "f8[:,:,::1]", "u1[::1]"))
NUMBERS, PLACES, INDICES = map(_example, ("i8[::1]", "i4[::1]", "i8[:,::1]"))
SQUARE = Opening(0.5 * np.array([[1, -1], [1, 1], [-1, 1], [-1, -1]]))
PLANE = SensorPlane(1.0, None)
AROUND = SourcePixels(
    *(INDICES, (0, 0), _example("i4[:,::1]"), NUMBERS, INDICES, ROWS, _example("b1[:,::1]"), (0, 0), (1, 1), PLANE),
    DeflectionRecord(far_field(SQUARE, None, np.eye(2)), COLUMN, COLUMN, np.eye(2), 1.0, 8, 8),
)
BENT = {
    "deflected": DeflectedSamples(NUMBERS, NUMBERS, None),
    "illuminated.sources": AROUND,
    "illuminated.kernel": KernelTable(ROWS, ROWS, 1, 1, 1, PLANE, COLUMN, 1, 0.0, 1.0),
}
GUIDES = _example("u2[::1]"), _example("u2[:,::1]")
MAP = Environment(_example("f4[:,:,::1]"), COLUMN, ROWS, *GUIDES, ROWS, ROWS, COLUMN, 0.5, 1.0)
PICTURE = TextureColumn(PLACES, np.empty(1, TEXTURE), _example("f4[::1]"))
OWN = np.empty(1, MICROLENS)
COLOUR = {"wavelengths.number": NUMBERS, "wavelengths.basis": ROWS}
PLACED = {"hits.instance": PLACES, "geometry.instance_to_world": ROWS}
KIND = {"bsdf.kind": NUMBERS}
"""Of a material, which is `surface.kind` of a record that kernels make for functions they call."""


def _suns(record):
    return {f"{record}.suns": np.empty(1, SUN_LIGHT), f"{record}.sun_colors": ROWS}


OF_MATERIALS = [KIND | {"bsdf.metal_index": CUBE}, KIND | {"bsdf.glass_index": ROWS}]
OF_MATERIALS += [KIND | {"bsdf.pane_index": COLUMN}, KIND | {"bsdf.coupling": ROWS}, COLOUR]
MODULES = {
    "fill_camera_samples": "camera.sampling.kernels.camera_samples",
    "fill_sums": "rendering.kernels.film_sums",
    "fill_world_rays": "core.kernels.bundles",
    "fill_thin": "optics.microlens.kernels.ideal_microlenses",
    "fill_through_lens": "optics.lens.kernels.trace",
    "add_emission": "rendering.integrator.kernels.emission",
    "add_sky": "rendering.integrator.kernels.sky_emission",
    "fill_interactions": "scene.geometry.kernels.interaction",
    "fill_parameters": "scene.materials.kernels.parameters",
    "sample_emitters": "scene.lights.kernels.sample_emitters",
    "eval_direct": "rendering.integrator.kernels.direct_light",
    "sample_bsdf": "rendering.integrator.kernels.bounce",
}
FEATURES = [
    ("fill_camera_samples", {"illuminated.pixel.skew": COLUMN}),
    ("fill_camera_samples", BENT),
    ("fill_camera_samples", {"lenslets": OWN, "illuminated.regions.details": OWN}),
    ("fill_sums", {"bundle.radiance": ROWS}),
    ("fill_sums", {"bundle.waves": NUMBERS, "bundle.weights": ROWS}),
    ("fill_world_rays", {"rotation": ROWS, "position": COLUMN}),
    ("fill_thin", {"sensor.tilt": COLUMN}),
    ("fill_thin", {"lenslets": OWN}),
    ("fill_through_lens", {"lens.conic": COLUMN, "lens.aspheric": ROWS}),
    ("fill_through_lens", {"lens.frames": ROWS}),
    ("fill_through_lens", {"lens.masks": COLUMN}),
    ("add_emission", {"geometry.uv": ROWS, "emission.texture": PICTURE}),
    ("add_emission", PLACED),
    ("add_sky", _suns("sky")),
    ("add_sky", {"sky.environment": MAP}),
    ("add_emission", {"queue.rough": BYTES}),
    ("add_emission", COLOUR),
    ("add_sky", {"queue.rough": BYTES}),
    ("add_sky", COLOUR),
    ("fill_interactions", {"geometry.normals": ROWS}),
    ("fill_interactions", PLACED),
    ("fill_interactions", {"geometry.uv": ROWS}),
    ("fill_parameters", {"bsdf.roughness": COLUMN, "bsdf.metallic": COLUMN}),
    ("sample_emitters", {"lights.points": np.empty(1, POINT_LIGHT), "lights.point_colors": ROWS}),
    ("sample_emitters", _suns("lights.sky")),
    ("sample_emitters", {"lights.sky.environment": MAP}),
    ("sample_emitters", {"alpha": Alpha(COLUMN, COLUMN, None)}),
    *((kernel, features) for kernel in ("eval_direct", "sample_bsdf") for features in OF_MATERIALS),
    ("sample_bsdf", {"source": NUMBERS}),
]
"""A kernel, and its arguments or members of them that are None where nothing needs them, as they are otherwise."""

LARGE = {
    *("fill_thin: lenslets", "fill_through_lens: lens.frames", "add_sky: sky.suns, sky.sun_colors"),
    *("fill_interactions: hits.instance, geometry.instance_to_world", "eval_direct: bsdf.kind, bsdf.metal_index"),
    "sample_bsdf: bsdf.kind, bsdf.pane_index",
}
"""Features of some hundred instructions, one a kernel. Small ones may make it shorter: loops are then not unrolled."""

NEEDED = {"bundle.radiance"}
"""What the plain rendering has all the same; a white image has not."""


@pytest.fixture(scope="module")
def plain():
    """The types of arguments with which a rendering of a grey floor under a lamp and a sky calls each kernel."""
    found = {}
    patch = pytest.MonkeyPatch()

    def recorded(module, name):
        kernel = getattr(module, name)

        def record(*arguments):
            found.setdefault(name, (kernel, [numba.typeof(argument) for argument in arguments]))
            return kernel(*arguments)

        record.specialize = lambda: record
        # Those who call it may hold it by name.
        for place in [held for there, held in sys.modules.items() if there.startswith("plenoptic.")]:
            if getattr(place, name, None) is kernel:
                patch.setattr(place, name, record)

    importlib.import_module("plenoptic.rendering.tile")
    importlib.import_module("plenoptic.rendering.integrator.path")
    for name, module in MODULES.items():
        recorded(importlib.import_module(f"plenoptic.{module}"), name)
    lens, array = pl.load_lens("double-gauss-100mm-f2"), pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,))
    camera = pl.PlenopticCamera(lens, pl.Sensor((4, 4), 0.01), 123.3, array, 1.7)
    lamp = pl.QuadLight((0, 30, -360), (20, 0, 0), (0, 12, -16), radiance=3.0)
    scene = pl.Scene([pl.quad((-50, -50, -404), (100, 0, 0), (0, 100, 0))], [lamp], background=0.1)
    pl.render(scene, camera, samples=8, max_bounces=2, truth=pl.Truth.NONE, progress=False)
    patch.undo()
    return found


_COUNTS = {}


def counted(kernel, types):
    """`instructions`, kept: features of one kernel share the plain variant."""
    key = kernel, tuple(types)
    if key not in _COUNTS:
        _COUNTS[key] = instructions(kernel, tuple(types))
    return _COUNTS[key]


def types_with(name, features, plain):
    """A kernel, and the types of its arguments by name, with some of them, or of their members, changed."""
    kernel, recorded = plain[name]
    types = dict(zip(inspect.signature(kernel.py_func).parameters, recorded, strict=True))
    for member, kind in features.items():
        assert _part(types, member) == numba.none or member in NEEDED
        _set_part(types, member, kind)
    return kernel, types


def lacking(name, features, plain):
    """Instructions of a kernel with the feature's arguments None, and without their source."""
    kernel, absent = types_with(name, dict.fromkeys(features, numba.none), plain)
    made = {"surface.kind"} if "bsdf.kind" in features else set()
    cut = without(kernel, frozenset({*features, *made}))
    left = [kind for argument, kind in absent.items() if argument not in features]
    return counted(kernel, absent.values()), counted(cut, left)


def furnished(name, features, plain):
    """Instructions of a kernel with the feature."""
    kernel, present = types_with(name, {member: numba.typeof(made) for member, made in features.items()}, plain)
    return counted(kernel, present.values())


def _part(types, name):
    """The type of an argument, or of a member of it such as lens.masks."""
    argument, *members = name.split(".")
    kind = types[argument]
    for member in members:
        kind = kind.types[kind.fields.index(member)]
    return kind


def _set_part(types, name, made):
    """Give an argument, or a member of it, another type."""
    *records, member = name.split(".")
    if records:
        record = _part(types, ".".join(records))
        parts = [made if field == member else kind for field, kind in zip(record.fields, record.types, strict=True)]
        _set_part(types, ".".join(records), numba.types.NamedTuple(parts, record.instance_class))
    else:
        types[name] = made


@pytest.mark.slow
@pytest.mark.parametrize("kernel", sorted(MODULES))
def test_a_kernel_without_a_feature_is_one_without_its_source(kernel, plain):
    for features in (features for name, features in FEATURES if name == kernel):
        absent, cut = lacking(kernel, features, plain)
        assert abs(absent / cut - 1) <= TOLERANCE, named(kernel, features)
        if named(kernel, features) in LARGE:
            # What would be found if absence were not None but an empty table: the types, and the code, are these.
            assert furnished(kernel, features, plain) / cut - 1 > 2 * TOLERANCE, named(kernel, features)


def named(kernel, features):
    return f"{kernel}: {', '.join(features)}"


def test_every_large_feature_is_one():
    assert {named(kernel, features) for kernel, features in FEATURES} >= LARGE


@pytest.mark.slow
def test_what_is_pruned_in_callees_is_cut_there_too(plain):
    # `trace_block` and what it calls lose three features at once.
    three = (
        "fill_through_lens",
        {"lens.conic": COLUMN, "lens.aspheric": ROWS, "lens.frames": ROWS, "lens.masks": COLUMN},
    )
    absent, cut = lacking(*three, plain)
    assert abs(absent / cut - 1) <= TOLERANCE and furnished(*three, plain) > 2 * absent


LIBRARIES = {"embreex", "trimesh", "plyfile", "mapbox_earcut", "OpenImageIO", "matplotlib", "PIL", "mpmath", "tqdm"}
HEAVY = LIBRARIES | {"numba", "llvmlite", "scipy", "batoid", "zarr", "xarray", "pandas", "dask", "distributed"}

LOOK = """
import json, sys
import plenoptic as pl
imported = sorted(sys.modules)
import numpy as np
repr(pl.Exposure(np.ones((2, 2, 1))))
import plenoptic.core.sampling  # with its kernels
print(json.dumps([imported, sorted(sys.modules)]))

def look(shot):
    kernels = [
        f"{module.rpartition('.')[2]}.{name}"
        for module, found in list(sys.modules.items()) if module.startswith("plenoptic.")
        for name, part in vars(found).items()
        if type(part).__name__ == "Kernel" and part.signatures and part.__module__ == module
    ]
    parts = [name for name in ("standard_error", "truth", "sample_counts") if getattr(shot, name, None) is not None]
    print(json.dumps([kernels, parts, sorted(sys.modules)]))

def camera(stop, pitch=0.217):
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(stop))
    array = pl.MicrolensArray(pitch=pitch, focal_lengths=(2.0,))
    return pl.PlenopticCamera(lens, pl.Sensor((4, 4), 0.01), 123.3, array, 1.7)

look(pl.render_white(camera(16.0, 0.1), samples=8, replicates=1, progress=False))
look(pl.render_white(camera(5.0), samples=8, replicates=1, progress=False))
floor = pl.quad((-50, -50, -404), (100, 0, 0), (0, 100, 0))
lamp = pl.QuadLight((0, 30, -360), (20, 0, 0), (0, 12, -16), radiance=3.0)
look(pl.render(pl.Scene([floor], [lamp]), camera(5.0), samples=8, max_bounces=2, truth=pl.Truth.NONE, progress=False))
"""

OF_THE_CAMERA = {
    *(
        "sobol.fill_net",
        "candidates.fill_cells",
        "region_polygons.fill_regions",
        "ideal_microlenses.fill_thin",
        "trace.fill_through_lens",
    ),
    *("camera_samples.fill_camera_samples", "film_sums.fill_sums", "bundles.fill_status_counts"),
}
OF_OPENINGS = {
    *("ray_transfer.fill_transfer_rays", "ray_transfer.fill_ray_transfers", "region_polygons.fill_boxes"),
    "to_lens.fill_weights",
}
"""Where few microlenses are near a pixel, so that it pays to look through them at the openings of the lens."""
OF_THE_SCENE = {
    *("bundles.fill_world_rays", "path_keys.fill_path_keys", "sobol.fill_samples", "embree._fill_closest"),
    "grown.fill_grown",
    *("interaction.fill_interactions", "parameters.fill_parameters", "sample_emitters.sample_emitters"),
    *("emission.add_emission", "direct_light.eval_direct", "bounce.sample_bsdf"),
}
AS_NEEDED = {"embree._fill_occlusion", "direct_light.add_direct"}
"""Called where the few paths of the test find a lamp that shines on what they meet."""


@pytest.fixture(scope="module")
def seen():
    """Modules after importing the package and making an exposure; then kernels, parts of the exposure, and modules,
    after white images through open and closed stops, and after a scene."""
    done = subprocess.run([sys.executable, "-c", LOOK], capture_output=True, text=True, check=True)
    return [tuple(map(set, json.loads(line))) for line in done.stdout.splitlines()]


def test_nothing_is_loaded_before_it_is_needed(seen):
    imported, exposure = seen[0]
    assert not imported & HEAVY and not exposure & HEAVY


def test_a_white_image_calls_the_kernels_of_the_camera_alone(seen):
    assert seen[1][0] == OF_THE_CAMERA
    kernels, parts, modules = seen[2]
    assert kernels == OF_THE_CAMERA | OF_OPENINGS
    assert not parts
    assert not modules & (LIBRARIES | {"plenoptic.scene.scene", "plenoptic.truth.kernels"})
    assert not [module for module in modules if re.match(r"plenoptic\.scene\..*kernels\.", module)]


def test_a_lambertian_scene_calls_what_it_needs(seen):
    kernels, parts, modules = seen[3]
    assert kernels - AS_NEEDED == OF_THE_CAMERA | OF_OPENINGS | OF_THE_SCENE
    assert parts == {"standard_error"}
    assert modules & LIBRARIES <= {"embreex"}
    assert "plenoptic.scene.materials.kernels.bsdf" in modules

"""Edits that change the digest of a kernel, so that it is compiled again."""

import ast
import json
import os
import shutil
import subprocess
import sys
import types
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

import plenoptic
from plenoptic.core.numba.code_digest import UnknownValueError, code_digest

ROOT = Path(plenoptic.__file__).parent
SOURCE = '''
import enum, math
from typing import NamedTuple
import numpy as np
from plenoptic.core.numba.jit import device, kernel

FACTOR, TABLE, LIMITS = 2.0, np.array([1.0, 2.0]), (0, 5)

class Kind(enum.IntEnum):
    ROUND, FLAT = 0, 1

def times(factor):
    @device
    def product(x):
        return factor * x
    return product

once, twice = times(1.0), times(2.0)

class Pair(NamedTuple):
    kernel: float  # also a global variable
    second: float

@device
def scale(x):
    """Multiply."""
    return FACTOR * x

@device
def pair(x):
    return Pair(x, scale(x))

@kernel
def fill_scaled(x, out):
    for i in range(x.size):
        out[i] = scale(x[i]) + math.sin(x[i])

@kernel
def fill_pairs(x, out):
    for i in range(x.size):
        out[i] = pair(x[i]).second - pair(x[i]).kernel

@kernel
def fill_table(x, out):
    for i in range(x.size):
        out[i] = TABLE[LIMITS[0]] + once(x[i]) - twice(x[Kind.FLAT])
'''
KERNELS = {"fill_scaled", "fill_pairs", "fill_table"}


def digests(source):
    module = types.ModuleType("edited")
    exec(compile(source, "edited.py", "exec"), module.__dict__)
    return {name: code_digest(vars(module)[name].py_func) for name in KERNELS}


def test_edits_change_the_digests_of_the_kernels_that_they_reach():
    before = digests(SOURCE)
    assert len(set(before.values())) == 3
    for old, new, changed in [
        ("import enum, math", "import enum, math\n# a comment\n", set()),
        ("ROUND, FLAT = 0, 1", "FLAT, ROUND = 0, 1", {"fill_table"}),
        ("times(1.0), times(2.0)", "times(2.0), times(1.0)", {"fill_table"}),
        ('"""Multiply."""', '"""Return the product."""', set()),
        ("FACTOR * x", "FACTOR * x + 0.0", {"fill_scaled", "fill_pairs"}),
        ("FACTOR * x", "x * FACTOR", {"fill_scaled", "fill_pairs"}),
        ("= 2.0, np", "= 2, np", {"fill_scaled", "fill_pairs"}),
        ("= 2.0, np", "= -2.0, np", {"fill_scaled", "fill_pairs"}),
        ("[1.0, 2.0]", "[1.0, 3.0]", {"fill_table"}),
        ("np.array([1.0, 2.0])", "np.array([1.0, 2.0], np.float32)", {"fill_table"}),
        ("(0, 5)", "(0, 6)", {"fill_table"}),
        ("second: float", "other: float\n    second: float = 1.0", {"fill_pairs"}),
        ("math.sin", "math.cos", {"fill_scaled"}),
        ("@kernel\ndef fill_table", "@kernel\ndef new(x):\n    x[0] = 1.0\n\n@kernel\ndef fill_table", set()),
        ("def scale(x)", "def scale(x, y=1.0)", {"fill_scaled", "fill_pairs"}),
    ]:
        assert old in SOURCE
        after = digests(SOURCE.replace(old, new))
        assert {name for name in KERNELS if after[name] != before[name]} == changed, (old, new)


def test_values_of_a_closure_enter():
    def made(number):
        return lambda x: x + number

    assert code_digest(made(1)) == code_digest(made(1))
    assert len({code_digest(made(value)) for value in (1, 1.0, np.float32(1), (1,), None, "1")}) == 6


def test_attributes_are_no_globals_of_the_same_name():
    namespace = {"__name__": "edited", "item": object()}  # an object has no digest
    exec("def first(x):\n    return x.item\n\ndef second(x):\n    return item", namespace)
    assert code_digest(namespace["first"])
    with pytest.raises(UnknownValueError):
        code_digest(namespace["second"])


def test_values_without_a_digest_are_refused():
    thing = object()
    with pytest.raises(UnknownValueError, match="type object have no digest"):
        code_digest(lambda x: x is thing)


PRINT_DIGESTS = """
import importlib, json, pkgutil, sys, plenoptic
from plenoptic.core.numba.code_digest import code_digest
from plenoptic.core.numba.kernel_cache import _compiler_text
found = {"compiler": _compiler_text()}
for name in [one.name for one in pkgutil.walk_packages(plenoptic.__path__, "plenoptic.")]:
    if ".kernels." in name:
        module = importlib.import_module(name)
        for function in vars(module).values():
            if type(function).__name__ == "Kernel":
                key = f"{function.py_func.__module__}.{function.py_func.__name__}"
                found[key] = code_digest(function.py_func)
print(json.dumps(found))
"""


def package_digests(folder):
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", PRINT_DIGESTS]
    process = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=folder)
    return json.loads(process.stdout)


def callers(target):
    """Names of the package's functions that call another one, directly or not, by what their sources name."""
    calls, kernels = defaultdict(set), set()
    for path in ROOT.rglob("kernels/*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                calls[node.name] |= {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
                calls[node.name] |= {one.attr for one in ast.walk(node) if isinstance(one, ast.Attribute)}
                if any(isinstance(one, ast.Name) and one.id == "kernel" for one in node.decorator_list):
                    kernels.add(node.name)
    reached, before = {target}, 0
    while len(reached) > before:
        before = len(reached)
        reached |= {name for name, callees in calls.items() if callees & reached}
    return reached & kernels


def test_in_the_package_comments_cost_nothing_and_a_changed_function_its_callers(tmp_path):
    shutil.copytree(ROOT, tmp_path / "plenoptic", ignore=shutil.ignore_patterns("__pycache__"))
    before = package_digests(tmp_path)
    assert len(before) > 90
    for name in (
        "core/warn.py",
        "core/numba/pipeline.py",
        "optics/lens/kernels/spherical_refraction.py",
        "optics/lens/lens_record.py",
    ):
        path = tmp_path / "plenoptic" / name
        path.write_text("# A comment.\n" + path.read_text(encoding="utf-8") + "\n# Another.\n", encoding="utf-8")
    assert package_digests(tmp_path) == before
    path = tmp_path / "plenoptic" / "optics" / "lens" / "kernels" / "spherical_refraction.py"
    head, name, body = path.read_text(encoding="utf-8").partition("def refract_sphere")
    path.write_text(head + name + body.replace("math.sqrt(", "1.0 * math.sqrt(", 1), encoding="utf-8")
    after = package_digests(tmp_path)
    changed = {name.rpartition(".")[2] for name in after if after[name] != before[name]}
    assert changed == callers("refract_sphere") and "fill_through_lens" in changed and len(changed) < len(before) / 2

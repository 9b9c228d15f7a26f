"""What is noted only on request costs nothing otherwise: kernels are those of a source without it."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import plenoptic as pl

NOTED = {
    **{"trace_block": 2, "refract_asphere": 1, "refract_freeform": 1},
    **{"_newton": 1, "_settle": 1, "first_crossing": 1, "_climb": 1},
}
"""Functions, and how many of their last arguments are what is noted."""
GONE = {"log", "steps", "noted", "path"}

COUNT = """
import numpy as np
import plenoptic as pl
from plenoptic.optics.lens.kernels import trace
from plenoptic.optics.lens.record import lens_record

glass = pl.ConstantMedium(1.5)
asphere = pl.Surface(50.0, 5.0, glass, semi_diameter=20.0, conic=-0.5, aspheric=(0.0, 1e-5))
other = pl.LensStack([pl.CircularStop(9.0), asphere, pl.Surface(-60.0, semi_diameter=20.0)])
lenses = pl.load_lens("double-gauss-100mm-f2"), other
y = np.linspace(-9.0, 9.0, 300)
rays = pl.RayBundle(np.stack([0.1 * y, y, 0 * y - 50.0], axis=1), np.stack([0 * y, 0.01 * y, 0 * y + 1.0], axis=1))
bits = []
for lens in lenses:
    out = lens.trace(rays)
    bits += [out.origin.tobytes().hex(), out.direction.tobytes().hex()]
    trace.fill_traced(np.zeros(2048), lens_record(lens, 587.6, reverse=True), None)
for kernel in (trace.fill_traced_rows, trace.fill_traced):
    for code in kernel.inspect_asm().values():
        print(sum(line.startswith("\\t") and not line.lstrip().startswith(".") for line in code.splitlines()))
print("".join(bits))
"""


class Without(ast.NodeTransformer):
    """Takes out of a source what has to do with notes."""

    def visit_FunctionDef(self, node):
        self.generic_visit(node)
        if node.name in ("_note", "fill_paths"):
            return None
        if node.name in NOTED:
            del node.args.args[-NOTED[node.name] :]
        return node

    def visit_Call(self, node):
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in NOTED:
            del node.args[-NOTED[node.func.id] :]
        return node

    def visit_If(self, node):
        self.generic_visit(node)
        return None if ast.unparse(node.test) in {f"{name} is not None" for name in GONE} else node

    def visit_Assign(self, node):
        self.generic_visit(node)
        return None if ast.unparse(node.targets[0]) in ("steps", "noted") else node


def counted(root: Path, cache: Path) -> tuple[list[int], str]:
    environment = os.environ | {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(cache)}
    run = subprocess.run([sys.executable, "-c", COUNT], cwd=root, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    *counts, bits = run.stdout.split()
    return [int(count) for count in counts], bits


@pytest.mark.slow
def test_tracing_is_that_of_a_source_without_notes(tmp_path):
    package = Path(pl.__file__).parent
    shutil.copytree(package, tmp_path / "without" / "plenoptic", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("trace.py", "conic_asphere.py"):
        path = tmp_path / "without" / "plenoptic" / "optics" / "lens" / "kernels" / name
        bare = Without().visit(ast.parse(path.read_text()))
        assert not GONE & {node.id for node in ast.walk(bare) if isinstance(node, ast.Name)}
        path.write_text(ast.unparse(bare))
    ours, bits = counted(package.parent, tmp_path / "cache")
    theirs, bare_bits = counted(tmp_path / "without", tmp_path / "cache")
    assert len(ours) == len(theirs) == 4 and min(theirs) > 1000
    # Registers that are assigned otherwise cost a few moves, outside the loops over the rays of a block.
    for with_notes, without in zip(ours, theirs, strict=True):
        assert abs(with_notes / without - 1.0) <= 0.03
    assert bits == bare_bits

"""The notebooks of the tutorials run from top to bottom, at small size, and show each figure once."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TUTORIALS = ROOT / "examples" / "tutorials"
MISSING = [name for name in ("ipykernel", "nbclient", "sphinx_gallery") if importlib.util.find_spec(name) is None]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(MISSING), reason=f"{', '.join(MISSING)} missing: pip install '.[notebook]'"),
]


BAR = """
import sys, time
sys.modules["ipywidgets"] = None
from plenoptic.core.progress import bar
from plenoptic.core.parallel import run_in_order
bar.DELAY, bar._INTERVAL = 0.1, 0.02
with bar.CallProgress("waiting", kind="camera", show=True):
    list(run_in_order(time.sleep, [0.05] * 8, threads=1))
"""


def test_without_ipywidgets_a_bar_is_one_output_and_nothing_stays_of_it():
    import nbformat
    from nbclient import NotebookClient

    made = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(BAR)])
    NotebookClient(made, timeout=120).execute()
    (output,) = made.cells[0].outputs
    assert output.output_type == "display_data" and output.data == {"text/plain": ""}


NAMES = ("blender_scene", "calibration", "camera_design", "data_set", "large_sensor", "own_lens")
"""One for each kind of user."""


@pytest.mark.parametrize("name", NAMES)
def test_notebook_runs_and_shows_each_figure_once(name, tmp_path):
    import nbformat

    assert sorted(path.stem for path in TUTORIALS.glob("*.py")) == sorted(NAMES)
    script = TUTORIALS / f"{name}.py"

    command = [sys.executable, str(ROOT / "docs" / "make_notebooks.py"), str(script)]
    surroundings = {**os.environ, "PLENOPTIC_EXAMPLE_SIZE": "small", "MPLBACKEND": "Agg"}
    process = subprocess.run(command, cwd=tmp_path, env=surroundings, capture_output=True, text=True, timeout=600)
    assert process.returncode == 0, process.stderr
    made = nbformat.read(tmp_path / "output" / "notebooks" / f"{name}.ipynb", as_version=4)
    cells = [cell for cell in made.cells if cell.cell_type == "code"]
    outputs = [output for cell in cells for output in cell.outputs]
    said = "".join(output.text for output in outputs if output.get("name") == "stderr")
    # A busy machine does little in a short time, and waits so long that bars are shown.
    assert set(re.findall(r"\w+Warning", said)) <= {"BudgetWarning", "TqdmWarning"}, said
    figures = sum("image/png" in output.get("data", {}) for output in outputs)
    assert figures == sum(cell.source.count(".savefig(") for cell in cells) > 0
    # Nothing is shown that is not a figure: no representation of what a cell happens to end with.
    assert not [output for output in outputs if output.output_type == "execute_result"]

"""Makes notebooks of the tutorials and runs them, without a browser.

    pip install ".[notebook]" && python docs/make_notebooks.py

writes them with all outputs to `output/notebooks` below the current folder, and says what each took. Other examples can
be named: ``python docs/make_notebooks.py examples/first_light.py``.
"""

import os
import shutil
import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from sphinx_gallery.notebook import python_to_jupyter_cli

TUTORIALS = Path(__file__).resolve().parents[1] / "examples" / "tutorials"


def notebook(script, folder):
    """The notebook of a script, run in a folder and written there; an exception where a cell fails."""
    folder.mkdir(parents=True, exist_ok=True)
    copy = Path(shutil.copy(script, folder))
    python_to_jupyter_cli([str(copy)])  # writes beside the script
    copy.unlink()
    path = copy.with_suffix(".ipynb")
    made = nbformat.read(path, as_version=4)
    try:
        NotebookClient(made, timeout=None, resources={"metadata": {"path": str(folder)}}).execute()
    finally:
        nbformat.write(made, path)  # what there is, with its error
    return path


if __name__ == "__main__":
    os.environ.pop("MPLBACKEND", None)  # another one than the notebooks' own shows no figures in them
    for script in [Path(name) for name in sys.argv[1:]] or sorted(TUTORIALS.glob("*.py")):
        begin = time.perf_counter()
        print(notebook(script, Path("output/notebooks")), f"{time.perf_counter() - begin:.1f} s", flush=True)

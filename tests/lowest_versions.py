"""Print the lowest versions of what the package needs, as constraints: `pip install -c lowest.txt ".[plot,zarr]"`."""

import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
for one in project["dependencies"] + extras["plot"] + extras["zarr"]:
    print(one.replace(">=", "=="))

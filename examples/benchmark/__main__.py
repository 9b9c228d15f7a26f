"""Render scenes through plenoptic cameras, find their depth and say how good it is.

Packages that are already in the folder are not rendered again; delete them to have them anew.
"""

import argparse
import time
from pathlib import Path

import cameras
import judging
import packages
import pictures
from algorithms import algorithms, is_focused
from scenes import CASES


def main():
    parser = argparse.ArgumentParser(prog="python examples/benchmark", description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("output/benchmark"), help="what is written where")
    parser.add_argument("--cameras", default=",".join(cameras.MADE), help=f"some of {', '.join(cameras.MADE)}")
    parser.add_argument("--only", default=",".join(CASES), help=f"some of {', '.join(CASES)}")
    parser.add_argument("--error", type=float, default=0.03, help="relative error of the pictures")
    parser.add_argument("--size", type=float, default=1.0, help="of the sensors, over that of the design")
    parser.add_argument("--quick", action="store_true", help="--size 0.4 --error 0.2: shows that all works, no more")
    parser.add_argument("--programs", help="folder with the command plenopticam; without it, its lines are empty")
    options = parser.parse_args()
    if options.quick:
        options.size, options.error = 0.4, 0.2
    chosen = [_some(parser, options.cameras, cameras.MADE), _some(parser, options.only, CASES)]
    options.folder.mkdir(parents=True, exist_ok=True)
    report = "\n".join(f"### {name}\n\n{text}" for name, text in tables(options, *chosen))
    path = options.folder / "table.md"
    path.write_text(report, encoding="utf-8")
    print(f"{report}\nwritten: {path}")


def _some(parser, text, known):
    names = text.split(",")
    if unknown := [name for name in names if name not in known]:
        parser.error(f"there is no {', '.join(unknown)}; there are {', '.join(known)}")
    return names


def tables(options, camera_names, case_names):
    """The name of each camera and its table; scores are printed as they are found."""
    for camera_name in camera_names:
        camera = cameras.load(camera_name, options.size)
        folder = options.folder / f"{camera_name}-{camera.sensor.shape[0]}-{options.error:g}"
        rows, shown = [], {}
        for name in case_names:
            package = packages.package(folder / f"{plain(name)}.zip", CASES[name], camera, error=options.error)
            truth = judging.reference(package, CASES[name].make())
            for algorithm, how in algorithms(camera, options.programs).items():
                row, estimate = judged(name, algorithm, how, package, truth)
                print(f"{camera_name}, {name}, {algorithm}:\n{row.scores or 'not there'}", flush=True)
                rows.append(row)
                if estimate is not None:
                    parts = pictures.panels(package, truth, estimate)
                    shown.setdefault(algorithm, {})[name] = [pictures.overview(CASES[name].make, camera), *parts]
        for algorithm, columns in shown.items():
            largest = 0.5 if is_focused(camera) else 0.2
            pictures.figure(options.folder / f"{camera_name}_{plain(algorithm)}.png", columns, largest=largest)
        yield camera_name, judging.table(camera, rows)


def plain(name):
    """For files."""
    return name.replace(",", "").replace(" ", "_")


def judged(name, algorithm, how, package, truth):
    """A line of the table, and the disparities."""
    error = package.exposure.relative_error
    if how is None:
        return judging.Row(name, algorithm, None, None, None, 0.0, error), None
    begin = time.perf_counter()
    estimate = how.find(package)
    seconds = time.perf_counter() - begin
    estimate = judging.on_scale(estimate, truth) if how.scaled else estimate
    return judging.Row(name, algorithm, *judging.scores(estimate, truth), seconds, error), estimate


if __name__ == "__main__":
    main()

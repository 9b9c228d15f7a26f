"""Every example runs, at small size and in a folder of its own, and leaves files that load."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
SLOW = pytest.mark.slow
MAIN_LENSES = ("achromat-100mm-f4.4", "double-gauss-100mm-f2")

PLAIN = (
    *("paper_camera", "textured_mesh", "disparity", "file_gallery", "targets", "focused_views", "enough_samples"),
    *("lens_library", "lens_report", "ghosts", "fog_and_depth", "underwater_still_life"),
)
"""Those whose figures no test below looks at."""


def _run(script, folder, *options):
    """Run a script, or a folder of them, in a folder; returns what it printed."""
    surroundings = {**os.environ, "PLENOPTIC_EXAMPLE_SIZE": "small", "MPLBACKEND": "Agg"}
    command = [sys.executable, str(script), *options]
    process = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=300)
    assert process.returncode == 0, process.stderr
    return process.stdout


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Run an example once, which leaves its files and says where; returns its output folder and what it printed."""
    done = {}

    def run(name):
        if name not in done:
            folder = tmp_path_factory.mktemp(name)
            said, folder = _run(EXAMPLES / f"{name}.py", folder), folder / "output" / name
            files = list(folder.iterdir())
            assert files, name
            for file in files:
                assert file.name in said or file.name in ("label.png", "tin.obj", "tin.mtl")
                if file.suffix in (".exr", ".png", ".jpg"):
                    image = pl.Exposure.load(file).image
                    assert np.isfinite(image).all() and image.max() > 0, file
            done[name] = folder, said
        return done[name]

    return run


def test_every_example_is_tested():
    named = re.findall(r'ran\("(\w+)"\)', Path(__file__).read_text(encoding="utf-8"))
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*PLAIN, *named}


@SLOW
@pytest.mark.parametrize("name", PLAIN)
def test_example_leaves_its_files_and_says_where(ran, name):
    ran(name)


@SLOW
def test_the_pair_of_dual_pixels_has_the_disparity_of_rays(ran):
    found = _numbers(ran("dual_pixel")[1], r" *\d+ mm ")
    # Crosstalk of 2 % takes up to 2 % off; a depth of 600 mm is as uncertain.
    assert len(found) == 3 and np.allclose(found[:, 1], found[:, 0], rtol=0.03, atol=0.03)


@SLOW
def test_readme_runs(tmp_path):
    code, _ = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    script = tmp_path / "readme.py"
    script.write_text(code, encoding="utf-8")
    _run(script, tmp_path)
    assert pl.Exposure.load(tmp_path / "shot.exr").image.shape == (64, 64, 3)
    assert (tmp_path / "shot.png").exists()


def test_first_light_keeps_everything(ran):
    folder, said = ran("first_light")
    raw, white = (pl.Exposure.load(folder / name) for name in ("raw.exr", "white.exr"))
    assert raw.image.shape == (96, 120, 3) and white.image.shape == (96, 120, 1)
    assert raw.camera == white.camera and raw.standard_error is not None and white.standard_error is not None
    assert np.isfinite(raw.depth).any() and raw.stats.nonfinite == 0
    assert "relative error" in said and str(folder.resolve()) in said


@SLOW
def test_the_twin_of_a_calibrated_camera_projects_as_it_does(ran):
    _, said = ran("calibrate_a_camera")
    ((rms,),) = _numbers(said, r"\d+ images of middles: twin minus real")
    # A third of the error of a corner, 0.1 pixels.
    assert rms < 0.1


@SLOW
def test_displacements_of_particles_behind_a_window_are_those_of_the_projection(ran):
    _, said = ran("vortex_behind_window")
    ((difference,),) = _numbers(said, "weights and projection differ by")
    assert difference < 0.01


@SLOW
def test_stop_behind_the_lens_cuts_micro_images_off_in_the_corner_only(ran):
    folder, _ = ran("stop_shapes")

    def light(stop, place):
        shot = pl.Exposure.load(folder / f"{stop}_{place}.exr")
        return _mean_and_error(shot, np.ones(shot.image.shape[:2], dtype=bool))

    whole, error = light("circle_nothing_behind", "on_the_axis")
    cut, its_error = light("circle", "on_the_axis")
    assert abs(cut - whole) < 4 * np.hypot(error, its_error)
    # The lens of two overlapping circles that is left holds clearly less.
    assert light("circle", "upper_left_corner")[0] < 0.8 * light("circle_nothing_behind", "upper_left_corner")[0]


@SLOW
def test_blades_and_star_pass_the_share_of_the_circle_that_their_hole_has(ran):
    folder, _ = ran("stop_shapes")
    # The microlens on the axis alone: its image ends 10.3 pixels from the centre, its neighbours' begin at 11.8.
    place = np.arange(24) - 11.5
    alone = np.hypot(place[:, None], place) < 11

    def light(stop):
        return _mean_and_error(pl.Exposure.load(folder / f"{stop}_on_the_axis.exr"), alone)

    round_one, error = light("circle")
    shares = {f"{n}_blades": n / (2 * np.pi) * np.sin(2 * np.pi / n) for n in (6, 12)}
    shares["star"] = pl.StarStop(points=5, semi_diameter=4.25, inner_semi_diameter=1.7).area / (np.pi * 4.25**2)
    for name, share in shares.items():
        cut, its_error = light(name)
        # Four standard errors, and 1 %: cos^4 varies by less over the image, and the pupil has hardly any distortion.
        assert abs(cut - share * round_one) < 4 * np.hypot(its_error, share * error) + 0.01 * share * round_one


def _mean_and_error(shot, where):
    """Mean over some pixels and its standard error; pixels are independent."""
    errors = shot.standard_error[where].astype(np.float64)
    return float(shot.image[where].mean(dtype=np.float64)), float(np.sqrt(np.sum(errors**2)) / errors.size)


def _numbers(said, line):
    """Numbers with a point, after what a pattern matches at the start of a line; a row for each line."""
    ends = [row[found.end() :] for row in said.splitlines() if (found := re.match(line, row))]
    return np.array([[float(n) for n in re.findall(r"[-+]?\d+\.\d+", end)] for end in ends])


@SLOW
def test_contrast_in_micro_images_is_that_of_opening_and_pixel(ran):
    found = _numbers(ran("fine_structure")[1], r"  (?=.*\+-)")
    assert len(found) == 6
    _, _, expected, rendered, error = found.T
    # Four standard errors, and 0.03 for the harmonics that a window of 12 pixels does not tell from the wave.
    assert (np.abs(rendered - expected) < 4 * error + 0.03).all()


@SLOW
def test_diffraction_leaves_what_the_opening_s_overlap_says_of_contrast(ran):
    without, bent, expected = _numbers(ran("diffraction")[1], r" +-\d+\.\d\d ").T
    assert len(bent) == 6 and (bent < without).all()
    # Four standard errors of 0.02, in the microscope's view of 128 pixels that are known to 25 %, and 0.02 for what
    # spokes, by their Fourier transform, differ from a grating.
    assert np.abs(bent - expected).max() < 0.1


@SLOW
def test_edges_move_between_views_as_geometry_says(ran):
    found = _numbers(ran("sub_aperture")[1], r" +\d+ mm ")
    # 7 views tell a slope to 0.2 times the error of an edge, of some 0.05 pixels.
    assert len(found) == 3 and np.allclose(found[:, 0], found[:, 1], rtol=0, atol=0.04)


@SLOW
def test_lateral_colour_is_that_of_chief_rays(ran):
    found = _numbers(ran("chromatic")[1], r" +\d+ +[RGB] ")
    assert len(found) == 6 and (np.abs(found[:, 0] - found[:, 1]) < 4 * found[:, 2]).all()
    red, _, blue = found[3:, 0]
    assert red - blue > 20  # at the border: 26 pixels


@SLOW
def test_demosaicing_errs_at_the_rims_of_micro_images(ran):
    _, said = ran("sensor_noise")
    for rims, inside in _numbers(said, r"colour filters, no noise, \w+ (?=.*\d +\d)"):
        assert rims > 5 * inside
    ((measured, gain),) = _numbers(said, "gain from photon transfer")
    # A variance from 4096 pixels has a relative error of sqrt(2 / 4096), and few levels carry the slope.
    assert abs(measured / gain - 1) < 5 * np.sqrt(2 / 4096)


@SLOW
def test_white_image_loses_what_dust_covers(ran):
    _, said = ran("imperfections")
    ((lost, covered, expected),) = _numbers(said, "light lost to dust on pixels")
    # The design is rendered with the same paths, 2.6e5 of them; those that meet dust have Poisson's error.
    assert abs(lost / covered - 1) < 4 / np.sqrt(0.5 * covered * 64 * 64 * 16)
    assert abs(expected - covered) < 0.03
    ((tilted, by_slope),) = _numbers(said, "tilt: columns")
    assert abs(tilted - by_slope) < 0.05


@SLOW
def test_each_type_of_microlens_sees_another_plane_best(ran):
    planes = _numbers(ran("multi_focus")[1], r" +(?=-\d+\.\d .*,)")
    assert planes.shape == (3, 7)
    assert planes[:, 2::2].argmax(axis=0).tolist() == [0, 1, 2]


@SLOW
def test_micro_images_lie_apart_as_reported(ran):
    found = _numbers(ran("main_lenses")[1], "|".join(MAIN_LENSES))
    # As printed, and what differs between the pitch on the axis and that to its neighbours.
    assert len(found) == 2 and (np.abs(found[:, 2] - found[:, 3]) < 0.01).all()


@SLOW
def test_detected_corners_lie_where_projected(ran):
    _, said = ran("calibration_points")
    rows, columns, row_spread, column_spread = _numbers(said, "detected minus true")[0]
    count = int(re.search(r"(\d+) detected", said).group(1))
    assert count >= 5 and max(row_spread, column_spread) < 0.2
    assert abs(rows) < 4 * row_spread / np.sqrt(count) and abs(columns) < 4 * column_spread / np.sqrt(count)


@SLOW
def test_files_of_the_benchmark_s_cameras_are_those_that_its_code_makes():
    module = runpy.run_path(str(EXAMPLES / "benchmark" / "cameras.py"))
    for name, make in module["MADE"].items():
        camera = module["load"](name)
        # Designs are searched, to 1e-8: other processors round differently.
        assert camera.stop_to_microlenses == pytest.approx(make().stop_to_microlenses, rel=1e-7)
        assert camera.report().focus[0].kind == make().report().focus[0].kind
    assert {path.stem for path in module["FILES"].glob("*.json")} == set(module["MADE"])


@SLOW
def test_benchmark_scores_depth_against_the_truth(tmp_path):
    said = _run(EXAMPLES / "benchmark", tmp_path, "--quick", "--only", "noise", "--cameras", "views,three-types")
    folder = tmp_path / "output" / "benchmark"
    table = (folder / "table.md").read_text(encoding="utf-8")
    assert table in said
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if line.startswith("| ")]
    views, focused = (
        [dict(zip(rows[k], row, strict=True)) for row in rows[k + 2 : k + n]] for k, n in ((0, 6), (6, 5))
    )
    assert views[-1]["algorithm"] == "PlenoptiCam" and views[-1]["kept %"] == "not there"
    blind, found, sure = focused
    # The blind one is far off almost everywhere.
    assert float(sure["Rel7"]) < float(found["Rel7"]) < 0.5 * float(blind["Rel7"])
    assert float(sure["kept %"]) < float(found["kept %"]) <= float(blind["kept %"]) == 100
    assert abs(float(found["bias %"])) < 3 and len(found["Rel3 of types"].split(",")) == 3
    assert len(list(folder.glob("*.png"))) == 6
    package = pl.package.read(next(folder.glob("three-types*/noise.zip")))
    assert package.raw.model.read_noise == 3 and package.exposure.truth.chord_disparity is not None

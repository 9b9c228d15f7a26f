"""Slips in a copy of the package, and which test finds each: whether a suite still sees what it should see.

    python tests/mutations.py [--only NAME,..] [--suite FOLDER] [--seconds N] [--package FOLDER]

One mutation is made at a time, in a copy that stands first on the path, and tests run until one fails that passes
without it: those named here, then the other normal ones, its own room and those that build on it first, then the slow
ones. Tests that hold bits or sources are left out: they find any change and say nothing about laws. Lines were drawn
from all rooms of the package before a look at the tests, and each change matters for input that is valid.
"""

import argparse
import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
MUTATIONS = """
sphere_far_half optics/lens/kernels/spherical_refraction.py: optics/surfaces optics/lens/test_trace.py
- or (divisor == 0.0 and g == g) or c * z > max_depth else lost
+ or (divisor == 0.0 and g == g) else lost
asphere_stale_slope optics/lens/kernels/aspheric_refraction.py: optics/surfaces
- _, heights[1, i] = height(r2, conic, aspheric)
+ _, _ = height(r2, conic, aspheric)
star_notch optics/lens/kernels/stops.py: optics/stops
- inside = min(ax * x + ay * y, bx * x + by * y) <= limit
+ inside = max(ax * x + ay * y, bx * x + by * y) <= limit
mirror_without_conic optics/lens/kernels/mirror.py: optics/lens/test_mirrors.py rendering/test_mirror_camera.py
- height(x * x + y * y, (c, kz), lens.aspheric[k])
+ height(x * x + y * y, (c, 1.0), lens.aspheric[k])
plate_front_plane optics/microlens/kernels/plano_convex.py: optics/microlens camera/psf
- z_front = z_array - (thickness / index if curved_first else 0.0)
+ z_front = z_array - (thickness if curved_first else 0.0)
pupil_in_a_medium optics/lens/gaussian/paraxial.py: optics/lens/gaussian
- entrance_pupil = float(z[0]) + over(front_index * float(front[0, 1]), float(front[0, 0]))
+ entrance_pupil = float(z[0]) + over(float(front[0, 1]), float(front[0, 0]))
nodal_points_as_principal_points optics/lens/gaussian/paraxial.py: optics/lens/test_two_media.py
- front_nodal=front_focus + efl if focal else -math.inf,
+ front_nodal=front_focus + front_efl if focal else -math.inf,
ideal_lens_in_one_medium optics/lens/lens_record.py: optics/lens/test_two_media.py
- index_ratio=ahead / behind_it,
+ index_ratio=behind_it / ahead,
radiance_over_squared_index camera/camera_record.py: camera/test_two_media.py
- (indices[:, 1] / indices[:, 0]) ** 2
+ (indices[:, 0] / indices[:, 1]) ** 2
dome_of_one_radius optics/lens/window.py: optics/lens/test_window.py
- Surface(outer - thick, gap, lens.front_medium, semi_diameter=inner_size),
+ Surface(outer, gap, lens.front_medium, semi_diameter=inner_size),
window_about_its_front optics/lens/window.py: optics/lens/test_window.py
- pivot = float(behind.vertices[1])
+ pivot = float(behind.vertices[0])
optical_distance_in_air truth/truth_stages.py: camera/test_underwater.py
- = self._truth.front_index * self.hits.distance
+ = self.hits.distance
viewpoint_of_one_ray camera/report/illumination.py: camera/test_underwater.py
- distance = np.linalg.lstsq((direction * [[-1.0], [1.0]]).T, origin[0] - origin[1], rcond=None)[0]
+ distance = np.linalg.lstsq((direction * [[-1.0], [1.0]]).T, origin[1] - origin[0], rcond=None)[0]
seidel_distortion optics/lens/analysis/seidel.py: optics/lens/analysis/test_seidel.py optics/lens/analysis
- + (invariant - a_bar * y) * y_bar * c * inverse_step)
+ + (invariant + a_bar * y) * y_bar * c * inverse_step)
glass_resonance optics/glass/dispersion.py: optics/glass
- + k[3] / (w * w - k[4] ** 2),
+ + k[3] / (w * w - k[4]),
choice_in_a_piece camera/sampling/kernels/camera_samples.py: camera/test_aperture_regions.py rendering/test_render.py
- remainder -= pieces[k - 1].area
+ remainder -= 0.0
plane_moves_along_u camera/sampling/kernels/region_polygons.py: camera/test_aperture_regions.py rendering
- nx * transfer.x_by_v + ny * transfer.y_by_v
+ nx * transfer.x_by_v + ny * transfer.y_by_u
point_in_a_triangle core/kernels/polygons.py: core/test_sampling.py camera/test_aperture_regions.py camera/psf
- root = math.sqrt(min(max(remaining / twice, 0.0), 1.0)) if twice > 0.0 else 0.0
+ root = min(max(remaining / twice, 0.0), 1.0) if twice > 0.0 else 0.0
projection_axes camera/points/projection.py: camera/points/test_projection.py camera/points
- (np.abs(rows.position) <= 0.5 * np.array(sensor.size[::-1]))
+ (np.abs(rows.position) <= 0.5 * np.array(sensor.size))
spread_error camera/psf/psf_results.py: camera/psf
- error = np.sqrt(squares / (max(len(crops) - 1, 1) * len(crops)))
+ error = np.sqrt(squares / max(len(crops) - 1, 1))
far_field_tail optics/diffraction/kernels/far_field.py: optics/diffraction rendering/test_diffraction.py
- a = field.radius / (1.0 - v)
+ a = field.radius / math.sqrt(1.0 - v)
wave_through_dim_lens wave/microlenses.py: wave
- dim = math.sqrt(self.lenses.transmission[k])
+ dim = self.lenses.transmission[k]
instance_normal scene/geometry/kernels/intersect.py: rendering/integrator/test_features.py scene/geometry
- + (m[4] * m[9] - m[5] * m[8]) * z
+ + (m[5] * m[8] - m[4] * m[9]) * z
environment_chance scene/lights/kernels/sample_emitters.py: rendering/integrator/test_features.py scene/lights
- rows[i, PDF] = environment.probability * environment_pdf[at_row, at_column]
+ rows[i, PDF] = environment_pdf[at_row, at_column]
conductor_density scene/materials/kernels/conductor.py: scene/materials rendering/integrator
- return d / (4.0 * o[2] * (1.0 + hidden_o))
+ return d / (4.0 * o[2])
texture_seam scene/textures/kernels/lookup.py: scene/textures
- first = first if first >= 0 else n - 1
+ first = first if first >= 0 else 0
emission_weight rendering/integrator/kernels/emission.py: rendering/integrator scene/lights
- mis_weight = weight(ray_pdf, area_pdf[material] * path_length * path_length / cosine)
+ mis_weight = weight(ray_pdf, area_pdf[material] * path_length * path_length * cosine)
roulette_weight rendering/integrator/kernels/bounce.py: rendering/integrator
- radiance_scale /= largest
+ radiance_scale /= 1.0
light_in_a_liquid scene/materials/kernels/absorption.py: rendering/integrator scene/materials
- row_vector(rows, i, NORMAL)) < 0.0:
+ row_vector(rows, i, NORMAL)) > 0.0:
pooled_error rendering/film.py: rendering/test_film.py rendering/test_standard_error.py
- pooled = (independent + _BLOCK_WEIGHT * block_mean) / (1.0 + _BLOCK_WEIGHT) * reduction[..., None]
+ pooled = (independent + _BLOCK_WEIGHT * block_mean) * reduction[..., None]
expected_with_noise core/relative_error.py: rendering/test_rare_light.py core/test_relative_error.py
- signal_variance = np.maximum(between - diagonal_sums(noise) / divisor, 0.0)
+ signal_variance = np.maximum(between, 0.0)
own_colour_decides rendering/schedule/progress.py: rendering/schedule/test_progress.py rendering/test_render.py
- other_squares = tile_squares[(colours == 1 - colour) & ~np.isnan(tile_squares)]
+ other_squares = tile_squares[(colours == colour) & ~np.isnan(tile_squares)]
estimated_samples rendering/estimation/decisions.py: rendering/test_estimate.py
- at * np.maximum(over, 1.0) ** (1 / falls)
+ at * np.maximum(over, 1.0) ** falls
estimated_error_of_ghosts rendering/estimation/errors.py: rendering/test_estimate.py
- light.standard_error * factor
+ light.standard_error / factor
merged_error rendering/merging/stacking.py: rendering/test_merging.py
- np.square(weight * shot["standard_error"])
+ weight * np.square(shot["standard_error"])
truth_on_tilted_sensor truth/truth_stages.py: truth
- (starts[:, 0] * plane.tilt[0] + starts[:, 1] * plane.tilt[1])
+ (starts[:, 0] * plane.tilt[0] - starts[:, 1] * plane.tilt[1])
order_of_turns sequences/sequence.py: sequences
- pose = Pose(pose.rotation @ stands.rotation, pose.to_world(stands.position))
+ pose = Pose(stands.rotation @ pose.rotation, pose.to_world(stands.position))
rounding_of_numbers readout/develop.py: readout
- return np.rint(np.clip(numbers, 0.0, 2.0**model.bits - 1)).astype(np.uint16)
+ return np.clip(numbers, 0.0, 2.0**model.bits - 1).astype(np.uint16)
viewpoint_up lightfield/decode.py: lightfield/test_decode.py
- central = np.array([viewpoint[0], -viewpoint[1]])
+ central = np.array([viewpoint[0], viewpoint[1]])
depth_of_views lightfield/view_model.py: lightfield/test_depth.py lightfield/test_decode.py
- lever / (1.0 - lever * self.vergence)
+ lever / (1.0 + lever * self.vergence)
noise_of_two_pixels lightfield/kernels/subpixel.py: lightfield/test_depth.py
- error = math.sqrt(0.5 * variance * slope_variance + excess) / stiffness
+ error = math.sqrt(variance * slope_variance + excess) / stiffness
zemax_order_of_turns optics/lens/files/zemax_folds.py: optics/lens/files/test_zemax_folds.py optics/lens/files
- rotation = z @ y @ x
+ rotation = x @ y @ z
gltf_turned_texture scene/files/gltf/textures.py: scene/files
- u, v = cosine * u + sine * v, cosine * v - sine * u
+ u, v = cosine * u - sine * v, cosine * v + sine * u
damage_in_a_record core/files/record_log.py: core/files rendering/schedule/test_resuming.py
- return arrays if body.digest() == entry.digest else None
+ return arrays
seed_of_a_camera dataset/task.py: dataset
- spawn_key=(frame, camera)
+ spawn_key=(frame,)
toolbox_middle export/to_lftoolbox.py: export
- matrix[axis, [axis, 4]] = step, -step * 0.5 * (views + 1)
+ matrix[axis, [axis, 4]] = step, -step * 0.5 * (views - 1)
blur_of_a_point package/calibration.py: package export
- blur = 0.5 * opening_width(array) * spread
+ blur = opening_width(array) * spread
order_of_views viewer/light_field.py: viewer
- for i in part.across for j in part.down]
+ for j in part.down for i in part.across]
"""

ROOMS = (
    *("core", "optics", "scene", "camera", "truth", "sequences", "rendering", "readout", "lightfield", "wave"),
    *("package", "dataset", "export", "viewer", "plots", "study", "command", "hostile", "fuzz"),
)
"""From those below to those that build on them."""
LEFT_OUT = (
    *("golden", "benchmarks", "validation", "core/test_jit.py", "test_structure.py", "test_absence.py"),
    *("test_layers.py", "test_public_names.py", "test_import_cost.py", "test_distribution.py"),
)
"""What holds bits, sources and files of the package, and what needs other programs."""
SLOW = "slow and not benchmark and not validation and not browser"


class Mutation(NamedTuple):
    name: str
    file: str
    tests: list[str]
    old: str
    new: str

    def of(self, package: Path) -> str:
        """The file with the change, which must have one place there, and which Python must be able to read."""
        text = (package / self.file).read_text(encoding="utf-8")
        if (count := text.count(self.old)) != 1:
            raise SystemExit(f"{self.name}: its text stands {count} times in {self.file}")
        ast.parse(text := text.replace(self.old, self.new))
        return text


def mutations() -> dict[str, Mutation]:
    found = re.findall(r"^(\w+) (\S+): (.+)\n- (.+)\n\+ (.+)$", MUTATIONS, re.MULTILINE)
    return {name: Mutation(name, file, tests.split(), old, new) for name, file, tests, old, new in found}


def run(folder: Path, suite: Path, arguments: list[str], seconds: float) -> tuple[str, str] | None:
    """The first test that fails with the package in `folder` and why, "" for none; None where time is over."""
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "pytest", "-xq", "-n0", "-pno:cacheprovider", "-rfE", "--tb=no"]
    command += ["-c", str(ROOT / "pyproject.toml"), f"--rootdir={suite.parent}", *arguments]
    env = {**os.environ, "PYTHONPATH": path, "BUILD_NUMBER": "1"}  # with which pytest cuts no reason off
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            command, cwd=folder, env=env, stdout=said, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            status = process.wait(max(seconds, 1.0))
        except subprocess.TimeoutExpired:
            return None
        finally:
            with suppress(ProcessLookupError):  # what it has started ends with it
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        said.seek(0)
        text = said.read()
    if status in (0, 5):
        return "", ""
    found = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - (.*))?$", text, re.MULTILINE)
    if found is None:
        return "pytest", f"ended with {status}: {' '.join(text.split())[-200:]}"
    file, *part = found[1].split("::", 1)
    return "::".join([str((folder / file).resolve()), *part]), found[2] or ""


def stages(suite: Path, one: Mutation) -> list[list[str]]:
    """What pytest is asked for, one after the other. Where a file of tests has gone, its folder takes its place."""
    first = list(dict.fromkeys(path if (path := suite / name).exists() else path.parent for name in one.tests))
    start = ROOMS.index(one.file.split("/")[0])
    rest = [suite / room for room in (*ROOMS[start:], *ROOMS[:start])] + sorted(suite.glob("test_*.py"))
    rest = [path for path in rest if path.exists() and path not in first and path.name not in LEFT_OUT]
    never, others = ([f"--ignore={path}" for path in paths] for paths in (map(suite.joinpath, LEFT_OUT), first))
    parts = [*never, *map(str, first)], [*never, *others, *map(str, rest)]
    return [[*more, *part] for more in ([], ["-m", SLOW]) for part in parts]


def verdict(folder: Path, suite: Path, one: Mutation, seconds: float) -> str:
    path, end, passed_over = folder / "plenoptic" / one.file, time.perf_counter() + seconds, []
    before, after = path.read_text(encoding="utf-8"), one.of(folder / "plenoptic")
    for arguments in stages(suite, one):
        while True:
            path.write_text(after, encoding="utf-8")
            try:
                found = run(folder, suite, [*arguments, *passed_over], end - time.perf_counter())
            finally:
                path.write_text(before, encoding="utf-8")
            if found is None:
                return f"not found in {seconds:g} s"
            if not found[0]:
                break
            begin, (test, why) = time.perf_counter(), found
            without = None if test == "pytest" else run(folder, suite, ["-m", "", test], seconds)
            if without is None or without[0] in ("", "pytest"):
                return f"{test.removeprefix(f'{suite}/')}  [{why[:100]}]"
            print(f"# {test} fails without {one.name}, too", flush=True)
            passed_over.append(f"--deselect={os.path.relpath(test, suite.parent)}")
            end += time.perf_counter() - begin
    return "SURVIVED"


def main() -> None:
    known = mutations()
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", help=f"names with commas between them, of {', '.join(known)}")
    parser.add_argument("--suite", type=Path, default=ROOT / "tests", help="the folder of tests")
    parser.add_argument("--seconds", type=float, default=900.0, help="for each mutation")
    parser.add_argument("--package", type=Path, default=ROOT / "plenoptic", help="the folder of the package")
    given = parser.parse_args()
    for one in known.values():
        one.of(given.package)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        shutil.copytree(given.package, folder / "plenoptic", ignore=shutil.ignore_patterns("__pycache__"))
        asked, env = "import plenoptic; print('#', plenoptic.__file__)", {**os.environ, "PYTHONPATH": name}
        subprocess.run([sys.executable, "-c", asked], cwd=folder, env=env, check=True)
        for one in [known[name] for name in given.only.split(",")] if given.only else known.values():
            begin = time.perf_counter()
            found = verdict(folder, given.suite.resolve(), one, given.seconds)
            print(f"{one.name:24}{one.file:46}{time.perf_counter() - begin:6.0f} s  {found}", flush=True)


if __name__ == "__main__":
    main()

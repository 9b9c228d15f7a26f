"""Light transport beside Mitsuba 3: the same scene through the same thin lens, with the same limit of depth."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from table import Table
from timing import Cost, Task, cost_of, median, taking_turns

import plenoptic as pl

SIDE = 128
PIXELS = SIDE * SIDE
BOUNCES = 8
LIT = 0.1  # of the reference's 99th percentile
REFERENCE_SEED = 1_000_003
WANTED = 2.0
OURS, THEIRS, STRATIFIED = "plenoptic", "Mitsuba scalar_rgb", "Mitsuba scalar_rgb, multijitter"


def tables(*, quick: bool) -> Iterator[Table]:
    programs = _programs()
    usual = {name: program for name, program in programs.items() if name != STRATIFIED}
    yield rates(usual, samples=4 if quick else 128, rounds=1 if quick else 5)
    numbers = (4, 16) if quick else (4, 16, 64, 256)
    yield errors(programs, numbers, converged=32 if quick else 8192, seeds=1 if quick else 5)


class Program(Protocol):
    """Something that renders `objects`."""

    def image(self, samples: int, seed: int) -> NDArray[np.float64]:
        """(H, W): radiance, the mean of the channels."""

    def use(self, threads: int) -> None:
        """How many threads to take from now on."""

    @property
    def reaching(self) -> float:
        """Share of the paths that reach the scene."""


class Plenoptic:
    def __init__(self) -> None:
        self.scene, self.camera, self.threads = _of_tests("mitsuba_scenes").objects(), camera(), 1

    def shot(self, samples: int, seed: int, **settings: Any) -> pl.Exposure:
        settings = {"max_bounces": BOUNCES, "replicates": 1, "threads": self.threads, **settings}
        return pl.render(
            self.scene, self.camera, samples=samples, seed=seed, truth=pl.Truth.NONE, progress=False, **settings
        )

    def image(self, samples: int, seed: int) -> NDArray[np.float64]:
        return np.asarray(self.shot(samples, seed).image.mean(axis=2, dtype=np.float64))

    def use(self, threads: int) -> None:
        self.threads = threads

    @property
    def reaching(self) -> float:
        stats = self.shot(8, 0).stats
        assert stats is not None
        return float(stats.paths_through_lens / stats.paths)

    def nothing(self) -> None:
        """Set everything up and render one path."""
        self.shot(1, 0, region=np.s_[:1, :1])


class Mitsuba:
    reaching = 1.0

    def __init__(self, sampler: str) -> None:
        import mitsuba as mi

        translator, scene = _of_tests("in_mitsuba"), _of_tests("mitsuba_scenes").objects()
        described = translator.described_scene(scene, camera(), max_bounces=BOUNCES)
        described["integrator"]["rr_depth"] = 5  # Mitsuba's own default
        described["sensor"]["sampler"] = {"type": sampler}
        self.scene = mi.load_dict(described)
        # Mitsuba sees radiance: pixels through which all of it passes alike.
        self.white = translator.projected_solid_angles(camera())[..., 0]

    def image(self, samples: int, seed: int) -> NDArray[np.float64]:
        import mitsuba as mi

        rendered = np.array(mi.render(self.scene, spp=samples, seed=seed), dtype=np.float64)
        return np.asarray(rendered.mean(axis=2) * self.white)

    def use(self, threads: int) -> None:
        import drjit

        drjit.set_thread_count(threads)


def camera() -> pl.PlenopticCamera:
    """The double Gauss of the reference camera as a thin lens, without microlenses; 14.5 mm fill the picture."""
    lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0)).with_model(pl.LensModel.THIN)
    sensor = pl.Sensor(shape=(SIDE, SIDE), pixel_pitch=0.0375)
    design = pl.PlenopticCamera(lens=lens, sensor=sensor, stop_to_microlenses=130.0)
    return design.focused_at(z=-404.0).posed(position=(0, 0, 404), look_at=(0, 0, 0), up=(0, 1, 0))


def _programs() -> dict[str, Program]:
    programs: dict[str, Program] = {OURS: Plenoptic()}
    if importlib.util.find_spec("mitsuba") is not None:
        programs |= {THEIRS: Mitsuba("independent"), STRATIFIED: Mitsuba("multijitter")}
    return programs


def _of_tests(module: str) -> Any:
    """What the tests know of the scenes, and how they tell Mitsuba of them."""
    place = str(Path(__file__).resolve().parents[1] / "validation")
    if place not in sys.path:
        sys.path.insert(0, place)
    return importlib.import_module(module)


def rates(programs: Mapping[str, Program], *, samples: int, rounds: int) -> Table:
    """Paths that reach the scene, without what sets it up."""
    shares = {name: program.reaching for name, program in programs.items()}
    rows: list[tuple[object, ...]] = []
    for threads in (1, 2):
        for program in programs.values():
            program.use(threads)
        tasks = {
            (name, amount): Task(lambda _, p=program, n=amount: p.image(n, 1))
            for name, program in programs.items()
            for amount in (samples, 2 * samples)
        }
        costs = taking_turns(tasks, rounds=rounds)  # type: ignore[arg-type]
        added = {name: _added(*(median(costs[name, n]) for n in (samples, 2 * samples))) for name in programs}  # type: ignore[index]
        paths = {name: 1e-6 * samples * PIXELS * shares[name] for name in programs}
        per_cpu = {name: paths[name] / added[name].cpu for name in programs}
        for name in programs:
            compared = name != OURS
            rows.append(
                (
                    threads,
                    name,
                    per_cpu[name],
                    paths[name] / added[name].wall,
                    per_cpu[OURS] / per_cpu[name] if compared else None,
                    WANTED if compared else None,
                )
            )
    columns = (
        "threads",
        "program",
        "million paths per CPU-second",
        "million paths per second of wall time",
        "plenoptic's over it",
        "wanted",
    )
    remark = (
        f"`objects`, {SIDE} x {SIDE} pixels, thin lens, depth limit {BOUNCES} bounces, each program with its own "
        f"Russian roulette. What {samples} samples more cost, medians of {rounds} rounds in turns. {_absent(programs)}"
    )
    return Table("Paths of `objects` through a thin lens, beside Mitsuba", columns, rows, [remark])


def _added(less: Cost, more: Cost) -> Cost:
    """What the second half cost; never nothing, which short runs might show."""
    return Cost(max(more.wall - less.wall, 1e-6), max(more.cpu - less.cpu, 1e-6))


class Row(NamedTuple):
    """What a number of samples costs per pixel and how far it is off, as ratios."""

    samples: int
    ms: float
    median: float
    rms: float


def errors(programs: Mapping[str, Program], numbers: tuple[int, ...], *, converged: int, seeds: int) -> Table:
    """Relative errors on lit pixels against CPU time, one thread, without setting up."""
    ours = Plenoptic()
    truth = ours.image(converged, REFERENCE_SEED)
    lit = truth > LIT * np.percentile(truth, 99)
    runs: dict[str, list[Row]] = {}
    for name, program in programs.items():
        program.use(1)
        nothing = median([cost_of(Task(lambda _: ours.nothing())) for _ in range(5)]).cpu if name == OURS else 0.0
        # Ours reach beyond the others, so that their times lie between two of ours.
        chosen = (numbers[0] // 2, *numbers, 2 * numbers[-1]) if name == OURS else numbers
        runs[name] = [_row(program, n, seeds, truth, lit, nothing) for n in chosen]
    rows: list[tuple[object, ...]] = []
    for name, found in runs.items():
        for row in found:
            ratios = (None, None) if name == OURS else [_over(row, runs[OURS], k) for k in ("median", "rms")]
            rows.append((name, row.samples, row.ms, 100 * row.median, 100 * row.rms, *ratios))
    columns = (
        "program",
        "samples",
        "CPU ms per pixel",
        "median relative error %",
        "relative RMS error %",
        "its median over plenoptic's in the same time",
        "its RMS over plenoptic's in the same time",
    )
    remark = (
        f"{np.count_nonzero(lit)} lit pixels, mean of the channels, {seeds} seeds a row, 1 replicate, one thread; "
        f"plenoptic's {converged} samples with another seed are the reference. Ratios are interpolated between rows; "
        f"cells are empty where plenoptic's rows do not reach the time. {_absent(programs)}"
    )
    return Table("Error against time: `objects` through a thin lens, beside Mitsuba", columns, rows, [remark])


def _row(
    program: Program, samples: int, seeds: int, truth: NDArray[np.float64], lit: NDArray[np.bool_], nothing: float
) -> Row:
    images: list[NDArray[np.float64]] = []
    costs = [cost_of(Task(lambda _, s=seed: images.append(program.image(samples, s)))) for seed in range(seeds)]
    off = [np.abs(image[lit] / truth[lit] - 1.0) for image in images]
    ms = 1e3 * max(median(costs).cpu - nothing, 1e-6) / PIXELS
    return Row(samples, ms, float(np.median(off)), float(np.sqrt(np.mean(np.square(off)))))


def _over(row: Row, others: list[Row], kind: str) -> float | None:
    """An error over that of other rows in the same time, straight between two of them in logarithms."""
    ms = np.array([other.ms for other in others])
    if not ms.min() <= row.ms <= ms.max():
        return None
    order = np.argsort(ms)
    found = np.array([getattr(other, kind) for other in others])[order]
    return float(getattr(row, kind) / np.exp(np.interp(np.log(row.ms), np.log(ms[order]), np.log(found))))


def _absent(programs: Mapping[str, Program]) -> str:
    return "" if len(programs) > 1 else "Mitsuba is not installed; the extra `validation` has it."

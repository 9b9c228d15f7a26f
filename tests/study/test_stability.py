"""Rounding errors of ray tracing against 50 digits, every ray held to its own bound."""

import functools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.command.main import main
from plenoptic.errors import InvalidValueError
from plenoptic.study import stability
from plenoptic.study.stability_study import QUICK, StabilityRow

sys.path.insert(0, str(Path(__file__).parents[1] / "validation"))
import rounding_study
from rounding_study.exact_trace import trace_exactly
from rounding_study.rounding_bounds import EPS, bounds_of
from rounding_study.rounding_cases import GLASS, WIDE, single

CASES = {case.name: case for case in rounding_study.rounding_cases()}


@functools.cache
def quick_table():
    return stability(rays=QUICK)


def test_every_ray_is_within_its_bounds():
    for row in quick_table().rows:
        assert row.holds, row
        assert sum(count for _, count in row.returned) == QUICK, row
    assert quick_table().notes == (f"{len(CASES)} cases, all within their bounds.",)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(3))
def test_every_one_of_many_rays_is_within_its_bounds(part):
    for row in stability(rays=120, seed=1, only=list(CASES)[part::3]).rows:
        assert row.holds, row


def test_cases_return_what_they_are_about():
    returned = {row.case: dict(row.returned) for row in quick_table().rows}
    assert returned["miss"] == {"MISSED": QUICK}
    for name in ("backward rays: the wrong way", "backward rays: the wrong way, plane"):
        assert "OK" not in returned[name], name
    for name in ("total reflection, sphere", "exact tangent", "hyper-hemisphere, in reverse"):
        assert len(returned[name]) >= 2 and "OK" in returned[name], name
    for name in (*(f"grazing, cos i 1e-{k}" for k in range(2, 8)), "radius 1e9, then 1e-3, scene 1 km away"):
        assert returned[name] == {"OK": QUICK}, name
    assert {"OK", "NOT_FINITE"} <= set(returned["wild numbers, double Gauss"])


def exact_of(name, n=QUICK):
    case = CASES[name]
    lens, rays, first, last, reverse = case.setup(np.random.default_rng(5), n)
    return trace_exactly(lens, rays, first, last, reverse=reverse, digits=case.digits)


def test_rays_graze_and_meet_the_critical_angle_down_to_rounding():
    for k in range(2, 8):
        # cos^2 i is off by some ten eps, those of coordinates of up to 10 mm over the radius of 10 mm: 10 % of it at
        # 1e-7.
        cosines = [float(ray.hits[0].cos_i) for ray in exact_of(f"grazing, cos i 1e-{k}")]
        assert cosines == pytest.approx([10.0**-k] * QUICK, rel=0.3), k
    for ray in exact_of("near the axis, 1e-4"):
        assert math.hypot(*map(float, ray.hits[0].point[:2])) <= 1.1e-4
    cos2_t = np.array([float(ray.hits[0].cos2_t) for ray in exact_of("total reflection, sphere", 200)])
    for side in (cos2_t[cos2_t > 0], -cos2_t[cos2_t < 0]):
        assert side.size > 50 and side.min() < 1e-13 and side.max() > 1e-3


def test_some_rays_cross_their_asphere_several_times():
    for shape in ["a ring", "gull wings", "ripples"]:
        lens, rays, k, _, _ = CASES[f"asphere crossed several times: {shape}"].setup(np.random.default_rng(5), 200)
        surface = lens.elements[k]
        points = rays.origin[:, None] + np.linspace(0.0, 20.0, 4001)[:, None] * rays.direction[:, None]
        r = np.hypot(points[..., 0], points[..., 1])
        inside = r <= surface.semi_diameter
        above = points[..., 2] - lens.vertices[k] > surface.sag(np.minimum(r, surface.semi_diameter))
        crossings = np.count_nonzero((above[:, 1:] != above[:, :-1]) & inside[:, 1:] & inside[:, :-1], axis=1)
        assert np.count_nonzero(crossings >= 3) >= 5, shape


def test_bounds_of_one_surface_are_those_of_the_book():
    lens, k = single(pl.Surface(50.0, semi_diameter=45.0), 1.0, GLASS)
    rays = pl.RayBundle([[0, 0.0, -100.0], [20.0, 0.0, -60.0]], [[0, 0, 1.0], [0, 0.1, 1.0]])
    for ray in trace_exactly(lens, rays, k, k):
        bounds, hit = bounds_of(ray, [lens.elements[k]]), ray.hits[0]
        cos_i, cos_t, mu = float(hit.cos_i), math.sqrt(float(hit.cos2_t)), float(hit.mu)
        size = math.hypot(*map(float, hit.point))
        assert bounds.position == pytest.approx(4 * EPS * size / cos_i, rel=1e-12, abs=1e-29)
        assert bounds.direction == bounds.snell == pytest.approx(4 * EPS * (1 + mu * mu) / cos_t, rel=1e-12)
    lens, k = single(pl.Surface(10.0, semi_diameter=5.0), 1.7, 1.5, iris=3.0)
    assert lens.indices()[k : k + 2].tolist() == [1.7, 1.5]
    assert lens.vertices[k] == -3.0 and lens.stop.semi_diameter == WIDE


def made_up(**changed):
    row = StabilityRow("made up", 3, 1e-15, 1.0, 0.5, 0.0, None, None, 1e-9, 0.001, (("OK", 2), ("MISSED", 1)), 0, 0.1)
    return row._replace(**changed)


def test_a_row_beyond_a_bound_is_named(monkeypatch, capsys):
    assert made_up().holds
    for changed in ({"position_ratio": 1.01}, {"snell_ratio": math.nan}, {"direction_ratio": 2.0}, {"wrong": 1}):
        assert not made_up(**changed).holds
    lost = rounding_study.RayErrors(False)
    monkeypatch.setattr(rounding_study, "case_errors", lambda case, **_: ([lost], [("MISSED", 1)]))
    assert main(["study", "stability", "--only", "plane"]) == 1
    assert "2 beyond their bounds: plane, plane, in reverse" in capsys.readouterr().out


def test_the_command_prints_the_table_and_says_what_is_wrong(capsys):
    assert main(["study", "stability", "--quick", "--only", "radius 1e-3", "--markdown"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("| case") and len(lines) == 4 + sum(name.startswith("radius 1e-3") for name in CASES)
    assert f" {QUICK} OK" in lines[3] and len({line.count("|") for line in lines[:-2]}) == 1
    for typed, said in (
        ("--rays 0", "rays is 0; it must be at least 1"),
        ("--only spheres", "no case begins so; the cases are 'double Gauss"),
    ):
        assert main(["study", "stability", *typed.split()]) == 1
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("only", ["plane", b"plane", 5, [3], ["plane", None], [], True], ids=repr)
def test_beginnings_of_names_are_checked_before_anything_runs(only, monkeypatch):
    monkeypatch.setattr("plenoptic.study.stability_study._reference", lambda: pytest.fail("cases are loaded"))
    with pytest.raises(InvalidValueError, match=r"it must be a sequence of names or their beginnings: \['plane'\]"):
        stability(only=only)
    for wrong in ({"rays": "many"}, {"rays": 2.5}, {"rays": True}, {"seed": -1}, {"seed": None}):
        with pytest.raises(InvalidValueError, match=r"(rays|seed) is .*; it must be"):
            stability(**wrong)


def test_without_mpmath_or_the_repository_it_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setattr("plenoptic.study.stability_study.__file__", str(tmp_path / "a" / "b" / "c.py"))
    assert stability(rays=1, only=["plane"]).rows  # the working directory is a clone
    monkeypatch.chdir(tmp_path)
    with pytest.raises(pl.PlenopticError, match="run this in a clone"):
        stability(rays=1, only=["plane"])
    monkeypatch.setitem(sys.modules, "mpmath", None)
    with pytest.raises(pl.PlenopticError, match="pip install mpmath") as caught:
        stability(rays=1, only=["plane"])
    assert isinstance(caught.value, ImportError)


def test_the_same_seed_gives_the_same_numbers_whatever_else_runs():
    alone, among = stability(rays=10, only=["plane"]), stability(rays=10, only=["radius 50", "plane"])
    same = [row for row in among.rows if row.case.startswith("plane")]
    assert [row.cells[:-1] for row in alone.rows] == [row.cells[:-1] for row in same]
    assert stability(rays=10, seed=1, only=["plane"]).rows[0].position != alone.rows[0].position


def test_an_interrupted_study_keeps_the_cases_it_has(monkeypatch, capsys):
    original = rounding_study.case_errors

    def interrupted(case, **options):
        if case.name.startswith("miss"):
            raise KeyboardInterrupt
        return original(case, **options)

    monkeypatch.setattr(rounding_study, "case_errors", interrupted)
    table = stability(rays=10, only=["plane", "miss"])
    assert table.interrupted and len(table.rows) == 2 and repr(table) == "<StudyTable: 2 rows, interrupted>"
    assert table.to_markdown().endswith("bounds.\n\nInterrupted: further rows were asked for.")
    assert main(["study", "stability", "--rays", "10", "--only", "plane", "--only", "miss"]) == 130
    assert "Interrupted: further rows" in capsys.readouterr().out
    with pytest.raises(KeyboardInterrupt):
        stability(rays=10, only=["miss"])

"""The table of an error study: slopes, floors, fronts, recommendations, files and figures of known numbers."""

import csv
import math
import pickle

import matplotlib
import numpy as np
import pytest

import plenoptic as pl
from plenoptic.study import ErrorRow, ErrorTable
from plenoptic.study.error_time.error_table import csv_of
from plenoptic.study.study_table import csv_text, markdown_table

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402

from plenoptic.plots.error_time import plot_error_against_time, plot_error_studies  # noqa: E402

NUMBERS = (16, 32, 64, 128)


def row(variant, n, *, noise=0.4, slope=-0.5, bias=0.0, each=1e-3, setup=0.01, **more):
    """A row of a variant whose noise is a power of the number of samples, and whose time grows evenly with it."""
    variance = noise**2 * n ** (2 * slope)
    times = {"cpu_seconds": setup + each * n, "wall_seconds": setup + 0.5 * each * n}
    times |= {"setup_cpu_seconds": setup, "setup_wall_seconds": setup}
    errors = {"variance": variance, "variance_error": 0.01 * variance, "reported_variance": variance / 1.1**2}
    errors |= {"bias_squared": bias**2, "bias_squared_error": 0.02 * variance}
    return ErrorRow(variant, n, **(times | errors | more))


def table(rows, title="made up"):
    return ErrorTable(
        title, rows, pixels=4096, lit_pixels=4000, seeds=8, threads=2, reference_samples=4096, reference_error=0.001
    )


EXACT = [row("EXACT lens", n, slope=-0.7) for n in NUMBERS]
THIN = [row("THIN lens", n, slope=-0.7, bias=0.03, each=5e-4) for n in NUMBERS]
RANDOM = [row("RANDOM sampler", n) for n in NUMBERS]
MADE = table([*EXACT, *THIN, *RANDOM])


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")


def test_a_row_says_what_its_parts_come_to():
    one = row("THIN lens", 64, noise=0.32, bias=0.03)
    assert one.noise == pytest.approx(0.04) and one.bias == pytest.approx(0.03) and one.error == pytest.approx(0.05)
    assert one.true_over_reported == pytest.approx(1.1)
    assert one.bias_is_found and one.bias_error == pytest.approx(0.02 * 0.04**2 / (2 * 0.03))
    hidden = row("THIN lens", 64, noise=0.32, bias_squared=-1e-5)
    assert hidden.bias == 0 and not hidden.bias_is_found and math.isnan(hidden.bias_error)
    assert hidden.bias_limit == pytest.approx(math.sqrt(2 * 0.02 * 0.04**2))


def test_slopes_are_those_of_the_noise_whatever_the_bias():
    assert [MADE.slope(name) for name in MADE.variants] == pytest.approx([-0.7, -0.7, -0.5])
    # Four points at steps of log 2 of y, each with the error 0.005: 0.005 / (log 2 sqrt(5)).
    assert MADE.slope_error("THIN lens") == pytest.approx(0.005 / (math.log(2) * math.sqrt(5)))
    assert math.isnan(table(EXACT[:1]).slope("EXACT lens"))


def test_floors_come_from_the_row_that_knows_best():
    rows = [row("a", n, bias=bias) for n, bias in zip(NUMBERS, (0.2, 0.1, 0.05, 0.04), strict=True)]
    assert table(rows).bias_floor("a") == pytest.approx(0.04)
    assert MADE.bias_floor("EXACT lens") == 0.0 and MADE.bias_floor("THIN lens") == pytest.approx(0.03)


def test_no_row_beats_the_front_and_the_front_beats_all_others():
    front = MADE.pareto()
    assert [a.cpu_seconds for a in front] == sorted(a.cpu_seconds for a in front)
    for a in MADE.rows:
        better = [b for b in MADE.rows if b.cpu_seconds <= a.cpu_seconds and b.error <= a.error and b != a]
        assert (a in front) == (not better)
    assert {a.variant for a in front} == {"THIN lens", "EXACT lens"}


def test_a_recommendation_inverts_the_model():
    """Noise 0.4 n^-0.7: the number of samples is the least of its kind that does it, inside the rows and beyond."""
    made = table(EXACT)

    def model(n):
        # Beyond the rows the power is one standard error smaller, and promises less.
        return max(n / 128, 1.0) ** made.slope_error("EXACT lens") * 0.4 * n**-0.7

    for target in (0.05, 0.03, 0.02, 0.01, 0.001):
        found = made.recommend(target)
        assert found.error == pytest.approx(model(found.samples), rel=1e-9) and found.error <= target
        # The next smaller number of the form 4 ... 7 times a power of 2 would not.
        step = 1 << (found.samples.bit_length() - 3)
        assert model(found.samples - (step if found.samples != 4 * step else step // 2)) > target
        assert found.cpu_seconds == pytest.approx(0.01 + 1e-3 * found.samples), target
        assert found.wall_seconds == pytest.approx(0.01 + 5e-4 * found.samples), target
        assert found.extrapolated == (found.samples > 128) == ("extrapolated from 128" in str(found)), target
    # Nothing is promised below the fewest samples.
    found = made.recommend(0.5)
    assert found.samples == 16 and "16 samples are the fewest" in str(found)


def test_the_cheapest_variant_is_chosen_as_long_as_its_bias_allows():
    assert MADE.recommend(0.05).variant == "THIN lens"
    # 0.032^2 leaves a noise of 0.0111, for which THIN needs 167 samples at half the price of 37 of EXACT.
    found = MADE.recommend(0.032)
    assert (found.variant, found.samples) == ("EXACT lens", 40)
    below = MADE.recommend(0.02)
    assert below.variant == "EXACT lens" and "THIN lens cannot: its bias of 3 % is above 2 %" in str(below)
    # The bias is part of what is expected; one that could be hidden is named.
    found = table(THIN).recommend(0.05)
    assert found.bias == pytest.approx(0.03) and found.error <= 0.05
    assert found.error == pytest.approx(math.hypot(0.03, 0.4 * found.samples**-0.7))
    unsure = [row("unsure", n, bias_squared_error=1e-4) for n in NUMBERS]
    assert "a bias of unsure below 1.4 % would not have been found" in str(table(unsure).recommend(0.02))


def test_what_is_impossible_or_not_reached_is_refused_with_the_reasons():
    flat = [row("stuck", n, slope=0.0) for n in NUMBERS]
    for make, text in (
        (lambda: table(THIN).recommend(0.01), "1 %, which no variant reaches; THIN lens cannot: its bias of 3 %"),
        (lambda: table(flat).recommend(0.01), "stuck cannot: its error was not seen to fall"),
        (lambda: MADE.recommend(0.0), "target_error is 0"),
        (lambda: MADE.recommend(5), "target_error is 5, which is 500 %"),
        (lambda: MADE.slope("thin"), "'thin'; it must be one of 'EXACT lens', 'THIN lens'"),
        (lambda: table([EXACT[0], EXACT[0]]), "two rows"),
        (lambda: table([]), "one ErrorRow or more"),
        (lambda: plot_error_studies([]), "tables"),
        (lambda: plot_error_against_time(EXACT), "table is an? "),
    ):
        with pytest.raises(pl.errors.InvalidValueError, match=text):
            make()


def test_what_reports_no_errors_is_named_with_what_does():
    silent = [row("1 replicate", n, noise=0.3, slope=-0.7, reported_variance=None) for n in NUMBERS]
    found = table([*EXACT, *silent]).recommend(0.02)
    assert found.variant == "1 replicate" and found.samples < 80
    # 0.4 n^-0.7 is 0.02 at 72.2, and 80 takes 0.09 s.
    assert "no standard errors; EXACT lens does, with 80 samples in 0.09 CPU-s" in str(found)
    assert "1 replicate reports no standard errors" in str(table(silent).recommend(0.02))


def test_files_hold_every_number(tmp_path):
    path = tmp_path / "study.csv"
    no_errors = table([row("1 replicate", n, reported_variance=None) for n in NUMBERS], 'white, "quoted"')
    text = no_errors.to_csv(path)
    assert path.read_text(encoding="utf-8") == text == no_errors.to_csv()
    lines = list(csv.DictReader(csv_of([MADE, no_errors], None).splitlines()))
    for line, one in zip(lines, (*MADE.rows, *no_errors.rows), strict=True):
        numbers = {name: "" if number is None else str(number) for name, number in one._asdict().items()}
        assert numbers.items() <= line.items() and (line["pixels"], line["interrupted"]) == ("4096", "False")
    assert {line["title"] for line in lines} == {"made up", 'white, "quoted"'}
    with pytest.raises(pl.errors.FileError, match="make it first"):
        MADE.to_csv(tmp_path / "nowhere" / "study.csv")
    assert pickle.loads(pickle.dumps(MADE)) == MADE and table([*reversed(EXACT)]) == table(EXACT)


def cells(markdown):
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.splitlines()]


def test_columns_are_padded_and_signs_escaped():
    escaped = ["| a  | b    |", "| -- | ---- |", r"| 10 | x\|y |"]
    assert markdown_table([(("a", "10"), ("b", "x|y"))]).splitlines() == escaped
    lines = csv_text([{"name": "a, b", "s": None}, {"name": "c", "s": 0.1}], None).splitlines()
    assert lines == ["name,s", '"a, b",', "c,0.1"]


def test_markdown_shows_the_numbers():
    first, second = MADE.to_markdown().split("\n\n")
    head, rule, *body = cells(first)
    assert set(rule[0]) == {"-"} and len(body) == len(MADE.rows)
    assert {len(line) for line in (head, *body)} == {len(head)}
    for line, one in zip(body, MADE.rows, strict=True):
        shown = dict(zip(head, line, strict=True))
        assert (shown["variant"], int(shown["samples"])) == (one.variant, one.samples)
        # Three digits are shown.
        assert float(shown["CPU s"]) == pytest.approx(one.cpu_seconds, rel=5e-3)
        assert float(shown["error %"]) == pytest.approx(100 * one.error, rel=5e-3)
        assert float(shown["CPU us per pixel"]) == pytest.approx(1e6 * one.cpu_seconds / 4096, rel=5e-3)
        assert (shown["front"] == "*") == (one in MADE.pareto())
    _, _, *body = cells(second)
    assert [line[0] for line in body] == list(MADE.variants)
    assert [float(line[1].split()[0]) for line in body] == pytest.approx([-0.7, -0.7, -0.5], abs=5e-4)
    assert body[1][2].startswith("3.0") and body[0][2].startswith("< ")


def test_the_figure_has_axes_units_title_slopes_floors_and_the_front():
    ax = MADE.plot()
    ax.figure.canvas.draw()
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert ax.get_xlabel() == "CPU time of 4096 pixels / s" and ax.get_ylabel() == "relative RMS error / %"
    assert ax.get_title() == "Error against time: made up"
    lines = {line.get_label(): line for line in ax.get_lines()}
    assert np.allclose(lines["EXACT lens: $n^{-0.70}$"].get_xydata()[:, 1], [100 * one.error for one in EXACT])
    floor = lines["bias of THIN lens, 3 %"]
    assert floor.get_linestyle() == "--" and np.allclose(floor.get_ydata(), 3.0)
    assert not any("bias of EXACT" in label for label in lines)
    front = lines["Pareto front, with n"].get_xydata()
    assert np.allclose(front, [[one.cpu_seconds, 100 * one.error] for one in MADE.pareto()])
    assert len(ax.get_legend().get_texts()) == 3 + 1 + 1
    figure = plot_error_studies([MADE, table(EXACT, "other")])
    assert [ax.get_title() for ax in figure.axes] == ["Error against time: made up", "Error against time: other"]

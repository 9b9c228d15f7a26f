"""What leaving out saves: bundled renderings without one of their stages, and the plain camera with one part more."""

import numpy as np
from parts import part_costs
from table import Table

from plenoptic.study.cost.cases import COST_CASES
from plenoptic.study.cost.measurement import cost_of

CASES = ("white", "check", "objects", "furnished")


def tables(*, quick):
    for case in CASES[:1] if quick else CASES:
        yield omitted(case, quick=quick)
    yield part_costs(quick=quick)


def omitted(case, *, quick):
    """CPU time of a bundled rendering with and without each stage that runs."""
    # The furnished case has some forty stages, and every one of its paths does all that there is.
    samples, rounds, side = (8, 2, 64) if quick else (8, 5, 48) if case == "furnished" else (32, 9, 128)
    plan = COST_CASES[case]()
    centre = plan.subject.camera.sensor.shape[0] // 2
    middle = slice(centre - side // 2, centre + side // 2)
    found = cost_of(plan, samples=samples, rounds=rounds, region=np.s_[middle, middle])
    rows = []
    for row in found.dearest:
        costs = (row.with_it, row.without_it, row.percent, row.standard_error, 1000 * row.set_up)
        name = row.stage.name.lower().replace("_", " ")
        rows.append((name, row.instead, *costs, row.picture_change, len(row.also)))
    columns = (
        "stage | without it | CPU s per million paths with it | without | % of the CPU time | standard error | set-"
        "up, ms | picture changes by % | stages that stop too"
    )
    title = f"What leaving out saves: `{case}`, {side} x {side} pixels, {samples} samples, one thread, {rounds} rounds"
    remarks = [
        f"All of it takes {found.cpu_per_million:.3g} CPU s per million paths and {found.set_up:.2f} s of set-up.",
        *(f"Not left out: {stage.name.lower()}: {reason}." for stage, reason in found.kept),
    ]
    return Table(title, columns, rows, remarks)

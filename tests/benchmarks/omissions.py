"""What leaving out saves: the reference camera with one thing more or less."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import reference
from parts import part_costs
from table import Table
from timing import Task, median, taking_turns

import plenoptic as pl
from plenoptic.camera.truth import Truth


class Variant(NamedTuple):
    """A camera, a scene and how it is rendered."""

    camera: pl.PlenopticCamera
    scene: pl.Scene | None
    replicates: int = 8
    truth: Truth = Truth.NONE


def tables(*, quick: bool) -> Iterator[Table]:
    samples, rounds = (1, 1) if quick else (16, 5)
    camera, check = reference.camera(), pl.check_scene()
    yield compared("white image", white_variants(camera), samples=samples, rounds=rounds)
    yield compared("`check`", check_variants(camera, check), samples=samples, rounds=rounds)
    yield compared("`objects`", objects_variants(camera), samples=samples, rounds=rounds)
    yield part_costs(quick=quick)


def white_variants(camera: pl.PlenopticCamera) -> dict[str, Variant]:
    spherical = dataclasses.replace(camera.microlenses, model=pl.MicrolensModel.SPHERICAL)
    bare = dataclasses.replace(camera, microlenses=None, microlenses_to_sensor=0.0, stop_to_microlenses=camera.z_sensor)
    return {
        "reference: thin microlenses, round stop, 8 replicates": Variant(camera, None),
        "spherical microlenses": Variant(dataclasses.replace(camera, microlenses=spherical), None),
        "no microlenses": Variant(bare, None),
        "stop of 6 blades": Variant(_with_stop(camera, pl.PolygonStop(blades=6, semi_diameter=5.0)), None),
        "1 replicate: no standard error": Variant(camera, None, replicates=1),
    }


def check_variants(camera: pl.PlenopticCamera, check: pl.Scene) -> dict[str, Variant]:
    # The pose is the world's own: the same rays, but turned and moved.
    posed = camera.posed(position=(0, 0, 0), look_at=(0, 0, -404))
    return {
        "reference: no pose, no depth, 8 replicates": Variant(camera, check),
        "no scene: a white image": Variant(camera, None),
        "depth": Variant(camera, check, truth=Truth.DEPTH),
        "all truth": Variant(camera, check, truth=Truth.ALL),
        "pose": Variant(posed, check),
        "1 replicate: no standard error": Variant(camera, check, replicates=1),
    }


def objects_variants(camera: pl.PlenopticCamera) -> dict[str, Variant]:
    scene = pl.objects_scene()
    return {
        "reference: light and background": Variant(camera, scene),
        "no background": Variant(camera, dataclasses.replace(scene, background=None)),
        "no light": Variant(camera, dataclasses.replace(scene, lights=())),
        "depth": Variant(camera, scene, truth=Truth.DEPTH),
    }


def _with_stop(camera: pl.PlenopticCamera, stop: pl.CircularStop | pl.PolygonStop) -> pl.PlenopticCamera:
    return dataclasses.replace(camera, lens=camera.lens.with_stop(stop))


def compared(title: str, variants: dict[str, Variant], *, samples: int, rounds: int) -> Table:
    """CPU time of each variant per path, and over the first one's."""
    stats: dict[str, pl.RenderStats] = {}

    def task(name: str, variant: Variant) -> Task:
        def run(_: None) -> None:
            shot = reference.exposed(
                variant.scene,
                variant.camera,
                samples=samples,
                replicates=variant.replicates,
                truth=variant.truth,
                threads=1,
            )
            stats[name] = shot.stats

        return Task(run)

    costs = taking_turns({name: task(name, variant) for name, variant in variants.items()}, rounds=rounds)
    rows, first = [], None
    for name in variants:
        cost, million = median(costs[name]), 1e-6 * stats[name].paths
        first = cost.cpu / million if first is None else first
        rows.append(
            (
                name,
                cost.wall / million,
                cost.cpu / million,
                100 * stats[name].fraction_through_lens,
                cost.cpu / million / first,
            )
        )
    columns = (
        "variant",
        "wall s per million paths",
        "CPU s per million paths",
        "% of paths leave the lens",
        "CPU time over the reference's",
    )
    return Table(f"What leaving out saves: {title}, 512 x 512 pixels, {samples} samples, one thread", columns, rows)

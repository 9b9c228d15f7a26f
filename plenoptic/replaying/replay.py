"""One path of an exposure, from the sensor to light, as a value and as a table."""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
from numpy.typing import ArrayLike

from plenoptic.core.values import Floats, result
from plenoptic.replaying.events import (
    DirectLight,
    ElementPassage,
    Escape,
    Event,
    Meeting,
    MicrolensPassage,
    PathEnding,
    Place,
    SensorPoint,
    WorldRay,
)

_NAMES = {SensorPoint: "sensor", MicrolensPassage: "array", ElementPassage: "lens", WorldRay: "world"}
"""First column of the table; others are hits."""


@result
class Replay:
    """One path of an exposure, traced again, which prints as a table of its events. See `replay`."""

    pixel: tuple[int, int]
    """Row and column on the whole sensor."""
    sample: int
    """Number of the path in its pixel."""
    replicate: int
    index: int
    """Number of its sampling point in the replicate."""
    wavelength: float | None
    """nm; None if all paths have the camera's."""
    events: tuple[Event, ...]
    """In order: `SensorPoint`, `MicrolensPassage`, an `ElementPassage` for each element of the lens, `WorldRay`, a
    `Meeting` for each surface, and an `Escape` if the path leaves the scene. Fewer if it ends before."""
    ending: PathEnding
    weight: float
    """Factor of the radiance, sr; 0 for a lost path."""
    certain: float
    """Projected solid angle of the unvignetted core, sr, which white images add to the path; 0 for other images."""
    radiance: Floats
    """(c,): radiance along the path after clamping; c = 1 with a wavelength, and for grey scenes."""
    clamped: float
    """Fraction of the radiance that `clamp` left, in (0, 1]."""
    contribution: Floats
    """(C,): addition to the sum of its pixel, in units of the image: with n samples, the pixel's value is the sum of
    their contributions over n. Channels that are not finite count as 0, as in the image."""
    finite: bool
    """True if all channels were finite."""

    @property
    def bounces(self) -> tuple[Meeting, ...]:
        """Hits of the path on surfaces of the scene."""
        return tuple(event for event in self.events if isinstance(event, Meeting))

    @property
    def camera_points(self) -> Floats:
        """(n, 3): points of the path in the camera, in its axes, mm: sensor, array and the elements of the lens.

        `plenoptic.plots.lens.plot_layout(camera.lens, [path.camera_points[None]])` draws them.
        """
        points: list[Floats | None] = []
        for event in self.events:
            if isinstance(event, MicrolensPassage):
                points.append(event.aim)
            if isinstance(event, SensorPoint | MicrolensPassage | ElementPassage):
                points.append(event.point)
        return np.array([point for point in points if point is not None]).reshape(-1, 3)

    @property
    def first_nonfinite(self) -> int | None:
        """Index of the first event with a number that is not finite; None if all are finite, though sums overflow."""
        return next((number for number, event in enumerate(self.events) if not _is_finite(event)), None)

    def __repr__(self) -> str:
        row, column = self.pixel
        wave = "" if self.wavelength is None else f", {self.wavelength:g} nm"
        sample = f"replicate {self.replicate}, point {self.index}{wave}"
        table, bounce, first = [], 0, self.first_nonfinite
        for number, event in enumerate(self.events):
            table.append((_NAMES.get(type(event), f"bounce {bounce}"), _describe(event)))
            bounce += isinstance(event, Meeting)
            if number == first:
                table.append(("", ["not finite from here on"]))
        clamped = "" if self.clamped == 1 else f", clamped to {self.clamped:.3g} of it"
        core = [f"and {self.certain:.6g} sr beside it that surely pass"] if self.certain else []
        dropped = "" if self.finite else ", not finite: left out of the image"
        table += [
            ("ends", [_name(self.ending)]),
            ("brings", [f"radiance {_numbers(self.radiance)}{clamped}, times {self.weight:.6g} sr", *core]),
            ("adds", [f"{_numbers(self.contribution)}{dropped}"]),
        ]
        rows = [f"{name if k == 0 else '':<11}{text}" for name, texts in table for k, text in enumerate(texts)]
        return "\n".join([f"sample {self.sample} of pixel ({row}, {column}): {sample}", *rows])


def _is_finite(event: Event | DirectLight) -> bool:
    items = [getattr(event, field.name) for field in dataclasses.fields(event)]
    numbers = all(np.isfinite(item).all() for item in items if isinstance(item, np.ndarray | float))
    return numbers and all(_is_finite(item) for item in items if isinstance(item, DirectLight))


def _describe(event: Event) -> list[str]:
    """Lines of an event in the table."""
    if isinstance(event, SensorPoint):
        return [f"from {_point(event.point)}"]
    if isinstance(event, MicrolensPassage):
        return _array_lines(event)
    if isinstance(event, ElementPassage):
        return [_element_line(event)]
    if isinstance(event, WorldRay):
        return [f"from {_point(event.origin)} towards {_numbers(event.direction)}"]
    if isinstance(event, Escape):
        return [f"meets nothing towards {_numbers(event.direction)}, sees {_numbers(event.emitted)}"]
    return _meeting_lines(event)


def _array_lines(event: MicrolensPassage) -> list[str]:
    which = "no microlenses" if event.microlens is None else f"microlens {event.microlens}, type {event.type}"
    lines = [f"{which}, aimed at {_point(event.aim)}, {event.weight:.6g} sr"]
    if event.point is None or event.direction is None:
        return [*lines, f"lost: {_name(event.status)}"]
    return [*lines, f"leaves {_point(event.point)} towards {_numbers(event.direction)}"]


def _element_line(event: ElementPassage) -> str:
    point = "" if event.point is None else f" at {_point(event.point)}"
    continuation = f"lost: {_name(event.status)}" if event.after is None else f"towards {_numbers(event.after)}"
    return f"{event.element:>2} {_name(event.kind)}{point}, {continuation}"


def _meeting_lines(event: Meeting) -> list[str]:
    lines = [
        f"{_which(event.place)}, {type(event.material).__name__}, after {event.distance:.7g} mm",
        f"at {_point(event.point)}, normal {_numbers(event.normal)}",
    ]
    if event.emitted.any():
        lines.append(f"emits {_numbers(event.emitted)}")
    if event.light is not None:
        lines.append(_light_line(event.light))
    if event.direction is not None and event.throughput is not None:
        lines.append(f"goes on towards {_numbers(event.direction)}, throughput {_numbers(event.throughput)}")
    return lines


def _light_line(light: DirectLight) -> str:
    name = f"light: {_name(light.kind)}"
    if light.place is not None:
        name = f"light: {_which(light.place)}"
    elif light.light is not None:
        name += f" {light.light}"
    if light.point is None:
        return f"{name}, shines the other way"
    if light.blocked is None:
        return f"{name} at {_point(light.point)}, of which nothing is scattered here"
    effect = "is blocked" if light.blocked else f"adds {_numbers(light.contribution)}"
    return f"{name} at {_point(light.point)} {effect}"


def _which(place: Place) -> str:
    instance = "" if place.instance is None else f", instance {place.instance}"
    return f"object {place.object}{instance}, triangle {place.triangle}"


def _name(member: enum.IntEnum) -> str:
    return member.name.lower().replace("_", " ")


def _numbers(array: ArrayLike) -> str:
    return "(" + ", ".join(f"{number:.6g}" for number in np.ravel(array)) + ")"


def _point(array: ArrayLike) -> str:
    return f"{_numbers(array)} mm"

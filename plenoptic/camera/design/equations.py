"""Targets of a plenoptic camera's design, and its equations, solved one after the other.

Unknowns: distance from array to sensor b, focal length f, pitch p, semi-diameter h of the iris, position of the array
L, distance behind the array s of the image in focus, virtual depth v. With the images of the main lens known, each
equation contains at most three unknowns. Equations with a single unknown are solved for it until none is left.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable
from typing import NamedTuple

from plenoptic.camera.gaussian import CameraKind, check_real_image
from plenoptic.core.values import check_kind, choice, number, positive
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.matrices import over
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.lattice import Lattice

FIELDS = {
    "h": "semi_diameter",
    "L": "stop_to_microlenses",
    "b": "microlenses_to_sensor",
    "p": "pitch",
    "f": "focal_length",
}
"""Public names of the unknowns."""
Numbers = dict[str, float]


class ImageFill(enum.IntEnum):
    """Targets for the diameter of micro images over their distance other than numbers.

    Examples
    --------
    See `design_camera`.
    """

    TOUCHING = 0
    """Micro images touch with their border, which fades out since the exit pupil is not in focus on the sensor: 1 less
    the border, but at least a half."""


@dataclasses.dataclass(frozen=True)
class DesignTargets:
    """Targets of a design; None for no target."""

    kind: CameraKind
    z: float | None
    depth_at: float | None
    image_fill: float | ImageFill | None
    virtual_depth: float | None
    disparity: float | None
    pixel_pitch: float

    @property
    def sign(self) -> float:
        """Sign of the image distance s."""
        return 1.0 if self.kind is CameraKind.GALILEAN else -1.0

    @property
    def names(self) -> list[str]:
        """Names of the targets."""
        required = [
            name for name in ("z", "image_fill", "virtual_depth", "disparity") if getattr(self, name) is not None
        ]
        return ["kind", *required] if self.kind is CameraKind.PLENOPTIC_1 else required


def check_targets(targets: DesignTargets, lens: LensStack, wavelength: float) -> None:
    """Raise an InvalidValueError for targets that contradict each other, or planes without a real image."""
    kind, z, depth_at = targets.kind, targets.z, targets.depth_at
    if kind is CameraKind.CONVENTIONAL:
        raise InvalidValueError(
            "kind is CONVENTIONAL, a camera without microlenses; focus one with camera.focused_at(z)"
        )
    if (kind is CameraKind.CAMERA_ARRAY) != (lens.model is LensModel.NONE):
        raise InvalidValueError(
            f"kind is {kind.name} and the lens has the model LensModel.{lens.model.name}; a CAMERA_ARRAY needs "
            "lens.with_model(LensModel.NONE), and all others another model"
        )
    for name, plane in (("z", z), ("depth_at", depth_at)):
        if plane is not None:
            check_real_image(lens, number(plane, name), wavelength, name)
    for name in ("image_fill", "virtual_depth", "disparity"):
        if getattr(targets, name) is not None and not isinstance(getattr(targets, name), ImageFill):
            positive(getattr(targets, name), name)
    if targets.virtual_depth is not None and targets.disparity is not None:
        raise InvalidValueError("virtual_depth and disparity say the same; give one of them")
    depth = targets.virtual_depth is not None or targets.disparity is not None
    if depth_at is not None and (z is None or not depth):
        raise InvalidValueError(
            "depth_at is the plane of virtual_depth or disparity, in a camera that is focused at z; give these too"
        )
    if kind is CameraKind.PLENOPTIC_1 and (targets.virtual_depth is not None or (depth and depth_at in (None, z))):
        raise InvalidValueError(
            "a PLENOPTIC_1 camera has virtual depth and disparity 0 in the plane in focus; ask for a disparity at "
            "another plane depth_at, or for another kind"
        )


def template_array(
    microlenses: MicrolensArray | None, pitch: float | None, focal_length: float | None, lattice: Lattice
) -> MicrolensArray:
    """Array whose pitch and focal length the design replaces unless they are fixed."""
    if microlenses is not None:
        check_kind(microlenses, "microlenses", MicrolensArray, "pl.MicrolensArray(0.2, (2.0,))")
        if pitch is not None or focal_length is not None:
            raise InvalidValueError(
                "microlenses have a pitch and a focal length already; leave out pitch and focal_length"
            )
        return microlenses
    if choice(lattice, Lattice, "lattice") in (Lattice.RECTANGULAR, Lattice.FREE):
        raise InvalidValueError(f"lattice is {lattice!r}, which needs more than a pitch; give microlenses")
    pitch, focal_length = 1.0 if pitch is None else pitch, 1.0 if focal_length is None else focal_length
    return MicrolensArray(pitch=pitch, focal_lengths=(focal_length,), lattice=lattice)


def check_count(targets: DesignTargets, fixed: Numbers) -> None:
    """Raise an InvalidValueError unless there are as many targets as numbers to solve for."""
    required, unknowns = targets.names, [FIELDS[u] for u in FIELDS if u not in fixed]
    fill = "; image_fill=None is no target" if targets.image_fill is not None else ""
    if len(required) > len(unknowns):
        raise InvalidValueError(
            f"{len(required)} targets ({', '.join(required)}) for {len(unknowns)} open numbers "
            f"({', '.join(unknowns) or 'none'}) are too many; leave out {len(required) - len(unknowns)} of the targets "
            f"or of the numbers given{fill}"
        )
    if len(required) < len(unknowns):
        raise InvalidValueError(
            f"{len(required)} targets ({', '.join(required) or 'none'}) for {len(unknowns)} open numbers "
            f"({', '.join(unknowns)}) are too few; give {len(unknowns) - len(required)} more"
        )


class MainLensState(NamedTuple):
    """Properties of the main lens by tracing, from the last iteration."""

    image: float
    """z of the image of the plane in focus, mm."""
    shift: float
    """Distance behind it of the image of the plane for which depth or disparity is a target, mm."""
    slope: float
    """Slope of the marginal ray at the array per mm of the iris, 1/mm."""
    vergence: float
    """1 / distance from exit pupil to array, 1/mm."""
    fill: float
    """Target for the diameter of micro images over their distance; nan without."""


Rule = tuple[str, tuple[str, ...], Callable[[Numbers, str], float]]
"""Name of an equation, its unknowns, and the function that solves it for one of them."""


def solve(targets: DesignTargets, fixed: Numbers, lens: MainLensState) -> Numbers:
    """Solve for all unknowns; InvalidValueError if they are not determined or impossible."""
    values, rules = dict(fixed), _rules(targets, lens)
    while True:
        rule = next((rule for rule in rules if sum(u not in values for u in rule[1]) <= 1), None)
        if rule is not None:
            name, rule_unknowns, solve_rule = rule
            missing = [u for u in rule_unknowns if u not in values]
            if not missing:
                raise InvalidValueError(
                    f"{name} has nothing left to choose: its numbers are given or follow from other targets; leave "
                    f"out {name}, or one of the numbers given"
                )
            values[missing[0]] = _check_solution(solve_rule(values, missing[0]), missing[0], name, targets)
            rules.remove(rule)
        elif not _solve_pair(values, rules, targets, lens):
            break
    undetermined = [FIELDS[u] for u in FIELDS if u not in values]
    if undetermined:
        raise InvalidValueError(
            f"{' and '.join(undetermined)} cannot be found from {', '.join(targets.names)} alone; give one of them, "
            "or a microlens array with pitch and focal length"
        )
    return values


def _rules(targets: DesignTargets, lens: MainLensState) -> list[Rule]:
    rules: list[Rule] = []
    first = targets.kind is CameraKind.PLENOPTIC_1
    if first:
        rules.append(("kind", ("b", "f"), lambda n, u: n["f" if u == "b" else "b"]))
    else:
        rules.append(("sharpness", ("b", "f", "s"), _sharpness))
    if targets.z is not None and first:
        rules.append(("z", ("L",), lambda n, u: lens.image))
    elif targets.z is not None:
        rules.append(("z", ("L", "s"), lambda n, u: lens.image - n["s" if u == "L" else "L"]))
    if first and targets.disparity is not None:
        area = abs(lens.shift) * targets.pixel_pitch / targets.disparity
        rules.append(("disparity", ("b", "p"), lambda n, u: area / n["p" if u == "b" else "b"]))
    elif targets.virtual_depth is not None or targets.disparity is not None:
        rules.append(("virtual depth", ("v", "s", "b"), lambda n, u: _depth(n, u, targets.sign, lens.shift)))
    if targets.virtual_depth is not None:
        v = targets.virtual_depth
        rules.append(("virtual_depth", ("v",), lambda n, u: v))
    if targets.disparity is not None and not first:
        per_pixel = targets.disparity * targets.pixel_pitch
        rules.append(("disparity", ("v", "p"), lambda n, u: n["p"] / per_pixel if u == "v" else n["v"] * per_pixel))
    if targets.image_fill is not None:
        rules.append(("image_fill", ("h", "b", "p"), lambda n, u: _fill(n, u, lens.fill, lens)))
    return rules


def _sharpness(n: Numbers, u: str) -> float:
    """Solve 1/b - 1/f = 1/s for one unknown."""
    if u == "s":
        return over(n["b"] * n["f"], n["f"] - n["b"])
    if u == "b":
        return over(n["f"] * n["s"], n["f"] + n["s"])
    return over(n["b"] * n["s"], n["s"] - n["b"])


def _depth(n: Numbers, u: str, sign: float, shift: float) -> float:
    """Solve v b = |s + shift| (virtual depth) for one unknown."""
    if u == "s":
        return sign * n["v"] * n["b"] - shift
    distance = sign * (n["s"] + shift)
    return distance / n["b"] if u == "v" else distance / n["v"]


def _fill(n: Numbers, u: str, fill: float, lens: MainLensState) -> float:
    """Solve 2 b h slope = fill p (1 + b vergence) for one unknown."""
    if u == "h":
        return fill * n["p"] * (1.0 + n["b"] * lens.vergence) / (2.0 * n["b"] * lens.slope)
    if u == "p":
        return 2.0 * n["b"] * n["h"] * lens.slope / (fill * (1.0 + n["b"] * lens.vergence))
    return over(fill * n["p"], 2.0 * n["h"] * lens.slope - fill * n["p"] * lens.vergence)


def _solve_pair(values: Numbers, rules: list[Rule], targets: DesignTargets, lens: MainLensState) -> bool:
    """Solve for b if no single equation determines it: a quadratic in b, from sharpness and virtual depth.

    With f and v known, v b = +-(b f / (f - b) + shift). With f and h known, v follows from the disparity and the pitch,
    and the pitch from the image fill: p = 2 b h slope / fill / (1 + b vergence).
    """
    names = {rule[0] for rule in rules}
    if not {"sharpness", "virtual depth"} <= names or "f" not in values or {"b", "s"} & set(values):
        return False
    f, sign = values["f"], targets.sign
    if "v" in values:
        v = values["v"]
        b = _larger_root(v, sign * (f - lens.shift) - v * f, sign * lens.shift * f, f, sign)
        target = f"virtual depth {v:.4g}"
    elif {"disparity", "image_fill"} <= names and "h" in values and "p" not in values and lens.shift == 0:
        assert targets.disparity is not None
        per_b, per_v = 2.0 * values["h"] * lens.slope / lens.fill, targets.disparity * targets.pixel_pitch
        b = _larger_root(per_b, sign * f * per_v * lens.vergence - per_b * f, sign * f * per_v, f, sign)
        target = f"disparity {targets.disparity:.4g}"
    else:
        return False
    if b is None:
        remedy = "a virtual depth above 1" if targets.kind is CameraKind.GALILEAN else "a larger virtual depth"
        raise InvalidValueError(
            f"{target} cannot be had with microlenses of focal length {f:.4g} mm in a camera of kind "
            f"{targets.kind.name}; ask for {remedy}, or for a smaller disparity"
        )
    values["b"] = b
    if "v" in values:
        rules[:] = [rule for rule in rules if rule[0] != "virtual depth"]
    else:
        # One of the remaining equations follows from the others.
        rules[:] = [rule for rule in rules if rule[0] != "disparity"]
    return True


def _larger_root(a: float, b: float, c: float, f: float, sign: float) -> float | None:
    """Larger root x > 0 of a x^2 + b x + c for which the image, x f / (f - x), lies on the side given by `sign`."""
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0:
        return None
    # The form without cancellation.
    half = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    roots = [half / a, c / half] if half != 0 else [0.0]
    return max((x for x in roots if x > 0 and x != f and sign * (f - x) * f > 0), default=None)


def _check_solution(solution: float, unknown: str, rule: str, targets: DesignTargets) -> float:
    """Return a solution; InvalidValueError if it is impossible."""
    if unknown == "s":
        if not targets.sign * solution > 0:
            side = "behind" if targets.kind is CameraKind.GALILEAN else "in front of"
            raise InvalidValueError(
                f"a camera of kind {targets.kind.name} needs its image {side} the array, and {rule} puts it "
                f"{solution:.4g} mm behind; choose another kind, or change the numbers given"
            )
        return solution
    is_possible = math.isfinite(solution) and (solution > 0 or (unknown == "f" and solution < 0))
    if not is_possible:
        name = FIELDS.get(unknown, "virtual depth")
        raise InvalidValueError(
            f"{rule} would need {name} = {solution:.4g}, which is impossible; change the targets, or fix fewer numbers"
        )
    return solution

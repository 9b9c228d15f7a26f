"""The equations of a plenoptic camera's design, solved one after the other.

Unknowns: distance from array to sensor b, focal length f, pitch p, semi-diameter h of the iris, place of the array L,
place of the sharp image behind the array s, virtual depth v. With the lens's images known, each equation holds three of
them at most, and any that has one unknown left is solved for it, until none is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from plenoptic.camera.design.wishes import FIELDS, Numbers, Wishes
from plenoptic.camera.report.focus import CameraKind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.gaussian.matrices import over


class Lens(NamedTuple):
    """Traced properties of the main lens, from the last round."""

    image: float
    """z of the image of the plane in focus, mm."""
    shift: float
    """How far behind that the image lies of the plane for which a depth or disparity is wanted, mm."""
    slope: float
    """Slope of the rim ray at the array for each mm of the iris, 1/mm."""
    vergence: float
    """1 / distance from exit pupil to array, 1/mm."""


Rule = tuple[str, tuple[str, ...], Callable[[Numbers, str], float]]
"""A name, the unknowns, and what gives one of them from the others."""


def solved(wishes: Wishes, given: Numbers, lens: Lens) -> Numbers:
    """All unknowns, from those given; an error where they are not determined or impossible."""
    values, rules = dict(given), _rules(wishes, lens)
    while True:
        rule = next((rule for rule in rules if sum(u not in values for u in rule[1]) <= 1), None)
        if rule is not None:
            name, unknowns, solve = rule
            missing = [u for u in unknowns if u not in values]
            if not missing:
                raise InvalidValueError(
                    f"{name} has nothing left to choose: what it acts on is given or follows from the rest; leave "
                    f"out {name}, or one of what is given"
                )
            values[missing[0]] = _possible(solve(values, missing[0]), missing[0], name, wishes)
            rules.remove(rule)
        elif not _solved_pair(values, rules, wishes, lens):
            break
    open_ = [FIELDS[u] for u in FIELDS if u not in values]
    if open_:
        raise InvalidValueError(
            f"{' and '.join(open_)} cannot be found from {', '.join(wishes.names)} alone; give one of them, "
            "or a microlens array with pitch and focal length"
        )
    return values


def _rules(wishes: Wishes, lens: Lens) -> list[Rule]:
    rules: list[Rule] = []
    first = wishes.kind is CameraKind.PLENOPTIC_1
    if first:
        rules.append(("kind", ("b", "f"), lambda n, u: n["f" if u == "b" else "b"]))
    else:
        rules.append(("sharpness", ("b", "f", "s"), _sharpness))
    if wishes.z is not None and first:
        rules.append(("z", ("L",), lambda n, u: lens.image))
    elif wishes.z is not None:
        rules.append(("z", ("L", "s"), lambda n, u: lens.image - n["s" if u == "L" else "L"]))
    if first and wishes.disparity is not None:
        area = abs(lens.shift) * wishes.pixel_pitch / wishes.disparity
        rules.append(("disparity", ("b", "p"), lambda n, u: area / n["p" if u == "b" else "b"]))
    elif wishes.virtual_depth is not None or wishes.disparity is not None:
        rules.append(("virtual depth", ("v", "s", "b"), lambda n, u: _depth(n, u, wishes.sign, lens.shift)))
    if wishes.virtual_depth is not None:
        v = wishes.virtual_depth
        rules.append(("virtual_depth", ("v",), lambda n, u: v))
    if wishes.disparity is not None and not first:
        per_pixel = wishes.disparity * wishes.pixel_pitch
        rules.append(("disparity", ("v", "p"), lambda n, u: n["p"] / per_pixel if u == "v" else n["v"] * per_pixel))
    if wishes.image_fill is not None:
        fill = wishes.image_fill
        rules.append(("image_fill", ("h", "b", "p"), lambda n, u: _fill(n, u, fill, lens)))
    return rules


def _sharpness(n: Numbers, u: str) -> float:
    """1/b - 1/f = 1/s."""
    if u == "s":
        return over(n["b"] * n["f"], n["f"] - n["b"])
    if u == "b":
        return over(n["f"] * n["s"], n["f"] + n["s"])
    return over(n["b"] * n["s"], n["s"] - n["b"])


def _depth(n: Numbers, u: str, sign: float, shift: float) -> float:
    """Virtual depth: v b = |s + shift|."""
    if u == "s":
        return sign * n["v"] * n["b"] - shift
    away = sign * (n["s"] + shift)
    return away / n["b"] if u == "v" else away / n["v"]


def _fill(n: Numbers, u: str, fill: float, lens: Lens) -> float:
    """2 b h slope = fill p (1 + b vergence)."""
    if u == "h":
        return fill * n["p"] * (1.0 + n["b"] * lens.vergence) / (2.0 * n["b"] * lens.slope)
    if u == "p":
        return 2.0 * n["b"] * n["h"] * lens.slope / (fill * (1.0 + n["b"] * lens.vergence))
    return over(fill * n["p"], 2.0 * n["h"] * lens.slope - fill * n["p"] * lens.vergence)


def _solved_pair(known: Numbers, rules: list[Rule], wishes: Wishes, lens: Lens) -> bool:
    """Array to sensor where no equation alone has it: a quadratic in b, from the sharpness and the virtual depth.

    With f and v known, v b = +-(b f / (f - b) + shift). With f and h known, v follows from the disparity and the pitch,
    and the pitch from the image fill: p = 2 b h slope / fill / (1 + b vergence).
    """
    names = {rule[0] for rule in rules}
    if not {"sharpness", "virtual depth"} <= names or "f" not in known or {"b", "s"} & set(known):
        return False
    f, sign = known["f"], wishes.sign
    if "v" in known:
        v = known["v"]
        b = _larger_root(v, sign * (f - lens.shift) - v * f, sign * lens.shift * f, f, sign)
        wish = f"virtual depth {v:.4g}"
    elif {"disparity", "image_fill"} <= names and "h" in known and "p" not in known and lens.shift == 0:
        assert wishes.image_fill is not None and wishes.disparity is not None
        per_b, per_v = 2.0 * known["h"] * lens.slope / wishes.image_fill, wishes.disparity * wishes.pixel_pitch
        b = _larger_root(per_b, sign * f * per_v * lens.vergence - per_b * f, sign * f * per_v, f, sign)
        wish = f"disparity {wishes.disparity:.4g}"
    else:
        return False
    if b is None:
        remedy = "a virtual depth above 1" if wishes.kind is CameraKind.GALILEAN else "a larger virtual depth"
        raise InvalidValueError(
            f"{wish} cannot be had with microlenses of focal length {f:.4g} mm in a camera of kind "
            f"{wishes.kind.name}; wish for {remedy}, or for a smaller disparity"
        )
    known["b"] = b
    if "v" in known:
        rules[:] = [rule for rule in rules if rule[0] != "virtual depth"]
    else:
        # Of the equations that are left, one follows from the others.
        rules[:] = [rule for rule in rules if rule[0] != "disparity"]
    return True


def _larger_root(a: float, b: float, c: float, f: float, sign: float) -> float | None:
    """The larger x > 0 with a x^2 + b x + c = 0 for which the image, x f / (f - x), lies on the right side."""
    inside = b * b - 4.0 * a * c
    if inside < 0:
        return None
    # The form without a difference of like numbers.
    half = -0.5 * (b + math.copysign(math.sqrt(inside), b))
    roots = [half / a, c / half] if half != 0 else [0.0]
    return max((x for x in roots if x > 0 and x != f and sign * (f - x) * f > 0), default=None)


def _possible(found: float, unknown: str, rule: str, wishes: Wishes) -> float:
    """A number that can be, or an error."""
    if unknown == "s":
        if not wishes.sign * found > 0:
            side = "behind" if wishes.kind is CameraKind.GALILEAN else "in front of"
            raise InvalidValueError(
                f"a camera of kind {wishes.kind.name} needs its image {side} the array, and {rule} puts it "
                f"{found:.4g} mm behind; choose another kind, or change what is given"
            )
        return found
    fine = math.isfinite(found) and (found > 0 or (unknown == "f" and found < 0))
    if not fine:
        name = FIELDS.get(unknown, "virtual depth")
        raise InvalidValueError(
            f"{rule} would need {name} = {found:.4g}, which cannot be; wish for other numbers, or give less"
        )
    return found

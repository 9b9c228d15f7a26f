"""Requirements on a camera's design, checked."""

from __future__ import annotations

import dataclasses

from plenoptic.camera.report.focus import CameraKind
from plenoptic.core.values import check_kind, choice, finite, length_in_mm, number, positive
from plenoptic.errors import InvalidValueError
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
"""Unknowns by the names that users know."""


Numbers = dict[str, float]


@dataclasses.dataclass(frozen=True)
class Wishes:
    """Requirements on a design; None where there is none."""

    kind: CameraKind
    z: float | None
    depth_at: float | None
    image_fill: float | None
    virtual_depth: float | None
    disparity: float | None
    pixel_pitch: float

    @property
    def sign(self) -> float:
        """Sign of s."""
        return 1.0 if self.kind is CameraKind.GALILEAN else -1.0

    @property
    def names(self) -> list[str]:
        """Names of the required quantities."""
        wishes = [name for name in ("z", "image_fill", "virtual_depth", "disparity") if getattr(self, name) is not None]
        return ["kind", *wishes] if self.kind is CameraKind.PLENOPTIC_1 else wishes


def check_wishes(wishes: Wishes, lens: LensStack) -> None:
    """An error where they cannot be wanted together."""
    kind, z, depth_at = wishes.kind, wishes.z, wishes.depth_at
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
        if plane is not None and not number(plane, name) < 0:
            raise InvalidValueError(f"{name} is {plane:g} mm; the plane must lie in front of the camera, below 0")
    for name in ("image_fill", "virtual_depth", "disparity"):
        if getattr(wishes, name) is not None:
            positive(getattr(wishes, name), name)
    if wishes.virtual_depth is not None and wishes.disparity is not None:
        raise InvalidValueError("virtual_depth and disparity say the same; give one of them")
    depth = wishes.virtual_depth is not None or wishes.disparity is not None
    if depth_at is not None and (z is None or not depth):
        raise InvalidValueError(
            "depth_at says where virtual_depth or disparity is wanted, in a camera that is focused at z; give these too"
        )
    if kind is CameraKind.PLENOPTIC_1 and (wishes.virtual_depth is not None or (depth and depth_at in (None, z))):
        raise InvalidValueError(
            "a PLENOPTIC_1 camera has virtual depth and disparity 0 in the plane in focus; wish for a disparity at "
            "another plane depth_at, or for another kind"
        )


def template_array(
    microlenses: MicrolensArray | None, pitch: float | None, focal_length: float | None, lattice: Lattice
) -> MicrolensArray:
    """The array whose pitch and focal length the design replaces where they are not given."""
    if microlenses is not None:
        check_kind(microlenses, "microlenses", MicrolensArray, "pl.MicrolensArray(0.2, (2.0,))")
        if pitch is not None or focal_length is not None:
            raise InvalidValueError(
                "microlenses have a pitch and a focal length already; leave out pitch and focal_length"
            )
        return microlenses
    if choice(lattice, Lattice, "lattice") in (Lattice.RECTANGULAR, Lattice.FREE):
        raise InvalidValueError(f"lattice is {lattice!r}, which needs more than a pitch; give microlenses")
    pitch = 1.0 if pitch is None else length_in_mm(pitch, "pitch")
    focal_length = 0.0 if focal_length is None else finite(focal_length, "focal_length")
    return MicrolensArray(pitch=pitch, focal_lengths=(focal_length or 1.0,), lattice=lattice)


def checked_numbers(numbers: dict[str, float | None]) -> Numbers:
    """Check the given numbers."""
    values = {u: x for u, x in numbers.items() if x is not None}
    if values.get("f") == 0:
        raise InvalidValueError(f"{FIELDS['f']} is 0 mm; it must be another number")
    return {u: finite(x, FIELDS[u]) if u == "f" else length_in_mm(x, FIELDS[u]) for u, x in values.items()}


def check_count(wishes: Wishes, given: Numbers) -> None:
    """An error where there are more wishes than open numbers, or fewer."""
    wished, open_ = wishes.names, [FIELDS[u] for u in FIELDS if u not in given]
    fill = "; image_fill=None is no wish" if wishes.image_fill is not None else ""
    if len(wished) > len(open_):
        raise InvalidValueError(
            f"{len(wished)} wishes ({', '.join(wished)}) for {len(open_)} open numbers ({', '.join(open_) or 'none'}) "
            f"are too many; leave out {len(wished) - len(open_)} of the wishes or of what is given{fill}"
        )
    if len(wished) < len(open_):
        raise InvalidValueError(
            f"{len(wished)} wishes ({', '.join(wished) or 'none'}) for {len(open_)} open numbers ({', '.join(open_)}) "
            f"are too few; give {len(open_) - len(wished)} more"
        )

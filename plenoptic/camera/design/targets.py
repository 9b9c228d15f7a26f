"""Targets and fixed numbers of a camera's design, and their checks."""

from __future__ import annotations

import dataclasses

from plenoptic.camera.gaussian import CameraKind
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
"""Public names of the unknowns."""


Numbers = dict[str, float]


@dataclasses.dataclass(frozen=True)
class DesignTargets:
    """Targets of a design; None for no target."""

    kind: CameraKind
    z: float | None
    depth_at: float | None
    image_fill: float | None
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


def check_targets(targets: DesignTargets, lens: LensStack) -> None:
    """Raise an InvalidValueError for targets that contradict each other."""
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
        if plane is not None and not number(plane, name) < 0:
            raise InvalidValueError(f"{name} is {plane:g} mm; the plane must lie in front of the camera, below 0")
    for name in ("image_fill", "virtual_depth", "disparity"):
        if getattr(targets, name) is not None:
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
    pitch = 1.0 if pitch is None else length_in_mm(pitch, "pitch")
    focal_length = 0.0 if focal_length is None else finite(focal_length, "focal_length")
    return MicrolensArray(pitch=pitch, focal_lengths=(focal_length or 1.0,), lattice=lattice)


def valid_lengths(numbers: dict[str, float | None]) -> Numbers:
    """Fixed numbers of a design; InvalidValueError if one is impossible."""
    fixed = {u: x for u, x in numbers.items() if x is not None}
    if fixed.get("f") == 0:
        raise InvalidValueError(f"{FIELDS['f']} is 0 mm; it must be another number")
    return {u: finite(x, FIELDS[u]) if u == "f" else length_in_mm(x, FIELDS[u]) for u, x in fixed.items()}


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

"""Coordinate breaks and plane mirrors of Zemax files, against the same lens moved here or without the mirrors."""

import math

import numpy as np
import pytest

from plenoptic import LensStack, RayBundle, Surface, load_lens
from plenoptic.errors import FileWarning, PrescriptionError
from plenoptic.optics import MIRROR as MIRRORED
from plenoptic.optics import RingStop
from plenoptic.optics.lens.gaussian.paraxial import cardinal_points, system_matrix

HEAD = ("MODE SEQ", "UNIT MM", "ENPD 6", "FTYP 0 0 1 1 0 0 0", "XFLN 0", "YFLN 0", "WAVM 1 0.5875618 1", "PWAV 1")
STOP = ("STOP", "DISZ 10", "DIAM 3")
LENS = (
    ("CURV 0.02", "DISZ 3", "GLAS N-BK7", "DIAM 9"),
    ("TYPE EVENASPH", "CURV -0.015", "PARM 2 1e-6", "DISZ 40", "DIAM 9"),
)
MIRROR = ("DISZ 0", "GLAS MIRROR", "DIAM 20")
ROUNDING = 1e-12
"""Of some ten rotations and reflections, at distances below 100 mm."""


def turned(*parameters: float, gap: float = 0.0) -> tuple[str, ...]:
    return ("TYPE COORDBRK", f"DISZ {gap}", *(f"PARM {i} {p}" for i, p in enumerate(parameters, start=1)))


def load(folder, *surfaces: tuple[str, ...], head: tuple[str, ...] = HEAD) -> LensStack:
    lines = list(head)
    for i, surface in enumerate((("DISZ INFINITY",), *surfaces, ("CURV 0",))):
        lines += [f"SURF {i}", *(["  TYPE STANDARD"] * (not surface[0].startswith("TYPE"))), *surface]
    path = folder / "lens.zmx"
    path.write_text("\n".join(lines), encoding="utf-8")
    return load_lens(path)


def backward(surface: tuple[str, ...]) -> tuple[str, ...]:
    """A surface as it is written for light that goes along -z."""

    lines = [line.split() for line in surface]
    return tuple(" ".join([*w[:-1], repr(-float(w[-1]))] if w[0] in ("CURV", "PARM", "DISZ") else w) for w in lines)


RAYS = RayBundle(
    [[0.0, 0.0, -20.0], [0.0, 2.0, -20.0], [1.5, -1.0, -20.0]], [[0.0, 0.0, 1.0], [0.0, -0.02, 1.0], [0.01, 0.0, 1.0]]
)


def same_rays(one: LensStack, other: LensStack):
    a, b = one.trace(RAYS), other.trace(RAYS)
    assert (a.status == 0).all() and np.abs(a.direction - b.direction).max() < ROUNDING
    # Both stand behind their last vertex, which is the place of the lens along z.
    assert np.abs(a.origin - b.origin).max() < 1e-10


def test_a_break_and_its_inverse_place_what_stands_between_them(tmp_path):
    tilt = math.radians(2.0)
    front, back = LENS
    # Back about the rear vertex, not the front one: the image is off the axis by 3 mm sin 2 degrees.
    with pytest.warns(FileWarning, match="tilt and decentre of the image"):
        flush = (*back[:-2], "DISZ 0", "DIAM 9")
        broken = load(tmp_path, STOP, turned(0.3, -0.2, 2.0), front, flush, turned(-0.3, 0.2, -2.0, 0, 0, 1))
    straight = load(tmp_path, STOP, front, back)
    moved = straight.moved([1, 2], tilt=(tilt, 0.0, 0.0), shift=(0.3, -0.2, 0.0), pivot=float(straight.vertices[1]))
    same_rays(broken, moved)
    assert cardinal_points(broken).efl == cardinal_points(straight).efl
    # A break with all signs and the order changed undoes it.
    parameters = (0.3, -0.2, 5.0, -3.0, 20.0)
    undone = (*(-p for p in parameters), 1)
    lens = load(tmp_path, STOP, turned(*parameters, 0), turned(*undone), *LENS)
    assert lens.elements == load(tmp_path, STOP, *LENS).elements


def test_a_turn_about_x_by_a_positive_angle_turns_y_towards_z(tmp_path):
    with pytest.warns(FileWarning, match="tilt and decentre of the image"):
        lens = load(tmp_path, STOP, turned(0, 0, 10.0), *LENS)
    angle = math.radians(10)
    expected = [0, -math.sin(angle), math.cos(angle)]
    assert np.asarray(lens.elements[1].placement.rotation)[:, 2] == pytest.approx(expected)


def test_a_folded_path_is_the_straight_one(tmp_path):
    straight = load(tmp_path, (STOP[0], "DISZ 40", STOP[2]), *LENS)
    x, y = (turned(*(45.0 if i == axis else 0.0 for i in range(1, 6))) for axis in (3, 4))
    once = [(turn, MIRROR, (*turn[:1], "DISZ -30", *turn[2:]), *map(backward, LENS)) for turn in (x, y)]
    twice = (x, MIRROR, (*x[:1], "DISZ -12", *x[2:]), y, MIRROR, (*y[:1], "DISZ 18", *y[2:]), *LENS)
    for surfaces in (*once, twice):
        folded = load(tmp_path, STOP, *surfaces)
        assert cardinal_points(folded).efl == pytest.approx(cardinal_points(straight).efl, rel=1e-15)
        assert folded.vertices == pytest.approx(straight.vertices)
        same_rays(folded, straight)


def test_what_is_no_lens_or_fold_is_refused_by_its_number(tmp_path):
    with pytest.raises(PrescriptionError, match=r"line \d+: surface 1 is a plane mirror and the stop"):
        load(tmp_path, ("STOP", *MIRROR), *map(backward, LENS))
    for kind in ("DGRATING", "TOROIDAL", "BINARY_2"):
        with pytest.raises(PrescriptionError, match=rf"line \d+: surface 2 is of type {kind}; .*STANDARD"):
            load(tmp_path, STOP, (f"TYPE {kind}", "CURV 0.02", "DISZ 3", "DIAM 9"), *LENS)


def test_a_curved_mirror_becomes_a_surface_that_reflects(tmp_path):
    read = load(tmp_path, STOP, ("CURV -0.01", "DISZ -30", "GLAS MIRROR", "CONI -1", "DIAM 20"), *map(backward, LENS))
    straight = load(tmp_path, STOP, *LENS)
    mirror = Surface(-100.0, 30.0, MIRRORED, semi_diameter=20.0, conic=-1.0)
    made = LensStack([read.elements[0], mirror, *straight.elements[1:]])
    assert read.elements == made.elements
    # The prescription behind the mirror, by hand: power 2 / 100 in front of the lens.
    assert np.allclose(system_matrix(read), system_matrix(straight) @ [[1 - 0.6, 30.0], [-0.02, 1.0]], atol=1e-13)


def test_a_curved_mirror_folds_the_axis_by_its_own_normal(tmp_path):
    turn = turned(0, 0, 20.0)
    bent = ("CURV -0.01", "DISZ 0", "GLAS MIRROR", "DIAM 20")
    read = load(tmp_path, STOP, turn, bent, (*turn[:1], "DISZ -30", *turn[2:]), *map(backward, LENS))
    assert [element.placement is None for element in read.elements] == [True, False, True, True]
    ray = RayBundle([[0.0, 0.0, -20.0]], [[0.0, 0.0, 1.0]])
    # Along the axis light stays on it, and turned back it stays there too.
    assert np.abs(read.trace(ray).at_z(100.0) - [0.0, 0.0, 100.0]).max() < 1e-13
    # A beam in the plane of the fold focuses at R cos(i) / 2, across it at R / (2 cos(i)).
    alone = LensStack(read.elements[:2])
    close = RayBundle([[0.0, 1e-4, -20.0], [1e-4, 0.0, -20.0]], [[0.0, 0.0, 1.0]] * 2)
    there, cos = alone.trace(close), math.cos(math.radians(20.0))
    focus = -1e-4 / np.array([there.direction[0, 1], there.direction[1, 0]])
    assert focus == pytest.approx([50.0 * cos, 50.0 / cos], rel=1e-5)


def test_obscurations_and_rims_of_mirrors_become_stops(tmp_path):
    read = load(tmp_path, (*STOP, "CLAP 1 3 0"), (*LENS[0], "OBSC 0 2 0"), LENS[1])
    ring, stop, disc, front, _ = read.elements
    assert (type(ring), type(disc)) == (RingStop, RingStop)
    assert (ring.inner_semi_diameter, stop.semi_diameter, disc.inner_semi_diameter) == (1.0, 3.0, 2.0)
    # The rim of what they stand on limits light, not theirs.
    assert ring.semi_diameter > stop.semi_diameter and disc.semi_diameter > front.semi_diameter
    assert read.iris_index == 1
    # The rim of a mirror is a tilted stop.
    turn = turned(0, 0, 45.0)
    back = (*turn[:1], "DISZ -30", *turn[2:])
    lens = load(tmp_path, STOP, turn, (*MIRROR, "CLAP 0 2.0 0"), back, *map(backward, LENS))
    # Of radius 2 mm, at 45 degrees: light passes 2 mm along x, and 2 cos 45 = 1.41 mm along y.
    rays = RayBundle([[x, y, -20.0] for x, y in ((1.9, 0), (2.1, 0), (0, 1.4), (0, 1.43))], [[0.0, 0.0, 1.0]] * 4)
    assert (lens.trace(rays).status == 0).tolist() == [True, False, True, False]


def test_a_semi_diameter_from_the_beam_is_at_most_the_radius(tmp_path):
    ball = ("CURV 0.2", "DISZ 10", "GLAS N-BK7"), ("CURV -0.2", "DISZ 2")
    head = (*HEAD[:2], "FLOA", "FTYP 0 0 1 1", "YFLN 50", *HEAD[6:])
    assert load(tmp_path, ("STOP", "DISZ 4", "DIAM 2"), *ball, head=head).elements[1].semi_diameter == 5.0

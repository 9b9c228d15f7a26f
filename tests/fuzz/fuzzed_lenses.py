"""Lenses.

What a lens has that others lack makes kernels of their own; so lenses have one of a few sets of features.
"""

import enum
import math

from fuzzed_numbers import angle, chance, length, signed, table, uniform

import plenoptic as pl


class Glass(enum.Flag):
    """Features of a lens that have kernels of their own."""

    PLAIN = 0
    CONICS = enum.auto()
    ASPHERES = enum.auto()
    MOVED = enum.auto()
    MASKED = enum.auto()
    ALL = CONICS | ASPHERES | MOVED | MASKED


CENTRED = (Glass.PLAIN, Glass.PLAIN, Glass.CONICS, Glass.CONICS | Glass.ASPHERES, Glass.MASKED)
MOVED = (Glass.MOVED, Glass.ALL)
"""Bounds on the pupil of a camera take 16 times as long for these."""


def a_stop(rnd, semi_diameter, thickness=0.0, *, masked=False):
    """A stop of any shape; a mask where, and only where, one is wanted."""
    if masked:
        rows, columns = rnd.randint(1, 5), rnd.randint(1, 5)
        return pl.optics.MaskStop(table(rnd, 0.0, 1.0, rows, columns), semi_diameter, thickness)
    kind, corners, turn = rnd.randint(0, 4), rnd.randint(3, 12), angle(rnd, 7.0)
    if kind == 1:
        return pl.PolygonStop(corners, semi_diameter, turn, thickness)
    if kind == 2:
        least = rnd.choice([1.0, -math.tan(math.pi / corners)])
        bulge = (1.0 + length(rnd, 1.0)) * least * semi_diameter
        return pl.PolygonStop(corners, semi_diameter, turn, thickness, blade_radius=bulge)
    if kind == 3:
        inner = uniform(rnd, 0.01, 1.0) * semi_diameter * math.cos(math.pi / corners)
        return pl.StarStop(corners, semi_diameter, inner, turn, thickness)
    return pl.CircularStop(semi_diameter, thickness)


def a_medium(rnd):
    kind = rnd.randint(0, 3)
    if kind == 0:
        return pl.ConstantMedium(uniform(rnd, 1.0, 4.0))
    if kind == 1:
        return pl.ModelGlass(uniform(rnd, 1.3, 2.2), uniform(rnd, 15.0, 95.0))
    return pl.glass(rnd.choice(["N-BK7", "F2", "N-SF11"])) if kind == 2 else pl.ConstantMedium(1.5)


def a_surface(rnd, scale, thickness, medium, features):
    radius = math.inf if chance(rnd, 6) else signed(rnd, 3.0 * scale, spread=0.7)
    conic = aspheric = None
    if Glass.CONICS in features:
        conic = rnd.choice([0.0, -1.0]) if chance(rnd, 3) else uniform(rnd, -5.0, 3.0)
    equator = abs(radius) if not conic else abs(radius) / math.sqrt(1 + conic) if conic > -1 else math.inf
    semi_diameter = min(length(rnd, 0.5 * scale, spread=0.5), equator)
    if Glass.ASPHERES in features:
        # Heights of up to a tenth of the semi-diameter at the rim, seldom more.
        terms = rnd.randint(1, 4)
        aspheric = [signed(rnd, 0.01) * semi_diameter ** (-2 * i - 1) for i in range(terms)]
    return pl.Surface(
        radius, thickness, medium, semi_diameter=semi_diameter, conic=conic or 0.0, aspheric=aspheric or ()
    )


def a_thick_lens(rnd, scale, features):
    """One to three lenses, cemented or not, with a stop anywhere among them."""
    ambient = pl.optics.AIR if not chance(rnd, 8) else pl.ConstantMedium(uniform(rnd, 1.0, 1.5))
    elements = []
    for _ in range(rnd.randint(1, 3)):
        for medium in [a_medium(rnd) for _ in range(rnd.randint(1, 2))] + [ambient]:
            gap = 0.0 if chance(rnd, 10) else length(rnd, 0.1 * scale)
            elements.append(a_surface(rnd, scale, gap, medium, features))
    semi_diameter = length(rnd, 0.2 * scale)
    stop = a_stop(rnd, semi_diameter, length(rnd, 0.1 * scale), masked=Glass.MASKED in features)
    place = rnd.choice([i for i in range(len(elements) + 1) if not i or elements[i - 1].medium == ambient])
    elements.insert(place, stop)
    lens = pl.LensStack(elements, iris=place, ambient=ambient)
    if Glass.MOVED in features:
        for _ in range(rnd.randint(1, 2)):
            first = rnd.randrange(len(elements))
            shift = [signed(rnd, 0.01 * scale) for _ in range(3)]
            tilt = [angle(rnd, 0.5) for _ in range(3)]
            lens = lens.moved(slice(first, first + rnd.randint(1, 3)), shift=shift, tilt=tilt)
    return lens


def a_lens(rnd, *, features=Glass.PLAIN):
    """A lens, its size in mm, and how it is followed."""
    kind = rnd.randint(0, 3)
    if kind == 0:
        scale = 10.0 ** uniform(rnd, -6, 6)
        return pl.no_lens(scale), scale
    if kind == 1 and features in (Glass.PLAIN, Glass.MASKED):
        # A fisheye is among them, and no asphere: none brings a kernel of its own.
        lens = pl.load_lens(rnd.choice([name for name in pl.lens_names() if "-100mm-" in name]))
        lens = lens.with_stop(a_stop(rnd, length(rnd, 5.0), masked=Glass.MASKED in features))
        scale = 100.0
    else:
        scale = 10.0 ** (uniform(rnd, -6.0, 6.0) if chance(rnd, 3) else uniform(rnd, 0.0, 2.0))
        lens = a_thick_lens(rnd, scale, features)
    model = rnd.choice([pl.LensModel.EXACT] * 3 + [pl.LensModel.THIN, pl.LensModel.PARAXIAL])
    return lens.with_model(model), scale

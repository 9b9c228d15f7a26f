"""Lenses and cameras: of a few kinds, so that few kernels are compiled, of any size.

What a lens has that others lack makes kernels of its own; so lenses have one of a few sets of features.
"""

import enum
import math

import numpy as np
from fuzzed_numbers import angle, chance, length, rotation, signed, table, uniform

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
    front, rear = (pl.optics.AIR if not chance(rnd, 8) else pl.ConstantMedium(uniform(rnd, 1.0, 1.5)) for _ in range(2))
    elements = []
    for _ in range(rnd.randint(1, 3)):
        for medium in [a_medium(rnd) for _ in range(rnd.randint(1, 2))] + [rear]:
            gap = 0.0 if chance(rnd, 10) else length(rnd, 0.1 * scale)
            elements.append(a_surface(rnd, scale, gap, medium, features))
    semi_diameter = length(rnd, 0.2 * scale)
    stop = a_stop(rnd, semi_diameter, length(rnd, 0.1 * scale), masked=Glass.MASKED in features)
    place = rnd.choice([i for i in range(len(elements) + 1) if not i or elements[i - 1].medium == rear])
    elements.insert(place, stop)
    lens = pl.LensStack(elements, iris=place, front_medium=front, rear_medium=rear)
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


Kind = enum.Enum("Kind", "CONVENTIONAL SIMPLE SEVERAL_TYPES PINHOLES PLATES ROUND_OPENINGS WALLS IMPERFECT FREE")
"""What lies between lens and sensor."""
COMMON = (Kind.CONVENTIONAL, Kind.SIMPLE)
_LATTICES = (pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR)


def an_array(rnd, kind, pitch):
    """Microlenses of some pitch and an F-number around 10."""
    lattice = rnd.choice(_LATTICES)
    each = (pitch, length(rnd, pitch, spread=0.3)) if lattice is pl.Lattice.RECTANGULAR else pitch
    focal_lengths = [length(rnd, 10.0 * pitch, spread=0.7)]
    more = {}
    if kind is Kind.SEVERAL_TYPES:
        focal_lengths += [signed(rnd, 10.0 * pitch, spread=0.7) for _ in range(rnd.randint(1, 3))]
    elif kind is Kind.PINHOLES:
        more = {"model": pl.optics.MicrolensModel.PINHOLE}
    elif kind is Kind.PLATES:
        high = chance(rnd, 2)
        more = {
            "model": pl.optics.MicrolensModel.FLAT_HIGH_INDEX if high else pl.optics.MicrolensModel.SPHERICAL,
            "index": uniform(rnd, 10.0, 1000.0) if high else uniform(rnd, 1.1, 4.0),
            "thickness": length(rnd, pitch),
            "convex_side": rnd.choice(list(pl.optics.ConvexSide)),
        }
    elif kind is Kind.ROUND_OPENINGS:
        filled, gaps = uniform(rnd, 0.001, 0.78), rnd.choice(list(pl.optics.Gaps))
        more = {"aperture": pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, filled, gaps)}
    elif kind is Kind.WALLS:
        more = {"walls": pl.optics.Walls.OPAQUE}
    elif kind is Kind.IMPERFECT:
        missing, dark = uniform(rnd, 0, 0.5), uniform(rnd, 0, 0.5)
        wrong = length(rnd, 0.01 * pitch), length(rnd, 0.01 * pitch), uniform(rnd, 0, 0.2)
        more = {"imperfections": pl.MicrolensImperfections(*wrong, missing=missing, dark=dark, seed=rnd.randint(0, 9))}
    elif kind is Kind.FREE:
        centres = [[signed(rnd, 2.0 * pitch), signed(rnd, 2.0 * pitch)] for _ in range(rnd.randint(1, 9))]
        more, lattice, each = {"centres": centres}, pl.Lattice.FREE, pitch
    if kind is not Kind.FREE and chance(rnd, 8):
        more["extent"] = (length(rnd, 3.0 * pitch), length(rnd, 3.0 * pitch))
    return pl.MicrolensArray(each, tuple(focal_lengths), lattice, **more)


def a_sensor(rnd, width):
    """A sensor of some width in mm, one pixel or some."""
    shape = rnd.choice([(1, 1), (4, 4), (1, 7), (5, 2), (8, 8)])
    pitch = min(max(width / max(shape), 1e-5), 1e2)
    response = None
    if chance(rnd, 4):
        response = pl.sensor.AngularResponse(
            well_depth=length(rnd, pitch) if chance(rnd, 2) else 0.0,
            index=uniform(rnd, 1.0, 4.0),
            pupil_distance=length(rnd, 1e3 * pitch) if chance(rnd, 2) else math.inf,
            exponent=uniform(rnd, 0.0, 10.0),
        )
    aperture = (uniform(rnd, 0.01, 1.0), uniform(rnd, 0.01, 1.0)) if chance(rnd, 4) else (1.0, 1.0)
    return pl.Sensor(shape, pitch, aperture, response)


def a_pose(rnd, scale):
    return pl.Pose(rotation(rnd), [signed(rnd, scale, spread=3.0) for _ in range(3)])


def a_camera(rnd, *, common=False):
    """A camera and its size in mm."""
    kind = rnd.choice(COMMON if common else list(Kind))
    kinds = (Glass.PLAIN,) if common else MOVED if chance(rnd, 60) else CENTRED
    lens, scale = a_lens(rnd, features=rnd.choice(kinds))
    behind = float(lens.vertices[-1])
    focus = pl.paraxial.cardinal_points(lens).rear_focus if lens.model is not pl.LensModel.NONE else math.inf
    distance = behind + length(rnd, scale)
    if behind < focus < math.inf and not chance(rnd, 3):
        distance = behind + (focus - behind) * (1.0 + length(rnd, 0.01))
    width = length(rnd, 0.3 * (distance - behind) + 0.01 * scale, spread=0.5)
    sensor = a_sensor(rnd, width)
    array, gap = None, 0.0
    if kind is not Kind.CONVENTIONAL:
        array = an_array(rnd, kind, sensor.pixel_pitch * length(rnd, 3.0, spread=0.6))
        gap = length(rnd, array.focal_length, spread=0.2)
    sensitivity = None
    if not common and chance(rnd, 8):
        sensitivity = rnd.choice([pl.sensitivities.colour_camera(), pl.sensitivities.cie_1931()])
    camera = pl.PlenopticCamera(
        *(lens, sensor, distance, array, gap),
        pose=None if chance(rnd, 2) else a_pose(rnd, scale),
        wavelength=rnd.choice([587.6, 400.0, 1000.0]),
        blemishes=() if common or not chance(rnd, 6) else some_dust(rnd, width, gap if array else distance - behind),
        sensitivity=sensitivity,
    )
    if not common and kind in (Kind.CONVENTIONAL, Kind.SIMPLE, Kind.IMPERFECT) and chance(rnd, 5):
        part = rnd.choice([p for p in pl.CameraPart if array or p is not pl.CameraPart.MICROLENSES])
        shift = [signed(rnd, 0.01 * gap if array else 0.01 * (distance - behind)) for _ in range(3)]
        camera = camera.moved(part, shift=shift, tilt=[angle(rnd, 0.2) for _ in range(3)])
    return camera, scale


def some_dust(rnd, width, room):
    n, site = rnd.randint(1, 4), rnd.choice([pl.BlemishSite.SENSOR, pl.BlemishSite.LENS_FRONT])
    start = np.array([[signed(rnd, 0.3 * width) for _ in range(2)] for _ in range(n)])
    along = np.array([[signed(rnd, 0.1 * width) for _ in range(2)] for _ in range(n)])
    radius = [length(rnd, 0.05 * width) for _ in range(n)]
    passes = [uniform(rnd, 0, 1) for _ in range(n)]
    height = min(length(rnd, 0.1 * room), 0.9 * room) if site is pl.BlemishSite.SENSOR else 0.0
    return pl.Blemishes(site, start, start + along, radius, passes, height=height)

"""Cameras: one of a few kinds, so that few kernels are compiled, of any size."""

import enum
import math

import numpy as np
from fuzzed_lenses import CENTRED, MOVED, Glass, a_lens
from fuzzed_numbers import angle, chance, length, rotation, signed, uniform

import plenoptic as pl


class Kind(enum.Enum):
    """What lies between lens and sensor."""

    CONVENTIONAL = enum.auto()
    SIMPLE = enum.auto()
    SEVERAL_TYPES = enum.auto()
    PINHOLES = enum.auto()
    PLATES = enum.auto()
    ROUND_OPENINGS = enum.auto()
    WALLS = enum.auto()
    IMPERFECT = enum.auto()
    FREE = enum.auto()


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
        shares = uniform(rnd, 0, 0.5), uniform(rnd, 0, 0.5)
        more = {
            "imperfections": pl.MicrolensImperfections(
                pitch_jitter=length(rnd, 0.01 * pitch),
                decentre=length(rnd, 0.01 * pitch),
                focal_length_spread=uniform(rnd, 0, 0.2),
                missing=shares[0],
                dark=shares[1],
                seed=rnd.randint(0, 9),
            )
        }
    elif kind is Kind.FREE:
        centres = [[signed(rnd, 2.0 * pitch), signed(rnd, 2.0 * pitch)] for _ in range(rnd.randint(1, 9))]
        more, lattice, each = {"centres": centres}, pl.Lattice.FREE, pitch
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
    turn = rotation(rnd)
    return pl.Pose(turn, [signed(rnd, scale, spread=3.0) for _ in range(3)])


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
        lens=lens,
        sensor=sensor,
        stop_to_microlenses=distance,
        microlenses=array,
        microlenses_to_sensor=gap,
        pose=None if chance(rnd, 2) else (a_pose(rnd, scale)),
        wavelength=rnd.choice([587.6, 400.0, 1000.0]),
        blemishes=() if common or not chance(rnd, 6) else (some_dust(rnd, width, gap if array else distance - behind)),
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

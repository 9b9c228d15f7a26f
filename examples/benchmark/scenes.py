"""The scenes, each with one difficulty, between 330 and 450 mm before the camera and some 12 mm wide there."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import plenoptic as pl

TEXELS = 256  # along a texture: on 24 mm as fine as what the cameras resolve
WINDOW = pl.QuadLight.facing((-60, 80, -230), (0, 0, -400), (70, 70), radiance=12.0)
STONE = [(0.10, 0.09, 0.08), (0.42, 0.38, 0.33), (0.85, 0.80, 0.72)]
MOSS = [(0.03, 0.08, 0.02), (0.22, 0.36, 0.10), (0.75, 0.80, 0.35)]
BRICK = [(0.15, 0.03, 0.02), (0.55, 0.18, 0.10), (0.85, 0.62, 0.45)]
SEA = [(0.02, 0.06, 0.15), (0.10, 0.32, 0.50), (0.75, 0.88, 0.90)]
WOOD = [(0.12, 0.06, 0.02), (0.45, 0.27, 0.12), (0.78, 0.60, 0.36)]


def noise(seed, stretch=1.0, contrast=0.2):
    """Grey noise whose amplitude falls as 1 / frequency, as in natural pictures; stretched along x for grain."""
    across, up = np.meshgrid(stretch * np.fft.fftfreq(TEXELS), np.fft.fftfreq(TEXELS))
    frequency = np.hypot(across, up)
    frequency[0, 0] = 1.0
    values = np.random.default_rng(seed).normal(size=(TEXELS, TEXELS))
    values = np.fft.ifft2(np.fft.fft2(values) / frequency).real
    return np.clip(0.5 + contrast * (values - values.mean()) / values.std(), 0.0, 1.0)


def pattern(seed, colours, stretch=1.0, contrast=0.2):
    """The same as a texture from a dark, a middle and a bright colour."""
    grey = noise(seed, stretch, contrast)
    channels = [np.interp(grey, [0.0, 0.5, 1.0], channel) for channel in np.transpose(colours)]
    return pl.Texture(np.stack(channels, axis=-1))


def board(material, z, size=24.0, x=0.0, y=0.0):
    """A square across the axis."""
    return pl.quad((x - size / 2, y - size / 2, z), (size, 0, 0), (0, size, 0), material=material)


def lit(*meshes):
    return pl.Scene(meshes, [WINDOW], background=0.15)


def planes():
    """Three boards at virtual depths of about 9, 5 and 3, side by side."""
    near = board(pl.Lambertian(pattern(1, MOSS)), -354.0, x=-13.6)
    middle = board(pl.Lambertian(pattern(2, BRICK)), -404.0, x=13.8)
    return lit(near, middle, board(pl.Lambertian(pattern(3, STONE)), -437.0))


def slanted():
    """A floor and a wall that go from 350 to 440 mm, and a wall behind them that leans by 60 degrees."""
    floor, wall = (pl.Lambertian(pattern(10 + n, *look)) for n, look in enumerate([(WOOD, 4.0), (SEA, 1.0)]))
    down = pl.quad((-12, -5.0, -350), (24, 0, 0), (0, 3.4, -90), material=floor)
    right = pl.quad((-12, -5.0, -350), (24, 0, 0), (0, 3.4, -90), material=wall).rotated_deg((0, 0, 1), 90)
    behind = board(pl.Lambertian(pattern(12, BRICK)), 0.0, size=36.0)
    return lit(down, right, behind.rotated_deg((0, 1, 0), 60).translated(z=-425))


def occlusions():
    """Cards and balls at six distances before a wall."""
    meshes = [board(pl.Lambertian(pattern(20, STONE)), -445.0)]
    cards = [
        (-3.4, 2.6, -428, 20, SEA),
        (3.0, 2.0, -415, -35, BRICK),
        (-1.2, -1.6, -398, 65, MOSS),
        (3.6, -3.0, -380, 10, WOOD),
    ]
    for number, (x, y, z, turn, colours) in enumerate(cards):
        card = board(pl.Lambertian(pattern(21 + number, colours)), 0.0, size=4.4)
        meshes.append(card.rotated_deg((0, 0, 1), turn).translated(x, y, z))
    for number, (x, y, z, colours) in enumerate([(-3.8, -3.2, -372, BRICK), (0.6, 1.2, -388, SEA)]):
        meshes.append(pl.sphere(1.1, center=(x, y, z), material=pl.Lambertian(pattern(30 + number, colours))))
    return lit(*meshes)


def thin_structures():
    """Rods 0.2 to 0.8 mm thick at eight distances before a wall."""
    meshes = [board(pl.Lambertian(pattern(40, STONE)), -440.0)]
    turns = np.random.default_rng(40).uniform(-75, 75, size=8)
    for number, (turn, z) in enumerate(zip(turns, np.linspace(-425, -350, 8), strict=True)):
        radius = 0.1 + 0.3 * (number % 4) / 3
        bark = pl.Lambertian(pattern(41 + number, (WOOD, MOSS)[number % 2], contrast=0.3))
        rod = pl.shapes.turned([[radius, -12], [radius, 12]], segments=32, material=bark)
        meshes.append(rod.rotated_deg((0, 0, 1), turn).translated(1.1 * (number - 3.5), 0, z))
    return lit(*meshes)


def low_texture():
    """Plaster: a wall, a ball and a block that differ by a few percent from place to place."""
    weak = {"contrast": 0.03}
    wall, ball, block = (pl.Lambertian(pattern(50 + n, c, **weak)) for n, c in enumerate((STONE, BRICK, SEA)))
    cube = pl.box(3.6, material=block).rotated_deg((0, 1, 0), 35).rotated_deg((1, 0, 0), 20)
    ball = pl.sphere(2.2, center=(-2.4, -1.0, -392), material=ball)
    return lit(board(wall, -435.0), ball, cube.translated(2.8, 1.2, -405))


def gloss():
    """Balls with glaze and varnish, of brushed and of polished metal: reflections lie at depths of their own."""
    gold = (0.18 + 3.42j, 0.42 + 2.35j, 1.37 + 1.77j)
    wall = pl.MetallicRoughness(pattern(60, STONE), roughness=0.35)
    things = {
        (-3.0, 2.0, -415.0): pl.MetallicRoughness(pattern(61, SEA), roughness=0.15),
        (2.8, 2.4, -400.0): pl.Conductor(index=gold, alpha=0.15),
        (-2.6, -2.6, -385.0): pl.MetallicRoughness(
            pattern(62, WOOD), roughness=0.5, clearcoat=1.0, clearcoat_roughness=0.05
        ),
        (2.4, -2.2, -375.0): pl.Conductor(0.9),
    }
    return lit(board(wall, -440.0), *(pl.sphere(1.9, center=place, material=made) for place, made in things.items()))


def glass():
    """A ball and a block of glass and a pane in a frame before a wall; the truth is the first surface."""
    pane, clear = pl.materials.ThinGlass(1.5), pl.Dielectric(1.5)
    cube = pl.box((3.0, 3.0, 2.0), material=clear).rotated_deg((0, 1, 0), 25).translated(2.6, 2.0, -400)
    ball = pl.sphere(1.6, center=(-2.6, -2.0, -385), material=clear)
    bar = pl.box((24.0, 0.5, 0.5), material=pl.Lambertian(pattern(71, WOOD, 4.0)))
    bars = [bar.rotated_deg((0, 0, 1), turn).translated(z=-420) for turn in (0, 90)]
    window = board(pane, -420.0, size=12.0, x=6.25, y=-6.25)
    return lit(board(pl.Lambertian(pattern(70, BRICK)), -440.0), *bars, window, cube, ball)


class Sensor(NamedTuple):
    """What reads a picture out, with so many electrons on its brightest pixels; None: as much light as 16 bits hold."""

    electrons: float | None = None
    filters: pl.BayerPattern | None = None


class Case(NamedTuple):
    """A scene and what reads it out; those of one scene share its exposure."""

    make: Callable[[], pl.Scene]
    sensor: Sensor = Sensor()


SCENES = (planes, slanted, occlusions, thin_structures, low_texture, gloss, glass, pl.still_life)
CASES = {
    **{make.__name__.replace("_", " "): Case(make) for make in SCENES},
    "noise": Case(pl.still_life, Sensor(electrons=200.0)),
    "colour filter": Case(pl.still_life, Sensor(electrons=10000.0, filters=pl.BayerPattern.RGGB)),
}

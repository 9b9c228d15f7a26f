"""Zemax files with many constructs at once, made at random, against rays traced here.

Units, encodings, line ends and the order of lines vary; so do types of surfaces, names of glasses, dummies, stops
behind the next vertex, and configurations with operands, pickups and an image in the paraxial focus.
"""

import math

import numpy as np
import pytest

import plenoptic as pl

UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}
POWERS = {"STANDARD": (), "EVENASPH": (2, 4, 6), "XASPHERE": (2, 4, 8), "XOSPHERE": (2, 3, 4, 5), "ODDASPHE": (2, 3, 6)}
LINE = 587.5618


class RandomFile:
    """Blocks of a file in its unit, and the surfaces in mm of one of three configurations; the second is active."""

    def __init__(self, rng: np.random.Generator):
        self.rng, self.unit = rng, str(rng.choice(list(UNITS)))
        self.mm, self.chosen = UNITS[self.unit], int(rng.integers(1, 4))
        self.blocks: list[list[str]] = [["DISZ INFINITY", "TYPE STANDARD"]]
        self.operands: list[str] = []
        self.surfaces: list[tuple] = []  # curvature, conic, coefficients by power, gap, index behind
        self.air: list[tuple[int, float]] = []
        stop = int(rng.integers(3))
        for i in range(3):
            if i == stop:
                self._add_stop()
            self._add_surface(1.0 + rng.random(), self._glass())
            if rng.random() < 0.3:
                self._add_gap(0.4, self.glass_line)
            self._add_surface(0.0, None)
            way = self._add_air_gap()
        self.is_focused = way == "fixed" and rng.random() < 0.7
        if self.is_focused:
            self.blocks[-1].append("MAZH 0 0")
        self.blocks.append(["TYPE STANDARD"])

    def _length(self, length: float) -> str:
        return f"{length / self.mm!r}"

    def _glass(self) -> tuple[str, float]:
        nd = round(float(self.rng.uniform(1.45, 1.8)), 3)
        code = f"{round(1000 * (nd - 1)):03d}550"
        names = (
            f"GLAS ___BLANK 1 0 {nd} 0",
            f"GLAS Mine_{code} 1 2 {nd:E} 55. 0 0",
            f"GLAS {code} 0 0 1.5 40",
            f"glas {code}",
        )
        return str(self.rng.choice(names)), nd

    def _add_surface(self, gap: float, glass: tuple[str, float] | None) -> None:
        rng, kind = self.rng, str(self.rng.choice(list(POWERS)))
        c, k = float(rng.uniform(-0.03, 0.03)), float(rng.uniform(-2.0, 1.0)) * (kind != "STANDARD")
        terms = {p: float(rng.uniform(-1.0, 1.0)) * 4e-3 * 6.0 ** (1 - p) for p in POWERS[kind]}
        block = [f"TYPE {kind}", f"CURV {c * self.mm!r} 0 0 0 0", f"CONI {k!r}", f"DIAM {self._length(9.0)} 1 0 0 1"]
        step, norm = 2 if kind in ("EVENASPH", "XASPHERE") else 1, float(rng.uniform(0.5, 9.0))
        if kind.startswith("X"):
            block += [f"XDAT 1 {max(terms) // step} 0 0", f"XDAT 2 {self._length(norm)}"]
            block += [f"XDAT {p // step + 2} {a * norm**p / self.mm!r}" for p, a in terms.items()]
        else:
            block += [f"PARM {p // step} {a * self.mm ** (p - 1)!r}" for p, a in terms.items()]
        if glass is not None:
            self.glass_line, self.index = glass
            block.append(glass[0])
        self.blocks.append([*block, f"DISZ {self._length(gap)}"])
        self.surfaces.append((c, k, terms, gap, 1.0 if glass is None else self.index))

    def _add_gap(self, gap: float, *lines: str) -> None:
        """A dummy, whose gap belongs to the surface before it."""
        self.blocks.append([f"DISZ {self._length(gap)}", *lines])
        *shape, before, n = self.surfaces[-1]
        self.surfaces[-1] = (*shape, before + gap, n)

    def _add_stop(self) -> None:
        """In front of the vertex that follows, or behind it, by 0.2."""
        gap = float(self.rng.choice([-0.2, 0.2]))
        lines = ["STOP", f"DIAM {self._length(4.0)}"]
        if self.surfaces:
            self._add_gap(gap, *lines)
        else:
            self.blocks.append([*lines, f"DISZ {self._length(gap)}"])

    def _add_air_gap(self) -> str:
        """The gap behind the last block: fixed, of an operand for each configuration, or a pickup of the air before."""
        block, gaps = len(self.blocks) - 1, (1.0 + 3.0 * self.rng.random(3)).tolist()
        gap, way = gaps[self.chosen - 1], str(self.rng.choice(["fixed", "operand", "pickup"][: 2 + bool(self.air)]))
        in_file, pickup = gap, []
        if way == "operand":
            in_file = gaps[1]
            self.operands += [f"THIC {block} {i} {self._length(t)} 0 0 0 1 1" for i, t in enumerate(gaps, start=1)]
        elif way == "pickup":
            source, gap = self.air[-1]
            gap = 0.5 * gap + 0.7
            in_file, pickup = gap if self.chosen == 2 else 99.0, [f"PZUP {source}. 0.5 {self._length(0.7)} 0"]
        lines = [line for line in self.blocks[-1] if not line.startswith("DISZ")]
        self.blocks[-1] = [*lines, f"DISZ {self._length(in_file)}", *pickup]
        self.air.append((block, gap))
        self.surfaces[-1] = (*self.surfaces[-1][:3], gap, 1.0)
        return way

    def content(self) -> bytes:
        head = [
            f"UNIT {self.unit} X W X CM",
            f"ENPD {self._length(2.0)} 0",
            "MODE SEQ",
            "FTYP 0 0 1 1",
            "XFLN 0",
            "YFLN 0",
        ]
        head += [f"WAVM 1 {LINE / 1e3:E} 1", "PWAV 1"]
        self.rng.shuffle(head)
        lines = ["VERS 140124 258", *head]
        for i, block in enumerate(self.blocks):
            block = [*block, "COMM of a test", "HIDE 0 0 0", "  "]
            self.rng.shuffle(block)
            lines += [f"SURF {i}", *(f"  {line}" for line in block)]
        text = str(self.rng.choice(["\n", "\r\n", "\r"])).join([*lines, "TOL TOFF 0 0", "MNUM 3 2", *self.operands, ""])
        return text.encode(str(self.rng.choice(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])))


def sag(c: float, k: float, terms: dict[int, float], r: float) -> tuple[float, float]:
    """Sag and its derivative over r."""
    root = math.sqrt(1.0 - (1.0 + k) * c * c * r * r)
    z = c * r * r / (1.0 + root) + sum(a * r**p for p, a in terms.items())
    return z, c / root + sum(p * a * r ** (p - 2) for p, a in terms.items())


def real_ray(surfaces: list[tuple], point: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Point in the plane of the last vertex, of a ray from the plane of the first."""
    p, d, n = point.copy(), direction.copy(), 1.0
    for c, k, terms, gap, behind in surfaces:
        for _ in range(40):
            z, slope = sag(c, k, terms, math.hypot(p[0], p[1]))
            normal = np.array([-slope * p[0], -slope * p[1], 1.0])
            p = p - (p[2] - z) / float(normal @ d) * d
        normal /= np.linalg.norm(normal)
        cosine, ratio = float(normal @ d), n / behind
        d = ratio * d + (math.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * normal
        p, n, last = p - [0.0, 0.0, gap], behind, gap
    return p - (p[2] + last) / d[2] * d


def paraxial(surfaces: list[tuple]) -> tuple[float, float]:
    """Focal length, and the distance of the focus from the last vertex."""
    y, angle, n = 1.0, 0.0, 1.0
    for i, (c, _, terms, gap, behind) in enumerate(surfaces):
        angle -= (behind - n) * (c + 2.0 * terms.get(2, 0.0)) * y
        y, n = y + (gap if i < len(surfaces) - 1 else 0.0) * angle / behind, behind
    return -1.0 / angle, -y / angle


def test_random_files_against_rays_traced_here(tmp_path):
    for seed in range(40):
        file = RandomFile(np.random.default_rng(seed))
        (tmp_path / "random.zmx").write_bytes(file.content())
        lens = pl.load_lens(tmp_path / "random.zmx", configuration=file.chosen)
        efl, back = paraxial(file.surfaces)
        assert pl.paraxial.cardinal_points(lens, LINE).efl == pytest.approx(efl, rel=1e-9), seed
        expected = back if file.is_focused and file.chosen != 2 else file.surfaces[-1][3]
        assert lens.specification.z_image - lens.vertices[-1] == pytest.approx(expected, rel=1e-9, abs=1e-9), seed
        z_first = next(z for z, e in zip(lens.vertices, lens.elements, strict=True) if isinstance(e, pl.Surface))
        point, direction = np.array([0.4, 0.5, 0.0]), np.array([0.03, -0.02, 1.0]) / math.hypot(0.03, 0.02, 1.0)
        start = point + np.array([0.0, 0.0, z_first]) - 20.0 * direction
        ray = lens.trace(pl.RayBundle(start[None], direction[None], LINE))
        at_last = ray.at_z(float(lens.vertices[-1]))[0]
        assert ray.status[0] == pl.RayStatus.OK, seed
        np.testing.assert_allclose(
            at_last[:2], real_ray(file.surfaces, point, direction)[:2], atol=1e-11, rtol=0, err_msg=str(seed)
        )

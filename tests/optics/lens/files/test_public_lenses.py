"""Files of a folder of public lenses (PLENOPTIC_LENSES=), against a parser and a tracer of this file.

Surfaces are read here line by line and traced by Newton's method; only indices are those of the package's media.
"""

import collections
import math
import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import RayBundle, Surface
from plenoptic.core.files.text_lines import decode_text
from plenoptic.errors import PlenopticError

FOLDER = os.environ.get("PLENOPTIC_LENSES", "")
RAYS = 20
ENDINGS = (".zmx", ".seq", ".txt")

pytestmark = pytest.mark.skipif(not FOLDER, reason="PLENOPTIC_LENSES names no folder of lens files")


class NotReadError(Exception):
    """A file that the parser of this test does not understand."""


def rows_of_zmx(text: str) -> list[tuple]:
    """(curvature, conic, coefficients of r^2, r^4, ..., gap, glass) of each surface but object and image, mm."""
    unit = {"MM": 1.0, "IN": 25.4, "CM": 10.0, "METER": 1000.0}[re.search(r"(?m)^UNIT (\S+)", text)[1].upper()]
    rows = []
    for block in re.split(r"(?m)^SURF ", text)[2:-1]:
        entries = [line.split() for line in block.split("\nTOL ")[0].splitlines()[1:] if line.split()]
        value = {entry[0]: entry[1:] for entry in entries}
        kind = value.get("TYPE", ["STANDARD"])[0]
        if kind not in ("STANDARD", "EVENASPH") or value.get("GLAS", [""])[0] == "MIRROR":
            raise NotReadError(kind)
        parm = {int(e[1]): float(e[2]) for e in entries if e[0] == "PARM" and kind == "EVENASPH"}
        terms = [parm.get(i, 0.0) * unit ** (1 - 2 * i) for i in range(1, 9)]
        glass = " ".join(value["GLAS"][:6]) if "GLAS" in value else ""
        gap = value.get("DISZ", ["0"])[0]
        row = float(value.get("CURV", ["0"])[0]) / unit, float(value.get("CONI", ["0"])[0]), terms
        rows.append((*row, 0.0 if gap.upper() == "INFINITY" else float(gap) * unit, glass))
    return rows


def rows_of_seq(text: str) -> list[tuple]:
    if re.search(r"(?im)^\s*(dar|ben|rev|ade|prv)\b|\brefl\b", text):
        raise NotReadError("tilts, mirrors, or a catalogue")
    is_radius = not re.search(r"(?im)^\s*rdm n", text)
    unit = {"M": 1.0, "I": 25.4, "C": 10.0}[(re.findall(r"(?im)^\s*dim +(\w)", text) or ["M"])[0].upper()]
    rows = []
    for line in re.sub(r"!.*", "", text).replace(";", "\n").splitlines():
        words = line.split() or [""]
        if words[0].upper() == "S":
            c = float(words[1])
            c = (1.0 / c if c else 0.0) if is_radius else c
            rows.append([c / unit, 0.0, [0.0] * 5, float(words[2]) * unit, " ".join(words[3:4])])
        elif rows and words[0].upper() == "K":
            rows[-1][1] = float(words[1])
        elif rows and words[0].upper() in ("A", "B", "C", "D"):
            power = "ABCD".index(words[0].upper()) + 1
            rows[-1][2][power] = float(words[1]) * unit ** (-1 - 2 * power)
    return [tuple(row) for row in rows]


def rows_of_table(text: str) -> list[tuple]:
    """The first configuration."""
    sections = {part.split("]")[0]: part.split("\n", 1)[-1] for part in re.split(r"(?m)^\[", text)}
    cells = {key: [line.split("\t") for line in body.splitlines() if line.strip()] for key, body in sections.items()}
    values = {row[0].strip(): row[1].strip() for row in cells.get("variable distances", []) if len(row) > 1}
    if "Odd" in sections.get("constants", ""):
        raise NotReadError("odd powers")
    rows, numbers = [], {}
    for row in cells["lens data"]:
        if row[0].startswith("#"):
            continue
        row = [cell.strip() for cell in [*row, "", "", "", ""]]
        is_plane = row[1].strip("+-").upper() in ("AS", "FS", "CG", "INFINITY") or float(row[1]) == 0
        c = 0.0 if is_plane else 1.0 / float(row[1])
        gap = float(values.get(row[2], row[2]))
        glass = f"{row[3]} {row[5]}" if row[3] else ""
        numbers[row[0]] = len(rows)
        rows.append([c, 0.0, [0.0] * 14, gap, glass])
    for row in cells.get("aspherical data", []):
        if not row[0].startswith("#"):
            numerals = [float(cell.strip() or 0) for cell in row[2:]]
            first = 0 if "AsphericalA2" in sections.get("constants", "") else 1
            target = rows[numbers[row[0].strip()]]
            target[1] = numerals[0] if numerals else 0.0
            target[2][first : first + len(numerals) - 1] = numerals[1:]
    return [tuple(row) for row in rows]


PARSERS = {".zmx": rows_of_zmx, ".seq": rows_of_seq, ".txt": rows_of_table}


def indices(rows: list[tuple], lens: pl.LensStack, wavelength: float) -> list[float]:
    """Index behind each row: that of the lens's surfaces at which the medium changes, in turn."""
    media, before = [], pl.optics.AIR
    for element in lens.elements:
        if isinstance(element, Surface) and element.medium != before:
            media.append(element.medium)
            before = element.medium
    behind, glass, result = iter(media), "", []
    n = 1.0
    for row in rows:
        if row[4] != glass:
            glass, n = row[4], next(behind).index(wavelength)
        result.append(n)
    assert next(behind, None) is None
    return result


def efl(rows: list[tuple], behind: list[float]) -> float:
    y, nu, n = 1.0, 0.0, 1.0
    for (c, _, terms, gap, _), following in zip(rows, behind, strict=True):
        nu -= (following - n) * (c + 2.0 * terms[0]) * y
        n = following
        y += gap * nu / n
    return -1.0 / nu if nu else math.inf


def sag(c: float, k: float, terms: list[float], s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sag and its derivative by s = r^2."""
    root = np.sqrt(1.0 - (1.0 + k) * c * c * s)
    z, slope = c * s / (1.0 + root), c / (2.0 * root)
    for i, a in enumerate(terms, start=1):
        z, slope = z + a * s**i, slope + i * a * s ** (i - 1)
    return z, slope


def trace(rows, behind, origin: np.ndarray, direction: np.ndarray, image: float) -> np.ndarray:
    """Points in the plane z = image; the first row lies at z = 0."""
    p, d, vertex, n = origin.copy(), direction.copy(), 0.0, 1.0
    for (c, k, terms, gap, _), following in zip(rows, behind, strict=True):
        if following != n:
            # Newton's method begins on the sphere of the vertex.
            z = p[:, 2] - vertex
            b, e = (
                d[:, 2] - c * (p[:, 0] * d[:, 0] + p[:, 1] * d[:, 1] + z * d[:, 2]),
                c * (p[:, 0] ** 2 + p[:, 1] ** 2),
            )
            e = e + c * z**2 - 2.0 * z
            t = e / (b + np.sqrt(np.maximum(b * b - c * e, 0.0)))
            for _ in range(30):
                q = p + t[:, None] * d
                z, slope = sag(c, k, terms, q[:, 0] ** 2 + q[:, 1] ** 2)
                normal = np.column_stack([-2.0 * slope * q[:, 0], -2.0 * slope * q[:, 1], np.ones(len(q))])
                t = t - (q[:, 2] - vertex - z) / np.einsum("ij,ij->i", normal, d)
            p = p + t[:, None] * d
            _, slope = sag(c, k, terms, p[:, 0] ** 2 + p[:, 1] ** 2)
            normal = np.column_stack([-2.0 * slope * p[:, 0], -2.0 * slope * p[:, 1], np.ones(len(p))])
            normal /= np.linalg.norm(normal, axis=1)[:, None]
            cosine = np.einsum("ij,ij->i", normal, d)
            ratio = n / following
            along = np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine
            d = ratio * d + along[:, None] * normal
            n = following
        vertex += gap
    return p + ((image - p[:, 2]) / d[:, 2])[:, None] * d


def difference(rows, lens) -> tuple[float, float]:
    """Relative difference of the EFL, and the largest of the points of real rays in the image plane, mm."""
    wavelength = lens.specification.wavelengths[0]
    behind = indices(rows, lens, wavelength)
    expected, got = efl(rows, behind), pl.paraxial.cardinal_points(lens, wavelength=wavelength).efl
    z_first = next(z for z, e in zip(lens.vertices, lens.elements, strict=True) if isinstance(e, Surface))
    first = next(i for i, n in enumerate(behind) if n != 1.0)
    shift = float(z_first) - sum(row[3] for row in rows[:first])
    pupil = pl.paraxial.cardinal_points(lens, wavelength=wavelength)
    rng = np.random.default_rng(1)
    radius = min(pupil.entrance_pupil_semi_diameter, 1e3) * np.sqrt(rng.random(400))
    angle, field = 2.0 * math.pi * rng.random(400), 0.1 * rng.random(400)
    z_pupil = pupil.entrance_pupil if abs(pupil.entrance_pupil) < 1e4 else 0.0
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(400, z_pupil)])
    directions = np.column_stack([0 * field, np.sin(field), np.cos(field)])
    start = min(float(lens.vertices[0]), 0.0) - 50.0
    origins = points + ((start - points[:, 2]) / directions[:, 2])[:, None] * directions
    out = lens.trace(RayBundle(origins, directions, wavelength=wavelength))
    passing = np.flatnonzero(out.status == 0)[:RAYS]
    assert len(passing) == RAYS, "fewer than 20 rays of 400 pass"
    image = lens.specification.z_image
    theirs = out.at_z(image)[passing]
    mine = trace(rows, behind, origins[passing] - [0, 0, shift], directions[passing], image - shift)
    same = 0.0 if got == expected else abs(got / expected - 1.0)
    return same, float(np.abs(theirs[:, :2] - mine[:, :2]).max())


@pytest.mark.slow
def test_public_lens_files_load_and_agree_with_an_independent_trace():
    """EFL to 1e-9 and 20 real rays to 1e-9 mm; the counts and the reasons of those that do not load are printed."""
    files = sorted(path for path in Path(FOLDER).rglob("*") if path.suffix.lower() in ENDINGS)
    reasons, unread, compared, wrong = collections.Counter(), collections.Counter(), [], []
    for path in files:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                lens = pl.load_lens(path)
            except PlenopticError as error:
                reasons[re.sub(r"[-+]?[0-9.]+(e[-+]?[0-9]+)?|'[^']*'", "#", str(error).split(": ", 1)[-1])[:70]] += 1
                continue
            try:
                rows = PARSERS[path.suffix.lower()](decode_text(path.read_bytes()).replace("\r\n", "\n"))
                compared.append((*difference(rows, lens), path.name))
            except (NotReadError, StopIteration, AssertionError, KeyError, ValueError) as error:
                unread[f"{type(error).__name__} {error}"[:60]] += 1
                continue
        if compared[-1][0] > 1e-9 or not compared[-1][1] < 1e-9:
            wrong.append(compared[-1])
    loaded = len(files) - sum(reasons.values())
    print(f"{loaded} of {len(files)} load, {len(compared)} are compared")
    print(f"EFL to {max(c[0] for c in compared):.1e}, rays to {max(c[1] for c in compared):.1e} mm")
    print(f"not loaded: {reasons.most_common()}\nnot compared: {unread.most_common()}")
    assert files and compared
    assert not wrong, wrong


@pytest.mark.slow
def test_public_lens_files_agree_with_listings_of_opticstudio():
    """Files NAME.zmx with a listing "System/Prescription Data" NAME.txt, as in github.com/nzhagen/LensLibrary.

    Listings have seven digits; their focal length is that in air. The wavelengths of files are rounded.
    """
    paths = [path for path in Path(FOLDER).rglob("*") if path.suffix.lower() in (".zmx", ".txt")]
    listings = {path.stem: path for path in paths if path.suffix == ".txt"}
    errors = collections.defaultdict(dict)
    for path in sorted(path for path in paths if path.suffix.lower() == ".zmx" and path.stem in listings):
        text = decode_text(listings[path.stem].read_bytes())
        names = "Effective Focal Length|Entrance Pupil Diameter|Stop Radius"
        listed = dict(reversed(re.findall(rf"(?m)^({names}) *:\s*(\S+)", text)))  # the focal length in air is the first
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                lens = pl.load_lens(path)
            except PlenopticError:
                continue
        points = pl.paraxial.cardinal_points(lens, wavelength=lens.specification.wavelengths[0])
        ours = (1.0 / points.power, 2.0 * points.entrance_pupil_semi_diameter, lens.stop.semi_diameter)
        for (name, number), value in zip(sorted(listed.items()), ours, strict=True):
            if abs(float(number)) < 1e3 * lens.length:
                errors[name][path.stem] = abs(abs(value / float(number)) - 1.0)
    for name, of_file in errors.items():
        accurate = sum(error < 1e-5 for error in of_file.values())
        print(f"{name}: {len(of_file)} files, {accurate} to 1e-5, worst {max(of_file.values()):.1e}")
    assert errors and not [of_file for of_file in errors.values() if max(of_file.values()) > 1e-4], errors

"""The meshes of OBJ files."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from plenoptic.core.files.file_limits import FileReader
from plenoptic.core.files.text_lines import decode_text, parse_numbers, word_starts
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning
from plenoptic.scene.files.obj import obj_materials
from plenoptic.scene.files.polygons import Indices, shared_vertices, triangulate
from plenoptic.scene.files.vertex_colours import VertexColours
from plenoptic.scene.geometry.mesh import Mesh, has_area
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.registry import Material

_PARTS = 4000
"""Materials of a file, each of which makes a mesh."""
_BLANK, _LINE_END, _SLASH = 32, 10, 47


def obj_meshes(
    file_name: str, content: bytes, reader: FileReader, scale: float, material: Material | None
) -> Iterator[Mesh]:
    """Meshes of an OBJ file whose unit is `scale` mm, in mm: one for each material, in the order of first use.

    Material files are read by `reader`; a material replaces those of the file. Free-form curves and surfaces, lines
    and points are left out.
    """
    lines = _Lines(content)
    labels, label_of_face = _labels(lines)
    if len(labels) > _PARTS:
        raise FileError(f"it has {len(labels)} parts; at most {_PARTS} are read: join them")
    libraries = [name for _, name in lines.said("mtllib")]
    materials = obj_materials(file_name, libraries, labels, reader) if material is None else {}
    vertices, uv, normals = lines.columns(b"v", 3), lines.columns(b"vt", 2), lines.columns(b"vn", 3)
    colours, vertex_colours = _colours(file_name, lines) if material is None else None, VertexColours(reader)
    lengths, rows = lines.faces(file_name, (len(vertices), len(uv), len(normals)))
    triangles, polygon = triangulate(vertices, lengths, rows[0])
    objects = dict.fromkeys(name for _, name in lines.said("o") if name)
    default = next(iter(objects)) if len(objects) == 1 else file_name
    if len(triangles) == 0:
        return
    part = label_of_face[polygon]
    ends = np.cumsum(np.bincount(part, minlength=len(labels)))
    for label, corners in zip(labels, np.split(triangles[np.argsort(part, kind="stable")], ends[:-1]), strict=True):
        v, vt, vn = (row[corners.ravel()] for row in rows)
        if len(v) == 0 or not has_area(vertices, v.reshape(-1, 3)):
            continue
        key, corner_uv = vt, _rows(uv, vt)
        chosen = material if material is not None else materials.get(label)
        if chosen is None:
            chosen = Lambertian()
            if colours is not None:
                chosen, texels = vertex_colours.matt(file_name, colours[v].reshape(-1, 3, 3))
                key, corner_uv = texels or (key, corner_uv)
        elif chosen.row().textures and vt.max(initial=-1) >= 0 and vt.min() < 0:
            warn(f"{file_name}: some faces of the material {label!r} have no uv; they show one texel", FileWarning)
        faces, corner = shared_vertices(v, *(row if row.max() >= 0 else None for row in (key, vn)))
        yield Mesh(
            scale * vertices[v[corner]],
            faces.reshape(-1, 3),
            chosen,
            _rows(normals, vn[corner]),
            None if corner_uv is None else corner_uv[corner],
            label if len(labels) > 1 and label else default,
        )


def _rows(array: Floats, indices: Indices) -> Floats | None:
    """Rows of an array, zeros where an index is -1; None where all are."""
    if indices.max() < 0:
        return None
    return np.where((indices >= 0)[:, None], array[indices], 0.0) if indices.min() < 0 else array[indices]


class _Lines:
    """The lines of a file by their keywords, without comments, indents and tabs."""

    def __init__(self, content: bytes) -> None:
        text = decode_text(content).replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ").replace("\t", " ")
        content = text.encode()
        content = re.sub(rb"^ +", b"", content, flags=re.MULTILINE) if b"\n " in b"\n" + content else content
        if b"#" in content:
            content = re.sub(rb"^((?:(?:f|v|vt|vn) [^#\n]*)?)#[^\n]*", rb"\1", content, flags=re.MULTILINE)
        self._bytes = np.frombuffer(content + b"\n\n\n\n", dtype=np.uint8).copy()
        self._ends = np.flatnonzero(self._bytes == _LINE_END)[:-3]
        self._starts = np.concatenate([[0], self._ends[:-1] + 1])
        first, second, third = (self._bytes[self._starts + k] for k in range(3))
        self._is = {key: (first == key[0]) & (second == _BLANK) for key in (b"v", b"f")}
        self._is |= {key: (first == 118) & (second == key[1]) & (third == _BLANK) for key in (b"vt", b"vn")}
        self._numbers: dict[bytes, tuple[Floats, Indices]] = {}

    def said(self, keyword: str) -> list[tuple[int, str]]:
        """Lines that begin with a keyword: their numbers from 0, and the text that follows."""
        letters = keyword.encode() + b" "
        is_said = self._bytes[self._starts] == letters[0]
        if len(keyword) > 1:
            is_said &= self._bytes[self._starts + 1] == letters[1]
        said = []
        for line in np.flatnonzero(is_said).tolist():
            words = self._bytes[self._starts[line] : self._ends[line]].tobytes()
            if (words + b" ").startswith(letters):
                said.append((line, words[len(keyword) :].decode().strip()))
        return said

    def numbers_of(self, keyword: bytes) -> Indices:
        """Numbers of the lines of a keyword, from 0."""
        return np.flatnonzero(self._is[keyword])

    def _chunk(self, keyword: bytes) -> bytes:
        """All lines of a keyword, without it."""
        lines = self._is[keyword]
        chosen = np.repeat(lines, np.diff(self._ends, prepend=-1))
        for k in range(len(keyword)):
            self._bytes[self._starts[lines] + k] = _BLANK
        return bytes(self._bytes[:-3][chosen])

    def _parse(self, keyword: bytes) -> tuple[Floats, Indices]:
        """All numbers behind a keyword, and how many each line has."""
        if keyword not in self._numbers:
            chunk = self._chunk(keyword)
            _, lines = word_starts(chunk)
            counts = np.bincount(lines, minlength=int(self._is[keyword].sum()))
            numbers = parse_numbers(chunk)
            if len(numbers) != counts.sum():
                raise FileError("it holds text in place of a number; export it again")
            self._numbers[keyword] = numbers, counts
        return self._numbers[keyword]

    def counts(self, keyword: bytes) -> Indices:
        """Numbers of each line of a keyword."""
        return self._parse(keyword)[1]

    def columns(self, keyword: bytes, width: int) -> Floats:
        """(n, width): the first numbers behind a keyword."""
        numbers, counts = self._parse(keyword)
        if len(counts) and counts.min() < width:
            line = self.numbers_of(keyword)[np.argmin(counts)] + 1
            raise FileError(f"its line {line} has {counts.min()} numbers; {keyword.decode()} takes {width}: correct it")
        if len(counts) and counts.min() == counts.max():
            return numbers.reshape(len(counts), -1)[:, :width]
        columns: Floats = numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(width)]
        return columns

    def faces(self, file_name: str, sizes: tuple[int, int, int]) -> tuple[Indices, tuple[Indices, ...]]:
        """Corners of each face, and rows of v, vt and vn of each corner, -1 for none; `sizes` count the rows."""
        chunk = self._chunk(b"f")
        for before, after in ((rb"/ ", rb"/+ "), (b"/\n", rb"/+\n")):
            chunk = re.sub(after, before[1:], chunk) if before in chunk else chunk
        starts, lines = word_starts(chunk)
        slashes = np.cumsum(np.frombuffer(chunk, dtype=np.uint8) == _SLASH, dtype=np.int32)
        parts = np.diff(slashes[starts - 1], append=slashes[-1:]) + 1 if len(starts) else starts
        numbers = parse_numbers(chunk.replace(b"//", b"/nan/").replace(b"/", b" "))
        if re.search(rb"[^-+0-9/ \n]", chunk) or len(numbers) != parts.sum() or parts.max(initial=0) > 3:
            raise FileError("its faces hold text in place of an index; export it again")
        offsets = np.cumsum(parts) - parts
        numbers = np.concatenate([numbers, [0.0, 0.0]])
        line_of_face = self.numbers_of(b"f")
        rows = []
        for k, (keyword, size) in enumerate(zip((b"v", b"vt", b"vn"), sizes, strict=True)):
            values = np.where(parts > k, numbers[offsets + k], np.nan)
            if k and size == 0 and not np.isnan(values).all():
                name, values = keyword.decode(), np.full(len(parts), np.nan)
                warn(f"{file_name}: its faces name {name}, of which it has none; they are left out", FileWarning)
            row = values - 1
            if np.any(values < 0):  # counted backwards from the face's line
                row = np.where(values < 0, values + np.cumsum(self._is[keyword])[line_of_face[lines]], row)
            wrong = (values == 0) | (row < 0) | (row >= size)
            if wrong.any():
                at = int(np.argmax(wrong))
                raise FileError(
                    f"its line {line_of_face[lines[at]] + 1} names {keyword.decode()} {values[at]:.0f}, out of bounds "
                    f"for {size} of them, which count from 1 or, backwards, from -1; export it again"
                )
            rows.append(np.nan_to_num(row, nan=-1.0).astype(np.int64))
        return np.bincount(lines, minlength=len(line_of_face)), tuple(rows)


def _colours(file_name: str, lines: _Lines) -> Floats | None:
    """(n, 3) codes behind the positions of all vertices; None where some have none, with a warning if others have."""
    counts = lines.counts(b"v")
    if counts.min(initial=6) >= 6:
        return lines.columns(b"v", 6)[:, 3:]
    if counts.max() >= 6:
        warn(f"{file_name}: colours are left out, which only some of its vertices have", FileWarning)
    return None


def _labels(lines: _Lines) -> tuple[list[str], Indices]:
    """Names of materials that faces use, "" for none, and the number of that of each face."""
    said = lines.said("usemtl")
    names = ["", *(" ".join(name.split()) for _, name in said)]
    labels = list(dict.fromkeys(names))
    numbers = {name: number for number, name in enumerate(labels)}
    of_names = np.array([numbers[name] for name in names])
    of_faces = of_names[np.searchsorted([line for line, _ in said], lines.numbers_of(b"f"))]
    used, of_faces = np.unique(of_faces, return_inverse=True)
    return [labels[number] for number in used], of_faces

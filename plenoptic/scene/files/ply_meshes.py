"""The meshes of PLY files. plyfile reads their headers, and binary lists of different lengths."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plenoptic.core.files.file_limits import FileReader
from plenoptic.core.files.text_lines import parse_numbers, word_starts
from plenoptic.core.values import Floats
from plenoptic.core.warn import warn
from plenoptic.errors import FileError, FileWarning, PlenopticError
from plenoptic.scene.files.file_materials import REPLACE, file_texture
from plenoptic.scene.files.polygons import Indices, shared_vertices, triangulate
from plenoptic.scene.files.vertex_colours import VertexColours
from plenoptic.scene.geometry.mesh import Mesh, has_area
from plenoptic.scene.materials.diffuse import Lambertian
from plenoptic.scene.materials.registry import Material

_INDICES = ("vertex_indices", "vertex_index")
_UV = ("s t", "u v", "texture_u texture_v")
_COLOURS = ("red green blue", "diffuse_red diffuse_green diffuse_blue", "r g b")
_END = re.compile(rb"^end_header *(\r\n|\n|\r)", re.MULTILINE)


class _Lists(NamedTuple):
    """The lists of all rows of an element: their lengths, and their numbers one after the other."""

    lengths: Indices
    numbers: NDArray[Any]


_Element = Mapping[str, NDArray[Any] | _Lists]
_Type = tuple[str, str, str]
"""Name of a property, the type of the lengths of its lists, "" for a single number, and the type of its numbers."""


def ply_meshes(
    file_name: str, content: bytes, reader: FileReader, scale: float, material: Material | None
) -> Iterator[Mesh]:
    """The mesh of a PLY file whose unit is `scale` mm, in mm: its faces and strips of triangles.

    The texture that it names is read by `reader`, else the colours of its vertices or faces count, without their
    opacity; a material replaces both.
    """
    end = _END.search(content)
    if end is None:
        raise FileError("it is cut off: it has no 'end_header'; export it again")
    header = content[: end.start()].replace(b"\r\n", b"\n").replace(b"\r", b"\n").decode(errors="replace")
    elements = _elements(header, content[end.end() :])
    vertex, face = elements.get("vertex", {}), elements.get("face", {})
    vertices = _columns(vertex, ("x y z",))
    polygons, strips = _lists(face, _INDICES), _strips(_lists(elements.get("tristrips", {}), _INDICES))
    numbers = np.concatenate([polygons.numbers, strips]) if len(strips) else polygons.numbers
    if vertices is None or (numbers.size and not 0 <= numbers.min() <= numbers.max() < len(vertices)):
        count = 0 if vertices is None else len(vertices)
        raise FileError(f"its faces name vertices out of bounds for {count} of them; export it again")
    lengths = np.concatenate([polygons.lengths, np.full(len(strips) // 3, 3)])
    triangles, polygon = triangulate(vertices, lengths, numbers)
    faces = numbers[triangles]
    if len(faces) == 0 or not has_area(vertices, faces):
        return
    uv, normals = _columns(vertex, _UV), _columns(vertex, ("nx ny nz",))
    chosen, texels = _texture(file_name, header, reader) if material is None else material, None
    if chosen is None:
        codes = _corner_codes(vertex, face, faces, polygon)
        chosen, texels = (Lambertian(), None) if codes is None else VertexColours(reader).matt(file_name, codes)
    wedges = _lists(face, ("texcoord",))
    if texels is None and len(wedges.lengths) and np.array_equal(wedges.lengths, 2 * lengths):
        corner_uv = wedges.numbers.reshape(-1, 2)[triangles.ravel()].astype(np.float64)
        texels = np.unique(corner_uv, axis=0, return_inverse=True)[1].ravel(), corner_uv
    if texels is not None:  # a vertex has a uv in each of its faces
        key, corner_uv = texels
        corners = faces.ravel()
        faces, corner = shared_vertices(corners, key)
        rows, uv = corners[corner], corner_uv[corner]
        vertices, normals = vertices[rows], None if normals is None else normals[rows]
    yield Mesh(scale * vertices, faces.reshape(-1, 3), chosen, normals, uv, file_name)


def _corner_codes(vertex: _Element, face: _Element, faces: Indices, polygon: Indices) -> Floats | None:
    """(m, 3 corners, 3) codes of colours of triangles: those of vertices, else those of polygons; None for neither."""
    codes = _columns(vertex, _COLOURS)
    if codes is not None:
        return codes[faces]
    codes = _columns(face, _COLOURS)
    return None if codes is None or polygon.max() >= len(codes) else np.repeat(codes[polygon, None], 3, axis=1)


def _columns(element: _Element, choices: tuple[str, ...]) -> Floats | None:
    """(n, k) numbers of the first set of properties that an element has; codes of colours from 0 to 1."""
    for names in (choice.split() for choice in choices):
        columns = [column for name in names if isinstance(column := element.get(name), np.ndarray)]
        if len(columns) == len(names):
            kind = columns[0].dtype
            white = np.iinfo(kind).max if choices is _COLOURS and kind.kind in "ui" else 1
            return np.stack(columns, axis=1).astype(np.float64) / white
    return None


def _lists(element: _Element, names: tuple[str, ...]) -> _Lists:
    """The first of several lists that an element has; no list where it has none."""
    empty = _Lists(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    return next((lists for name in names if isinstance(lists := element.get(name), _Lists)), empty)


def _strips(strips: _Lists) -> Indices:
    """(3 m,) corners of the triangles of strips, every other one turned; -1 begins a new strip."""
    numbers = np.insert(strips.numbers.astype(np.int64), np.cumsum(strips.lengths)[:-1], -1)
    numbers = np.concatenate([[-1], numbers, [-1, -1]])
    places = np.arange(len(numbers))
    odd = (places - np.maximum.accumulate(np.where(numbers == -1, places, 0)) - 1) % 2
    first = np.flatnonzero((numbers[:-2] != -1) & (numbers[1:-1] != -1) & (numbers[2:] != -1))
    return numbers[np.stack([first, first + 1 + odd[first], first + 2 - odd[first]], axis=1)].ravel()


def _texture(file_name: str, header: str, reader: FileReader) -> Lambertian | None:
    """The texture that the header of a PLY file names, if it does."""
    comments = (line.split(maxsplit=2) for line in header.split("\n") if line.startswith("comment"))
    names = [words[2].rstrip() for words in comments if len(words) > 2 and words[1].lower() == "texturefile"]
    if not names:
        return None
    if len(set(names)) > 1:
        warn(f"{file_name} names {len(names)} textures, and all its faces show the first", FileWarning)
    try:
        return Lambertian(file_texture(reader, names[0]))
    except PlenopticError as error:
        raise FileError(f"its texture cannot be used: {error}, {REPLACE}") from None


def _elements(header: str, body: bytes) -> dict[str, _Element]:
    """The elements of a file by name. Their counts are checked first: plyfile makes room for all that they promise."""
    from plyfile import PlyData, PlyListProperty

    first = header.find("\nelement") + 1
    lines = [line for line in header[:first].split("\n") if line.split()[:1] in (["ply"], ["format"])]
    lines += [line for line in header[first:].split("\n") if line.split()[:1] not in ([], ["comment"], ["obj_info"])]
    text = "\n".join([*lines, "end_header\n"]).encode()
    layout = PlyData.read(BytesIO(re.sub(rb"(?m)^(element +\S+ +)\S+", rb"\g<1>0", text)))
    counts = [int(line.split()[2]) for line in lines if line.startswith("element")]
    if any(not 0 <= count * len(part.properties) <= len(body) for part, count in zip(layout, counts, strict=True)):
        raise FileError(f"it is cut off: it has {len(body)} bytes for {max(counts)} rows; export it again")
    elements: dict[str, _Element] = {}
    start = 0  # the number of a line, or of a byte
    if layout.text:
        body = body.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        tokens, (_, line_of_token) = parse_numbers(body), word_starts(body)
        if len(tokens) != len(line_of_token):
            raise FileError("it holds text in place of a number; export it again")
        rows_begin = np.append(np.flatnonzero(np.diff(line_of_token, prepend=-1)), len(tokens))
    for element, count in zip(layout.elements, counts, strict=True):
        order = layout.byte_order
        types: list[_Type] = [
            (part.name, *(part.list_dtype(order) if isinstance(part, PlyListProperty) else ("", part.dtype(order))))
            for part in element.properties
        ]
        if layout.text:
            elements[element.name] = _text_rows(types, tokens, rows_begin[start : start + count + 1], count)
            start += count
            continue
        rows = _equal_rows(types, count, body, start)
        if rows is None:
            return {part.name: _columns_of(part.data) for part in PlyData.read(BytesIO(text + body))}
        elements[element.name], start = rows
    return elements


def _text_rows(types: list[_Type], tokens: Floats, lines: Indices, count: int) -> _Element:
    """Rows of an element from all numbers of a file, its lines of which begin at `lines`; the last ends with them."""
    if any(length_type for _, length_type, _ in types):
        numbers, places, row_ends = tokens.tolist(), [], []
        for at in lines[:count].tolist():
            for _, length_type, _ in types:
                places.append(at)
                at += 1 + int(numbers[at]) if length_type and at < len(numbers) else 1
            row_ends.append(at)
        begins, ends = np.array(places, dtype=np.int64).reshape(-1, len(types)), np.array(row_ends, dtype=np.int64)
    else:
        begins = lines[:count, None] + np.arange(len(types))
        ends = lines[:count] + len(types)
    if len(lines) <= count or np.any(ends > lines[1:]):
        raise FileError("it is cut off: rows are missing, or have too few numbers; export it again")
    element: dict[str, NDArray[Any] | _Lists] = {}
    for (name, length_type, kind), begin in zip(types, begins.T, strict=True):
        element[name] = tokens[begin].astype(kind)
        if length_type:
            lengths = tokens[begin].astype(np.int64)
            within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
            element[name] = _Lists(lengths, tokens[np.repeat(begin + 1, lengths) + within].astype(kind))
    return element


def _equal_rows(types: list[_Type], count: int, body: bytes, start: int) -> tuple[_Element, int] | None:
    """Rows of an element whose lists are as long as in the first row, and the byte behind them; None for all others."""
    fields: list[Any] = []
    for name, length_type, kind in types:
        shape: tuple[int, ...] = ()
        if length_type:
            at = start + np.dtype(fields).itemsize
            shape = (int(np.frombuffer(body, length_type, 1, at)[0]) if count else 0,)
            fields.append((f"{name} length", length_type))
        fields.append((name, kind, shape))
    layout = np.dtype(fields)
    if start + count * layout.itemsize > len(body):
        return None
    rows = np.frombuffer(body, layout, count, start)
    element: dict[str, NDArray[Any] | _Lists] = {}
    for name, length_type, _ in types:
        element[name] = rows[name]
        if length_type:
            lengths = rows[f"{name} length"].astype(np.int64)
            if np.any(lengths != rows[name].shape[1]):
                return None
            element[name] = _Lists(lengths, rows[name].reshape(-1))
    return element, start + count * layout.itemsize


def _columns_of(rows: NDArray[Any]) -> _Element:
    """The columns of an element from plyfile, whose lists are arrays of their own."""
    element: dict[str, NDArray[Any] | _Lists] = {name: rows[name] for name in rows.dtype.names or ()}
    for name, column in element.items():
        if isinstance(column, np.ndarray) and column.dtype == object and len(column):
            element[name] = _Lists(np.fromiter(map(len, column), np.int64, len(column)), np.concatenate(column))
    return element

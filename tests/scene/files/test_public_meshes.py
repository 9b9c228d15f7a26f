"""Files of a folder of public meshes (PLENOPTIC_MESHES=), against parsers of this file.

These share neither code nor libraries with the package: struct and regular expressions for STL, OBJ and PLY, json and
arrays for glTF. Compared are the triangles' number, area and bounds, and a characteristic function of all corners.
"""

import base64
import collections
import json
import os
import re
import urllib.parse
import warnings
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.errors import PlenopticError

FOLDER = os.environ.get("PLENOPTIC_MESHES", "")
ENDINGS = (".stl", ".glb", ".gltf", ".obj", ".ply")
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
PLY_KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"}
PLY_KINDS |= {"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"}
PLY_KINDS |= {"uint32": "u4", "float32": "f4", "float64": "f8"}
MOST = 10**6
"""Triangles of a file that are compared."""

pytestmark = pytest.mark.skipif(not FOLDER, reason="PLENOPTIC_MESHES names no folder of mesh files")


class NotReadError(Exception):
    """A file that the parsers of this test do not understand."""


def stl(path):
    """Corners (n, 3, 3) of an STL file; it has no vertex normals."""
    content = path.read_bytes()
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= 84 + 50 * count > 84:
        rows = np.frombuffer(content, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("bits", "<u2")], count, 84)
        return rows["corners"].astype(np.float64), None
    number = rb"\s+([-+\w.]+)"
    corners = [tuple(map(float, found)) for found in re.findall(rb"(?im)^\s*vertex" + 3 * number, content)]
    return np.array(corners, dtype=np.float64).reshape(-1, 3, 3), None


def polygons(lengths):
    """Rows of a fan's corners for each polygon of the given numbers of corners, (triangles, 3)."""
    starts = np.cumsum([0, *lengths])
    fans = [(at, at + k, at + k + 1) for at, n in zip(starts, lengths, strict=False) for k in range(1, n - 1)]
    return np.array(fans, dtype=int).reshape(-1, 3)


def obj(path):
    content = path.read_bytes()
    text = content.decode("utf-16" if content[:2] in (b"\xfe\xff", b"\xff\xfe") else "latin-1")
    text = re.sub(r"\\\r?\n", " ", text.removeprefix("\xef\xbb\xbf"))
    v, vn, corners, lengths = [], [], [], []
    for line in text.splitlines():
        words = line.partition("#")[0].split() or [""]
        if words[0] in ("v", "vn"):
            (v if words[0] == "v" else vn).append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            for word in words[1:]:
                i, _, n = (word + "//").split("/")[:3]
                i, n = int(i), int(n or 0)
                corners.append((i - 1 if i > 0 else i + len(v), n - 1 if n >= 0 else n + len(vn)))
            lengths.append(len(words) - 1)
    at = polygons(lengths)
    normals = np.array([vn[n] if n >= 0 and vn else (0, 0, 0) for _, n in corners]).reshape(-1, 3)
    return np.array(v)[[i for i, _ in corners]][at], normals[at] if vn and normals.any() else None, lengths


def ply(path):
    content = path.read_bytes()
    end = re.search(rb"end_header *(\r\n|\n|\r)", content).end()
    header = re.split(r"[\r\n]+", content[:end].decode("latin-1"))
    elements = []
    for words in (line.split() for line in header):
        if words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    order, at = "<" if "binary_little_endian" in header[1] else ">", end
    lines = iter(re.split(rb"[\r\n]+", content[end:])) if "ascii" in header[1] else None
    tokens = iter(())

    def take(kind):
        nonlocal at
        kind = np.dtype(order + PLY_KINDS[kind])
        if lines is not None:
            return np.array(float(next(tokens))).astype(kind)
        at += kind.itemsize
        return np.frombuffer(content, kind, 1, at - kind.itemsize)[0]

    rows = {}
    for name, count, properties in elements:
        rows[name] = []
        for _ in range(count):
            if lines is not None:  # a line may hold more numbers than its element has
                tokens = iter(next(line for line in lines if line.strip()).split())
            rows[name].append({})
            for *kinds, key in properties:
                is_list = kinds[0] == "list"
                value = [take(kinds[2]) for _ in range(int(take(kinds[1])))] if is_list else take(kinds[0])
                rows[name][-1][key] = value
    faces = [row.get("vertex_indices", row.get("vertex_index")) for row in rows.get("face", ())]
    for row in rows.get("tristrips", ()):
        start = 0  # -1 ends a strip
        for k, corner in enumerate(row["vertex_indices"]):
            start = k + 1 if corner < 0 else start
            if k - start >= 2:
                a, b, c = row["vertex_indices"][k - 2 : k + 1]
                faces.append((a, b, c) if (k - start) % 2 == 0 else (b, a, c))
    corners, fans = np.array([i for face in faces for i in face], dtype=int), polygons([len(face) for face in faces])
    points, normals = (
        np.array([[row.get(c, 0) for c in names] for row in rows["vertex"]], dtype=float)
        for names in ("xyz", ("nx", "ny", "nz"))
    )
    return points[corners][fans], normals[corners][fans] if normals.any() else None, [len(face) for face in faces]


class Gltf:
    """Accessors of a glTF file, and its triangles in the world."""

    def __init__(self, path):
        content, chunk = path.read_bytes(), b""
        if content[:4] == b"glTF":
            end = 20 + int.from_bytes(content[12:16], "little")
            content, chunk = content[20:end], content[end + 8 :]
        self.all = json.loads(content)
        if set(self.all.get("extensionsRequired", ())) & {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}:
            raise NotReadError("compressed")
        self.buffers = [self.data(path, buffer.get("uri"), chunk) for buffer in self.all.get("buffers", ())]

    @staticmethod
    def data(path, uri, chunk):
        if uri is None:
            return chunk
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return (path.parent / urllib.parse.unquote(uri)).read_bytes()

    def rows(self, where, kind, count, width):
        view = self.all["bufferViews"][where["bufferView"]]
        size = width * np.dtype(kind).itemsize
        starts = (
            view.get("byteOffset", 0) + where.get("byteOffset", 0) + np.arange(count) * view.get("byteStride", size)
        )
        content = np.frombuffer(self.buffers[view["buffer"]], np.uint8)
        return content[starts[:, None] + np.arange(size)].view(kind)

    def array(self, number):
        accessor = self.all["accessors"][number]
        kind, count, width = KINDS[accessor["componentType"]], accessor["count"], WIDTHS[accessor["type"]]
        array = np.zeros((count, width), kind)
        if "bufferView" in accessor:
            array = self.rows(accessor, kind, count, width)
        if "sparse" in accessor:
            sparse, array = accessor["sparse"], array.copy()
            at = self.rows(sparse["indices"], KINDS[sparse["indices"]["componentType"]], sparse["count"], 1)[:, 0]
            array[at] = self.rows(sparse["values"], kind, sparse["count"], width)
        array = array.astype(np.float64)
        if accessor.get("normalized"):
            array = np.maximum(array / {"<i1": 127, "<u1": 255, "<i2": 32767, "<u2": 65535}[kind], -1)
        return array

    @staticmethod
    def matrix(node):
        if "matrix" in node:
            return np.array(node["matrix"], dtype=float).reshape(4, 4).T
        return placed(*(node.get(name) for name in ("translation", "rotation", "scale")))

    def primitive(self, described, weights):
        attributes, mode = described["attributes"], described.get("mode", 4)
        if mode < 4 or "POSITION" not in attributes:
            return None
        arrays = []
        for name in ("POSITION", "NORMAL"):
            array = self.array(attributes[name]) if name in attributes else None
            for weight, target in zip(weights, described.get("targets", ()), strict=False):
                if array is not None and name in target:
                    array = array + weight * self.array(target[name])
            arrays.append(array)
        points, normals = arrays
        i = self.array(described["indices"])[:, 0].astype(int) if "indices" in described else np.arange(len(points))
        if mode == 4:
            i = i[: len(i) // 3 * 3].reshape(-1, 3)
        else:
            n = range(len(i) - 2)
            i = np.array(
                [(i[0], i[k + 1], i[k + 2]) if mode == 6 else (i[k], i[k + 1 + k % 2], i[k + 2 - k % 2]) for k in n]
            )
        return points[i], None if normals is None else normals[i]

    def triangles(self):
        nodes, found = self.all.get("nodes", []), []

        def visit(number, above):
            node = nodes[number]
            here = above @ self.matrix(node)
            if "mesh" in node:
                found.extend(self.mesh(node, here))
            for child in node.get("children", ()):
                visit(child, here)

        children = {child for node in nodes for child in node.get("children", ())}
        scenes = self.all.get("scenes")
        roots = scenes[self.all.get("scene", 0)].get("nodes", ()) if scenes else set(range(len(nodes))) - children
        for root in roots:
            visit(root, np.eye(4))
        if not found:
            raise NotReadError("nothing to show")
        return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))

    def mesh(self, node, here):
        mesh = self.all["meshes"][node["mesh"]]
        matrices = [here]
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            of = {k: self.array(a) for k, a in node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"].items()}
            each = [of.get(name) for name in ("TRANSLATION", "ROTATION", "SCALE")]
            count = max(len(a) for a in each if a is not None)
            matrices = [here @ placed(*(None if a is None else a[k] for a in each)) for k in range(count)]
        for described in mesh["primitives"]:
            read = self.primitive(described, node.get("weights", mesh.get("weights", ())))
            for matrix in matrices if read is not None and len(read[0]) else ():
                corners, normals = read
                if np.linalg.det(matrix[:3, :3]) == 0 or not area_vectors(corners).any():
                    continue
                corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
                normals = np.zeros_like(corners) if normals is None else normals @ np.linalg.inv(matrix[:3, :3])
                turn = slice(None, None, -1 if np.linalg.det(matrix[:3, :3]) < 0 else 1)
                yield corners[:, turn], normals[:, turn]


def placed(translation, rotation, scale):
    """The matrix that scales, turns by a quaternion (x, y, z, w), and shifts; None for none."""
    matrix = np.eye(4)
    if rotation is not None:
        v, w = np.array(rotation[:3], dtype=float), rotation[3]
        cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        matrix[:3, :3] += 2 * (w * cross + cross @ cross) / (v @ v + w * w)
    matrix[:3, :3] *= 1 if scale is None else np.array(scale, dtype=float)
    matrix[:3, 3] = 0 if translation is None else translation
    return matrix


def area_vectors(corners):
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.cross(b - a, c - a) / 2


def unit(vectors):
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def parsed(path):
    """Corners (n, 3, 3), normals at them, zeros for none, and the polygons' numbers of corners if not all are 3."""
    ending = path.suffix.lower()
    if ending in (".glb", ".gltf"):
        return (*Gltf(path).triangles(), ())
    corners, normals, *lengths = {".stl": stl, ".obj": obj, ".ply": ply}[ending](path)
    lengths = lengths[0] if lengths and set(lengths[0]) != {3} else ()
    return corners, np.zeros_like(corners) if normals is None else normals, lengths


def loaded(path):
    corners, normals, parts = [], [], pl.load_meshes(path, unit="mm", material=pl.Lambertian())
    size = sum(len(p) * len(p.mesh.faces) if isinstance(p, pl.scene.Instances) else len(p.faces) for p in parts)
    if size > MOST:
        raise NotReadError(f"{size} triangles")
    for part in parts:
        is_many = isinstance(part, pl.scene.Instances)
        for mesh in [part.mesh.transformed(matrix) for matrix in part.matrices] if is_many else [part]:
            corners.append(mesh.vertices[mesh.faces])
            normals.append(np.zeros_like(corners[-1]) if mesh.normals is None else mesh.normals[mesh.faces])
    return np.concatenate(corners), np.concatenate(normals)


def characteristic(corners, normals, low, size):
    """(32,): sums over all corners of cos(w x), x = (position, normal, normal of the triangle), each times its area.

    It does not depend on the order of triangles. A corner that is off by a share e of the size changes it by e or so.
    """
    flat, rng, total = area_vectors(corners), np.random.default_rng(1), np.zeros(32)
    w, b = rng.normal(0, 3, (9, 32)), rng.uniform(0, 6, 32)
    areas = np.linalg.norm(flat, axis=1)
    for k in np.array_split(np.arange(len(corners)), len(corners) // 10000 + 1):
        of_triangles = np.broadcast_to(unit(flat[k])[:, None], (len(k), 3, 3))
        x = np.concatenate([(corners[k] - low) / size, unit(normals[k]), of_triangles], axis=2)
        total += (areas[k, None, None] * np.cos(x @ w + b)).sum(axis=(0, 1))
    return total / areas.sum()


def different(corners, normals, low, size):
    """(n, 6): the positions and normals of all different corners, to nine digits, whatever divides the polygons."""
    rows = np.concatenate([(corners - low) / size, unit(normals)], axis=2).reshape(-1, 6)
    return np.unique(np.round(rows, 9) + 0.0, axis=0)


def difference(path):
    """How a file's mesh differs from what the parser finds, or None."""
    got, got_normals = loaded(path)
    corners, normals, lengths = parsed(path)
    if not np.isfinite(corners).all():
        return "is read though not finite"
    if len(got) != len(corners):
        return f"has {len(got)} triangles for {len(corners)}"
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = np.linalg.norm(high - low)
    bounds = np.array([got.min(axis=(0, 1)), got.max(axis=(0, 1))])
    if np.abs(bounds - [low, high]).max() > 1e-9 * (size + np.abs([low, high]).max()):
        return f"has the bounds {bounds.tolist()} for {[low.tolist(), high.tolist()]}"
    flat, got_flat = area_vectors(corners), area_vectors(got)
    if lengths and not np.array_equal(different(corners, normals, low, size), different(got, got_normals, low, size)):
        return "has other corners or normals"
    if lengths:  # any division of a polygon has its vector area; a plane one has the length of that as its area
        owner = np.repeat(np.arange(len(lengths)), np.maximum(np.array(lengths) - 2, 0))
        whole = np.stack([np.bincount(owner, column, len(lengths)) for column in flat.T], axis=1)
        expected = np.linalg.norm(whole, axis=1).sum()
        if np.abs(got_flat.sum(axis=0) - whole.sum(axis=0)).max() > 1e-9 * expected:
            return f"has the vector area {got_flat.sum(axis=0)} for {whole.sum(axis=0)}"
        heights = ((corners - corners[:, :1]) * unit(whole)[owner][:, None]).sum(axis=2)
        if np.abs(heights).max() > 1e-6 * size:
            return None  # the area of bent polygons is that of their division
    else:
        expected = np.linalg.norm(flat, axis=1).sum()
    found = np.linalg.norm(got_flat, axis=1).sum()
    if abs(found - expected) > 1e-9 * expected:
        return f"has the area {found} for {expected}"
    off = characteristic(got, got_normals, low, size) - characteristic(corners, normals, low, size)
    if not lengths and np.abs(off).max() > 1e-7:
        return f"differs in corners or normals by {np.abs(off).max():.1e}"
    return None


@pytest.mark.slow
@pytest.mark.timeout(0)
def test_public_meshes_are_read_as_their_parsers_find_them():
    told, counts = {}, collections.Counter()
    for path in sorted(p for p in Path(FOLDER).rglob("*") if p.suffix.lower() in ENDINGS):
        name, ending = str(path.relative_to(FOLDER)), path.suffix.lower()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                told[name] = difference(path)
                counts[f"{ending} agree"] += told[name] is None
            except PlenopticError as error:
                counts[f"{ending} refused"] += 1
                print(f"{name}: refused: {str(error).removeprefix(str(path))[:200]}")
            except (NotReadError, ValueError, KeyError, IndexError, OSError, AttributeError, StopIteration) as error:
                counts[f"{ending} not parsed here"] += 1
                print(f"{name}: not parsed here: {type(error).__name__} {str(error)[:80]}")
    print(dict(sorted(counts.items())))
    assert {name: text for name, text in told.items() if text} == {}
    assert sum(counts.values()) > 0

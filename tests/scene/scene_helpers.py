"""Meshes, places, directions and glTF files that tests of scenes share."""

import base64
import json
import math

import numpy as np

import plenoptic as pl

CORNERS = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]])
FACES = np.array([[0, 1, 2], [1, 3, 2]])
GREY = pl.Lambertian()
UV = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
GREY_MAP = pl.Texture(np.full((2, 3, 1), 0.5))
LAMP = pl.QuadLight((0, 0, 9), (3, 0, 0), (0, 4, 0), radiance=2.0)
SKY = pl.EnvironmentMap(np.ones((2, 4, 1)))


def square(material=GREY, **more):
    return pl.Mesh(CORNERS, FACES, material, **more)


def corners_of(mesh):
    """(n, 3 corners, 3)."""
    return mesh.vertices[mesh.faces]


def area_vectors(mesh):
    a, b, c = np.moveaxis(corners_of(mesh), 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def area(mesh):
    return np.linalg.norm(area_vectors(mesh), axis=1).sum()


def volume(mesh):
    """Positive where the fronts are outside."""
    a, b, c = np.moveaxis(corners_of(mesh), 1, 0)
    return (np.cross(a, b) * c).sum() / 6


def towards(angle_deg, azimuth_deg=0.0):
    """(1, 3): the unit vector at an angle from the normal; more than 90 degrees are behind the surface."""
    t, p = math.radians(angle_deg), math.radians(azimuth_deg)
    return np.array([[math.sin(t) * math.cos(p), math.sin(t) * math.sin(p), math.cos(t)]])


def smith(z, alpha):
    """Smith's Lambda of GGX (Heitz 2014, eq. 72): (sqrt(1 + alpha^2 tan^2) - 1) / 2."""
    return 0.5 * (np.sqrt(1 + alpha**2 * (1 / z**2 - 1)) - 1)


def turned(rng, count, *, reach=100.0, mirrored=False):
    """Random rotations after scalings along the axes of the mesh, (count, 4, 4)."""
    matrices = np.tile(np.eye(4), (count, 1, 1))
    rotation = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    rotation[:, :, 0] *= np.sign(np.linalg.det(rotation) * (-1 if mirrored else 1))[:, None]
    matrices[:, :3, :3] = rotation * rng.uniform(0.3, 2, (count, 1, 3))
    matrices[:, :3, 3] = rng.uniform(-reach, reach, (count, 3))
    return matrices


COMPONENTS = {"<i1": 5120, "<u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


class Writer:
    """A glTF file in one text, with its arrays as accessors."""

    def __init__(self):
        self.header = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "meshes": [], "nodes": []}
        self.bytes = b""

    def view(self, content, **more):
        self.header["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(content), **more}
        )
        self.bytes += content + bytes(-len(content) % 4)
        return len(self.header["bufferViews"]) - 1

    def array(self, numbers, kind="<f4", **more):
        array = np.asarray(numbers, dtype=kind)
        width = 1 if array.ndim == 1 else array.shape[1]
        entry = {"componentType": COMPONENTS[kind], "count": len(array), "type": TYPES[width]}
        self.header["accessors"].append({**entry, "bufferView": self.view(array.tobytes()), **more})
        return len(self.header["accessors"]) - 1

    def mesh(self, points, indices=None, material=None, mode=None, name=None, **attributes):
        primitive = {"attributes": {"POSITION": self.array(points), **attributes}}
        if indices is not None:
            primitive["indices"] = self.array(np.ravel(indices), "<u2")
        primitive |= {} if material is None else {"material": material}
        primitive |= {} if mode is None else {"mode": mode}
        self.header["meshes"].append({"primitives": [primitive]} | ({} if name is None else {"name": name}))
        return len(self.header["meshes"]) - 1

    def node(self, **described):
        self.header["nodes"].append(described)
        return len(self.header["nodes"]) - 1

    def save(self, path, **more):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.bytes).decode()
        buffers = [{"uri": uri, "byteLength": len(self.bytes)}]
        path.write_text(json.dumps(self.header | {"buffers": buffers} | more))
        return path

"""glTF files: what they name, claim, repeat and nest."""

import base64
import json
import os
import struct

import numpy as np
from hostile_images import many_scans, png

import plenoptic as pl

TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], dtype="<f4").tobytes()
INDICES = np.array([0, 1, 2, 0], dtype="<u2").tobytes()
OUTSIDE = "lies outside of"
POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 100 100\n(x) run\n%%EOF\n"


def data(content):
    return {"uri": "data:;base64," + base64.b64encode(content).decode(), "byteLength": len(content)}


def header():
    """A triangle with indices, in one text."""
    return {
        "asset": {"version": "2.0"},
        "buffers": [data(TRIANGLE + INDICES)],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 3},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }


def loading(folder, described):
    path = folder / "files.gltf"
    path.write_text(described if isinstance(described, str) else json.dumps(described))
    return lambda: pl.load_file(path)


def text(content):
    return lambda folder: loading(folder, content)


def changed(change):
    """A file whose header a function changes."""

    def make(folder):
        described = header()
        change(described)
        return loading(folder, described)

    return make


def put(*place):
    """A file with another entry: the way to it, and what it is there."""
    *way, last, entry = place

    def change(described):
        for step in way:
            described = described[step]
        described[last] = entry

    return changed(change)


def named(uri):
    """A buffer of that name."""
    return put("buffers", 0, {"uri": uri, "byteLength": 36})


def absolute(encode):
    def make(folder):
        name = str(folder.parent / "secret.bin")
        return named("".join(f"%{ord(c):02x}" for c in name) if encode else name)(folder)

    return make


def linked_folder(folder):
    (folder / "textures").symlink_to(folder.parent)
    return named("textures/secret.bin")(folder)


def pipe(folder):
    os.mkfifo(folder / "pipe.bin")
    return named("pipe.bin")(folder)


def pipe_itself(folder):
    os.mkfifo(folder / "files.glb")
    return lambda: pl.load_file(folder / "files.glb")


def image(**described):
    def make(folder):
        changed = header()
        changed["accessors"].append({"componentType": 5126, "type": "VEC2", "count": 3})
        changed["meshes"][0]["primitives"][0] |= {"material": 0}
        changed["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 2
        changed["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        changed["textures"], changed["images"] = [{"source": 0}], [described]
        return loading(folder, changed)

    return make


def pictured(name, content):
    """A file with an image beside it."""

    def make(folder):
        (folder / name).write_bytes(content(folder))
        return image(uri=name)(folder)

    return make


def many_materials(folder):
    """One image, in so many colours that all of them together fill memory."""
    (folder / "picture.png").write_bytes(png(512, 512, b"\x80"))
    described = header()
    described["accessors"].append({"componentType": 5126, "type": "VEC2", "count": 3})
    attributes, count = {"POSITION": 0, "TEXCOORD_0": 2}, 400
    described["meshes"] = [{"primitives": [{"attributes": attributes, "material": k} for k in range(count)]}]
    described["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [k / count, 0.5, 0.5, 1], "baseColorTexture": {"index": 0}}}
        for k in range(1, count + 1)
    ]
    described["textures"], described["images"] = [{"source": 0}], [{"uri": "picture.png"}]
    return loading(folder, described)


def instances(count, triangles):
    def change(described):
        described["accessors"].append({"componentType": 5126, "type": "VEC3", "count": count})
        places = {"count": 3, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 2}}
        corners = {"componentType": 5121, "type": "SCALAR", "count": 3 * triangles, "sparse": places}
        described["accessors"].append(corners)
        described["bufferViews"].append({"buffer": 1, "byteLength": 3})
        described["buffers"].append(data(bytes((0, 1, 2))))
        described["meshes"][0]["primitives"][0]["indices"] = 3
        described["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}

    return changed(change)


def children(*lists):
    """Nodes of these children after the mesh's."""
    return put("nodes", [{"mesh": 0}, *({"children": each} if each else {} for each in lists)])


def itself(described):
    described |= {"buffers": [{"uri": "files.gltf", "byteLength": 36}] * 3000, "padding": "x" * 100_000}


def no_light(described):
    described["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    described["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": -1}}


def nested(described):
    described["nodes"] = [{"children": [k + 1]} for k in range(200_000)] + [{"mesh": 0}]


def flat(described):
    described["nodes"] = [{"children": list(range(1, 200_000))}, *({"mesh": 0} for _ in range(199_999))]


def sparse(indices, count=1, kind="<i2"):
    def change(described):
        content = np.array(indices, dtype=kind).tobytes()
        described["buffers"].append(data(content + bytes(-len(content) % 4) + TRIANGLE))
        described["bufferViews"].append({"buffer": 1, "byteLength": len(content)})
        described["bufferViews"].append({"buffer": 1, "byteOffset": len(content) + -len(content) % 4, "byteLength": 36})
        code = {"<i2": 5122, "<u2": 5123}[kind]
        places = {"bufferView": 2, "componentType": code}
        described["accessors"][0]["sparse"] = {"count": count, "indices": places, "values": {"bufferView": 3}}

    return changed(change)


def glb(length=None, chunk=None, content=b"{}"):
    def make(folder):
        sizes = 20 + len(content) if length is None else length, len(content) if chunk is None else chunk
        path = folder / "files.glb"
        path.write_bytes(b"glTF" + struct.pack("<III4s", 2, *sizes, b"JSON") + content)
        return lambda: pl.load_file(path)

    return make


ZEROS = {"componentType": 5126, "type": "VEC3", "count": 375_000_000}
POSITION, VIEW = ("accessors", 0), ("bufferViews", 0)
PRIMITIVE = ("meshes", 0, "primitives", 0)
GLTF = {
    "gltf: a good file": (changed(lambda described: None), None),
    # What it names
    "gltf: parent folder": (named("../secret.bin"), OUTSIDE),
    "gltf: parent folder in per cent": (named("%2e%2e%2fsecret.bin"), OUTSIDE),
    "gltf: parent folder by a detour": (named("a/b/../../../secret.bin"), OUTSIDE),
    "gltf: absolute path": (absolute(False), OUTSIDE),
    "gltf: absolute path in per cent": (absolute(True), OUTSIDE),
    "gltf: a link out": (named("secret.bin"), OUTSIDE),
    "gltf: a folder that is a link out": (linked_folder, OUTSIDE),
    "gltf: file URI": (named("file:///etc/passwd"), "is missing"),
    "gltf: drive letter": (named("C:\\secret.bin"), "is missing"),
    "gltf: zero in a name": (named("a%00b.bin"), "cannot be used"),
    "gltf: endless name": (named("a" * 100_000), "'a+'"),
    "gltf: device": (named("/dev/zero"), OUTSIDE),
    "gltf: image of the parent folder": (image(uri="../secret.png"), OUTSIDE),
    "gltf: pipe": (pipe, "pipe.bin' is no file"),
    "gltf: pipe itself": (pipe_itself, "files.glb' is no file"),
    "gltf: folder for a buffer": (named("."), "is a folder"),
    "gltf: the file itself, again and again": (changed(itself), "the limit is 268435456"),
    "gltf: EPS named PNG": (pictured("a.png", lambda _: POSTSCRIPT), "not an image"),
    # What it claims to hold
    "gltf: zeros without a buffer view": (put(*POSITION, ZEROS), "accessors 0 would take 9000000000 bytes of memory"),
    "gltf: stride 0": (put(*VIEW, {"buffer": 0, "byteLength": 36, "byteStride": 0}), "byteStride 0.*export it again"),
    "gltf: negative stride": (put(*VIEW, {"buffer": 0, "byteLength": 36, "byteStride": -12}), "byteStride -12"),
    "gltf: stride too small": (put(*VIEW, {"buffer": 0, "byteLength": 36, "byteStride": 4}), "byteStride 4"),
    "gltf: more than the buffer view": (put(*POSITION, "count", 4), "accessors 0 ends beyond its bufferViews 0"),
    "gltf: far more than the buffer view": (put(*POSITION, "count", 10**15), "accessors 0 ends beyond"),
    "gltf: more than any number": (put(*POSITION, "count", 10**30), "count 10+; it must be"),
    "gltf: no elements": (put(*POSITION, "count", 0), "accessors 0 has the count 0"),
    "gltf: half an element": (put(*POSITION, "count", 2.5), "accessors 0 has the count 2.5"),
    "gltf: offset before the view": (put(*POSITION, "byteOffset", -12), "accessors 0 has the byteOffset -12"),
    "gltf: view before the buffer": (put(*VIEW, "byteOffset", -1), "bufferViews 0 has the byteOffset -1"),
    "gltf: view beyond the buffer": (put(*VIEW, "byteLength", 10**12), "bufferViews 0 ends beyond its buffer"),
    "gltf: buffer -1": (put(*VIEW, "buffer", -1), "number -1 of its 1 buffers"),
    "gltf: buffer view -1": (put(*POSITION, "bufferView", -1), "number -1 of its 2 bufferViews"),
    "gltf: accessor True": (put(*PRIMITIVE, "attributes", "POSITION", True), "number True of its 2 accessors"),
    "gltf: buffer shorter than said": (put("buffers", 0, "byteLength", 10**10), "buffers 0 is cut off"),
    "gltf: unknown component": (put(*POSITION, "componentType", 5130), "componentType 5130"),
    "gltf: unknown type": (put(*POSITION, "type", ["VEC3"]), r"type \['VEC3'\]"),
    "gltf: positions of two components": (put(*POSITION, "type", "VEC2"), "POSITION"),
    "gltf: normalised floats": (put(*POSITION, "normalized", True), "accessors 0 is normalised float32"),
    "gltf: signed indices": (put("accessors", 1, "componentType", 5122), "indices .accessors 1. are no whole numbers"),
    "gltf: indices of floats": (put(*PRIMITIVE, "indices", 0), "indices .accessors 0. are no whole numbers"),
    "gltf: index beyond": (put(*POSITION, "count", 2), "out of bounds for 2 vertices"),
    "gltf: negative sparse index": (sparse([-1]), "componentType 5122"),
    "gltf: sparse index beyond": (sparse([3], kind="<u2"), "reach 3"),
    "gltf: sparse indices that fall": (sparse([1, 0], 2, "<u2"), "do not grow"),
    "gltf: more sparse rows than rows": (sparse([0] * 9, 10**9, "<u2"), "count 1000000000"),
    "gltf: mode 99": (put(*PRIMITIVE, "mode", 99), "mode 99; it must be from 0 to 6"),
    "gltf: mode -1": (put(*PRIMITIVE, "mode", -1), "mode -1"),
    "gltf: mesh -1": (put("nodes", 0, "mesh", -1), "number -1 of its 1 meshes"),
    "gltf: light -1": (changed(no_light), "number -1 of its 1 lights"),
    "gltf: JPEG of 20 000 scans": (pictured("a.jpg", many_scans), "JPEG file of 200[0-9]+ scans"),
    "gltf: image bomb": (pictured("a.png", lambda _: png(8192, 8192)), "bytes of memory, while files of"),
    "gltf: one image in many colours": (many_materials, "bytes of memory, while files of"),
    "gltf: image without content": (image(), "texture of material"),
    # How it is built
    "gltf: 1e7 instances of a triangle": (instances(10**7, 1), "10000000 instances would take"),
    "gltf: 1e7 instances of a mesh": (instances(10**7, 1000), "10000000 instances would take"),
    "gltf: 700 000 instances of a mesh": (instances(700_000, 1000), None),
    "gltf: 200 000 nodes below each other": (changed(nested), None),
    "gltf: 200 000 nodes with a mesh": (changed(flat), "copies of its mesh 0 would take"),
    "gltf: a circle of nodes": (children([2], [1]), "node 1 hangs on itself"),
    "gltf: two parents": (children([3], [3], []), "node 3 hangs on several others"),
    "gltf: its own child": (put("nodes", 0, "children", [0]), "node 0 hangs on itself"),
    "gltf: child -1": (put("nodes", 0, "children", [-1]), "number -1 of its 1 nodes"),
    "gltf: scene of no node": (put("scenes", 0, "nodes", [7]), "number 7 of its 1 nodes"),
    "gltf: scene twice of a node": (put("scenes", 0, "nodes", [0, 0]), "lists a node twice"),
    "gltf: matrix of three numbers": (put("nodes", 0, "matrix", [1, 0, 0]), "matrix that is not 16 numbers"),
    "gltf: translation of texts": (put("nodes", 0, "translation", list("abc")), "translation that is not 3 numbers"),
    "gltf: no rotation": (put("nodes", 0, "rotation", [0, 0, 0, 0]), "rotation of 0"),
    "gltf: NaN": (put("nodes", 0, "scale", [float("nan"), 1, 1]), "number NaN, which JSON does not know"),
    "gltf: 1e999": (text(json.dumps(header()).replace('{"mesh"', '{"scale": [1e999, 1, 1], "mesh"')), "files.gltf"),
    "gltf: brackets": (text("[" * 10**6), "cannot be read"),
    "gltf: a number of a million digits": (text("1" * 10**6), "cannot be read"),
    "gltf: a list": (text("[]"), "no glTF file"),
    "gltf: everything else": (put("nodes", 5), "files.gltf"),
    "gltf: texts for lists": (put("meshes", "abc"), "number 0 of its 0 meshes"),
    "glb: longer than it is": (glb(length=2**31), "cut off"),
    "glb: chunk longer than it is": (glb(length=22, chunk=2**31), "cut off"),
    "glb: nothing in it": (glb(), "files.glb"),
}

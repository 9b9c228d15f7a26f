"""OBJ, PLY, STL, lens files, glasses, checkpoints."""

import hashlib
import json
import math
import os
import struct

import plenoptic as pl
from plenoptic.core.files.record_log import RecordLog
from plenoptic.rendering.schedule.checkpoint import KIND

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FACE = "f 1 2 3\n"
BODY = CORNERS + FACE
OUTSIDE = "lies outside of"
PLY = "ply\nformat {} 1.0\n{}element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY_FACES = "element face {}\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def load_checkpoint(path):
    log = RecordLog(path, KIND)
    try:
        return [log.read(entry) for entry in log.entries]
    finally:
        log.close()


LOADERS = {"agf": pl.optics.load_glasses, "checkpoint": load_checkpoint}
LOADERS |= dict.fromkeys(("csv", "json", "seq", "txt", "zmx"), pl.load_lens)
LOADERS |= dict.fromkeys(("obj", "ply", "stl"), pl.load_file)


def load(path):
    """By what reads files of that ending."""
    return LOADERS[path.suffix[1:]](path)


def written(name, content, **others):
    """A file that is loaded, and others beside it."""

    def make(folder):
        for other, inside in {name: content, **others}.items():
            inside = inside(folder) if callable(inside) else inside
            (folder / other).write_bytes(inside if isinstance(inside, bytes) else inside.encode())
        return lambda: load(folder / name)

    return make


def ply(kind, faces, more=""):
    return written("a.ply", PLY.format(kind, more) + PLY_FACES.format(faces))


def obj(text, mtl="newmtl a\nKd 1 1 1\n"):
    return written("a.obj", text, **{"a.mtl": mtl})


def textured(image):
    return obj(f"mtllib a.mtl\n{CORNERS}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n", f"newmtl a\nmap_Kd {image}\n")


def spiral(count):
    """Two turns that run back on themselves: dividing it takes time by the cube of its corners."""
    turns = [*range(count // 2), *(k + 0.5 for k in reversed(range(count // 2)))]
    lines = [f"v {k * math.cos(k / 10):.6f} {k * math.sin(k / 10):.6f} 0\n" for k in turns]
    return "".join(lines) + "f " + " ".join(map(str, range(1, count + 1))) + "\n"


def pipe(name):
    def make(folder):
        os.mkfifo(folder / name)
        return lambda: load(folder / name)

    return make


def named_pipe(folder):
    os.mkfifo(folder / "pipe.png")
    return textured("pipe.png")(folder)


def checkpoint(records, header=b'{"identity": {}, "tile_side": 8}', version=2):
    """A checkpoint whose digests are right, whatever it says."""
    start = b"plenoptic checkpoint %d\n%s %016d\n" % (version, hashlib.sha256(header).hexdigest().encode(), len(header))
    return written("a.checkpoint", start + header + records)


def checkpoint_record(arrays, length, body=b""):
    head, digest = json.dumps({"facts": {}, "arrays": arrays}).encode(), hashlib.blake2b(body, digest_size=16).digest()
    sizes = struct.pack("<IQ", len(head), length)
    of_head = hashlib.blake2b(sizes + digest + head, digest_size=16).digest()
    return b"\x93plenoptic rec\r\n" + sizes + of_head + digest + head + body


def large(name):
    """A file with a hole in it, that takes no room on the disk."""

    def make(folder):
        with open(folder / name, "wb") as file:
            file.truncate(2**40)
        return lambda: load(folder / name)

    return make


def absolute_materials(folder):
    return f"mtllib {folder.parent}/secret.mtl\n{BODY}"


AGAIN = "".join(f"mtllib {'./' * k}a.mtl\n" for k in range(1, 3000))
LIST, SPACES, LITTLE = "property list uchar int a\n", " " * 100_000, "binary_little_endian"
SPACED = f"comment texturefile{SPACES}a{SPACES}b\n"
LONG = "element face 1\nproperty list uint int vertex_indices\nend_header\n"
UNEQUAL = (PLY.format(LITTLE, "") + PLY_FACES.format(200_000)).partition("0 0 0\n")[0].encode()
UNEQUAL += struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + struct.pack("<B3i", 3, 0, 1, 2) * 199_999
UNEQUAL += struct.pack("<B4i", 4, 0, 1, 2, 1)
SOLID = "solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid a\n"
SURFACES = "".join(f"SURF {k}\n CURV 0.01\n DISZ 1\n" for k in range(100_000))
TOO_MANY = "a.csv, line 100001: there are 100000 surfaces and stops; a lens has at most 10000"
NO_NUMBER = checkpoint_record([("a", "<f8", (0, 10**18, 10**18))], 0)
TABLE = "radius;thickness;material;index;v-no;sa\n"
ZMX = "MODE SEQ\nUNIT MM\n"
TEXTS = {
    "obj: a good file": (obj(BODY), None),
    "obj: materials of the parent folder": (obj(f"mtllib ../secret.mtl\n{BODY}"), OUTSIDE),
    "obj: materials by an absolute path": (written("a.obj", absolute_materials), OUTSIDE),
    "obj: materials from a device": (obj(f"mtllib /dev/zero\n{BODY}"), OUTSIDE),
    "obj: materials in a folder": (obj(f"mtllib .\n{BODY}"), "is a folder"),
    "obj: materials again and again": (obj(AGAIN + BODY, "# " + "x" * 100_000), "the limit is 268435456"),
    "obj: map of the parent folder": (textured("../secret.png"), OUTSIDE),
    "obj: map of the parent folder, backslashes": (textured("..\\secret.png"), OUTSIDE),
    "obj: map that is a link out": (textured("secret.bin"), OUTSIDE),
    "obj: map that is a pipe": (named_pipe, "pipe.png' is no file"),
    "obj: map that is missing": (textured("C:\\a.png"), "does not exist"),
    "obj: a pipe": (pipe("a.obj"), "a.obj' is no file"),
    "obj: spaces in a name": (obj(f"mtllib a{SPACES}b\n{BODY}"), None),
    "obj: a spiral of 50 000 corners": (obj(spiral(50_000)), "concave faces of up to 50000 corners"),
    "obj: spaces before a comment": (obj(BODY + ("f " + " " * 1000 + "\n") * 100 + " " * 10**6), None),
    "obj: index beyond": (obj(CORNERS + "f 1 2 1000000000000\n"), "a.obj"),
    "obj: index beyond any number": (obj(CORNERS + f"f 1 2 {10**40}\n"), "a.obj"),
    "obj: no vertices": (obj(FACE), "a.obj"),
    "obj: a face of 1e6 corners": (obj(CORNERS + "f " + "1 2 3 " * 333_333 + "\n"), None),
    "obj: 100 000 materials": (obj(CORNERS + "".join(f"usemtl m{k}\n{FACE}" for k in range(100_000))), "100000 parts"),
    "obj: zeros": (obj(b"\0" * 10**6), "a.obj"),
    "obj: a hole": (large("a.obj"), "the limit is 268435456"),
    "ply: a good file": (ply("ascii", 1), None),
    "ply: texture of the parent folder": (ply("ascii", 1, "comment TextureFile ../secret.png\n"), OUTSIDE),
    "ply: texture from a device": (ply("ascii", 1, "comment TextureFile /dev/stdin\n"), OUTSIDE),
    "ply: 4e9 faces": (ply(LITTLE, 4 * 10**9), "it is cut off"),
    "ply: 4e9 faces in text": (ply("ascii", 4 * 10**9), "it is cut off"),
    "ply: a list of 4e9": (written("a.ply", PLY.format(LITTLE, "") + LONG + "\xff" * 40), "a.ply"),
    "ply: 2e5 lists, one longer": (written("a.ply", UNEQUAL), None),
    "ply: 1e30 faces": (ply(LITTLE, 10**30), "a.ply"),
    "ply: -1 faces": (ply("binary_big_endian", -1), "a.ply"),
    "ply: endless header": (written("a.ply", PLY.format("ascii", "comment\n" * 200_000)), "a.ply"),
    "ply: 990 lists": (written("a.ply", PLY.format(LITTLE, "") + LIST * 990 + PLY_FACES.format(1)), "a.ply"),
    "ply: spaces in a comment": (written("a.ply", PLY.format("ascii", SPACED)), "a.ply"),
    "ply: a pipe": (pipe("a.ply"), "a.ply' is no file"),
    "stl: 4e9 triangles": (written("a.stl", bytes(80) + b"\xff\xff\xff\xff" + bytes(50)), "cut off"),
    "stl: 100 000 solids": (written("a.stl", SOLID * 100_000), "100000 parts"),
    "lens: a pipe": (pipe("a.json"), "a.json' is no file"),
    "lens: a device": (lambda folder: lambda: pl.load_lens("/dev/zero.csv"), "does not exist"),
    "lens: a hole": (large("a.zmx"), "the limit is 4194304"),
    "lens: brackets": (written("a.json", "[" * 10**6), "a.json"),
    "lens: 1e5 surfaces in a table": (written("a.csv", TABLE + "10;1;;1.5;;1\n" * 100_000), TOO_MANY),
    "lens: 1e5 surfaces of Zemax": (written("a.zmx", ZMX + SURFACES), "a.zmx, line .*: there are 10001 surfaces"),
    "lens: numbers of 1e5 digits": (written("a.csv", f"{TABLE}{'9' * 100_000};1;;1.5;;1\n"), "a.csv"),
    "glasses: a pipe": (pipe("a.agf"), "a.agf' is no file"),
    "glasses: 1e5 names": (written("a.agf", "NM A 2 517642 1.5168 64.17\n" * 100_000), None),
    "glasses: a number of 1e5 digits": (written("a.agf", f"NM A {'9' * 100_000} 517642 1.5 64\n"), "a.agf"),
    "checkpoint: 1e18 numbers": (checkpoint(checkpoint_record([("a", "<f8", (10**9, 10**9))], 8 * 10**18)), None),
    "checkpoint: no number, in rows of 1e18": (checkpoint(NO_NUMBER), "cannot be read"),
    "checkpoint: objects": (checkpoint(checkpoint_record([("a", "|O", (1,))], 8, bytes(8))), None),
    "checkpoint: a thousand marks": (checkpoint(1000 * b"\x93plenoptic rec\r\n"), None),
    "checkpoint: brackets": (checkpoint(b"", b"[" * 10**6), "cannot be understood"),
    "checkpoint: of another version": (checkpoint(b"", version=1), "has version 1 of the format, not 2"),
    "checkpoint: a pipe": (pipe("a.checkpoint"), "is no file"),
}

"""Small good files of all formats, damaged at random: bits, numbers, pieces, ends.

`python mutations.py FOLDER COUNT SEED` damages each COUNT times, reads them, and prints as JSON what went wrong.
"""

import faulthandler
import json
import random
import re
import resource
import struct
import sys
import time
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
from corpus import HANGS, peak
from hostile_folders import INNER, SIZES, good, in_folder, zipped
from hostile_gltf import INDICES, TRIANGLE, data, header
from hostile_images import jpeg, png, tiff, webp
from hostile_texts import CORNERS, PLY, PLY_FACES

import plenoptic as pl
from plenoptic.core.files.array_files import matlab_7_3
from plenoptic.dataset.contents import FORMAT

NUMBERS = ("-1", "0", "2", "65535", "4294967296", "1e300", "-1e-300", "NaN", "1e999", "9" * 400)
NUMBERS += ("null", "true", '"a"', "[]")
"""What takes the place of a number in a text."""
SLOW = 5.0
"""s of CPU."""
EDGES = (0, 1, 0x7F, 0x80, 0xFF)


def texts():
    """Files that are texts, for the most part."""
    described = header()
    described["accessors"].append({"bufferView": 2, "componentType": 5126, "type": "VEC2", "count": 3})
    described["bufferViews"] += [{"buffer": 0, "byteLength": 36, "byteStride": 12}, {"buffer": 1, "byteLength": 81}]
    described["buffers"].append(data(png(2, 2)))
    described["bufferViews"][3]["byteLength"] = described["buffers"][1]["byteLength"]
    primitive = described["meshes"][0]["primitives"][0]
    primitive["attributes"] |= {"TEXCOORD_0": 2, "NORMAL": 0, "COLOR_0": 0, "TANGENT": 3}
    described["accessors"].append({"componentType": 5126, "type": "VEC4", "count": 3})
    primitive["material"], described["images"] = 0, [{"bufferView": 3, "mimeType": "image/png"}]
    described["textures"], described["samplers"] = [{"source": 0, "sampler": 0}], [{"wrapS": 33071, "magFilter": 9728}]
    info = {"index": 0, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0.5], "scale": [2, 2]}}}
    described["materials"] = [
        {
            "pbrMetallicRoughness": {"baseColorTexture": info, "metallicFactor": 0.5, "baseColorFactor": [1, 1, 1, 1]},
            "normalTexture": {**info, "scale": 0.5},
            "alphaMode": "MASK",
            "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5}},
        }
    ]
    lights = [{"type": "spot", "spot": {"outerConeAngle": 0.5}, "intensity": 3}]
    described["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    described["cameras"] = [{"perspective": {"yfov": 0.5, "aspectRatio": 1.5}}]
    places = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}
    described["nodes"] = [
        {"mesh": 0, "children": [1, 2], "rotation": [0, 0, 0, 1], "scale": [1, 2, 3], "extensions": places},
        {"camera": 0, "matrix": np.eye(4).ravel().tolist()},
        {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]
    mtl = "newmtl a\nKd 1 1 0.5\nKs 0.1 0.1 0.1\nNs 30\nd 0.5\nillum 2\nmap_Kd a.png\n"
    zmx = "MODE SEQ\nUNIT MM\nENPD 5\nWAVM 1 0.55 1\n"
    surfaces = ((0, ""), (0.02, "GLAS BK7 1 0 1.5168 64.2"), (-0.02, ""), (0, "STOP"), (0, ""))
    for k, (curvature, glass) in enumerate(surfaces):
        zmx += f"SURF {k}\n TYPE STANDARD\n CURV {curvature}\n DISZ 3\n {glass}\n DIAM 5 1 0 0 1\n"
    return {
        "a.gltf": json.dumps(described),
        "a.obj": f"mtllib a.mtl\n{CORNERS}vt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\n",
        "a.mtl": mtl,
        "a.ply": PLY.format("ascii", "comment made by hand\n") + PLY_FACES.format(1),
        "c.obj": "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n",
        "c.ply": PLY.format("ascii", "")
        + "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
        + "property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 99\n3 0 1 2\n",
        "a.stl": "solid a\nfacet normal 0 0 1\nouter loop\n"
        "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
        "a.csv": "radius;thickness;material;index;v-no;sa\n10;1;BK7;1.5;60;5\n-50;3;air;;;5\n;1;air;;;3\n",
        "a.zmx": zmx,
        "a.seq": "RDM Y;LEN\nTITLE 'a'\nEPD 5; DIM M; WL 587.6 486.1\nREF 1\nYAN 0 5\nPRV\nPWL 587.6 486.1 400\n"
        "'b' 1.5 1.51 1.52\nEND\nSO 0 1e11\nS 50 3 'b'\nASP\nK -1; A 1e-6\nCIR 5\nS -50 3\nS 0 40\nSTO\n"
        "SI 0 0\nZOO 2\nZOO THI S2 3 4\nGO\n",
        "a.txt": "[descriptive data]\ntitle\ta\n[variable distances]\nFocal Length\t50\t60\nAngle of View\t40\t30\n"
        "d0\tInfinity\t500\nd2\t3\t4\nBf\t40\t41\n[lens data]\n1\t50\t3\t1.5168\t20\t64\tN-BK7\tSchott\n"
        "2\t-50\td2\t\t20\n3\tAS\tBf\t\t10\n[aspherical data]\n1\t50\t-1\t1e-6\n",
        "a.agf": "NM N-BK7 2 517642 1.5168 64.17 0\nCD 1.04 0.006 0.23 0.02 1.01 103.56\nLD 0.3 2.5\n",
    }


def good_files(folder):
    """Name and content of good files; some are only there for others."""
    found = {name: text.encode() for name, text in texts().items()}
    described = {**header(), "buffers": [{"byteLength": 42}]}
    text = json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", 44) + b"BIN\0" + TRIANGLE + INDICES
    found["a.glb"] = b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks
    ply = PLY.format("binary_little_endian", "") + PLY_FACES.format(1).partition("0 0 0\n")[0]
    found["b.ply"] = ply.encode() + TRIANGLE + b"\3" + np.arange(3, dtype="<i4").tobytes()
    found["b.stl"] = bytes(80) + (1).to_bytes(4, "little") + bytes(12) + TRIANGLE + bytes(2)
    found |= {"a.png": png(4, 4, b"\x80"), "a.tif": tiff(4, 4), "a.jpg": jpeg(folder, 8), "a.webp": webp(8, 8)}
    found["a.hdr"] = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n" + bytes(range(100, 116))
    lens, array = pl.load_lens("double-gauss-100mm-f2"), pl.MicrolensArray(pitch=0.1, focal_lengths=0.4)
    camera = pl.PlenopticCamera(lens, pl.Sensor((4, 4), 0.01), 100.0, array, 0.4)
    shot = pl.Exposure(np.ones((4, 4, 3)), standard_error=np.ones((4, 4, 3)), samples=4, seed=1, camera=camera)
    shot.save(folder / "a.exr")
    shot.develop(pl.SensorModel(photon_rate=100.0)).save(folder / "raw.tif")
    pl.save_lens(lens, folder / "a.json")
    for name in ("a.exr", "raw.tif", "a.json"):
        found[name] = (folder / name).read_bytes()
    return found | good_folders(folder)


def good_folders(folder):
    """Packages, HDF5, stores, data sets and HCI folders; the files of a folder are damaged one at a time."""
    zipped(good("package"), folder / "a.zip")
    zipped(good("package"), folder / "b.zip", zipfile.ZIP_STORED)
    (folder / "a.mat").write_bytes(matlab_7_3({"LF": np.ones((1, 2, 3, 2, 3), np.uint16)}))
    with h5py.File(folder / "a.vox", "w") as file:
        file.attrs["description"], file["instrument/camera/f1"] = "VoxelDataFormat", 3.0
        file.create_dataset("data/image", data=np.ones((4, 4), np.uint16), compression="gzip").attrs["mode"] = "raw"
    found = {name: (folder / name).read_bytes() for name in ("a.zip", "b.zip", "a.mat", "a.vox")}
    found |= {
        f"a.zarr/{name}": content for name, content in good("store").items() if "image" in name or "/" not in name
    }
    found["hci/parameters.cfg"] = f"[extrinsics]\n{SIZES.format(1)}{INNER}".encode()
    image = {"camera": "a", "frame": 0, "camera_value": 0, "pose": None, "shutter": None, "samples": 1, "replicates": 1}
    image |= {"seed": 0, "motion": False, "object_names": 0, "parts": [{"arrays": ["image"]}]}
    manifest = {"format": FORMAT, "frames": 1, "complete": True, "cameras": {"a": [None]}, "images": [image]}
    manifest |= {"object_names": [None], "made_with": {"settings": None}}
    found["set/manifest.json"] = json.dumps(manifest).encode()
    in_folder({**{f"a.zarr/{name}": content for name, content in good("store").items()}, **found}, folder)
    in_folder({"hci/input_Cam000.png": png(4, 4, b"\x80")}, folder)
    return found


def damaged(content, dice):
    """The content with one to four faults."""
    for _ in range(dice.choice((1, 1, 2, 4))):
        at, kind = dice.randrange(max(1, len(content))), dice.randrange(6)
        if kind == 0:
            content = content[:at]
        elif kind == 1:
            content = content[:at] + bytes([dice.choice((dice.randrange(256), *EDGES))]) + content[at + 1 :]
        elif kind == 2:
            word = dice.choice((b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", bytes(4)))
            content = content[:at] + word + content[at + 4 :]
        elif kind == 3:
            size = dice.randrange(1, 64)
            content = content[:at] + content[at : at + size] * dice.choice((0, 2, 50)) + content[at + size :]
        else:
            numbers = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", content))
            if numbers:
                one = dice.choice(numbers)
                content = content[: one.start()] + dice.choice(NUMBERS).encode() + content[one.end() :]
    return content


def readers(name):
    """What reads a file of that name."""
    ending, first = Path(name).suffix, Path(name).parts[0]
    if ending == ".zip":
        return [pl.package.read]
    if ending in (".mat", ".vox"):
        return [pl.lightfield.read_lftoolbox if ending == ".mat" else pl.export.read_plenoptomos]
    if first == "a.zarr":
        folder = len(Path(name).parts) - 2
        return [lambda path: pl.Exposure.load(path.parents[folder])]
    if first in ("hci", "set"):
        return [lambda path: (pl.lightfield.read_hci if first == "hci" else pl.dataset.read)(path.parent)]
    if ending in (".gltf", ".glb", ".obj", ".ply", ".stl"):
        return [pl.Scene.load]
    if ending in (".json", ".csv", ".seq", ".txt", ".zmx"):
        return [pl.load_lens]
    if ending == ".agf":
        return [lambda path: [pl.optics.load_glasses(path)[name] for name in pl.optics.load_glasses(path).names]]
    if ending == ".mtl":
        return [lambda path: pl.Scene.load(path.with_suffix(".obj"))]
    if name == "raw.tif":
        return [pl.sensor.RawImage.load]
    mask = lambda path: pl.optics.MaskStop.load(path, 2.0)  # noqa: E731
    return [pl.Texture.load, pl.Exposure.load, mask, pl.EnvironmentMap.load]


def main(folder, count, seed):
    warnings.simplefilter("ignore")
    good, wrong, read = good_files(folder), [], 0
    for name, content in good.items():
        (folder / name).write_bytes(content)
    for name in good:
        readers(name)[0](folder / name)
    start = peak()
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    for name, content in good.items():
        for k in range(count):
            dice = random.Random(f"{seed} {name} {k}")
            (folder / name).write_bytes(damaged(content, dice))
            faulthandler.dump_traceback_later(HANGS, exit=True)
            print(name, k, file=sys.stderr)  # the last one, should the process be gone
            begin = time.process_time()
            try:
                dice.choice(readers(name))(folder / name)
                read += 1
            except pl.PlenopticError as error:
                if "llocate" in str(error) or "MemoryError" in str(error):
                    wrong.append(f"{name} {k}: fills memory: {error}")
            except BaseException as error:
                wrong.append(f"{name} {k}: {type(error).__name__}: {error}")
            if time.process_time() - begin > SLOW:
                wrong.append(f"{name} {k}: takes {time.process_time() - begin:.1f} s")
        (folder / name).write_bytes(content)
    faulthandler.cancel_dump_traceback_later()
    print(json.dumps({"wrong": wrong, "read": read, "of": count * len(good), "memory": peak() - start}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))

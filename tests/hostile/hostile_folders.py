"""HDF5, packages, stores, data sets, HCI folders."""

import hashlib
import io
import json
import struct
import tempfile
import zipfile
import zlib
from pathlib import Path

import numpy as np

import plenoptic as pl
from plenoptic.core.files.array_files import matlab_7_3

ELSEWHERE = "LF is stored in other files"


def hdf5(fill):
    """A .mat file of version 7.3, which `fill(file, folder)` fills."""

    def make(folder):
        import h5py

        content = io.BytesIO(matlab_7_3({}))
        with h5py.File(content, "r+") as file:
            fill(file, folder)
        (folder / "a.mat").write_bytes(content.getvalue())
        return lambda: pl.lightfield.read_lftoolbox(folder / "a.mat")

    return make


def external_bytes(file, folder):
    secret = str(folder.parent / "secret.bin").encode()
    file.create_dataset("LF", (1, 1, 3, 3, 2, 2), "u1", external=[(secret, 0, 36)])


def external_link(file, folder):
    import h5py

    file["LF"] = h5py.ExternalLink(str(folder.parent / "secret.bin"), "LF")


def soft_link(file, folder):
    import h5py

    file["a"], file["LF"] = np.zeros((1, 3, 3, 2, 2), "u1"), h5py.SoftLink("/a")


def virtual(file, folder):
    import h5py

    layout = h5py.VirtualLayout((1, 3, 3, 2, 2), "u1")
    layout[:] = h5py.VirtualSource(str(folder.parent / "secret.bin"), "LF", (1, 3, 3, 2, 2))
    file.create_virtual_dataset("LF", layout)


def wide(file, folder):
    file.create_dataset("LF", (1, 10**4, 10**4, 4, 4), "u1", chunks=(1, 100, 100, 4, 4), compression="gzip")


def large_chunks(file, folder):
    size = {"maxshape": (None,) * 5, "chunks": (1, 10**4, 10**4, 8, 1), "compression": "gzip"}
    file.create_dataset("LF", (1, 1, 1, 1, 1), "u1", **size)


def inflated_chunk(file, folder):
    """2 GB of zeros in a chunk of 36 bytes."""
    chunk = {"chunks": (1, 3, 3, 2, 2), "compression": "gzip", "shape": (1, 3, 3, 2, 2), "dtype": "u1"}
    file.create_dataset("LF", **chunk).id.write_direct_chunk((0,) * 5, zlib.compress(bytes(1 << 31), 9))


def group(file, folder):
    file.create_group("LF")


def texts(file, folder):
    file["LF"] = "a text"


MADE = {}


def good(kind):
    """Files of a small good package or store, as bytes by name; written once."""
    if kind not in MADE:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name, "a.zarr" if kind == "store" else "a")
            shot = pl.Exposure(np.ones((8, 8, 3)), samples=4, seed=1)
            if kind == "store":
                shot.save(folder)
            else:
                camera = pl.camera.example_camera(shape=(48, 48))
                shot = pl.Exposure(np.ones((48, 48, 3)), samples=4, seed=1, camera=camera)
                pl.package.write(folder, shot, shot)
            files = (path for path in folder.rglob("*") if path.is_file())
            MADE[kind] = {str(path.relative_to(folder)): path.read_bytes() for path in files}
    return MADE[kind]


def in_folder(files, folder):
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def zipped(files, path, how=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", how) as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def package(change):
    """A package in a zip file, whose files `change(files)` changes; hashes are right."""

    def make(folder):
        files = dict(good("package"))
        change(files)
        provenance = json.loads(files["provenance.json"])
        noted = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
        del noted["provenance.json"]
        if isinstance(provenance, dict) and isinstance(provenance.get("files"), dict):
            provenance["files"] = noted
        files["provenance.json"] = json.dumps(provenance).encode()
        zipped(files, folder / "a.zip")
        return lambda: pl.package.read(folder / "a.zip")

    return make


def replaced(name, content):
    return package(lambda files: files.update({name: content}))


def npz(**arrays):
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def flipped(folder):
    zipped(good("package"), folder / "a.zip")
    content = bytearray((folder / "a.zip").read_bytes())
    for at in range(200, len(content), 997):
        content[at] ^= 16
    (folder / "a.zip").write_bytes(content)
    return lambda: pl.package.read(folder / "a.zip")


def store(name, change):
    """A store, one of whose JSON files `change(tree, folder)` changes."""

    def make(folder):
        path = folder / "a.zarr"
        in_folder(good("store"), path)
        tree = json.loads((path / name).read_text())
        change(tree, path)
        (path / name).write_text(json.dumps(tree))
        return lambda: pl.Exposure.load(path)

    return make


def many_chunks(tree, path):
    tree["shape"], tree["chunk_grid"]["configuration"]["chunk_shape"] = [3000, 3000, 1], [1, 1, 1]


def inflated(codec):
    """A chunk that claims to be 2 GB large."""

    def change(tree, path):
        chunk = next(file for file in (path / "image" / "c").rglob("*") if file.is_file())
        if codec == "blosc":
            content = chunk.read_bytes()
            chunk.write_bytes(content[:4] + struct.pack("<I", 2**31 - 1) + content[8:])
        else:
            tree["codecs"] = [tree["codecs"][0], {"name": "zstd", "configuration": {"level": 1, "checksum": False}}]
            chunk.write_bytes(b"\x28\xb5\x2f\xfd\xa0" + struct.pack("<I", 2**31 - 1) + bytes(8))

    return change


def codecs(*names):
    def change(tree, path):
        tree["codecs"] = [tree["codecs"][0], *({"name": name, "configuration": {"level": 1}} for name in names)]

    return change


def attribute(**texts):
    return lambda tree, path: tree["attributes"].update({f"plenoptic:{name}": text for name, text in texts.items()})


def hci(text):
    def make(folder):
        (folder / "parameters.cfg").write_text(text)
        return lambda: pl.lightfield.read_hci(folder)

    return make


NESTED = "[extrinsics]\na0 = ha\n" + "".join(f"a{k + 1} = {f'%(a{k})s' * 10}\n" for k in range(9))
SIZES = "num_cams_x = {}\nnum_cams_y = 1\nfocus_distance_m = 1\nbaseline_mm = 1\n"
INNER = "[intrinsics]\nsensor_size_mm = 1\nfocal_length_mm = 1\n"


def data_set(content):
    def make(folder):
        (folder / "manifest.json").write_text(content)
        return lambda: pl.dataset.read(folder)

    return make


def vox(fill):
    def make(folder):
        import h5py

        with h5py.File(folder / "a.vox", "w") as file:
            file.attrs["description"] = "VoxelDataFormat"
            fill(file, folder)
        return lambda: pl.export.read_plenoptomos(folder / "a.vox")

    return make


def vox_bytes(file, folder):
    secret = str(folder.parent / "secret.bin").encode()
    file.create_dataset("data/image", (6, 6), "u1", external=[(secret, 0, 36)]).attrs["mode"] = "raw"
    file.create_group("instrument/camera")


def vox_number_elsewhere(file, folder):
    secret = str(folder.parent / "secret.bin").encode()
    file.create_dataset("data/image", data=np.zeros((2, 2))).attrs["mode"] = "raw"
    file.create_dataset("instrument/camera/f1", (2,), "f8", external=[(secret, 0, 16)])


def vox_group(file, folder):
    file.create_group("data/image").attrs["mode"] = "raw"
    file.create_group("instrument/camera")


def texts_without_end(folder):
    """The first text of a heap as free space of no size: the library looks for the next one there."""
    read = vox(vox_group)(folder)
    content = (folder / "a.vox").read_bytes()
    at = content.index(b"GCOL") + 16
    (folder / "a.vox").write_bytes(content[:at] + bytes(16) + content[at + 16 :])
    return read


BOMB = b"frame,point,X_mm,Y_mm,Z_mm,k,l,u_px,v_px,blur_px\n" + b",\n" * 10**8
FOLDERS = {
    "hdf5: bytes of another file": (hdf5(external_bytes), ELSEWHERE),
    "hdf5: a link to another file": (hdf5(external_link), "its LF is a link"),
    "hdf5: a link": (hdf5(soft_link), "its LF is a link"),
    "hdf5: a virtual dataset": (hdf5(virtual), ELSEWHERE),
    "hdf5: 1.6 GB of nothing": (hdf5(wide), "would take 1600000000 bytes"),
    "hdf5: chunks of 800 MB": (hdf5(large_chunks), "would take 800000000 bytes"),
    "hdf5: a chunk of 2 GB": (hdf5(inflated_chunk), "a chunk of LF holds more than it says"),
    "hdf5: a group": (hdf5(group), "LF is no array of numbers"),
    "hdf5: a text": (hdf5(texts), "LF is no array of numbers"),
    "vox: bytes of another file": (vox(vox_bytes), "data/image is stored in other files"),
    "vox: a number of another file": (vox(vox_number_elsewhere), "f1 is stored in other files"),
    "vox: texts without end": (texts_without_end, "keeps the library busy for ever"),
    "vox: a group": (vox(vox_group), "data/image is no array of numbers"),
    "package: a good one": (package(lambda files: None), None),
    "package: flipped bits": (flipped, r"a\.zip"),
    "package: centres without index": (
        replaced("centres.npz", npz(chief_ray_position=np.zeros((2, 2)))),
        "it has no 'ind",
    ),
    "package: centres of one number": (replaced("centres.npz", npz(chief_ray_position=np.zeros(()))), r"a\.zip"),
    "package: truth of texts": (replaced("truth.npz", npz(depth=np.array(["a"]))), "no possible ground truth"),
    "package: 200 MB of commas": (replaced("points.csv", BOMB), "more than may be unpacked"),
    "package: no points": (replaced("points.csv", b"\0\0"), "calibration points cannot be read"),
    "package: brackets": (replaced("camera.json", b"[" * 10**5), "is not JSON"),
    "package: a camera of nothing": (replaced("camera.json", b"null"), "has format None"),
    "package: provenance of a list": (replaced("provenance.json", b"[]"), "has another format"),
    "store: a good one": (store("zarr.json", lambda tree, path: None), None),
    "store: 9 million chunks": (store("image/zarr.json", many_chunks), "9000000 chunks"),
    "store: a chunk of 2 GB, blosc": (store("image/zarr.json", inflated("blosc")), "holds 2147483647 bytes where 768"),
    "store: a chunk of 2 GB, zstd": (store("image/zarr.json", inflated("zstd")), "holds 2147483647 bytes where 768"),
    "store: gzip": (store("image/zarr.json", codecs("gzip")), "is packed by"),
    "store: packed twice": (store("image/zarr.json", codecs("zstd", "zstd")), "is packed by"),
    "store: samples of null": (store("zarr.json", attribute(samples=None)), "a.zarr' holds no possible exposure"),
    "store: samples of brackets": (store("zarr.json", attribute(samples="[" * 10**5)), "no possible exposure"),
    "store: attributes of a list": (store("zarr.json", lambda tree, path: tree.update(attributes=[])), "zarr"),
    "hci: nested interpolation": (hci(f"{NESTED}num_cams_x = %(a9)s\n{INNER}"), "cannot be understood"),
    "hci: 1e6 cameras": (hci(f"[extrinsics]\n{SIZES.format(10**6)}{INNER}"), "which cannot be"),
    "hci: a number of 1e5 digits": (hci(f"[extrinsics]\n{SIZES.format('9' * 10**5)}{INNER}"), "cannot be understood"),
    "hci: nothing": (hci(""), "it has no 'intrinsics'"),
    "data set: brackets": (data_set("[" * 10**6), "is no manifest"),
    "data set: a list": (data_set("[]"), "is no manifest"),
    "data set: a number": (data_set('{"format": 7}'), "is no manifest"),
}

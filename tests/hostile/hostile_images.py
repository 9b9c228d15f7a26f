"""Images whose headers claim more than they hold, and metadata that claim to be values of the package."""

import json
import os
import struct
import zlib

import numpy as np
import PIL.Image

import plenoptic as pl

NO_IMAGE = "cannot be read as an image|is damaged|bytes of memory|must have at most"


def chunk(name, content):
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(columns, rows, texel=b"\0", *, content=None, more=b""):
    """A PNG file of three channels and one value."""
    if content is None:
        pack = zlib.compressobj(6)
        line = b"\0" + texel * (3 * columns)
        content = b"".join(pack.compress(line) for _ in range(rows)) + pack.flush()
    size = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + more + chunk(b"IDAT", content) + chunk(b"IEND", b"")


def tiff(columns, rows, channels=3, **tags):
    """A TIFF file of 8 bits whose one strip has 64 bytes."""
    numbers = {256: columns, 257: rows, 258: 8, 259: 1, 262: 2 if channels > 1 else 1, 273: 8, 277: channels}
    numbers |= {278: rows, 279: 64} | {int(tag[1:]): value for tag, value in tags.items()}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(numbers.items()))
    directory = struct.pack("<H", len(numbers)) + entries + bytes(4)
    return b"II*\0" + struct.pack("<I", 72) + bytes(64) + directory


def exr(columns, rows, names=("R", "G", "B"), metadata=None):
    """A small EXR file whose header claims another size."""

    def made(folder):
        path = folder / "made.exr"
        pl.images.write_channels(path, {name: np.zeros((2, 2)) for name in names}, metadata)
        content, box = path.read_bytes(), struct.pack("<iiii", 0, 0, 1, 1)
        path.unlink()
        assert content.count(box) == 2
        return content.replace(box, struct.pack("<iiii", 0, 0, columns - 1, rows - 1))

    return made


def jpeg(folder, side=65500):
    """A JPEG file of 8 x 8 pixels that claims to be of another size."""
    path = folder / "made.jpg"
    PIL.Image.new("L", (8, 8)).save(path)
    content = path.read_bytes()
    path.unlink()
    at = content.index(b"\xff\xc0") + 5
    return content[:at] + struct.pack(">HH", side, side) + content[at + 4 :]


def many_scans(folder):
    """A JPEG file whose second scan comes again and again."""
    path = folder / "made.jpg"
    PIL.Image.new("L", (2048, 2048), 128).save(path, progressive=True)
    content = path.read_bytes()
    path.unlink()
    first = content.index(b"\xff\xda", content.index(b"\xff\xda") + 2)
    return content[:first] + content[first : content.index(b"\xff\xc4", first)] * 20_000 + content[first:]


def webp(columns, rows):
    """A WebP file without loss and of one value: codes of one symbol take no bits."""
    size = b"\x2f" + struct.pack("<I", columns - 1 | rows - 1 << 14) + bytes.fromhex("88888800")
    size += bytes(-len(size) % 2)
    return b"RIFF" + struct.pack("<I", 12 + len(size)) + b"WEBPVP8L" + struct.pack("<I", len(size)) + size


READERS = {"Texture": pl.Texture.load, "EnvironmentMap": pl.EnvironmentMap.load}
READERS |= {"MaskStop": lambda path: pl.optics.MaskStop.load(path, 3.0), "Exposure": pl.Exposure.load}
READERS |= {"RawImage": pl.sensor.RawImage.load, "linear": pl.images.read_linear, "channels": pl.images.read_channels}


def image(name, content, reader="Texture"):
    """A file that is read: by name of a class of the package, or as plain numbers."""

    def make(folder):
        (folder / name).write_bytes(content(folder) if callable(content) else content)
        return lambda: READERS[reader](folder / name)

    return make


def pipe(reader):
    def make(folder):
        os.mkfifo(folder / "a.png")
        return lambda: READERS[reader](folder / "a.png")

    return make


def exposure(**metadata):
    """An EXR file with metadata of the package."""
    texts = {f"plenoptic:{name}": t if isinstance(t, str) else json.dumps(t) for name, t in metadata.items()}
    return image("a.exr", exr(2, 2, metadata=texts), "Exposure")


def array(dtype, shape, values):
    return exposure(camera={"array": {"dtype": dtype, "shape": shape, "values": values}})


def raw(text=None, **metadata):
    """A PNG file with metadata of the package in its description."""
    texts = {f"plenoptic:{name}": json.dumps(found) for name, found in metadata.items()}
    text = b"Description\0" + (json.dumps(texts) if text is None else text).encode()
    return image("a.png", png(2, 2, more=chunk(b"tEXt", text)), "RawImage")


PACKED = b"a\0\0" + zlib.compress(bytes(2**27), 9)
TILE = {"t322": 2**30, "t323": 2**30, "t324": 8, "t325": 64}
MANY = [f"c{k}" for k in range(200)]
HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n"
BMP = b"BM" + struct.pack("<IIIIiiHHIIIIII", 118, 0, 54, 40, 10**5, 10**5, 1, 24, 0, 64, 0, 0, 0, 0) + bytes(64)
BOMB = png(16384, 16384, content=zlib.compress(bytes(3 * 2**20), 9))
IMAGES = {
    "image: a good file": (image("a.png", png(4, 4)), None),
    # As large as a small file may be: the most memory.
    "image: 4096 x 4096 texels": (image("a.png", lambda folder: png(4096, 4096)), None),
    "image: 4096 x 4096 pixels of an exposure": (image("a.png", lambda folder: png(4096, 4096), "Exposure"), None),
    **{f"image: 16384 x 16384 for {reader}": (image("a.png", BOMB, reader), NO_IMAGE) for reader in READERS},
    **{f"image: a pipe for {reader}": (pipe(reader), "is no file") for reader in READERS},
    "image: PNG of 2^31 columns": (image("a.png", png(2**31 - 1, 2**31 - 1, content=b"")), NO_IMAGE),
    "image: PNG with a packed text of 128 MB": (image("a.png", png(2, 2, more=chunk(b"zTXt", PACKED))), None),
    "image: PNG with a packed profile of 128 MB": (image("a.png", png(2, 2, more=chunk(b"iCCP", PACKED))), None),
    "image: TIFF of 1e5 x 1e5": (image("a.tif", tiff(100_000, 100_000)), NO_IMAGE),
    "image: TIFF of 60000 x 60000": (image("a.tif", tiff(20_000, 20_000)), NO_IMAGE),
    "image: TIFF of 60000 channels": (image("a.tif", tiff(100, 100, 60_000), "channels"), NO_IMAGE),
    "image: TIFF with a tile of 2^30": (image("a.tif", tiff(16, 16, **TILE)), NO_IMAGE),
    "image: TIFF whose directory is its own next": (image("a.tif", tiff(4, 4)[:-4] + struct.pack("<I", 72)), None),
    "image: EXR of 1e5 x 1e5": (image("a.exr", exr(100_000, 100_000)), NO_IMAGE),
    "image: EXR of 2^30 rows": (image("a.exr", exr(1, 2**30)), NO_IMAGE),
    "image: EXR of 2^31 columns": (image("a.exr", exr(2**31 - 1, 2)), NO_IMAGE),
    "image: EXR of negative size": (image("a.exr", exr(-5, -5)), NO_IMAGE),
    "image: EXR of many channels": (image("a.exr", exr(2048, 2048, MANY), "Exposure"), NO_IMAGE),
    "image: HDR of 1e5 x 1e5": (image("a.hdr", HDR + b"-Y 100000 +X 100000\n" + bytes(64)), NO_IMAGE),
    "image: JPEG of 65500 x 65500": (image("a.jpg", jpeg), NO_IMAGE),
    "image: JPEG of 20 000 scans": (image("a.jpg", many_scans), "JPEG file of 200[0-9]+ scans"),
    "image: WebP of 16000 x 16000": (image("a.webp", webp(16_000, 16_000)), "(256 MB limit|would take).*FileLimits"),
    "image: PNM of 1e5 x 1e5": (image("a.ppm", b"P6 100000 100000 255\n" + bytes(64)), NO_IMAGE),
    "image: BMP of 1e5 x 1e5": (image("a.bmp", BMP), NO_IMAGE),
    "image: made up by OpenImageIO": (image("a.null?RES=60000x60000&TEX=1", b""), NO_IMAGE),
    "image: EPS": (image("a.png", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n"), NO_IMAGE),
    "image: empty": (image("a.png", b""), NO_IMAGE),
    "image: zeros": (image("a.exr", bytes(10**6)), NO_IMAGE),
    # Metadata
    "exposure: brackets": (exposure(camera="[" * 30_000), "cannot be understood"),
    "exposure: a value that is no value": (exposure(camera={"value": ["Popen", {"args": "id"}]}), "Popen"),
    "exposure: a function": (exposure(camera={"value": ["load_lens", {"name_or_path": "/etc/passwd"}]}), "load_lens"),
    "exposure: a private name": (exposure(camera={"value": ["__import__", {"name": "os"}]}), "__import__"),
    "exposure: an array of 1e18": (array("float64", [10**9, 10**9], []), "cannot be understood"),
    "exposure: an array of objects": (array("object", [1], ["a"]), "no type of an array"),
    "exposure: a count that is none": (exposure(samples=10**30, seed=-1), "no possible exposure"),
    "exposure: no scale": (exposure(scale={"float": "nan"}), "scale"),
    "raw: brackets": (raw("[" * 30_000), "names no sensor model"),
    "raw: a model that is none": (raw(model=[1, 2, 3]), "model"),
}

"""Raw images of real cameras: PNG and TIFF, and Lytro files that are packed here after their published layout."""

import hashlib
import json

import numpy as np
import pytest

import plenoptic as pl

PACKINGS = {12: "big", 10: "little", 16: "little"}
TILES = {"r": "RGGB", "gr": "GRBG", "gb": "GBRG", "b": "BGGR"}


def packed(numbers, bits):
    """Bytes of numbers, bit by bit: big-endian 12 bits in order, 10 bits with four low pairs in each fifth byte."""
    if bits == 16:
        return numbers.astype("<u2").tobytes()
    if bits == 12:
        text = "".join(f"{number:012b}" for number in numbers.ravel())
        return bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8))
    groups = numbers.reshape(-1, 4)
    return b"".join(
        bytes([*(n >> 2 for n in g), sum((n & 3) << 2 * k for k, n in enumerate(g))]) for g in groups.tolist()
    )


def description(numbers, bits, corner="b", black=64, *, nested=True):
    """Text of the camera, as the first model has it (`nested`) and as the second."""
    colours = ("r", "gr", "gb", "b")
    details = {
        "pixelFormat": {"black": dict.fromkeys(colours, black), "white": dict.fromkeys(colours, 2**bits - 1)},
        "pixelPacking": {"endianness": PACKINGS[bits], "bitsPerPixel": bits},
        "mosaic": {"tile": "r,gr:gb,b", "upperLeftPixel": corner},
    }
    rows, columns = numbers.shape
    image = {"width": columns, "height": rows, **({"rawDetails": details} if nested else details)}
    return {"image": image, "devices": {"mla": {"lensPitch": 2e-5}}}


def container(*sections):
    """Bytes of a container with sections, each padded to a multiple of 16."""
    content = b"\x89LFP\r\n\x1a\n\0\0\0\1\0\0\0\0"
    for k, data in enumerate(sections):
        mark = (b"\x89LFM" if k == 0 else b"\x89LFC") + b"\r\n\x1a\n\0\0\0\0"
        header = (
            mark + len(data).to_bytes(4, "big") + f"sha1-{hashlib.sha1(data).hexdigest()}".encode().ljust(80, b"\0")
        )
        content += header + data + b"\0" * (-(len(header) + len(data)) % 16)
    return content


def text(members):
    return json.dumps(members).encode()


@pytest.mark.parametrize("bits", sorted(PACKINGS))
def test_lytro_containers_and_white_images_give_every_number_back(bits, tmp_path):
    numbers = np.random.default_rng(bits).integers(0, 2**bits, (6, 12))
    for corner, pattern in TILES.items():
        said = description(numbers, bits, corner, nested=corner != "gr")
        path = tmp_path / f"{corner}.lfp"
        path.write_bytes(container(text({"picture": {}}), text(said), packed(numbers, bits), b"\xff\xd8 a preview"))
        raw, metadata = pl.images.read_lytro(path)
        assert np.array_equal(raw.data, numbers) and raw.colour_filters is pl.BayerPattern[pattern]
        assert (raw.black_level, raw.white_level, metadata["devices"]["mla"]["lensPitch"]) == (64, 2**bits - 1, 2e-5)
        assert pl.images.read_raw(path) == raw
        (tmp_path / "MOD_0000.RAW").write_bytes(packed(numbers, bits))
        (tmp_path / "MOD_0000.TXT").write_bytes(
            text({"master": {"picture": {"frameArray": [{"frame": {"metadata": said}}]}}})
        )
        assert pl.images.read_raw(tmp_path / "MOD_0000.RAW") == raw


def test_damaged_lytro_files_are_refused_with_a_reason(tmp_path):
    numbers = np.arange(24).reshape(4, 6)
    good = container(text(description(numbers, 12)), packed(numbers, 12))
    for content, reason in (
        (good[:-20], "damaged at byte"),
        (container(text(description(numbers, 12)), packed(numbers[:3], 12)), "no section of 36 bytes"),
        (container(text({"picture": {}})), "describes no raw image"),
        (container(text(description(numbers[:, :3][:3], 12)), b""), "do not fill whole bytes"),
        (container(text(description(numbers, 12, "w")), packed(numbers, 12)), "unknown way"),
        (b"II*\0", "no text of its camera"),
    ):
        (tmp_path / "bad.lfr").write_bytes(content)
        with pytest.raises(pl.errors.FileError, match=reason):
            pl.images.read_raw(tmp_path / "bad.lfr")
    (tmp_path / "good.lfr").write_bytes(good)
    with pytest.raises(pl.errors.InvalidValueError, match="states bits"):
        pl.images.read_raw(tmp_path / "good.lfr", bits=12)


def test_pictures_keep_their_numbers_and_levels(tmp_path):
    numbers = np.random.default_rng(0).integers(0, 4096, (5, 8)).astype(np.uint16)
    numbers[0, :3] = 64, 4000, 4095
    for ending in (".png", ".tif"):
        pl.images.write_16bit(tmp_path / f"photo{ending}", numbers[..., None])
        raw = pl.images.read_raw(
            tmp_path / f"photo{ending}", bits=12, black_level=64, white_level=4000, colour_filters=pl.BayerPattern.GRBG
        )
        assert np.array_equal(raw.data, numbers) and (raw.model.bits, raw.white_level) == (12, 4000)
        assert raw.linear()[0, :2].tolist() == [0.0, 1.0] and raw.fraction_saturated >= 2 / 40
        raw.save(tmp_path / f"saved{ending}")
        assert pl.images.read_raw(tmp_path / f"saved{ending}") == raw
    with pytest.raises(pl.errors.InvalidValueError, match="numbers up to 4095"):
        pl.images.read_raw(tmp_path / "photo.png", bits=10)
    with pytest.raises(pl.errors.InvalidValueError, match="white must lie above black"):
        pl.images.read_raw(tmp_path / "photo.png", bits=12, black_level=5000)
    pl.images.write_channels(tmp_path / "float.exr", {"Y": np.ones((2, 2))})
    with pytest.raises(pl.errors.FileError, match="8 or 16 bits"):
        pl.images.read_raw(tmp_path / "float.exr")

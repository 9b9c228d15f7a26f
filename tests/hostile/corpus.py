"""Files made by hand to do harm: by what they name, by what they claim to hold, by how they are built.

`python corpus.py FOLDER EACH` writes and reads every EACH-th of each kind and prints, as JSON, what came of them. A
case is a function that writes its files into a folder and says what is to be done, and a pattern of what must be said;
None: the file is read.
"""

import faulthandler
import json
import os
import resource
import sys
import warnings
from pathlib import Path

from hostile_folders import FOLDERS
from hostile_gltf import GLTF
from hostile_images import IMAGES, png
from hostile_texts import TEXTS

import plenoptic as pl

CASES = {**GLTF, **TEXTS, **IMAGES, **FOLDERS}
HANGS = 60
"""s: no case comes near it."""


SECRETS = {"secret.bin": bytes(36), "secret.mtl": b"newmtl a\nKd 1 0 0\n", "secret.png": png(2, 2)}
"""What lies beside the folder of a case and must stay unread."""


def chosen(each):
    """Names of every so-manieth case of each kind, beginning with the first."""
    kinds = {}
    for name in CASES:
        kinds.setdefault(name.partition(":")[0], []).append(name)
    return [name for names in kinds.values() for name in names[::each]]


def outcome(make, folder):
    """What came of a case: what was said, CPU time without the system's, which counts memory, and what was opened."""
    folder.mkdir(parents=True)
    for name, content in SECRETS.items():
        (folder.parent / name).write_bytes(content)
    (folder / "secret.bin").symlink_to(folder.parent / "secret.bin")
    read = make(folder)
    opened.clear()
    begin, error = os.times().user, None
    try:
        read()
    except pl.PlenopticError as found:
        error = f"{type(found).__name__}: {found}"
    except BaseException as found:
        error = f"FOREIGN {type(found).__name__}: {found}"
    seconds = os.times().user - begin
    strays = [name for name in opened if "secret" in name]
    return {"error": error, "seconds": seconds, "strays": strays, "memory": peak()}


def peak():
    """The most memory of this process so far, in bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


opened = []


def note(event, arguments):
    """Note every file that Python opens."""
    if event == "open" and isinstance(arguments[0], str | bytes | os.PathLike):
        opened.append(os.path.realpath(os.fsdecode(arguments[0])))


def main(folder, each):
    warnings.simplefilter("ignore")
    # All libraries are loaded before memory is measured.
    for name in ("trimesh", "plyfile", "mapbox_earcut", "PIL.Image", "OpenImageIO", "h5py", "zarr"):
        __import__(name)
    pl.Scene([pl.box(1)])
    start = peak()
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    sys.addaudithook(note)
    found = {}
    for number, name in enumerate(chosen(each)):
        faulthandler.dump_traceback_later(HANGS, exit=True)
        found[name] = outcome(CASES[name][0], folder / str(number) / "files")
    faulthandler.cancel_dump_traceback_later()
    print(json.dumps({"start": start, "peak": peak(), "cases": found}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))

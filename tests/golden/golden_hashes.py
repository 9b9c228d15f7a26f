"""The golden cases, hashes of their arrays, and which processor and programs these hold for."""

import hashlib
import importlib.metadata
import json
import platform
from pathlib import Path

import numpy as np
from golden_calculations import CALCULATIONS
from golden_renderings import RENDERINGS
from llvmlite import binding

CASES = {case.__name__: case for case in (*RENDERINGS, *CALCULATIONS)}
"""Functions that return arrays by name. Each is small, and together they call every kernel."""
QUICK = ("traces",)
"""In the normal run."""

STORE = Path(__file__).with_name("golden.json")

PROGRAMS = ("numpy", "numba", "llvmlite", "embreex")


def key():
    """What bits depend on besides the code: the processor that kernels are compiled for, and versions."""
    features = hashlib.sha256(binding.get_host_cpu_features().flatten().encode()).hexdigest()[:8]
    versions = [f"{program} {importlib.metadata.version(program)}" for program in PROGRAMS]
    system = f"{platform.system()} {' '.join(platform.libc_ver())}".strip()
    return ", ".join([f"{binding.get_host_cpu_name()} {features}", system, *versions])


def hash_of(array):
    """16 hexadecimal digits of type, shape and bytes."""
    array = np.ascontiguousarray(array)
    assert not array.dtype.hasobject
    digest = hashlib.sha256(f"{array.dtype.str} {array.shape}".encode())
    digest.update(array.tobytes())
    return digest.hexdigest()[:16]


def hashes(case):
    """Hashes of a case's arrays by name."""
    return {name: hash_of(array) for name, array in case().items()}


def stored():
    """Hashes by case and array for this key; None where there are none."""
    return json.loads(STORE.read_text()).get(key()) if STORE.exists() else None


def store(found):
    """Put hashes in the place of those that there are for this key, and keep those of other keys."""
    everything = json.loads(STORE.read_text()) if STORE.exists() else {}
    everything[key()] = found
    STORE.write_text(json.dumps(everything, indent=1, sort_keys=True) + "\n")

"""Owen-scrambled Sobol points by hashing: device functions and one kernel.

Sobol points: S. Joe and F. Y. Kuo, SIAM J. Sci. Comput. 30, 2635 (2008), direction numbers new-joe-kuo-6.
Scrambling by hashing: B. Burley, J. Comput. Graph. Tech. 9(4), 1 (2020), section 3; the hash is that of
N. Vegdahl, "Building a better LK hash" (2021), which acts on bit-reversed numbers. Points are therefore
tabulated bit-reversed, and their bits are reversed once, after scrambling.
"""

from __future__ import annotations

import numpy as np

from plenoptic.core.numba.jit import device, kernel

DIMENSIONS = 4
"""Dimensions of one set of points; a path uses one set for the camera and one for each bounce."""

# s, a and m_1 ... m_s of dimensions 2 to 4; dimension 1 is van der Corput's sequence.
_JOE_KUO = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)))

_TO_UNIT = 2.0**-32
_UNIT_53 = 2.0**-53


def _direction_numbers() -> np.ndarray:
    """(4, 32) direction numbers, most significant bit first."""
    v = np.zeros((DIMENSIONS, 32), dtype=np.uint64)
    v[0] = [1 << (31 - k) for k in range(32)]
    for dimension, (s, a, m) in enumerate(_JOE_KUO, start=1):
        row = [m[k] << (31 - k) for k in range(s)]
        for k in range(s, 32):
            entry = row[k - s] ^ (row[k - s] >> s)
            for j in range(1, s):
                if (a >> (s - 1 - j)) & 1:
                    entry ^= row[k - j]
            row.append(entry)
        v[dimension] = row
    return v


def _reversed_tables() -> np.ndarray:
    """(4, 4, 256) uint32: contribution of byte b of the index, value i, to a bit-reversed coordinate."""
    numbers = _direction_numbers()
    flipped = np.array([int(f"{number:032b}"[::-1], 2) for number in numbers.ravel().tolist()], dtype=np.uint32)
    bits = np.arange(256)[:, None] >> np.arange(8) & 1
    return np.asarray(np.bitwise_xor.reduce(flipped.reshape(DIMENSIONS, 4, 1, 8) * bits.astype(np.uint32), axis=-1))


_TABLES = _reversed_tables()


@device
def reverse_bits(x):
    x = np.uint32(x)
    x = np.uint32((x >> np.uint32(1)) & np.uint32(0x55555555)) | np.uint32((x & np.uint32(0x55555555)) << np.uint32(1))
    x = np.uint32((x >> np.uint32(2)) & np.uint32(0x33333333)) | np.uint32((x & np.uint32(0x33333333)) << np.uint32(2))
    x = np.uint32((x >> np.uint32(4)) & np.uint32(0x0F0F0F0F)) | np.uint32((x & np.uint32(0x0F0F0F0F)) << np.uint32(4))
    x = np.uint32((x >> np.uint32(8)) & np.uint32(0x00FF00FF)) | np.uint32((x & np.uint32(0x00FF00FF)) << np.uint32(8))
    return np.uint32(np.uint32(x >> np.uint32(16)) | np.uint32(x << np.uint32(16)))


@device
def scramble_bits(x, seed):
    """Nested uniform scrambling of a bit-reversed number."""
    x = np.uint32(x)
    seed = np.uint32(seed)
    x = np.uint32(x ^ np.uint32(x * np.uint32(0x3D20ADEA)))
    x = np.uint32(x + seed)
    x = np.uint32(x * np.uint32(np.uint32(seed >> np.uint32(16)) | np.uint32(1)))
    x = np.uint32(x ^ np.uint32(x * np.uint32(0x05526C56)))
    return np.uint32(x ^ np.uint32(x * np.uint32(0x53A22864)))


@device
def mix(state, salt):
    """64-bit hash of a state and a salt (the finalizer of SplitMix64; G. L. Steele et al., OOPSLA 2014)."""
    x = np.uint64(state) + np.uint64(salt) * np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@device
def stream(seed, pixel, replicate):
    """Key of one pixel's replicate: an independent scrambling."""
    key = mix(mix(np.uint64(seed), np.uint64(1)), np.uint64(pixel) + np.uint64(1))
    return mix(key, np.uint64(replicate) + np.uint64(1))


@device
def reversed_point(index, dimension):
    """Bit-reversed coordinate of Sobol point `index`."""
    i = np.uint32(index)
    table = _TABLES[dimension]
    x = table[0, i & np.uint32(255)] ^ table[1, (i >> np.uint32(8)) & np.uint32(255)]
    if i > np.uint32(65535):
        x ^= table[2, (i >> np.uint32(16)) & np.uint32(255)] ^ table[3, i >> np.uint32(24)]
    return x


@device
def to_unit(x):
    """A bit-reversed 32-bit number as a float64 in [0, 1)."""
    return np.float64(reverse_bits(x)) * _TO_UNIT


@device
def shuffle_index(index, seed):
    """Owen-shuffled index: aligned blocks of 2^k indices stay aligned blocks (Burley, section 4)."""
    return reverse_bits(scramble_bits(reverse_bits(np.uint32(index)), seed))


@device
def sample(index, dimension, key):
    """Coordinate of a scrambled point of the set that `key` names."""
    return to_unit(scramble_bits(reversed_point(index, dimension), np.uint32(mix(key, np.uint64(dimension)))))


@device
def random_number(key, index, salt):
    """Random number in [0, 1), independent of the Sobol points."""
    return np.float64(mix(mix(key, salt), np.uint64(index)) >> np.uint64(11)) * _UNIT_53


@kernel
def fill_net(net, first):
    """Bit-reversed Sobol points first ... first + n - 1 before scrambling, (4, n)."""
    for dimension in range(DIMENSIONS):
        for i in range(net.shape[1]):
            net[dimension, i] = reversed_point(first + i, dimension)


@kernel
def fill_points(points, seed, pixel, replicate, set_number):
    """Points 0 ... n-1 of one set of one pixel's replicate, shape (n, 4)."""
    key = set_key(stream(seed, pixel, replicate), set_number)
    for i in range(points.shape[0]):
        j = set_index(i, key, set_number)
        for dimension in range(DIMENSIONS):
            points[i, dimension] = sample(j, dimension, key)


@device
def set_key(key, set_number):
    """Key of set 0 (the camera) or of a later one (bounce 1, 2, ...)."""
    return mix(key, np.uint64(101) + np.uint64(set_number))


@device
def set_index(index, key, set_number):
    """Index of a point in its set; later sets are shuffled, so that sets do not correlate."""
    return np.uint32(index) if set_number == 0 else shuffle_index(index, np.uint32(mix(key, np.uint64(77))))


@kernel
def fill_samples(points, keys, indices, path_of, path_key, path_index, set_number):
    """Keys, indices and points (4, n) of a set for n lanes of paths; separate loops are vectorised."""
    n = path_of.size
    for i in range(n):
        path = path_of[i]
        keys[i] = set_key(path_key[path], set_number)
        indices[i] = set_index(path_index[path], keys[i], set_number)
    for dimension in range(DIMENSIONS):
        row = points[dimension]
        for i in range(n):
            row[i] = sample(indices[i], dimension, keys[i])

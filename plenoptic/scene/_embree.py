"""Embree 4 through its C library: the only module that knows it.

The library is the one that the embreex wheel ships. Importing this module registers its symbols with the
compiler; it raises ImportError where that cannot be done, and must be imported before any kernel that
is declared here is loaded from the cache of compiled code. A null scene never reaches a kernel.
"""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

import llvmlite.binding
import numpy as np
from embreex import rtcore_scene
from numba import types
from numpy.typing import NDArray

from plenoptic._jit import device, kernel
from plenoptic.scene._hit import SHADOW_END
from plenoptic.scene.accel import middle_of

PACKET = 16

_VERTEX, _INDEX, _FLOAT3, _UINT3, _TRIANGLE = 1, 0, 0x9003, 0x5003, 0
_SCENE_ROBUST = 4
_COHERENT = 1 << 16
_ALL_FEATURES = 0xFFFFFFFF
_PADDING = 16
_INVALID = np.uint32(0xFFFFFFFF)

# float32 rows of 16 lanes in RTCRay16 and, behind it, RTCHit16 (embree4/rtcore_ray.h).
_ORG_X, _ORG_Y, _ORG_Z, _NEAR, _DIR_X, _DIR_Y, _DIR_Z, _TIME, _FAR, _MASK, _ID, _FLAGS = (16 * k for k in range(12))
_PRIMITIVE, _GEOMETRY, _INSTANCE = 16 * 17, 16 * 18, 16 * 19
_RAYHIT = 16 * 21
"""Instance ids take one or two rows, depending on how the library was built: room for both."""

_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "rtcNewDevice": (ctypes.c_void_p, (ctypes.c_char_p,)),
    "rtcReleaseDevice": (None, (ctypes.c_void_p,)),
    "rtcGetDeviceError": (ctypes.c_int, (ctypes.c_void_p,)),
    "rtcNewScene": (ctypes.c_void_p, (ctypes.c_void_p,)),
    "rtcReleaseScene": (None, (ctypes.c_void_p,)),
    "rtcSetSceneFlags": (None, (ctypes.c_void_p, ctypes.c_int)),
    "rtcCommitScene": (None, (ctypes.c_void_p,)),
    "rtcNewGeometry": (ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_int)),
    "rtcReleaseGeometry": (None, (ctypes.c_void_p,)),
    "rtcSetSharedGeometryBuffer": (
        None,
        (
            ctypes.c_void_p,
            ctypes.c_int,
            ctypes.c_uint,
            ctypes.c_int,
            ctypes.c_void_p,
            ctypes.c_size_t,
            ctypes.c_size_t,
            ctypes.c_size_t,
        ),
    ),
    "rtcCommitGeometry": (None, (ctypes.c_void_p,)),
    "rtcAttachGeometry": (ctypes.c_uint, (ctypes.c_void_p, ctypes.c_void_p)),
}


def _load() -> Any:
    """The library with typed functions; its packet queries made known to the compiler."""
    try:
        library = ctypes.CDLL(rtcore_scene.__file__)
        for name, (result, arguments) in _FUNCTIONS.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
        for name in ("rtcIntersect16", "rtcOccluded16"):
            address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
            llvmlite.binding.add_symbol(name, address)
    except (OSError, AttributeError, TypeError) as error:
        raise ImportError(f"the Embree library inside embreex cannot be called directly: {error}") from error
    return library


_library = _load()
_intersect16 = types.ExternalFunction("rtcIntersect16", types.void(types.intp, types.intp, types.intp, types.intp))
_occluded16 = types.ExternalFunction("rtcOccluded16", types.void(types.intp, types.intp, types.intp, types.intp))


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments and RTCOccludedArguments, which have the same layout."""

    _fields_ = [
        ("flags", ctypes.c_int),
        ("feature_mask", ctypes.c_uint),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("function", ctypes.c_void_p),
        ("spare", ctypes.c_void_p * 4),
    ]


class EmbreeTriangles:
    """A committed Embree scene of one triangle mesh; it owns its buffers and frees the scene with itself."""

    def __init__(self, vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> None:
        self.middle = middle_of(vertices)
        # Embree reads 16 bytes at a time: buffers end with room to spare.
        self._vertices = np.zeros(vertices.size + _PADDING, dtype=np.float32)
        self._vertices[: vertices.size] = (vertices - self.middle).ravel()
        self._triangles = np.zeros(triangles.size + _PADDING, dtype=np.uint32)
        self._triangles[: triangles.size] = triangles.ravel()
        self._device = _library.rtcNewDevice(None)
        if not self._device:
            raise RuntimeError("Embree gave no device")
        geometry = _library.rtcNewGeometry(self._device, _TRIANGLE)
        for kind, layout, buffer, width, count in (
            (_VERTEX, _FLOAT3, self._vertices, 12, len(vertices)),
            (_INDEX, _UINT3, self._triangles, 12, len(triangles)),
        ):
            _library.rtcSetSharedGeometryBuffer(geometry, kind, 0, layout, buffer.ctypes.data, 0, width, count)
        _library.rtcCommitGeometry(geometry)
        self._scene = _library.rtcNewScene(self._device)
        _library.rtcSetSceneFlags(self._scene, _SCENE_ROBUST)
        _library.rtcAttachGeometry(self._scene, geometry)
        _library.rtcReleaseGeometry(geometry)
        _library.rtcCommitScene(self._scene)
        error = _library.rtcGetDeviceError(self._device)
        if error or not self._scene:
            raise RuntimeError(f"Embree could not build the scene (error {error})")
        self._coherent = _Arguments(flags=_COHERENT, feature_mask=_ALL_FEATURES)
        self._incoherent = _Arguments(flags=0, feature_mask=_ALL_FEATURES)
        weakref.finalize(self, _release, self._scene, self._device)

    def fill_closest(self, hits: NDArray[np.int32], rays: NDArray[np.float64], *, coherent: bool) -> None:
        """Triangle that each ray (origin and direction, (n, 6)) meets first, or -1."""
        arguments = self._coherent if coherent else self._incoherent
        _fill_closest(hits, rays, self.middle, self._scene, ctypes.addressof(arguments))

    def fill_blocked(self, blocked: NDArray[np.uint8], rays: NDArray[np.float64]) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""
        _fill_blocked(blocked, rays, self.middle, self._scene, ctypes.addressof(self._incoherent))


def _release(scene: int, device: int) -> None:
    _library.rtcReleaseScene(scene)
    _library.rtcReleaseDevice(device)


@device
def _aligned(rows, spare):
    """The part of `rows` that starts at a multiple of 64 bytes, as packets want it."""
    shift = (-rows.ctypes.data) % 64 // 4
    return rows[shift : rows.size - spare + shift]


@device
def _pack(packet, valid, rays, middle, start, far):
    """Put rays start ... start + 15 into a packet; lanes beyond the last ray are switched off."""
    number = packet.view(np.uint32)
    for lane in range(PACKET):
        inside = start + lane < rays.shape[0]
        i = start + lane if inside else start
        valid[lane] = -1 if inside else 0
        packet[_ORG_X + lane] = rays[i, 0] - middle[0]
        packet[_ORG_Y + lane] = rays[i, 1] - middle[1]
        packet[_ORG_Z + lane] = rays[i, 2] - middle[2]
        packet[_DIR_X + lane] = rays[i, 3]
        packet[_DIR_Y + lane] = rays[i, 4]
        packet[_DIR_Z + lane] = rays[i, 5]
        packet[_NEAR + lane] = 0.0
        packet[_TIME + lane] = 0.0
        packet[_FAR + lane] = far
        number[_MASK + lane] = _INVALID
        number[_FLAGS + lane] = np.uint32(0)
        number[_GEOMETRY + lane] = _INVALID
        number[_INSTANCE + lane] = _INVALID


@kernel
def _fill_closest(hits, rays, middle, scene, arguments):
    packet = _aligned(np.zeros(_RAYHIT + 16, np.float32), 16)
    valid = _aligned(np.zeros(PACKET + 16, np.int32), 16)
    number = packet.view(np.uint32)
    n = rays.shape[0]
    for start in range(0, n, PACKET):
        _pack(packet, valid, rays, middle, start, np.inf)
        _intersect16(valid.ctypes.data, scene, packet.ctypes.data, arguments)
        for lane in range(min(PACKET, n - start)):
            hit = number[_GEOMETRY + lane] != _INVALID
            hits[start + lane] = np.int32(number[_PRIMITIVE + lane]) if hit else np.int32(-1)


@kernel
def _fill_blocked(blocked, rays, middle, scene, arguments):
    packet = _aligned(np.zeros(_RAYHIT + 16, np.float32), 16)
    valid = _aligned(np.zeros(PACKET + 16, np.int32), 16)
    n = rays.shape[0]
    for start in range(0, n, PACKET):
        _pack(packet, valid, rays, middle, start, SHADOW_END)
        _occluded16(valid.ctypes.data, scene, packet.ctypes.data, arguments)
        for lane in range(min(PACKET, n - start)):
            # Embree marks an occluded ray by a far end of minus infinity.
            blocked[start + lane] = 1 if packet[_FAR + lane] < 0.0 else 0

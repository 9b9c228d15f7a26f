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

from plenoptic.core.jit import device, kernel
from plenoptic.core.values import Floats
from plenoptic.scene.geometry.compile import ChildMesh, child_meshes, part_of
from plenoptic.scene.geometry.kernels.grown import fill_grown
from plenoptic.scene.geometry.kernels.intersect import SHADOW_END
from plenoptic.scene.geometry.record import Geometry, Hits, InstanceRecord

PACKET = 16

_VERTEX, _INDEX, _FLOAT3, _UINT3, _FLOAT3X4 = 1, 0, 0x9003, 0x5003, 0x9134
_TRIANGLE, _INSTANCED = 0, 121
_SCENE_ROBUST = 4
"""Embree's own way to lose no ray between triangles, which takes a third longer. Scenes without instances do without:
their triangles are grown. Rays in the frame of an instance err by coordinates that its triangles do not know."""
_COHERENT = 1 << 16
_ALL_FEATURES = 0xFFFFFFFF
_PADDING = 16
_SOME = 1000
"""Vertices of which the usual distance from the middle is known well enough."""
_INVALID = np.uint32(0xFFFFFFFF)

# float32 rows of 16 lanes in RTCRay16 and, behind it, RTCHit16 (embree4/rtcore_ray.h).
_ORG_X, _ORG_Y, _ORG_Z, _NEAR, _DIR_X, _DIR_Y, _DIR_Z, _TIME, _FAR, _MASK, _ID, _FLAGS = (16 * k for k in range(12))
_U, _V, _PRIMITIVE, _GEOMETRY, _INSTANCE = (16 * k for k in range(15, 20))
_RAYHIT = 16 * 35
"""Room for eight levels of instances, of two rows each; the library is built for one level by default, the first."""

_EDGE = np.float32(2.0**-9)
"""Barycentric coordinates below this are near an edge: where grown triangles overlap, and one ray in 100."""

_STEEPEST = 1e-18
"""Embree takes the inverse of a smaller component of a direction for that of this one, without its sign. A coherent
packet, which is bounded as a whole, then loses rays; a component that is exactly 0 does no harm."""

_POINTER, _INT, _UINT, _SIZE = ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_size_t
_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "rtcNewDevice": (_POINTER, (ctypes.c_char_p,)),
    "rtcReleaseDevice": (None, (_POINTER,)),
    "rtcGetDeviceError": (_INT, (_POINTER,)),
    "rtcNewScene": (_POINTER, (_POINTER,)),
    "rtcReleaseScene": (None, (_POINTER,)),
    "rtcSetSceneFlags": (None, (_POINTER, _INT)),
    "rtcCommitScene": (None, (_POINTER,)),
    "rtcNewGeometry": (_POINTER, (_POINTER, _INT)),
    "rtcReleaseGeometry": (None, (_POINTER,)),
    "rtcSetSharedGeometryBuffer": (None, (_POINTER, _INT, _UINT, _INT, _POINTER, _SIZE, _SIZE, _SIZE)),
    "rtcCommitGeometry": (None, (_POINTER,)),
    "rtcAttachGeometryByID": (None, (_POINTER, _POINTER, _UINT)),
    "rtcSetGeometryInstancedScene": (None, (_POINTER, _POINTER)),
    "rtcSetGeometryTransform": (None, (_POINTER, _UINT, _INT, _POINTER)),
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
    """A committed Embree scene of triangles and instances; it owns its buffers and frees the scenes with itself."""

    def __init__(self, geometry: Geometry, instances: InstanceRecord | None = None) -> None:
        vertices, triangles, self._middle = geometry.vertices, geometry.triangles, geometry.middle
        self._first = None if instances is None else instances.first
        self._buffers: list[NDArray[Any]] = []
        self._scenes: list[int] = []
        self._device = _library.rtcNewDevice(None)
        if not self._device:
            raise RuntimeError("Embree gave no device")
        weakref.finalize(self, _release, self._scenes, self._device)
        self._scene = self._new_scene()
        if instances is None:
            self._attach(self._scene, self._grown_triangles(geometry), 0)
        else:
            # An instance is known by its row; plain triangles come behind.
            if instances.plain:
                plain = self._triangles(vertices, triangles[: instances.plain], self._middle)
                self._attach(self._scene, plain, len(instances.first))
            for child in child_meshes(vertices, triangles, instances, self._middle):
                self._attach_child(child)
        _library.rtcCommitScene(self._scene)
        error = _library.rtcGetDeviceError(self._device)
        if error:
            raise RuntimeError(f"Embree could not build the scene (error {error})")
        self._coherent = _Arguments(flags=_COHERENT, feature_mask=_ALL_FEATURES)
        self._incoherent = _Arguments(flags=0, feature_mask=_ALL_FEATURES)

    def fill_closest(self, hits: Hits, rays: Floats, *, coherent: bool) -> None:
        """Triangle that each ray (origin and direction, (n, 6)) meets first, or -1; and its instance, or -1."""
        # Embree turns directions into the axes of an instance, where a component may be tiny: see _STEEPEST.
        arguments = self._coherent if coherent and self._first is None else self._incoherent
        address = ctypes.addressof(arguments)
        _fill_closest(hits.triangle, hits.instance, self._first, rays, self._middle, self._scene, address)

    def fill_blocked(self, blocked: NDArray[np.uint8], rays: Floats) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""
        _fill_blocked(blocked, rays, self._middle, self._scene, ctypes.addressof(self._incoherent))

    def _new_scene(self) -> int:
        scene: int = _library.rtcNewScene(self._device)
        self._scenes.append(scene)
        _library.rtcSetSceneFlags(scene, 0 if self._first is None else _SCENE_ROBUST)
        return scene

    def _grown_triangles(self, geometry: Geometry) -> int:
        """A geometry of triangles that each have corners of their own."""
        vertices, triangles, middle = geometry.vertices, geometry.triangles, geometry.middle
        count, some = len(triangles), vertices[:: max(1, len(vertices) // _SOME)]
        usual = float(np.median(np.abs(some - middle).max(axis=1)))
        points = np.zeros(9 * count + _PADDING, dtype=np.float32)
        fill_grown(points[: 9 * count].reshape(-1, 3), vertices, triangles, middle, usual)
        rows = np.zeros(3 * count + _PADDING, dtype=np.uint32)
        rows[: 3 * count] = np.arange(3 * count, dtype=np.uint32)
        return self._geometry(points, 3 * count, rows, count)

    def _triangles(self, vertices: Floats, triangles: NDArray[np.int32], middle: Floats) -> int:
        """A geometry of triangles, in float32 relative to a point."""
        corners, faces = part_of(vertices, triangles)
        # Embree reads 16 bytes at a time: buffers end with room to spare.
        points = np.zeros(corners.size + _PADDING, dtype=np.float32)
        np.subtract(corners, middle, out=points[: corners.size].reshape(-1, 3), casting="same_kind")
        rows = np.zeros(faces.size + _PADDING, dtype=np.uint32)
        rows[: faces.size] = faces.ravel()
        return self._geometry(points, len(corners), rows, len(faces))

    def _geometry(self, points: NDArray[np.float32], corners: int, rows: NDArray[np.uint32], faces: int) -> int:
        """A geometry that reads arrays which are kept."""
        self._buffers += points, rows
        geometry: int = _library.rtcNewGeometry(self._device, _TRIANGLE)
        set_buffer = _library.rtcSetSharedGeometryBuffer
        set_buffer(geometry, _VERTEX, 0, _FLOAT3, points.ctypes.data, 0, 12, corners)
        set_buffer(geometry, _INDEX, 0, _UINT3, rows.ctypes.data, 0, 12, faces)
        return geometry

    def _attach(self, scene: int, geometry: int, number: int) -> None:
        _library.rtcCommitGeometry(geometry)
        _library.rtcAttachGeometryByID(scene, geometry, number)
        _library.rtcReleaseGeometry(geometry)

    def _attach_child(self, child: ChildMesh) -> None:
        """Attach the instances of a mesh, which is in float32 relative to its own middle."""
        scene = self._new_scene()
        self._attach(scene, self._triangles(child.vertices, child.triangles, child.middle), 0)
        _library.rtcCommitScene(scene)
        transforms = np.ascontiguousarray(child.matrices, dtype=np.float32)
        address = transforms.ctypes.data
        for k, instance in enumerate(child.instances.tolist()):
            geometry = _library.rtcNewGeometry(self._device, _INSTANCED)
            _library.rtcSetGeometryInstancedScene(geometry, scene)
            _library.rtcSetGeometryTransform(geometry, 0, _FLOAT3X4, address + 48 * k)
            self._attach(self._scene, geometry, instance)


def _release(scenes: list[int], device: int) -> None:
    for scene in scenes:
        _library.rtcReleaseScene(scene)
    _library.rtcReleaseDevice(device)


@device
def _aligned(rows, spare):
    """The part of `rows` that starts at a multiple of 64 bytes, as packets want it."""
    shift = (-rows.ctypes.data) % 64 // 4
    return rows[shift : rows.size - spare + shift]


@device
def _prepare(packet):
    """What is the same for all rays of a call, and what Embree leaves as it is."""
    number = packet.view(np.uint32)
    for lane in range(PACKET):
        packet[_NEAR + lane] = 0.0
        packet[_TIME + lane] = 0.0
        number[_MASK + lane] = _INVALID
        number[_FLAGS + lane] = np.uint32(0)


@device
def _direction(component):
    return component if abs(component) > _STEEPEST else 0.0


@device
def _pack(packet, valid, rays, middle, start, far):
    """Put rays start ... start + 15 into a packet; lanes beyond the last ray are switched off."""
    number = packet.view(np.uint32)
    x, y, z = middle[0], middle[1], middle[2]
    n = rays.shape[0]
    for lane in range(PACKET):
        inside = start + lane < n
        i = start + lane if inside else start
        valid[lane] = -1 if inside else 0
        packet[_ORG_X + lane] = rays[i, 0] - x
        packet[_ORG_Y + lane] = rays[i, 1] - y
        packet[_ORG_Z + lane] = rays[i, 2] - z
        packet[_DIR_X + lane] = _direction(rays[i, 3])
        packet[_DIR_Y + lane] = _direction(rays[i, 4])
        packet[_DIR_Z + lane] = _direction(rays[i, 5])
        packet[_FAR + lane] = far
        number[_GEOMETRY + lane] = _INVALID
        number[_INSTANCE + lane] = _INVALID


@device
def _again_alone(packet, valid, lane, scene, arguments):
    """Ask again for a lane that met a triangle near an edge: which neighbour is found depends on the other lanes."""
    u, v = packet[_U + lane], packet[_V + lane]
    if min(u, v, np.float32(1.0) - u - v) > _EDGE:
        return
    number = packet.view(np.uint32)
    for other in range(PACKET):
        valid[other] = -1 if other == lane else 0
    packet[_FAR + lane] = np.inf
    number[_GEOMETRY + lane] = _INVALID
    number[_INSTANCE + lane] = _INVALID
    _intersect16(valid.ctypes.data, scene, packet.ctypes.data, arguments)


@kernel
def _fill_closest(triangles, instances, first, rays, middle, scene, arguments):
    packet = _aligned(np.zeros(_RAYHIT + 16, np.float32), 16)
    valid = _aligned(np.zeros(PACKET + 16, np.int32), 16)
    number = packet.view(np.uint32)
    n = rays.shape[0]
    _prepare(packet)
    for start in range(0, n, PACKET):
        _pack(packet, valid, rays, middle, start, np.inf)
        _intersect16(valid.ctypes.data, scene, packet.ctypes.data, arguments)
        for lane in range(min(PACKET, n - start)):
            if number[_GEOMETRY + lane] != _INVALID:
                _again_alone(packet, valid, lane, scene, arguments)
            hit = number[_GEOMETRY + lane] != _INVALID
            row = np.int32(number[_PRIMITIVE + lane])
            instance = np.int32(-1)
            if first is not None and hit and number[_INSTANCE + lane] != _INVALID:
                instance = np.int32(number[_INSTANCE + lane])
                row += first[instance]
            if instances is not None:
                instances[start + lane] = instance
            triangles[start + lane] = row if hit else np.int32(-1)


@kernel
def _fill_blocked(blocked, rays, middle, scene, arguments):
    packet = _aligned(np.zeros(_RAYHIT + 16, np.float32), 16)
    valid = _aligned(np.zeros(PACKET + 16, np.int32), 16)
    n = rays.shape[0]
    _prepare(packet)
    for start in range(0, n, PACKET):
        _pack(packet, valid, rays, middle, start, SHADOW_END)
        _occluded16(valid.ctypes.data, scene, packet.ctypes.data, arguments)
        for lane in range(min(PACKET, n - start)):
            # Embree marks an occluded ray by a far end of minus infinity.
            blocked[start + lane] = 1 if packet[_FAR + lane] < 0.0 else 0

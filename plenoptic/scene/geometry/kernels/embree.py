"""Embree 4 through its C library: the only module that knows it.

The library comes with the embreex wheel. Importing this module registers its symbols with the
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

from plenoptic.core.kernels.vectors import vector
from plenoptic.core.numba.jit import device, kernel
from plenoptic.core.values import Floats
from plenoptic.scene.geometry.build_geometry import ChildMesh, child_meshes, part_of
from plenoptic.scene.geometry.geometry_records import Geometry, Hits, InstanceRecord
from plenoptic.scene.geometry.kernels.grown import fill_grown
from plenoptic.scene.geometry.kernels.intersect import SHADOW_END

_VERTEX, _INDEX, _FLOAT3, _UINT3, _FLOAT3X4 = 1, 0, 0x9003, 0x5003, 0x9134
_TRIANGLE, _INSTANCED = 0, 121
_SCENE_ROBUST = 4
"""Embree's own way to lose no ray between triangles, which takes a third longer. Scenes without instances do without:
their triangles are grown. Rays in the frame of an instance err by coordinates that its triangles do not know."""
_ALL_FEATURES = 0xFFFFFFFF
_PADDING = 16
_SOME = 1000
"""Number of vertices that give their median distance from the middle well enough."""
_INVALID = np.uint32(0xFFFFFFFF)

# Members of RTCRay16 and, behind it, RTCHit16 (embree4/rtcore_ray.h): 4 bytes for each ray of a packet.
_PACKET = 16
_ORIGIN, _NEAR, _DIRECTION, _TIME, _FAR, _MASK, _ID, _FLAGS = 0, 3, 4, 7, 8, 9, 10, 11
_PRIMITIVE, _GEOMETRY, _INSTANCE = 17, 18, 19
_RAYHIT = 40
"""Room for eight levels of instances, of two members each; the library is built for one level, the first."""

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
    """The library with typed functions; its queries made known to the compiler."""
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
_intersect = types.ExternalFunction("rtcIntersect16", types.void(types.intp, types.intp, types.intp, types.intp))
_occluded = types.ExternalFunction("rtcOccluded16", types.void(types.intp, types.intp, types.intp, types.intp))


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
        self._arguments = _Arguments(flags=0, feature_mask=_ALL_FEATURES)

    def fill_closest(self, hits: Hits, rays: Floats) -> None:
        """Closest triangle hit by each ray (origin and direction, (n, 6)), or -1; and its instance, or -1."""
        address = ctypes.addressof(self._arguments)
        _fill_closest(hits.triangle, hits.instance, self._first, rays, self._middle, self._scene, address)

    def fill_occlusion(self, blocked: NDArray[np.uint8], rays: Floats) -> None:
        """1 where something lies between a ray's origin and origin + direction, else 0."""
        _fill_occlusion(blocked, rays, self._middle, self._scene, ctypes.addressof(self._arguments))

    def _new_scene(self) -> int:
        scene: int = _library.rtcNewScene(self._device)
        self._scenes.append(scene)
        _library.rtcSetSceneFlags(scene, 0 if self._first is None else _SCENE_ROBUST)
        return scene

    def _grown_triangles(self, geometry: Geometry) -> int:
        """A geometry of triangles that each have corners of their own."""
        vertices, triangles, middle = geometry.vertices, geometry.triangles, geometry.middle
        count, some = len(triangles), vertices[:: max(1, len(vertices) // _SOME)]
        typical = float(np.median(np.abs(some - middle).max(axis=1)))
        points = np.zeros(9 * count + _PADDING, dtype=np.float32)
        fill_grown(points[: 9 * count].reshape(-1, 3), vertices, triangles, middle, typical)
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
def _new_packet():
    """An RTCRayHit16 at a multiple of 64 bytes, the same bytes as integers, and the mask of its rays."""
    rows, flags = np.zeros((_RAYHIT + 1) * _PACKET, np.float32), np.zeros(2 * _PACKET, np.int32)
    first, first_flag = (-rows.ctypes.data) % 64 // 4, (-flags.ctypes.data) % 64 // 4
    packet = rows[first : first + _RAYHIT * _PACKET]
    number = packet.view(np.uint32)
    number[_MASK * _PACKET : (_MASK + 1) * _PACKET] = _INVALID
    return packet, number, flags[first_flag : first_flag + _PACKET]


@device
def _begin(packet, number, is_ray, rays, i, middle, far):
    """Write up to 16 rays from ray i on, relative to the middle, in which nothing has been met; return their number."""
    count = min(_PACKET, rays.shape[0] - i)
    for j in range(count):
        for k in range(3):
            packet[(_ORIGIN + k) * _PACKET + j] = rays[i + j, k] - middle[k]
            packet[(_DIRECTION + k) * _PACKET + j] = rays[i + j, 3 + k]
    for j in range(_PACKET):
        is_ray[j] = -1 if j < count else 0
        packet[_FAR * _PACKET + j] = far
        number[_GEOMETRY * _PACKET + j] = _INVALID
        number[_INSTANCE * _PACKET + j] = _INVALID
    return count


# The hit of a ray does not depend on the others of its packet.
@kernel
def _fill_closest(triangles, instances, first, rays, middle, scene, arguments):
    (packet, number, is_ray), center = _new_packet(), vector(middle, 0)
    for i in range(0, rays.shape[0], _PACKET):
        count = _begin(packet, number, is_ray, rays, i, center, np.inf)
        _intersect(is_ray.ctypes.data, scene, packet.ctypes.data, arguments)
        for j in range(count):
            hit = number[_GEOMETRY * _PACKET + j] != _INVALID
            row = np.int32(number[_PRIMITIVE * _PACKET + j])
            instance = np.int32(-1)
            if first is not None and hit and number[_INSTANCE * _PACKET + j] != _INVALID:
                instance = np.int32(number[_INSTANCE * _PACKET + j])
                row += first[instance]
            if instances is not None:
                instances[i + j] = instance
            triangles[i + j] = row if hit else np.int32(-1)


@kernel
def _fill_occlusion(blocked, rays, middle, scene, arguments):
    (packet, number, is_ray), center = _new_packet(), vector(middle, 0)
    for i in range(0, rays.shape[0], _PACKET):
        count = _begin(packet, number, is_ray, rays, i, center, SHADOW_END)
        _occluded(is_ray.ctypes.data, scene, packet.ctypes.data, arguments)
        for j in range(count):
            # Embree marks an occluded ray by a far end of minus infinity.
            blocked[i + j] = 1 if packet[_FAR * _PACKET + j] < 0.0 else 0

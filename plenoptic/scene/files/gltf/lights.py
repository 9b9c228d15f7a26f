"""The lights and cameras of glTF files."""

from __future__ import annotations

import numpy as np

from plenoptic.errors import FileError
from plenoptic.scene.file_cameras import View
from plenoptic.scene.files.file_materials import colour_of
from plenoptic.scene.files.gltf.file import GltfFile
from plenoptic.scene.files.gltf.nodes import PlacedNode
from plenoptic.scene.lights.point import PointLight
from plenoptic.scene.lights.registry import Light
from plenoptic.scene.lights.spot import SpotLight
from plenoptic.scene.lights.sun import SunLight

_SHARPEST = 0.9999
"""The inner angle of a spot as a share of the outer one, at most: some exporters write the same number twice."""


def gltf_light(node: PlacedNode, file: GltfFile, scale: float) -> Light | None:
    """The light of a node (KHR_lights_punctual), in mm; None where it has none or a dark one.

    Its candela (points, spots) and lux (directional lights) are taken as scene units: at the distance d, in the file's
    unit of length, a point of intensity I makes the irradiance I / d^2. In mm that is the intensity I scale^2. Its
    `range`, where light would end, is left out: light does not end. It lies at the origin of the node and shines along
    its -z; the node's scale has no effect. `scale` is mm in one unit of the file.
    """
    named = node.described.get("extensions", {}).get("KHR_lights_punctual")
    if named is None:
        return None
    light = file.header["extensions"]["KHR_lights_punctual"]["lights"][named["light"]]
    emitted = np.array(light.get("color", (1.0, 1.0, 1.0)), dtype=np.float64) * light.get("intensity", 1.0)
    if not emitted.any():
        return None
    position, forwards, intensity = scale * node.matrix[:3, 3], -node.matrix[:3, 2], colour_of(emitted * scale**2)
    if light["type"] == "point":
        return PointLight(position, intensity)
    if light["type"] == "spot":
        cone = light.get("spot", {})
        outer = cone.get("outerConeAngle", np.pi / 4)
        inner = min(cone.get("innerConeAngle", 0.0), _SHARPEST * outer)
        return SpotLight(position, forwards, intensity, inner, outer)
    if light["type"] == "directional":
        return SunLight(forwards, colour_of(emitted), angular_radius=0.0)
    raise FileError(f"it has a light of the kind {light['type']!r}; export point, spot or directional lights")


def gltf_view(node: PlacedNode, file: GltfFile, scale: float) -> View | None:
    """The camera of a node, in mm; None where it has none.

    It stands at the origin of the node and looks along its -z, y up; it looks at a point one unit of the file ahead.
    """
    if "camera" not in node.described:
        return None
    camera = file.described("cameras", node.described["camera"])
    name = str(node.described.get("name") or camera.get("name") or f"camera {node.described['camera']}")
    position, axes = node.matrix[:3, 3], node.matrix[:3, :3] / np.linalg.norm(node.matrix[:3, :3], axis=0)
    lens, flat = camera.get("perspective", {}), camera.get("orthographic")
    aspect = lens.get("aspectRatio", None if flat is None else abs(flat["xmag"] / flat["ymag"]))
    return View(name, scale * position, scale * (position - axes[:, 2]), axes[:, 1], lens.get("yfov"), aspect)

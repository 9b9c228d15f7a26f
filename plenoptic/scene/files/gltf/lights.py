"""The lights and cameras of glTF files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from plenoptic.errors import FileError
from plenoptic.scene.file_cameras import View
from plenoptic.scene.files.file_materials import colour_of
from plenoptic.scene.files.gltf.file import GltfFile, entry_of
from plenoptic.scene.files.gltf.nodes import PlacedNode
from plenoptic.scene.lights.point import PointLight
from plenoptic.scene.lights.registry import Light
from plenoptic.scene.lights.spot import SpotLight
from plenoptic.scene.lights.sun import SunLight

_SHARPEST = 0.9999
"""The inner angle of a spot as a share of the outer one, at most: some exporters write the same number twice."""


def gltf_lights(nodes: Iterable[PlacedNode], file: GltfFile, scale: float) -> Iterator[Light]:
    """The lights of nodes (KHR_lights_punctual), in mm, but dark ones.

    Their candela (points, spots) and lux (directional lights) are taken as scene units: at the distance d, in the
    file's unit of length, a point of intensity I makes the irradiance I / d^2. In mm that is the intensity I scale^2.
    Their `range` is left out: light does not end. They lie at the origin of their node, at any scale of it, and shine
    along its -z. `scale` is mm in one unit of the file.
    """
    for node in nodes:
        extension = node.described.get("extensions", {}).get("KHR_lights_punctual")
        if extension is None:
            continue
        listed = file.header.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights")
        light = entry_of(listed, extension.get("light"), "lights")
        emitted = np.array(light.get("color", (1.0, 1.0, 1.0)), dtype=np.float64) * light.get("intensity", 1.0)
        if not emitted.any():
            continue
        position, forwards, intensity = scale * node.matrix[:3, 3], -node.matrix[:3, 2], colour_of(emitted * scale**2)
        if light["type"] == "point":
            yield PointLight(position, intensity)
        elif light["type"] == "spot":
            cone = light.get("spot", {})
            outer = cone.get("outerConeAngle", np.pi / 4)
            inner = min(cone.get("innerConeAngle", 0.0), _SHARPEST * outer)
            yield SpotLight(position, forwards, intensity, inner, outer)
        elif light["type"] == "directional":
            yield SunLight(forwards, colour_of(emitted), angular_radius=0.0)
        else:
            raise FileError(f"it has a light of the kind {light['type']!r}; export point, spot or directional lights")


def gltf_views(nodes: Iterable[PlacedNode], file: GltfFile, scale: float) -> Iterator[View]:
    """The cameras of nodes, in mm.

    They stand at the origin of their node and look along its -z, y up; they look at a point one unit of the file ahead.
    """
    for node in nodes:
        if "camera" in node.described:
            camera = file.entry("cameras", node.described["camera"])
            name = str(node.described.get("name") or camera.get("name") or f"camera {node.described['camera']}")
            position, axes = node.matrix[:3, 3], node.matrix[:3, :3] / np.linalg.norm(node.matrix[:3, :3], axis=0)
            lens, flat = camera.get("perspective", {}), camera.get("orthographic")
            aspect = lens.get("aspectRatio", None if flat is None else abs(flat["xmag"] / flat["ymag"]))
            yield View(name, scale * position, scale * (position - axes[:, 2]), axes[:, 1], lens.get("yfov"), aspect)

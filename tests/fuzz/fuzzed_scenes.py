"""Scenes: one of a few kinds, so that few kernels are compiled, of any size and at any distance."""

import enum

import numpy as np
from fuzzed_numbers import chance, colour, length, rotation, signed, table, uniform

import plenoptic as pl

Kind = enum.Enum("Kind", "WORLD GLOWING LAMPS DIFFUSE POINTS SKYLIT METALS GLASS EVERYTHING")
"""What there is in a scene."""
COMMON = (Kind.WORLD, Kind.GLOWING, Kind.LAMPS)
COLOURED = (Kind.WORLD, Kind.LAMPS, Kind.EVERYTHING)
"""What cameras of many wavelengths see."""


def a_shape(rnd, material, *, smooth=False, mapped=False):
    """A mesh around the origin, about 1 mm large."""
    kind = rnd.randint(0, 3)
    if kind == 0:
        mesh = pl.box([length(rnd, 1.0) for _ in range(3)])
    elif kind == 1:
        mesh = pl.sphere(0.5, segments=(rnd.randint(3, 12), rnd.randint(2, 8)))
    elif kind == 2:
        mesh = pl.quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0))
    else:
        mesh = a_soup(rnd)
    normals = None
    if smooth:
        normals = mesh.normals if mesh.normals is not None else np.tile([0.0, 0.6, 0.8], (len(mesh.vertices), 1))
    uv = mesh.vertices[:, :2] + 0.25 if mapped else None
    return pl.Mesh(mesh.vertices, mesh.faces, material, normals=normals, uv=uv)


def a_soup(rnd):
    """Triangles anywhere; some without area, some slivers, some twice."""
    n = rnd.randint(1, 8)
    vertices = table(rnd, -1.0, 1.0, 3 * n, 3)
    faces = np.arange(3 * n).reshape(-1, 3)
    if chance(rnd, 3):
        vertices[0] = vertices[1] + 1e-9
        faces = np.concatenate([faces, faces[:, ::-1], faces[:, [0, 0, 1]], faces[:, [2, 2, 2]]])
    return pl.Mesh(vertices, faces)


def a_texture(rnd, channels, brightest=1.0):
    texels = brightest * table(rnd, 0.0, 1.0, rnd.randint(1, 3), rnd.randint(1, 3), channels)
    wrap, how = rnd.choice(list(pl.materials.Wrap)), rnd.choice(list(pl.materials.TextureFilter))
    return pl.Texture(texels, wrap=wrap, filter=how)


def radiance(rnd):
    """Mostly from 1e-3 to 1e3; seldom whatever float32 can hold the image of."""
    return colour(rnd, 10.0 ** uniform(rnd, -40.0, 20.0) if chance(rnd, 40) else length(rnd, 1.0, spread=3.0))


def some_materials(rnd, kind):
    """One material for each of the kinds that the scene must have."""
    found = []
    if kind is Kind.GLOWING:
        found = [pl.Emissive(radiance(rnd), two_sided=chance(rnd, 2))]
    if kind in (Kind.LAMPS, Kind.DIFFUSE, Kind.POINTS, Kind.SKYLIT, Kind.EVERYTHING):
        found = [pl.Lambertian(colour(rnd))]
    if kind in (Kind.METALS, Kind.EVERYTHING):
        index = complex(uniform(rnd, 0.01, 10.0), uniform(rnd, 0.0, 20.0))
        found += [
            pl.Conductor(colour(rnd), alpha=uniform(rnd, 0.0, 1.0) if chance(rnd, 2) else 0.0),
            pl.Conductor(alpha=uniform(rnd, 0.0, 1.0), index=index),
            pl.materials.RoughDiffuse(colour(rnd), uniform(rnd, 0.0, 1.0)),
            pl.MetallicRoughness(colour(rnd), uniform(rnd, 0.0, 1.0), uniform(rnd, 0.0, 1.0), emission=radiance(rnd)),
        ]
    if kind in (Kind.GLASS, Kind.EVERYTHING):
        rough = uniform(rnd, 0.0, 1.0) if chance(rnd, 2) else 0.0
        found += [
            pl.Dielectric(uniform(rnd, 1.0, 4.0), rough, absorption=colour(rnd, length(rnd, 0.1, spread=3.0))),
            pl.materials.ThinGlass(uniform(rnd, 1.0, 4.0), colour(rnd)),
        ]
    if kind is Kind.EVERYTHING:
        base = a_texture(rnd, 3), a_texture(rnd, 1), a_texture(rnd, 1)
        more = {"normal_map": a_texture(rnd, 3), "emission": a_texture(rnd, 3, length(rnd, 1.0))}
        more |= {"opacity": a_texture(rnd, 1), "cutoff": uniform(rnd, 0.0, 1.0) if chance(rnd, 2) else None}
        found.append(pl.MetallicRoughness(*base, **more))
    return found


def some_lights(rnd, kind, place, size):
    """The lights of a kind of scene, around a place."""

    def beside():
        return place + np.array([signed(rnd, size) for _ in range(3)])

    found = []
    if kind in (Kind.LAMPS, Kind.METALS, Kind.GLASS, Kind.EVERYTHING):
        sides = [[signed(rnd, size), 0.0, 0.0], [0.0, signed(rnd, size), 0.0]]
        found += [
            pl.QuadLight(beside(), *sides, radiance(rnd), two_sided=chance(rnd, 2)),
            pl.lights.SphereLight(beside(), length(rnd, size), radiance(rnd)),
        ]
    if kind in (Kind.POINTS, Kind.EVERYTHING):
        inner, outer = sorted([uniform(rnd, 0.0, 1.5), uniform(rnd, 0.01, 1.5)])
        found += [
            pl.lights.PointLight(beside(), radiance(rnd)),
            pl.lights.SpotLight(beside(), rotation(rnd)[0], radiance(rnd), inner, outer),
            pl.SunLight(rotation(rnd)[0], radiance(rnd), length(rnd, 0.005)),
        ]
    return found


def a_scene(rnd, camera, scale, kinds):
    """A scene of one of some kinds, before a camera of some size, or around it, or elsewhere; and its kind."""
    kind = rnd.choice(kinds)
    if kind is Kind.WORLD:
        return pl.Scene(background=radiance(rnd)), kind
    distance = 0.0 if chance(rnd, 10) else length(rnd, 10.0 * scale, spread=2.0)
    size = length(rnd, (distance or scale), spread=1.0)
    place = np.array([0.0, 0.0, -distance])
    if camera.pose is not None:
        place = camera.pose.to_world(place)
    smooth = kind in (Kind.POINTS, Kind.EVERYTHING)
    meshes = []
    for material in some_materials(rnd, kind):
        mesh = a_shape(rnd, material, smooth=smooth, mapped=kind is Kind.EVERYTHING)
        matrix = np.eye(4)
        matrix[:3, :3] = rotation(rnd) * length(rnd, size, spread=0.5)
        matrix[:3, 3] = place + [0.3 * signed(rnd, size) for _ in range(3)]
        meshes.append(mesh.transformed(matrix))
    if kind is Kind.EVERYTHING:
        matrices = np.tile(np.eye(4), (rnd.randint(1, 3), 1, 1))
        matrices[:, :3, 3] = [[signed(rnd, size) for _ in range(3)] for _ in matrices]
        meshes[-1] = pl.scene.Instances(meshes[-1], matrices)
    background = None
    if kind in (Kind.GLOWING, Kind.DIFFUSE, Kind.GLASS):
        background = radiance(rnd)
    elif kind in (Kind.SKYLIT, Kind.EVERYTHING):
        rows, columns = rnd.randint(1, 4), rnd.randint(1, 4)
        texels = length(rnd, 1.0) * table(rnd, 0.0, 1.0, rows, columns, 1)
        background = pl.EnvironmentMap(texels, rotation(rnd))
    return pl.Scene(meshes, some_lights(rnd, kind, place, size), background), kind

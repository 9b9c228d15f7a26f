"""Aperture regions clipped by the openings of the lens give the light of paths drawn from the whole pupil.

The unvignetted core, which white images add without tracing, passes the lens.
"""

import dataclasses
import math

import numpy as np
import pytest
from camera_helpers import CAMERA, agree, bare_camera, camera_with, compiled_anew, out_of_blocks, the_lens, total

import plenoptic as pl
from plenoptic.camera import cache
from plenoptic.camera import camera_record as record
from plenoptic.camera.camera_rays import CameraRays, fill_through_array
from plenoptic.camera.camera_record import camera_record
from plenoptic.camera.sampling.aperture_regions import illuminated_pixels, pixel_centres
from plenoptic.camera.sampling.sampling_records import batch_record
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.lens.pupil.exit_pupil import rear_reach
from plenoptic.optics.lens.pupil.outline import polygon_around
from plenoptic.rendering import Stage


def opening(fill, gaps):
    return pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=fill, gaps=gaps)


def strong_lens():
    """Lens with a disconnected pupil: a crescent of grazing rays, and rays close to the axis."""
    front = pl.Surface(7.48, 14.348, pl.ConstantMedium(1.987), semi_diameter=6.6)
    return pl.LensStack([pl.CircularStop(0.641, 2.614), front, pl.Surface(-8.76, semi_diameter=6.685)])


def ball(index=1.8, stop=9.0):
    """A ball before a stop: rays meet its rim steeply, and some are reflected there."""
    surfaces = [pl.Surface(20.0, 40.0, pl.ConstantMedium(index), semi_diameter=19.9)]
    surfaces += [pl.Surface(-20.0, 20.0, semi_diameter=19.9), pl.CircularStop(stop, 1.0)]
    return pl.LensStack(surfaces)


COLOURS = {"sensitivity": pl.sensitivities.cie_1931()}
CAMERAS = {"2.0": CAMERA, "1.0, small stop": camera_with(2.0, 1.0), "small stop": camera_with(stop=1.0)}
CAMERAS |= {"tiny stop": camera_with(stop=0.1), "barrel": camera_with(stop=14.0)}
CAMERAS |= {"overlap": camera_with(stop=8.0, pitch=0.1), "ball": bare_camera(ball(), 40.0)}
CAMERAS |= {"no array": bare_camera(z=123.3), "no array, barrel": bare_camera(the_lens(17.0), 123.3)}
CAMERAS |= {
    "types": camera_with(focal_lengths=(1.6, 2.0, 2.4)),
    "blades": camera_with(stop=pl.PolygonStop(6, 5.0, rotation=0.2)),
    "pinholes": camera_with(stop=0.5, model=pl.optics.MicrolensModel.PINHOLE),
    "spoiled": camera_with(imperfections=pl.MicrolensImperfections(pitch_jitter=0.003, dark=0.2, missing=0.1)),
    "tilted array": CAMERA.moved(pl.CameraPart.MICROLENSES, tilt=(0.02, -0.01, 0.3)),
    "tilted sensor": CAMERA.moved(pl.CameraPart.SENSOR, tilt=(0.02, -0.01, 0.3), shift=(0.0, 0.1, 0.02)),
    "displaced stop": camera_with(lens=the_lens().moved(5, shift=(1.0, 0.5, 0.0))),
    "colours": dataclasses.replace(camera_with(stop=3.0), **COLOURS),
    "thin lens": camera_with(lens=the_lens(model=pl.LensModel.THIN)),
    "large sensor": dataclasses.replace(CAMERA, sensor=pl.Sensor(shape=(8192, 8192), pixel_pitch=0.003)),
}
ALONE = bare_camera(the_lens(model=pl.LensModel.THIN), 123.3)
MORE_CAMERAS = {
    "round openings": camera_with(aperture=opening(0.8, pl.optics.Gaps.OPAQUE)),
    "clear gaps": camera_with(aperture=opening(0.7, pl.optics.Gaps.CLEAR)),
    "walls": camera_with(walls=pl.optics.Walls.OPAQUE),
    "plates": camera_with(model=pl.optics.MicrolensModel.SPHERICAL, thickness=0.3, index=1.5),
    "star": camera_with(stop=pl.StarStop(5, 5.0, 2.0)),
    "curved blades": camera_with(stop=pl.PolygonStop(6, 5.0, blade_radius=9.0)),
    "mask off the axis": camera_with(stop=pl.optics.MaskStop(np.eye(4)[[2]].T @ np.eye(4)[[3]], 7.0)),
    "tilted element": camera_with(lens=the_lens().moved(0, tilt=(0.02, 0.01, 0.0))),
    "two parts": bare_camera(strong_lens(), 18.04),
    "two parts, microlenses": camera_with(0.5, lens=strong_lens(), to_array=18.04, pitch=0.1),
}


def some_regions(camera):
    """Rows and columns of regions in the middle, at the edge and in a corner."""
    rows, columns = camera.sensor.shape
    return [
        ((row, row + 12), (column, column + 12))
        for row, column in ((rows // 2, columns // 2 - 5), (rows // 2, 0), (rows - 12, columns - 12))
    ]


def render_sky(camera, **settings):
    """Render a uniform sky with all paths traced; a white image adds the unvignetted core."""
    return pl.render(pl.Scene(background=1.0), camera, truth=pl.Truth.NONE, **settings)


def count_core_rays(name):
    """Number of rays in the unvignetted core of a camera; all of them pass."""
    camera = camera_record(CAMERAS[name])
    n_core = 0
    for rows, columns in some_regions(CAMERAS[name]):
        number = np.arange((rows[1] - rows[0]) * (columns[1] - columns[0]))
        illuminated = illuminated_pixels(camera, pixel_centres(camera, rows, columns), number, with_core=True)
        if not illuminated.place.size:
            continue
        n = 64 * illuminated.place.size
        camera_rays = CameraRays(camera, illuminated, batch_record(np.uint64(7), 0, 64, 1, 0, 0), n)
        camera_rays.sample(0, n)
        core, lenslets = camera_rays.core, None
        *_, axis_x, _, _, axis_y, weights, _ = out_of_blocks(core, core.size // 8)
        if illuminated.regions.details is not None:
            # The path has another microlens than the core ray, whose microlens follows from its axis.
            rows_of = {
                (d["axis_x"], d["axis_y"]): d for d in illuminated.regions.details[: illuminated.regions.first[-1]]
            }
            lenslets = camera.lenslet_parameters(core.size // 8)
            for k, axis in enumerate(zip(axis_x, axis_y, strict=True)):
                lenslets[k] = rows_of.get(axis, lenslets[k])
        fill_through_array(core, lenslets, camera, camera_rays.waves)
        fill_through_lens(core, camera_rays.lens, camera_rays.waves)
        lost = out_of_blocks(core, core.size // 8)[7] != 0
        assert not (lost & (weights > 0)).any(), name
        n_core += int((weights > 0).sum())
    return n_core


FEW = (
    *("2.0", "tiny stop", "barrel", "blades", "types", "spoiled", "tilted sensor"),
    *("displaced stop", "no array", "ball", "colours", "thin lens"),
)


@pytest.mark.parametrize(
    "names", [FEW, pytest.param([n for n in CAMERAS if n not in FEW], marks=pytest.mark.slow)], ids=["few", "more"]
)
def test_the_unvignetted_core_is_unvignetted(names):
    for name in names:
        # Corners of a box around a wide pupil pass no lens, so that nothing is known.
        assert (count_core_rays(name) > 100) == (name not in {"no array, barrel", "ball"}), name


def test_other_stops_leave_no_unvignetted_core():
    for camera, why in (
        (MORE_CAMERAS["round openings"], "round"),
        (MORE_CAMERAS["plates"], "plates"),
        (MORE_CAMERAS["walls"], "walls"),
        (camera_with(stop=10.0, pitch=0.07), "microlenses are near a pixel"),
        (camera_with(2.0), "changes more over a pixel than over a microlens"),
        (MORE_CAMERAS["star"], "no circle and no polygon"),
        (dataclasses.replace(CAMERA, **COLOURS), "wavelengths"),
        (ALONE, "ellipse"),
    ):
        (said,) = (d for d in pl.plan(None, camera).decisions if d.stage is Stage.UNVIGNETTED_CORE)
        assert not said.runs and why in said.reason, why
    scene = pl.plan(pl.Scene([], background=1.0), CAMERA)
    assert scene.runs(Stage.APERTURE_REGIONS) and not scene.runs(Stage.UNVIGNETTED_CORE)
    for name in ("star", "curved blades"):
        camera = camera_record(MORE_CAMERAS[name])
        regions = illuminated_pixels(
            camera, pixel_centres(camera, (250, 258), (250, 258)), np.arange(64), with_core=True
        ).regions
        assert not regions.pieces["has_core"][: regions.first[-1]].any(), name


def test_white_images_of_an_ideal_lens_alone_are_those_of_a_sky():
    settings = {"samples": 16, "region": np.s_[:16, :16], "progress": False}
    white, sky = pl.render_white(ALONE, **settings), render_sky(ALONE, **settings)
    assert np.array_equal(white.image, sky.image) and not white.stats.lost
    # What is left is the cosine^4 over the pupil; rims would be 0.2 %.
    assert white.relative_error < 0.001
    blades = dataclasses.replace(ALONE, lens=ALONE.lens.with_stop(pl.PolygonStop(6, 5.0)))
    assert pl.plan(None, blades).runs(Stage.UNVIGNETTED_CORE)


def test_pixels_that_see_very_many_microlenses_are_traced_whole():
    # Few are near a point of such large pixels, but a hundred near all of them.
    for pitch, stop in ((0.1, 8.0), (0.2, 3.0)):
        camera = camera_with(stop=stop, pitch=pitch, lattice=pl.Lattice.SQUARE)
        camera = dataclasses.replace(camera, sensor=pl.Sensor(shape=(64, 64), pixel_pitch=pitch))
        settings = {"samples": 256, "replicates": 8, "region": np.s_[32:40, 32:40], "progress": False}
        white, traced = pl.render_white(camera, **settings), render_sky(camera, seed=1, **settings)
        agree(white, traced, case=pitch)


def test_exact_regions_give_the_light_of_pupil_bounds(monkeypatch):
    # Pinholes send all rays of a cell alike: no movement of their regions with the point on the pixel can be known.
    for camera in (CAMERA, camera_with(stop=0.5), CAMERAS["pinholes"]):
        arguments = {"samples": 256, "replicates": 16, "region": np.s_[:32, :32], "progress": False}
        exact = render_sky(camera, seed=1, **arguments)
        with monkeypatch.context() as patch:
            patch.setattr(record, "bounds_reason", lambda *_, **__: "they do")
            bounds = render_sky(compiled_anew(camera), seed=2, **arguments)
        agree(exact, bounds)
        assert exact.stats.paths_through_lens / exact.stats.paths > bounds.stats.paths_through_lens / bounds.stats.paths


def test_many_microlenses_and_clear_gaps_use_pupil_bounds():
    large = camera_with(stop=4.0, shape=(8192, 8192))
    for camera, exact in (
        *((CAMERA, True), (large, True), (camera_with(stop=20.0), False)),
        *((camera_with(stop=8.0, pitch=0.08), False), (MORE_CAMERAS["clear gaps"], False)),
    ):
        assert camera_record(camera).exact == exact


def blind(made, camera):
    """The same camera with trivial bounds on its pupil.

    Paths are drawn over all microlenses near a pixel, whole, from which rays may reach the lens's last element.
    """
    plane = made.parts.z_plane + (made.parts.distance if made.array is None else 0.0)
    a, b = rear_reach(camera.lens, plane, camera.wavelength)
    bins = len(made.pupil.reach)
    support = np.full(made.pupil.support.shape, 1.1 * (a + b * bins * made.pupil.step))
    everything = {"support": support, "corners": polygon_around(support), "disconnected": np.zeros(bins, dtype=bool)}
    return made._replace(exact=False, pupil=made.pupil._replace(**everything, reach=1.1 * support[:, 0]))


@pytest.mark.slow
@pytest.mark.parametrize("group", range(6))
def test_images_equal_those_of_paths_from_the_whole_pupil(group, monkeypatch):
    # Of a tiny stop, too few paths would arrive.
    names = [name for name in (*CAMERAS, *MORE_CAMERAS) if name != "tiny stop"]
    for name in names[group::6]:
        assert_as_drawn_anywhere(name, monkeypatch)


def assert_as_drawn_anywhere(name, monkeypatch):
    camera, samples, many = (CAMERAS | MORE_CAMERAS)[name], 1 << 10, 1 << 13
    over = {"white": [], "traced": []}
    for seed, (rows, columns) in enumerate(some_regions(camera)[::2]):
        arguments = {"replicates": 32, "region": (slice(*rows), slice(*columns)), "progress": False}
        white = pl.render_white(camera, samples=samples, seed=seed, **arguments)
        traced = render_sky(camera, samples=samples, seed=100 + seed, **arguments)
        with monkeypatch.context() as patch:
            patch.setattr(cache, "camera_record", lambda of: blind(camera_record(of), of))
            anywhere = render_sky(compiled_anew(camera), samples=many, seed=200 + seed, **arguments)
        value, useful = anywhere.image.astype(float), anywhere.stats.paths_through_lens / anywhere.stats.paths
        is_precise = anywhere.standard_error < 0.1 * value
        for kind, shot in (("white", white), ("traced", traced)):
            off = shot.image - value
            error = np.hypot(shot.standard_error, anywhere.standard_error).astype(float)
            assert abs(off.sum()) <= 4 * math.hypot(total(shot)[1], total(anywhere)[1]), (name, kind)
            # Of what a single path makes, such as the only one that is lost, no standard error knows.
            single = np.hypot(value / samples, value / max(many * useful, 1.0))
            over[kind].extend((off / np.hypot(error, single))[is_precise])
        # With a core of all light or none, both draw alike, and behind a small stop few pixels are informative.
        # Where a round opening is sampled exactly, no path is lost, and a core gains nothing.
        lit = traced.image > 0.1 * traced.image.max()
        is_exact = traced.stats.paths_through_lens == traced.stats.paths
        assert (
            is_exact or np.square(white.standard_error[lit]).sum() <= 2.0 * np.square(traced.standard_error[lit]).sum()
        )
    for kind, chi in over.items():
        # Errors of 32 replicates make Student's t of 31 degrees of freedom: mean square 31 / 29, and four standard
        # errors of that mean. Through the smallest pupils no pixel is known so well.
        assert not chi or np.mean(np.square(chi)) <= 31 / 29 * (1 + 4 * math.sqrt(2 / len(chi))), (name, kind)

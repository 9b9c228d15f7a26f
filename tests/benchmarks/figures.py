"""Figures of docs/validation.md that no test prints: those of the reference camera, and what rough surfaces lose."""

import dataclasses
import sys
import warnings
from pathlib import Path

import numpy as np
import reference
from table import Table

import plenoptic as pl

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / name) for name in ("rendering", "scene", "scene/materials")]
import test_bsdf as bsdf  # noqa: E402
import test_render as render  # noqa: E402

ALPHAS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0)
ANGLES_DEG = (0.0, 60.0, 84.0)
MEAN_OVER = 128


def tables(*, quick):
    yield Table("The reference camera", ("figure", "unit", "reference", "found"), [*paraxial(), *traced(quick)])
    metal, glass = ([f"{name}, {a:.0f} degrees" for a in ANGLES_DEG] for name in ("metal", "glass"))
    drawn = 1 << (12 if quick else 17)
    remark = f"Per cent of all light, by {drawn} drawn directions each. The mean is weighed by the cosine."
    rows = [(alpha, *losses(alpha, drawn)) for alpha in ALPHAS[:: 3 if quick else 1]]
    yield Table("What rough surfaces lose", ("alpha", *metal, "mean", *glass), rows, [remark])


def paraxial():
    lens = pl.load_lens("double-gauss-100mm-f2")
    points = pl.paraxial.cardinal_points(lens)
    yield "effective focal length", "mm", "100.72", f"{points.efl:.3f}"
    yield "second principal plane", "mm", "1.805", f"{points.rear_principal:.4f}"
    yield "rear focus", "mm", "102.52", f"{points.rear_focus:.3f}"
    yield "exit pupil", "mm", "-5.23", f"{points.exit_pupil:.3f}"
    yield "pupil magnification", "", "1.552", f"{points.pupil_magnification:.4f}"
    yield "image of z = -404 mm", "mm", "134.624", f"{pl.paraxial.image_position(lens, -404.0):.4f}"


def traced(quick):
    for mode, expected in zip(reference.Mode, ("21.987", "22.038"), strict=True):
        camera = reference.camera(mode)
        if not quick:
            found = f"{render.microlens_image_pitch(camera):.3f}"
            yield f"pitch of microlens images, {mode.title}", "pixels", expected, found
        array = dataclasses.replace(camera.microlenses, lattice=pl.Lattice.SQUARE)
        square = dataclasses.replace(camera, microlenses=array, sensor=pl.Sensor((70, 70), 0.010))
        apart = np.diff(np.unique(pl.microlens_centres(square).pixel[:, 0].round(6))).max()
        yield f"the same by chief rays, {mode.title}", "pixels", expected, f"{apart:.3f}"
        yield f"the same by `report()`, {mode.title}", "pixels", expected, f"{camera.report().image_pitch_pixels:.3f}"
    lenses, chief_rays = render.disparities_in_mode_2()
    yield "disparity of neighbours, relative to lens centres, 2.0", "pixels", "3.255", f"{lenses:.3f}"
    yield "the same, relative to chief-ray centres", "pixels", "3.542", f"{chief_rays:.3f}"
    report = reference.camera().report()
    focus = report.focus[0]
    yield "virtual depth of the plane in focus by `report()`, 2.0", "", "6.667", f"{focus.virtual_depth:.3f}"
    yield "disparity of the same", "pixels", "3.255", f"{focus.disparity:.3f}"
    yield "pixels that several microlenses feed, 2.0", "%", "12", f"{100 * report.overlap_fraction:.1f}"
    yield "plane in focus, Gaussian optics, 2.0", "mm", "-404", f"{focus.z:.2f}"
    camera = reference.camera(sensor=pl.Sensor(shape=(1, 1), pixel_pitch=1e-4))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pl.errors.ImplausibleCameraWarning)  # the pixel is a point
        white = pl.render_white(camera, samples=1 << 14, replicates=8, progress=False)
    found = f"{white.image[0, 0, 0]:.8f} +- {white.standard_error[0, 0, 0]:.0e}"
    yield "projected solid angle of the hexagonal cell, seen from its centre", "sr", "0.0140472", found
    if not quick:
        ratio = render.true_over_stated_on_check()
        yield "RMS of true error over RMS of standard error, `check`", "", "1", f"{ratio:.2f}"


def losses(alpha, n):
    """Per cent: of metal by angles and on average, of glass by angles."""

    def lost(material, angles, n):
        return [100 * (1 - float(bsdf.returned(material, bsdf.towards(angle), n)[0][0])) for angle in angles]

    metal, glass = pl.Conductor(alpha=alpha), pl.Dielectric(1.5, alpha=alpha)
    angles = np.degrees(np.arccos(np.sqrt((np.arange(MEAN_OVER) + 0.5) / MEAN_OVER)))
    mean = float(np.mean(lost(metal, angles, n // 16)))
    return *lost(metal, ANGLES_DEG, n), mean, *lost(glass, ANGLES_DEG, n)

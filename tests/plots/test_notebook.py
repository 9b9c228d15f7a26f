"""Pictures in notebooks: small, well-formed, the same twice, aside from pyplot; texts where there is no matplotlib."""

import base64
import io
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
import small_calibration
from PIL import Image

import plenoptic as pl
from plenoptic.camera.points.centres import MicrolensCentres
from plenoptic.camera.points.projection import Projection
from plenoptic.plots.notebook.html import list_html, picture_html, table_html

LENS = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(5.0))
CAMERA = pl.PlenopticCamera(
    LENS, pl.Sensor(shape=(64, 64), pixel_pitch=0.010), 123.3, pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)), 1.7
)
LIMIT = 200_000


def _noise(*shape):
    return np.random.default_rng(5).uniform(0.0, 1.0, shape)


def _field(channels=3):
    ones = np.ones((3, 3))
    return pl.lightfield.LightField(
        views=_noise(3, 3, 200, 300, channels).astype(np.float32), standard_error=None, u=np.arange(-1.0, 2.0),
        v=np.arange(-1.0, 2.0), pixel=np.zeros((200, 300, 2)), on_array=np.zeros((200, 300, 2)),
        exit_pupil=np.zeros((3, 3, 2)), pupil=np.zeros((3, 3, 2)), origin=ones, spacing=(20.0, 20.0),
        object_spacing=(0.1, 0.1), z_focus=-400.0, camera=None,
    )  # fmt: skip


def _view():
    plane, colours = _noise(150, 200), _noise(150, 200, 3).astype(np.float32)
    return pl.lightfield.View(colours, None, plane, plane, np.zeros((150, 200, 2)), 0.1, (0.0, 0.0), CAMERA)


def _centres(count=400):
    i, j = np.meshgrid(np.arange(20), np.arange(20))
    index = np.stack([i.ravel(), j.ravel()], axis=1)[:count]
    place, kind = 0.2 * index, (index[:, 0] - index[:, 1]) % 3
    return MicrolensCentres(index, kind, place, 1.02 * place, 20.0 * index, pl.CentreMethod.CHIEF_RAY)


def _projection():
    pixel, two = np.array([[3.0, 4.0], [9.0, 4.0], [np.nan, np.nan]]), np.zeros((3, 2))
    yes = np.array([True, False, True])
    return Projection(
        np.zeros((2, 3)), np.array([0, 1, 1]), None, None, two, pixel, two, pixel, two, np.ones(3), np.ones(3), yes, yes
    )


FIELDS, ANALYSES = np.linspace(0.0, 0.2, 5), pl.aberrations
ZERNIKE = ANALYSES.wavefront(LENS, field=(0.0, 0.1)).zernike(6)


VALUES = {
    "circle": lambda: pl.CircularStop(5.0),
    "polygon": lambda: pl.PolygonStop(6, 5.0, blade_radius=8.0),
    "star": lambda: pl.optics.StarStop(5, 4.0, 2.0),
    "mask": lambda: pl.optics.MaskStop(np.eye(3), 4.0),
    "ring": lambda: pl.optics.RingStop(5.0, 2.0),
    "sensor": lambda: pl.Sensor((48, 64), 0.01, pixel_aperture=(0.8, 0.5)),
    "pixel": lambda: pl.Sensor((1, 1), 0.1 + 0.2),
    "array": lambda: pl.MicrolensArray(0.217, (1.7, 2.0, 0.1 + 0.2)),
    "free array": lambda: pl.MicrolensArray(1.0, (2.0,), pl.Lattice.FREE, centres=[(-0.0, 0.0), (1.0, 0.5)]),
    "sensitivity": pl.sensitivities.colour_camera,
    "spots": lambda: ANALYSES.spot_diagram(LENS, field=(-0.0, -0.0), rays=500, wavelength=(486.09999999999997, 587.6)),
    "fan": lambda: ANALYSES.ray_fan(LENS, field=(0.0, 0.1)),
    "mtf": lambda: ANALYSES.mtf(LENS, [0.0, 10.0, 20.0], rays=500),
    "wave mtf": lambda: ANALYSES.wave_mtf(LENS, [0.0, 10.0, 20.0]),
    "point spread": lambda: ANALYSES.point_spread(LENS, rays=500),
    "distortion": lambda: ANALYSES.distortion(LENS, FIELDS),
    "field curvature": lambda: ANALYSES.field_curvature(LENS, FIELDS),
    "coma": lambda: ANALYSES.coma(LENS, FIELDS),
    "vignetting": lambda: ANALYSES.vignetting(LENS, FIELDS),
    "illumination": lambda: ANALYSES.relative_illumination(LENS, FIELDS),
    "depth distortion": lambda: ANALYSES.depth_distortion(LENS, [0.0, 10.0], z_image=123.3),
    "focus": lambda: ANALYSES.through_focus(LENS),
    "colour": lambda: ANALYSES.chromatic_shift(LENS),
    "seidel": lambda: ANALYSES.seidel_sums(LENS, field=0.17),
    "zernike": lambda: ZERNIKE,
    "lens": lambda: LENS,
    "camera": lambda: CAMERA,
    "report": CAMERA.report,
    "scene": lambda: pl.Scene([pl.box(4).translated(0, 0, -400)], [pl.lights.PointLight((0, 50, -400))]),
    "empty scene": lambda: pl.Scene(background=0.5),
    "plan": lambda: pl.plan(pl.Scene([pl.box(4).translated(0, 0, -400)], background=1.0), CAMERA),
    "white plan": lambda: pl.plan(None, CAMERA),
    "noise": lambda: pl.Exposure(_noise(700, 900, 3), standard_error=_noise(700, 900, 3)),
    "strip": lambda: pl.Exposure(_noise(2, 5000, 1)),
    "no light": lambda: pl.Exposure(np.zeros((200, 200, 1)), standard_error=np.zeros((200, 200, 1))),
    "nan": lambda: pl.Exposure(np.full((150, 150, 3), np.nan)),
    "raw": lambda: pl.Exposure(_noise(300, 400, 1)).develop(pl.SensorModel(photon_rate=1000.0)),
    "field": _field,
    "spectral field": lambda: _field(31),
    "view": _view,
    "depth": lambda: pl.lightfield.DepthMap(*[_noise(200, 300) for _ in range(5)]),
    "nothing known": lambda: pl.lightfield.DepthMap(*[np.full((20, 30), np.nan) for _ in range(5)]),
    "centres": _centres,
    "no centres": lambda: _centres(0),
    "grid": small_calibration.grid,
    "observations": small_calibration.observations,
    "calibration": small_calibration.calibration,
    "projection": _projection,
}


@pytest.fixture(scope="module")
def shown():
    before, made = (plt.get_fignums(), dict(matplotlib.rcParams)), {name: make() for name, make in VALUES.items()}
    html = {name: value._repr_html_() for name, value in made.items()}
    assert before == (plt.get_fignums(), dict(matplotlib.rcParams))
    return made, html


def test_html_is_small_and_well_formed_and_has_alternatives(shown):
    pictures = 0
    for name, html in shown[1].items():
        assert len(html.encode()) < LIMIT, name
        root = ElementTree.fromstring(f"<div>{html}</div>")
        for image in root.iter("img"):
            assert len(image.get("alt")) > 10, name
            picture = Image.open(io.BytesIO(base64.b64decode(image.get("src").split(",")[1])))
            assert picture.mode == "RGB" and image.get("src").startswith(f"data:image/{picture.format.lower()};"), name
            pictures += 1
        assert "\x00" not in html and "nan mm" not in html, name
        # Neither digits beyond those that mean something, nor a zero with a sign.
        text = repr(shown[0][name]) + re.sub('base64,[^"]*', "", html)
        assert not re.search(r"\d\.\d*[1-9]\d{12,}(?!\d*e)|(?<![\w.])-0(\.0*)?(?![\d.])", text), name
    assert pictures >= len(VALUES) - 3
    # Lines of a table stay lines.
    assert f"<figcaption><pre>{ZERNIKE!r}</pre></figcaption>" in shown[1]["zernike"]
    # Plans begin with what runs.
    html = shown[1]["plan"]
    assert html.index("intersection") < html.index("left out") < html.index("wavelengths")


def test_they_are_made_once_and_alike_in_threads_too(shown):
    made, html = shown
    for name in ("camera", "scene", "noise", "field", "centres"):
        first = made[name]._repr_html_()
        assert made[name]._repr_html_() is first and first == html[name], name
    names = ["scene", "strip", "centres"]
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda name: VALUES[name]()._repr_html_(), names))
    assert found == [html[name] for name in names]


def test_without_matplotlib_a_text_and_key_numbers_stay(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.setitem(sys.modules, name, None)
    for name in ("scene", "noise", "raw", "field", "view", "depth", "centres", "projection", "grid"):
        made = VALUES[name]()
        assert made._repr_html_() == f"<pre>{repr(made).replace('<', '&lt;').replace('>', '&gt;')}</pre>", name
    html = CAMERA.posed((0, 0, 1), (0, 0, 0))._repr_html_()
    assert "img" not in html and "pitch 0.217 mm" in html


def test_texts_are_escaped():
    assert "<b>" not in table_html(("<b>",), [("<b>", "<b>")], caption="<b>") + list_html(["<b>"], title="<b>")
    assert "<b>" not in picture_html(lambda figure: None, size=(1, 1), alt='"<b>', text="<b>")
    scene = pl.Scene([pl.box(4).with_material(pl.Lambertian(0.5))], views=[pl.scene.View("<i>", (0, 0, 9), (0, 0, 0))])
    assert "<i>" not in scene._repr_html_()


def test_pyplot_stays_out_and_nothing_is_compiled(tmp_path):
    code = """
import sys, plenoptic as pl
from plenoptic.core.progress.compiling import compiling
lens = pl.load_lens("double-gauss-100mm-f2")
camera = pl.PlenopticCamera(lens, pl.Sensor((64, 64), 0.01), 123.3, pl.MicrolensArray(0.217, (2.0,)), 1.7)
assert "data:image" in camera._repr_html_() and "data:image" in pl.Scene([pl.box(4)])._repr_html_()
print("matplotlib.pyplot" in sys.modules, compiling.names)
"""
    empty = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=empty)
    assert done.stdout == "False []\n"


def test_figures_leave_pyplot_when_a_notebook_shows_them(monkeypatch):
    figure = pl.plots.plot_depth_map(VALUES["depth"]())
    assert figure.number in plt.get_fignums()
    assert figure._repr_mimebundle_() == {} and figure.number in plt.get_fignums()
    monkeypatch.setattr(matplotlib, "get_backend", lambda: "module://matplotlib_inline.backend_inline")
    assert figure._repr_mimebundle_(include=None, exclude=None) == {}
    assert figure.number not in plt.get_fignums()
    plt.close("all")

"""Pages as files: what is in them, that they load nothing, and light fields and images of all kinds."""

import base64
import dataclasses
import hashlib
import html
import io
import re

import numpy as np
import pytest
from looking import camera_of, facts_of, field_of, views_of

import plenoptic as pl
from plenoptic.core.color.srgb import srgb_to_linear
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.lightfield.depth_map import DepthMap
from plenoptic.viewer import Viewer
from plenoptic.viewer.pictures import rgba, within
from plenoptic.viewer.sight import sight


def depth_of(disparity, error=0.01):
    shape = disparity.shape
    return DepthMap(disparity, np.full(shape, error), np.ones(shape), np.full(shape, np.nan), np.full(shape, np.nan))


def hashed(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@pytest.fixture(scope="module")
def pages():
    rng = np.random.default_rng(0)
    return {"views": views_of(3, 3).viewer(), "raw": pl.Exposure(rng.uniform(0, 1, (12, 16, 3))).viewer()}


def test_pages_load_nothing_and_run_only_what_their_policy_names(pages):
    for page in pages.values():
        document = page.document
        policy = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', document)[1]
        (script,) = re.findall(r'<script type="module">(.*?)</script>', document, re.DOTALL)
        (style,) = re.findall(r"<style>(.*?)</style>", document, re.DOTALL)
        assert policy.startswith("default-src 'none'; ") and "unsafe" not in policy and "http" not in policy
        assert hashed(script) in policy and hashed(style) in policy
        assert not re.search(r"^\s*(import|export)\b", script, re.MULTILINE)
        assert not re.search(r"https?://|//cdn|fetch\(|XMLHttpRequest|WebSocket|innerHTML|eval\(", document)
        assert "{{" not in document.replace(script, "")
        # Names that joined modules declare differ.
        names = re.findall(r"^(?:async )?(?:function|const|let|class) (\w+)", script, re.MULTILINE)
        assert len(names) > 20 and len(set(names)) == len(names)


def test_notebooks_and_files_get_the_same_document(pages, tmp_path):
    shown = pages["raw"]._repr_html_()
    assert html.unescape(re.search(r'srcdoc="(.*?)"', shown, re.DOTALL)[1]) == pages["raw"].document
    assert 'sandbox="allow-scripts"' in shown
    views_of(3, 3).save_html(tmp_path / "views.html")
    assert (tmp_path / "views.html").read_text("utf-8") == pages["views"].document
    with pytest.raises(FileError, match="does not exist"):
        Viewer("x").save(tmp_path / "none" / "views.html")


def test_what_could_end_an_element_cannot():
    from plenoptic.viewer.page import page

    made = page("</title><script>", facts={"x": "</script>{{data}}"}, data=b"", still=b"", modules=(), shaders=())
    assert "<title>&lt;/title&gt;" in made.document and made.document.count("</script>") == 3
    assert "\\u003c/script>{{data}}" in made.document


def decoded(facts, data, number):
    from PIL import Image

    start, size = facts["views"][number]
    return np.asarray(Image.open(io.BytesIO(data[start : start + size])).convert("RGBA"))


def test_views_are_kept_in_8_bits_and_their_gaps_as_clear_pixels():
    field = views_of(3, 3)
    facts, data = facts_of(field.viewer())
    assert facts["quality"] == 100 and facts["whole"] == [3, 3, 40, 56, 3] and facts["middle"] == [1, 1]
    for number, view in enumerate(field.views.reshape(9, 40, 56, 3)):
        codes = decoded(facts, data, number)
        known = np.isfinite(view).all(axis=2)
        assert np.array_equal(codes[..., 3] == 255, known)
        found = facts["top"] * srgb_to_linear(codes[..., :3] / 255)
        clipped = np.minimum(view, facts["top"])
        # Half a step of the steepest part of the curve, at white: d linear / d code = 2.4 / 1.055.
        assert np.abs(found - clipped)[known].max() < 0.51 / 255 * 2.28 * facts["top"]
    assert facts["top"] <= 2 * facts["white"] and facts["cut"] < 1e-3


def test_nine_by_nine_views_keep_within_their_size_by_the_quality():
    rng = np.random.default_rng(3)
    pictures = [rgba(rng.uniform(0, 1, (64, 64, 3)), 1.0) for _ in range(4)]
    files, quality = within(pictures, 1e6)
    assert quality == 100
    smaller, lossy = within(pictures, 0.5 * sum(map(len, files)))
    assert lossy < 100 and sum(map(len, smaller)) <= 0.5 * sum(map(len, files))


def test_light_fields_of_all_shapes_have_pages():
    for across, down, channels in ((1, 1, 3), (3, 1, 1), (1, 2, 3), (2, 4, 1), (3, 3, 5)):
        facts, _ = facts_of(views_of(across, down, 12, 14, channels).viewer())
        assert len(facts["views"]) == across * down and facts["middle"] == [across // 2, down // 2]
        assert (facts["focus"] is None) == (across * down == 1)


def test_distances_of_the_slider_are_those_of_the_light_field():
    field = views_of(3, 3)
    facts, _ = facts_of(field.viewer())
    focus = facts["focus"]
    table = np.linspace(focus["low"], focus["high"], len(focus["closeness"]))
    for disparity, closeness in zip(table, focus["closeness"], strict=True):
        if closeness:  # 0 is infinitely far
            assert field.disparity_at(-1 / closeness)[0] == pytest.approx(disparity, abs=1e-9)
    assert sum(each is not None for each in focus["closeness"]) > 20


def test_depth_and_error_are_kept_with_their_range():
    disparity = np.random.default_rng(5).uniform(-0.3, 0.9, (40, 56))
    disparity[0, 0] = np.nan
    field = dataclasses.replace(views_of(3, 3), standard_error=np.full((3, 3, 40, 56, 3), 0.02, np.float32))
    facts, _ = facts_of(field.viewer(depth=depth_of(disparity)))
    assert facts["focus"]["low"] < -0.3 < 0.9 < facts["focus"]["high"]
    assert facts["disparity"]["step"] == pytest.approx(1.2 / 65533, rel=0.01)
    assert facts["error"] is not None and facts["disparity_error"] is not None
    with pytest.raises(InvalidValueError, match=r"depth has shape \(4, 4\)"):
        field.viewer(depth=depth_of(np.zeros((4, 4))))
    with pytest.raises(InvalidValueError, match="holds any light"):
        field_of(np.full((3, 3, 4, 4, 3), np.nan)).viewer()


def test_many_views_are_thinned_out_and_large_ones_reduced(monkeypatch):
    from plenoptic.viewer import light_field

    monkeypatch.setattr(light_field, "_MOST_VIEWS", 9)
    monkeypatch.setattr(light_field, "_MOST_PIXELS", 9 * 40 * 56 / 3)
    field = field_of(np.random.default_rng(1).uniform(0.2, 1, (5, 5, 40, 56, 3)))
    facts, data = facts_of(field.viewer(depth=depth_of(np.full((40, 56), 0.5))))
    assert facts["u"] == [-2, 0, 2] and facts["middle"] == [1, 1] and (facts["rows"], facts["columns"]) == (20, 28)
    # Half as many pixels: disparities are half as large, and so is the range of focus.
    assert facts["disparity"]["low"] == pytest.approx(0.25) and facts["focus"]["high"] == pytest.approx(0.3)
    mean = field.views[0, 0].reshape(20, 2, 28, 2, 3).mean(axis=(1, 3))
    found = facts["top"] * srgb_to_linear(decoded(facts, data, 0)[..., :3] / 255)
    assert np.abs(found - mean).max() < 0.51 / 255 * 2.28 * facts["top"]


def test_images_of_all_shapes_and_values_have_pages():
    for shape in ((1, 1, 1), (4, 4, 3), (3, 50, 1)):
        for value in (0.0, 1e-20, 3.0, 1e12, -2.0):
            facts, _ = facts_of(pl.Exposure(np.full(shape, value)).viewer())
            assert facts["planes"] == {} and facts["lenses"] is None and facts["sight"] is None
            assert len(facts["image"]) == shape[2]
    image = np.random.default_rng(1).normal(size=(5, 6, 3))
    image[0, 0], image[1, 1, 0] = np.nan, np.inf
    facts, _ = facts_of(pl.Exposure(image, standard_error=np.full((5, 6, 3), np.inf)).viewer())
    assert facts["white"] > 0 and "error" in facts["planes"]


def test_a_region_is_cut_and_must_lie_in_the_image():
    shot = pl.Exposure(np.ones((8, 9, 1)), region=(10, 18, 20, 29))
    facts, _ = facts_of(shot.viewer(region=np.s_[12:15, 21:27]))
    assert (facts["rows"], facts["columns"], facts["first"]) == (3, 6, [12, 21])
    for wrong in (np.s_[0:3, 0:3], np.s_[12:12, 21:27], (1, 2), 5):
        with pytest.raises(InvalidValueError, match="region"):
            shot.viewer(region=wrong)


def test_large_images_become_smaller_copies():
    # No texture has such a side.
    wide = np.ones((2, 20_000, 1))
    facts, _ = facts_of(pl.Exposure(wide, standard_error=wide).viewer())
    assert (facts["rows"], facts["columns"], facts["block"]) == (1, 6666, 3)
    # More than a megapixel.
    rng = np.random.default_rng(7)
    image = rng.uniform(0.5, 1, (1100, 1100, 1)).astype(np.float32)
    truth = pl.GroundTruth(depth=rng.uniform(300, 500, (1100, 1100)))
    facts, _ = facts_of(pl.Exposure(image, standard_error=0.1 * image, truth=truth).viewer())
    assert (facts["block"], facts["rows"], facts["columns"]) == (2, 550, 550)


@pytest.fixture(scope="module")
def camera():
    return camera_of(90, 120)


def test_cells_of_the_lattice_fit_the_centres_and_what_is_left_out_is_said(camera, monkeypatch):
    shot = pl.Exposure(np.ones((90, 120, 1)), camera=camera, truth=pl.GroundTruth(depth=np.full((90, 120), 404.0)))
    facts, _ = facts_of(shot.viewer())
    assert facts["left_out"] == [] and facts["sight"] is not None
    corners, centres = np.array(facts["lenses"]["cell"]), pl.microlens_centres(camera).pixel
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    # In a hexagon the corners lie 1 / sqrt(3) of the distance between neighbours away; images differ by aberrations.
    expected = np.min(apart[apart > 0]) / np.sqrt(3)
    assert len(corners) == 6 and np.linalg.norm(corners, axis=1) == pytest.approx(expected, rel=1e-3)
    monkeypatch.setattr("plenoptic.viewer.sight.ENOUGH", 0.0)
    facts, _ = facts_of(shot.viewer())
    assert facts["sight"] is None and facts["lenses"] is not None and "Images of a point" in facts["left_out"][0]
    monkeypatch.setattr("plenoptic.viewer.raw._MOST_LENSES", 5)
    facts, _ = facts_of(shot.viewer())
    assert facts["lenses"] is None and "microlenses are more" in facts["left_out"][0]


def test_cameras_without_a_lattice_have_no_cells(camera):
    bare = dataclasses.replace(camera, microlenses=None, microlenses_to_sensor=0.0)
    facts, _ = facts_of(pl.Exposure(np.ones((90, 120, 1)), camera=bare).viewer())
    assert facts["lenses"] is None
    assert sight(bare, pl.microlens_centres(camera), np.array([404.0])) is None
    assert sight(camera, pl.microlens_centres(camera), np.empty(0)) is None
    places = np.random.default_rng(3).uniform(-0.5, 0.5, (12, 2))
    free = camera_of(80, 80, focal_lengths=(2.0,), lattice=pl.Lattice.FREE, centres=places)
    facts, _ = facts_of(pl.Exposure(np.ones((80, 80, 1)), camera=free).viewer())
    assert facts["lenses"]["cell"] is None and facts["lenses"]["free"] and facts["lenses"]["count"] > 3


def test_division_by_the_white_image_takes_the_lattice_away(camera):
    white = pl.Exposure(np.full((90, 120, 1), 0.25), standard_error=np.full((90, 120, 1), 0.0025), camera=camera)
    shot = pl.Exposure(np.full((90, 120, 3), 0.5), standard_error=np.full((90, 120, 3), 0.01), camera=camera)
    facts, _ = facts_of(shot.viewer(white=white))
    assert facts["white"] == pytest.approx(2.0) and facts["unit"] == "radiance"
    # 1 / 50 and 1 / 100 in quadrature, of 2.
    error = facts["planes"]["error"]
    assert error["unit"] * np.sinh(error["low"]) == pytest.approx(2 * np.hypot(0.02, 0.01), rel=1e-4)


POINTS = np.array([[0.0, 0.0, -404.0], [3.0, -2.0, -380.0], [-4.0, 3.0, -450.0], [2.0, 4.0, -404.0]])


def test_points_are_seen_where_project_sees_them():
    """By chief rays as a polynomial."""
    plain = camera_of(300, 300, focal_lengths=(2.0,))
    pinholes = dataclasses.replace(plain.microlenses, model=pl.optics.MicrolensModel.PINHOLE)
    for name, camera in (
        ("as designed", plain),
        ("tilted sensor", plain.moved(pl.CameraPart.SENSOR, tilt=(0.01, 0.02, 0.1))),
        ("displaced lens", plain.moved(pl.CameraPart.LENS, shift=(0.3, 0.0, 0.1), tilt=(0.01, 0.0, 0.0))),
        ("Keplerian", dataclasses.replace(plain, microlenses_to_sensor=2.3)),
        ("pinholes", dataclasses.replace(plain, microlenses=pinholes)),
    ):
        found = sight(camera, pl.microlens_centres(camera), np.array([380.0, 404.0, 450.0]))
        assert found is not None and found.error < 0.02, name
        seen = pl.project(camera, POINTS)
        seen = seen.selected(seen.passes)
        centres = pl.microlens_centres(camera, margin=1.0)
        place = {tuple(index): k for k, index in enumerate(centres.index.tolist())}
        rows = [k for k, index in enumerate(seen.index.tolist()) if tuple(index) in place]
        on_array = centres.on_array[[place[tuple(seen.index[k])] for k in rows]]
        # A step of Newton's from where they are leads nowhere else.
        off = found.beside(POINTS[seen.point[rows]], seen.pixel[rows], on_array)
        assert len(rows) > 60 and np.abs(off).max() < 0.1, name

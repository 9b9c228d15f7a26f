"""The page of a light field in a browser: its pixels, what it says, and what hands and keys do."""

import io

import numpy as np
import pytest
from looking import facts_of, field_of, moved, painted, photographed, point_of, readout, touching, views_of

from plenoptic.core.color.srgb import linear_to_srgb, srgb_to_linear
from plenoptic.lightfield.depth_map import DepthMap

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def viewer():
    return views_of().viewer()


def stored(viewer):
    """(U, V, rows, columns, 4): views as they are kept, in linear light, times their opacity."""
    from PIL import Image

    facts, data = facts_of(viewer)
    codes = np.stack(
        [np.asarray(Image.open(io.BytesIO(data[a : a + n])).convert("RGBA"), float) / 255 for a, n in facts["views"]]
    )
    opaque = codes[..., 3:]
    views = np.concatenate([srgb_to_linear(codes[..., :3]) * opaque, opaque], axis=-1)
    return facts, views.reshape(len(facts["u"]), len(facts["v"]), *views.shape[1:])


def shifted(view, down, right):
    """What a view shows beside each pixel, by bilinear interpolation; 0 outside."""
    rows, columns, _ = view.shape
    row, column = np.floor(down), np.floor(right)
    total = np.zeros_like(view)
    for i, share_i in ((row, 1 - (down - row)), (row + 1, down - row)):
        for j, share_j in ((column, 1 - (right - column)), (column + 1, right - column)):
            y, x = np.arange(rows) + int(i), np.arange(columns) + int(j)
            inside = ((y >= 0) & (y < rows))[:, None] & ((x >= 0) & (x < columns))
            picked = view[np.clip(y, 0, rows - 1)][:, np.clip(x, 0, columns - 1)]
            total += share_i * share_j * inside[..., None] * picked
    return total


def expected(viewer, disparity, across, viewpoint):
    """sRGB codes (rows, columns, 3) of the refocused picture, and where there is light."""
    facts, views = stored(viewer)
    total, weight = np.zeros(views.shape[2:]), 0.0
    for i, u in enumerate(facts["u"]):
        for j, v in enumerate(facts["v"]):
            place = np.array([i - facts["middle"][0], j - facts["middle"][1]]) - viewpoint
            share = np.clip(across / 2 + 0.5 - np.hypot(*place), 0, 1)
            if share > 0:
                total += share * shifted(views[i, j], -disparity * (v - viewpoint[1]), -disparity * (u - viewpoint[0]))
                weight += share
    total /= weight
    lit = total[..., 3] > 0.01
    linear = facts["top"] / facts["white"] * total[..., :3] / np.where(lit, total[..., 3], 1)[..., None]
    return 255 * linear_to_srgb(np.clip(linear, 0, 1)), lit


def test_refocused_pixels_are_shifted_and_added_in_linear_light(opened, viewer):
    with opened(viewer) as page:
        for disparity, across, viewpoint in (
            (0.0, 5.0, (0.0, 0.0)),
            (0.7, 5.0, (0.0, 0.0)),
            (-1.37, 6.6, (0.0, 0.0)),
            (0.7, 1.0, (2.0, -1.0)),
            (0.31, 1.0, (-0.4, 0.7)),
            (-0.6, 2.7, (-2.0, -2.0)),
            (1.9, 3.2, (1.3, 0.2)),
        ):
            for slider, value in zip(
                ("focus", "aperture", "view-u", "view-v"), (disparity, across, *viewpoint), strict=True
            ):
                moved(page, slider, value)
            found = photographed(page, 40, 56)
            # What sliders hold after their own rounding.
            across = page.evaluate("document.getElementById('aperture').valueAsNumber")
            codes, lit = expected(viewer, disparity, across, np.array(viewpoint))
            assert lit.mean() > 0.9
            largest = np.abs(found - codes)[lit].max()
            print(f"\nlargest difference {largest:.2f} of 255")
            # 2 is asked for; half a code is rounding.
            assert largest < 2.0, (disparity, across, viewpoint)
        # One view is what is stored.
        page.click("label[for=shown-single]")
        moved(page, "view-u", 1)
        moved(page, "view-v", -2)
        codes, lit = expected(viewer, 0.0, 1.0, np.array([1.0, -2.0]))
        assert np.abs(photographed(page, 40, 56) - codes)[lit].max() < 1.0


def depth_map(disparity, error):
    nowhere = np.full(disparity.shape, np.nan)
    return DepthMap(disparity, error, np.ones(disparity.shape), nowhere, nowhere)


def test_a_click_focuses_on_what_is_there_and_the_text_is_the_arrays(opened):
    field = views_of()
    disparity = np.where(np.arange(56) < 28, 0.4, -0.9) * np.ones((40, 1))
    disparity[30:] = np.nan
    error = np.full((40, 56), 0.02)
    with opened(field.viewer(depth=depth_map(disparity, error)), reduced_motion="reduce") as page:
        # What the scene has in its middle is in focus at first: more of it is known on the left.
        begins = page.evaluate("document.getElementById('focus').valueAsNumber")
        assert min(abs(begins - 0.4), abs(begins + 0.9)) < 1e-3
        for row, column in ((5, 10), (20, 40), (12, 27)):
            page.mouse.click(*point_of(page, row, column, 40, 56))
            painted(page)
            chosen = page.evaluate("document.getElementById('focus').valueAsNumber")
            assert chosen == pytest.approx(disparity[row, column], abs=1e-4)
            said = readout(page)
            assert said["Row, column"] == f"{row}, {column}"
            distance = float(said["Depth"].split(" ± ")[0])
            assert field.disparity_at(-distance)[0] == pytest.approx(disparity[row, column], rel=0.02)
            value, spread, unit = said["Disparity"].replace(" ± ", " ").split()
            assert float(value) == pytest.approx(disparity[row, column], abs=5e-3)
            assert float(spread) == pytest.approx(0.02, rel=0.06) and unit == "px"
        page.mouse.move(*point_of(page, 35, 10, 40, 56))
        assert readout(page)["Depth"] == "–"


def test_without_depth_a_click_matches_the_views(opened):
    rng = np.random.default_rng(2)
    texture = rng.uniform(0.1, 1, (60, 80, 3))
    # Nearest pixels of whole disparities: 1 on the left, -1 on the right.
    views = np.empty((5, 5, 40, 56, 3))
    for i in range(5):
        for j in range(5):
            left, right = (
                texture[10 + s * (j - 2) : 50 + s * (j - 2), 12 + s * (i - 2) : 68 + s * (i - 2)] for s in (1, -1)
            )
            views[i, j] = np.where(np.arange(56)[None, :, None] < 28, left, right)
    with opened(field_of(views).viewer(), reduced_motion="reduce") as page:
        box = page.locator("#stage").bounding_box()
        for share, disparity in ((0.3, 1.0), (0.7, -1.0)):
            page.mouse.click(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
            for _ in range(100):  # the card answers when it is done
                page.wait_for_timeout(50)
                chosen = page.evaluate("document.getElementById('focus').valueAsNumber")
                if abs(chosen - disparity) < 0.03:
                    break
            assert chosen == pytest.approx(disparity, abs=0.03)


def test_keys_and_drags_move_viewpoint_aperture_and_focus(opened, viewer):
    with opened(viewer) as page:

        def value(slider):
            return page.evaluate(f"document.getElementById('{slider}').valueAsNumber")

        begins = value("focus")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowUp")
        assert (value("view-u"), value("view-v")) == (0.25, -0.25)
        page.keyboard.press("]")
        assert value("aperture") == 5.5
        page.keyboard.press(",")
        assert value("focus") > begins
        page.keyboard.press("e")
        assert value("exposure") == 0.25
        page.keyboard.press("Home")
        assert [value(name) for name in ("view-u", "view-v", "aperture", "focus", "exposure")] == [0, 0, 5, begins, 0]
        box = page.locator("#stage").bounding_box()
        page.mouse.move(box["x"] + 300, box["y"] + 300)
        page.mouse.down()
        page.mouse.move(box["x"] + 400, box["y"] + 260, steps=5)
        page.mouse.up()
        assert value("view-u") > 0.3 and value("view-v") < -0.1
        for _ in range(4):
            page.keyboard.press("d")
        painted(page)
        assert page.evaluate("document.querySelector('input[name=shown]:checked').value") == "picture"
        # A control that has the focus takes its own keys.
        page.focus("#exposure")
        before = value("view-u")
        page.keyboard.press("ArrowRight")
        assert value("view-u") == before


def test_the_sheet_opens_the_view_that_is_clicked(opened, viewer):
    with opened(viewer) as page:
        page.click("label[for=shown-sheet]")
        painted(page)
        page.mouse.click(*point_of(page, 1.5 * 42 - 0.5, 4.5 * 58 - 0.5, 5 * 42 - 2, 5 * 58 - 2))
        shown = page.evaluate(
            "[document.querySelector('input[name=shown]:checked').value,"
            " ...['view-u', 'view-v'].map((id) => document.getElementById(id).valueAsNumber)]"
        )
        assert shown == ["single", 2, -1]


def test_the_slice_is_of_the_row_that_is_clicked(opened, viewer):
    with opened(viewer) as page:
        page.click("label[for=shown-slice]")
        painted(page)
        box = page.locator("#stage").bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20)
        painted(page)
        row = page.evaluate("document.getElementById('row').valueAsNumber")
        assert 0 <= row < 10


def test_light_fields_of_all_shapes_are_shown(opened):
    for shape in ((1, 1, 12, 9, 3), (3, 1, 10, 31, 1), (1, 4, 9, 12, 3)):
        with opened(views_of(*shape).viewer()) as page:
            for radio in page.locator(".choice label").all():
                radio.click()
                painted(page)
            assert page.locator(".apology").count() == 0, shape


def test_touch_moves_and_pinches_on_a_phone(opened, viewer):
    with opened(viewer, 360, 740, has_touch=True, is_mobile=True, device_scale_factor=2) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        box = page.locator("#stage").bounding_box()
        touch = touching(page)
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        touch("touchStart", (x, y))
        for k in range(1, 6):
            touch("touchMove", (x + 12 * k, y))
        touch("touchEnd")
        assert page.evaluate("document.getElementById('view-u').valueAsNumber") > 0.3
        before = page.evaluate("document.getElementById('view-u').valueAsNumber")
        touch("touchStart", (x - 20, y), (x + 20, y))
        for k in range(1, 6):
            touch("touchMove", (x - 20 - 8 * k, y), (x + 20 + 8 * k, y))
        touch("touchEnd")
        painted(page)
        assert page.evaluate("document.getElementById('view-u').valueAsNumber") == before
        frames = page.evaluate("document.getElementById('stage').dataset.frames")
        assert int(frames) > 4


def test_without_webgl_a_sentence_and_the_central_view_stay(chromium, viewer, tmp_path):
    viewer.save(tmp_path / "page.html")
    browser = chromium("--disable-3d-apis")
    page = browser.new_page()
    page.goto((tmp_path / "page.html").as_uri())
    page.wait_for_selector(".apology")
    assert "no WebGL2" in page.inner_text(".apology")
    assert page.evaluate("document.getElementById('still').naturalWidth") == 56
    browser.close()


def test_the_ring_of_a_slider_with_focus_leaves_its_label_alone(opened, viewer):
    ring = """slider => {
        const style = getComputedStyle(slider), label = slider.parentElement.querySelector("label")
        const reach = parseFloat(style.outlineWidth) + parseFloat(style.outlineOffset)
        return [style.outlineStyle, slider.getBoundingClientRect().top - reach - label.getBoundingClientRect().bottom]
    }"""
    with opened(viewer) as page:
        page.focus("#aperture")
        page.keyboard.press("ArrowRight")
        style, room = page.eval_on_selector("#aperture", ring)
    assert style == "solid" and room >= 0


def test_notebooks_show_the_page_in_a_frame(browser, viewer):
    page = browser.new_page()
    said = []
    page.on("console", lambda message: said.append(message.text))
    page.set_content(viewer._repr_html_())
    page.frame_locator("iframe").locator("#stage[data-ready]").wait_for(state="attached", timeout=60_000)
    assert said == []
    page.close()

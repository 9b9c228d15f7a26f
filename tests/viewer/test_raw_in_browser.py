"""The page of a raw image in a browser: its pixels, what it says of each, and images of the points that they show."""

import json

import numpy as np
import pytest
from looking import camera_of, facts_of, moved, painted, photographed, point_of, readout, touching

import plenoptic as pl
from plenoptic.core.color.srgb import linear_to_srgb

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def shot():
    return pl.render(pl.still_life(), camera_of(220, 260), samples=16, truth=pl.Truth.ALL, progress=False)


@pytest.fixture(scope="module")
def viewer(shot):
    return shot.viewer()


def pixels(shot, count, seed):
    rng = np.random.default_rng(seed)
    seen = np.argwhere(np.isfinite(shot.depth) & (shot.truth.microlens_type >= 0))
    return seen[rng.choice(len(seen), count, replace=False)].tolist()


def test_the_text_is_the_arrays(opened, shot, viewer):
    with opened(viewer) as page:
        for row, column in [*pixels(shot, 12, 1), [0, 0], [219, 259]]:
            page.mouse.move(*point_of(page, row, column))
            said, truth = readout(page), shot.truth
            assert said["Pixel (row, column)"] == f"{row}, {column}"
            i, j = truth.microlens[row, column]
            if truth.microlens_type[row, column] >= 0:
                kind = truth.microlens_type[row, column]
                assert said["Microlens"] == f"({i}, {j})"
                assert said["Type"].startswith(f"{kind}, f = {(1.9, 2.0, 2.1)[kind]:.3f} mm")
            else:
                assert said["Microlens"] == "none"
            # Written with 5 digits, in steps of 1 / 65533 of the range of reciprocals.
            depth = truth.depth[row, column]
            if np.isfinite(depth):
                assert float(said["Depth"].split()[0]) == pytest.approx(depth, rel=1e-4)
            for name, array, digits in (("Virtual depth", truth.virtual_depth, 4), ("Disparity", truth.disparity, 4)):
                if np.isfinite(array[row, column]):
                    found = float(said[name].split()[0])
                    assert found == pytest.approx(array[row, column], rel=10 ** (1 - digits))
            error = np.sqrt(np.mean(np.square(shot.standard_error[row, column], dtype=float)))
            assert float(said["Standard error"]) == pytest.approx(error, rel=0.06)
            values = [float(value) for value in said["Value R, G, B"].split(", ")]
            # Digits are as many as the error leaves, two at least.
            np.testing.assert_allclose(values, shot.image[row, column], atol=error, rtol=0.051)


def test_images_of_a_point_light_up_where_project_sees_it(opened, shot, viewer):
    scene, camera = pl.still_life(), shot.camera
    tried = pixels(shot, 12, 2)
    points = np.array([shot.truth.position[row, column] for row, column in tried])
    seen = pl.project(camera, points, scene=scene)
    centres = {tuple(index) for index in pl.microlens_centres(camera).index.tolist()}
    wanted = met = false = 0
    with opened(viewer) as page:
        for number, (row, column) in enumerate(tried):
            page.mouse.click(*point_of(page, row, column))
            lit = json.loads(page.evaluate("document.getElementById('stage').dataset.images"))
            found = {(int(each["i"]), int(each["j"])): each for each in lit}
            assert tuple(shot.truth.microlens[row, column]) in found
            rows = seen.selected(seen.point == number)
            visible = {tuple(index) for index in rows.index[rows.visible].tolist()}
            places = dict(zip(map(tuple, rows.index.tolist()), rows.pixel, strict=True))
            for index, each in found.items():
                if not each["hidden"] and index in places:
                    assert np.hypot(each["row"] - places[index][0], each["column"] - places[index][1]) < 0.5
            shown = {index for index, each in found.items() if not each["hidden"]}
            inside = [
                tuple(index)
                for index, pixel, visible in zip(rows.index.tolist(), rows.pixel, rows.visible, strict=True)
                if visible and (np.abs(pixel - (109.5, 129.5)) < (109, 129)).all() and tuple(index) in centres
            ]
            wanted += len(inside)
            met += len(shown & set(inside))
            false += len(shown - visible)
    print(f"\n{met} of {wanted} images light up, and {false} others")
    assert wanted > 100 and met >= 0.9 * wanted and false <= 0.1 * wanted


def test_pixels_on_the_screen_are_those_of_the_image(opened, shot, viewer):
    with opened(viewer) as page:
        moved(page, "exposure", 0.5)
        found = photographed(page, 220, 260)
        facts, _ = facts_of(viewer)
        codes = 255 * linear_to_srgb(np.clip(2**0.5 * shot.image / facts["white"], 0, 1))
        # Half a code, and values that are kept to a part of 2.5e-4: up to 0.03 codes.
        assert np.abs(found - codes).max() < 0.75


def test_keys_walk_zoom_and_choose(opened, viewer):
    with opened(viewer) as page:
        page.mouse.click(*point_of(page, 100, 100))
        page.mouse.move(5, 5)
        for key in ("ArrowRight", "ArrowRight", "ArrowDown", "Shift+ArrowUp"):
            page.keyboard.press(key)
        assert readout(page)["Pixel (row, column)"] == "91, 102"
        for key in ("+", "+", "-", "l", "c", "e", "E"):
            page.keyboard.press(key)
        painted(page)
        assert page.is_checked("#cells") and page.is_checked("#centres")
        for _ in range(5):
            page.keyboard.press("d")
            painted(page)
        page.keyboard.press("0")
        page.keyboard.press("Escape")
        assert "Pixel (row, column)" not in readout(page)


def test_the_wheel_zooms_to_single_pixels_around_the_cursor(opened, viewer):
    with opened(viewer) as page:
        place = point_of(page, 60, 200)
        page.mouse.move(*place)
        before = readout(page)["Pixel (row, column)"]
        for _ in range(30):
            page.mouse.wheel(0, -300)
        painted(page)
        page.mouse.move(place[0] + 1, place[1])
        assert readout(page)["Pixel (row, column)"] == before
        page.mouse.move(place[0] + 96, place[1])
        assert readout(page)["Pixel (row, column)"] == "60, 201"


def test_taps_and_pinches_on_a_phone(opened, viewer):
    with opened(viewer, 360, 740, has_touch=True, is_mobile=True, device_scale_factor=3) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        page.touchscreen.tap(*point_of(page, 110, 130))
        row, column = (int(part) for part in readout(page)["Pixel (row, column)"].split(", "))
        assert abs(row - 110) <= 1 and abs(column - 130) <= 1
        touch, (x, y) = touching(page), point_of(page, 110, 130)
        touch("touchStart", (x - 10, y), (x + 10, y))
        for k in range(1, 11):
            touch("touchMove", (x - 10 - 8 * k, y), (x + 10 + 8 * k, y))
        touch("touchEnd")
        painted(page)
        # Nine times larger: what was 45 CSS pixels beside the middle of the pinch is now 5.
        page.touchscreen.tap(x + 45, y)
        _, beside = (int(part) for part in readout(page)["Pixel (row, column)"].split(", "))
        assert 0 < beside - 130 < 12


def test_small_black_and_empty_images_are_shown(opened):
    for rows, columns, channels in ((4, 4, 1), (1, 1, 3), (3, 40, 1)):
        for value in (0.0, np.nan, 1e9):
            image = np.full((rows, columns, channels), value)
            with opened(pl.Exposure(image, standard_error=0 * np.nan_to_num(image)).viewer()) as page:
                page.mouse.move(*point_of(page, 0, 0, rows, columns))
                said = readout(page)["Value" if channels == 1 else "Value R, G, B"].split(", ")[0]
                assert said == "–" if np.isnan(value) else float(said) == pytest.approx(value, rel=1e-3)


def test_a_region_of_a_white_image_counts_from_the_sensor(opened, shot):
    white = pl.render_white(shot.camera, samples=4, region=np.s_[40:100, 50:130], progress=False)
    with opened(white.viewer(region=np.s_[50:90, 60:120])) as page:
        page.mouse.move(*point_of(page, 5, 7, 40, 60))
        said = readout(page)
        assert said["Pixel (row, column)"] == "55, 67"
        # Without ground truth, the nearest centre names the microlens.
        centres = pl.microlens_centres(shot.camera)
        nearest = np.linalg.norm(centres.pixel - (55, 67), axis=1).argmin()
        assert said["Microlens"] == "({}, {}), by its centre".format(*centres.index[nearest])
        assert "Depth" not in said

"""Raw images for programs that look for microlenses: rows as they count them, pictures turned as they need."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from raws import LENS, camera, focused, nearest, plain_shots

import plenoptic as pl
from plenoptic.errors import InvalidValueError
from plenoptic.export.lattice import lens_rows

HEXAGONAL, SQUARE, RECTANGULAR = pl.Lattice.HEXAGONAL, pl.Lattice.SQUARE, pl.Lattice.RECTANGULAR


def test_damaged_grids_are_refused_with_a_reason(tmp_path):
    pl.export.plenoptic_toolbox(tmp_path, blank(camera()))
    good = (tmp_path / "shot.xml").read_text()
    for old, new, reason in (
        ("</RayCalibData>", "", "holds no lattice"),
        ('<rotation units="rad">', '<rotation units="rad">x', "could not convert"),
        ("diameter", "width", "no diameter"),
        ('id="2"', 'id="1"', "lens types \\[0, 1, 1\\]"),
        ('<?xml version="1.0" encoding="UTF-8"?>', "<!DOCTYPE x>", "document type"),
    ):
        (tmp_path / "bad.xml").write_text(good.replace(old, new))
        with pytest.raises(pl.errors.FileError, match=reason):
            pl.calibration.read_grid(tmp_path / "bad.xml", (150, 150))


def blank(taken_by, region=None):
    rows, columns = taken_by.sensor.shape if region is None else (region[1] - region[0], region[3] - region[2])
    return pl.Exposure(np.zeros((rows, columns, 1)), camera=taken_by, region=region)


def test_rows_run_along_rows():
    angles = (-170, -91, -60, -31, -3, 0, 2, 29, 44, 88, 121, 179)
    for case in (
        *((HEXAGONAL, degrees, True) for degrees in angles),
        *((HEXAGONAL, degrees, False) for degrees in angles[::3]),
        *((lattice, angles[k], k % 2 == 0) for lattice in (SQUARE, RECTANGULAR) for k in range(0, 12, 3)),
    ):
        lattice, degrees, turn = case
        pitch = (0.147, 0.12) if lattice is RECTANGULAR else 0.147
        found = lens_rows(blank(camera(lattice, turned=np.radians(degrees), pitch=pitch)), turn=turn)
        # Neighbours in a row lie a pitch apart along the row; rows as far apart as the lattice has them.
        order = np.lexsort((found.place, found.row))
        same = np.diff(found.row[order]) == 0
        step = np.diff(found.centre[order], axis=0)[same] / np.diff(found.place[order])[same, None]
        np.testing.assert_allclose(np.hypot(*step.T), found.pitch[0], rtol=2e-3, err_msg=str(case))
        assert (step[:, 1] > 0).all() or abs(found.angle) > 0.6, case
        if lattice is HEXAGONAL:
            assert found.pitch[1] == pytest.approx(found.pitch[0] * np.sqrt(0.75), rel=2e-3), case
            assert abs(found.angle) <= np.radians(15.1 if turn else 30.1), case
        elif lattice is SQUARE:
            assert found.pitch[1] == pytest.approx(found.pitch[0], rel=2e-3), case
            assert abs(found.angle) <= np.radians(45.1), case
        assert found.shifted.any() == (lattice is HEXAGONAL), case
        # The place of a lens follows from its row and number: what other programs assume.
        down = np.array([np.cos(found.angle), np.sin(found.angle)])
        across = np.array([-np.sin(found.angle), np.cos(found.angle)])
        along = (found.place + 0.5 * found.shifted) * found.pitch[0]
        rest = found.centre - np.outer(found.row * found.pitch[1], down) - np.outer(along, across)
        assert np.abs(rest - rest.mean(axis=0)).max() < 0.1, case


def test_a_turned_centre_is_where_the_turned_image_shows_it():
    shot, white = plain_shots(HEXAGONAL)
    found = lens_rows(shot, turn=True)
    assert found.turns == 1  # as rendered, neighbours lie along columns
    picture = found.turn_image(white.image)[:, :, 0]
    half = int(found.pitch[0] / 2)
    rows, columns = np.mgrid[-half : half + 1, -half : half + 1]
    inside = rows**2 + columns**2 <= half**2
    whole = found.whole(shot.image.shape[:2])
    for centre in whole.centre[:: len(whole.centre) // 10]:
        r, c = np.rint(centre).astype(int)
        patch = picture[r + rows, c + columns] * inside
        light = np.array([(patch * (r + rows)).sum(), (patch * (c + columns)).sum()]) / patch.sum()
        assert np.abs(light - centre).max() < 0.45  # the window lies off by up to half a pixel


def test_a_region_has_the_lenses_that_the_whole_has_there():
    taken_by = camera()
    whole, part = lens_rows(blank(taken_by), turn=False), lens_rows(blank(taken_by, (30, 120, 30, 130)), turn=False)
    assert nearest(part.centre + np.array([30, 30]), whole.centre).max() == 0


def test_rectangles_have_no_gaps():
    for degrees in (0, 3, 12):
        lens = lens_rows(blank(camera(turned=np.radians(degrees))), turn=True)
        found = lens.rectangle()
        rows, places = found.row.max() + 1, found.place.max() + 1
        assert len(found.row) == rows * places > 0.4 * len(lens.row)
        np.testing.assert_array_equal(found.row * places + found.place, np.arange(rows * places))


def test_plenopticam_gets_what_it_reads(tmp_path):
    for lattice in (HEXAGONAL, SQUARE):
        turned, folder = lattice is HEXAGONAL, tmp_path / lattice.name
        shot, white = plain_shots(lattice)
        pl.export.plenopticam(folder, shot, white, name="flat-1")
        listed = json.loads((folder / "flat-1_centres.json").read_text())
        assert listed["pat_type"] == ("hex" if turned else "rec")
        table = np.array(listed["mic_list"])
        assert len(table) == (table[:, 2].max() + 1) * (table[:, 3].max() + 1)
        known = pl.microlens_centres(shot.camera, pl.CentreMethod.CENTROID).pixel
        # Back from the turned image: (row, column) was (column, columns - 1 - row).
        back = np.column_stack([table[:, 1], shot.image.shape[1] - 1 - table[:, 0]]) if turned else table[:, :2]
        assert nearest(back, known).max() < 1e-9
        raw = pl.images.read_linear(folder / "flat-1.tiff")[:, :, 0]
        expected = np.rot90(shot.image[:, :, 0], int(turned)) / shot.image.max()
        np.testing.assert_allclose(raw, expected, atol=2 / 65535)
        lit = pl.images.read_channels(folder / "flat-1_white.tiff")[0]["R"]
        np.testing.assert_allclose(lit, np.rot90(white.image[:, :, 0], int(turned)) / white.image.max(), atol=1 / 65535)


def test_the_toolbox_gets_what_it_reads(tmp_path):
    for focal_lengths, degrees in (((1.7, 2.0, 2.4), 0), ((2.0,), 17), ((1.7, 2.0, 2.4), 100)):
        turn = (0.0, 0.0, np.radians(degrees))
        taken_by = focused(focal_lengths=focal_lengths)
        taken_by = taken_by.moved(pl.CameraPart.MICROLENSES, shift=(0.05, 0.02, 0.0), tilt=turn)
        shot = pl.render(pl.check_scene(), taken_by, samples=2, truth=pl.Truth.DISPARITY, progress=False)
        folder = tmp_path / str(degrees)
        pl.export.plenoptic_toolbox(folder, shot)
        root = ET.parse(folder / "shot.xml").getroot()
        number = {key: float(root.find(key).text) for key in ("diameter", "rotation")}
        offset = complex(*(float(root.find(f"offset/{axis}").text) for axis in "xy"))
        base = [complex(*(float(root.find(f"lens_base_{k}/{axis}").text) for axis in "xy")) for k in "xy"]
        rows, columns = shot.image.shape[:2]
        centres = pl.microlens_centres(taken_by)
        measured = (centres.pixel[:, 1] - (columns - 1) / 2) + 1j * ((rows - 1) / 2 - centres.pixel[:, 0])
        # Axial coordinates of each lens, then its place and its type as the format has them.
        scaled = (measured - offset) / (number["diameter"] * np.exp(1j * number["rotation"]))
        second = scaled.imag / base[1].imag
        axial = np.rint(np.column_stack([scaled.real - second * base[1].real, second])).astype(int)
        place = offset + number["diameter"] * np.exp(1j * number["rotation"]) * (axial @ np.array(base))
        assert np.sqrt(np.mean(np.abs(place - measured) ** 2)) < 0.005, degrees
        kind = ((-axial[:, 0]) % 3 + axial[:, 1]) % 3
        assert [len(np.unique(centres.type[kind == k])) for k in range(3)] == [1, 1, 1]
        assert len(root.findall("lens_type")) == 3
        grid = pl.calibration.read_grid(folder / "shot.xml", shot.image.shape[:2])
        index = grid.indices_of(centres.pixel)
        assert np.sqrt(np.mean((grid.centres_of(index) - centres.pixel) ** 2)) < 0.005, degrees
        pairs = {*zip(grid.types_of(index).tolist(), centres.type.tolist(), strict=True)}
        assert len(pairs) == len({kind for _, kind in pairs}) == len(focal_lengths)
        drawn = pl.images.read_channels(folder / "shot_disp.png")[0]["R"] * number["diameter"]
        known = np.abs(shot.truth.disparity)
        seen = np.isfinite(known) & (known < number["diameter"])
        np.testing.assert_allclose(drawn[seen], known[seen], atol=number["diameter"] / 65535)


def test_what_has_no_rows_and_what_programs_do_not_know_is_refused(tmp_path):
    shot, toolbox = blank(camera()), pl.export.plenoptic_toolbox
    bare, two = pl.PlenopticCamera(LENS, pl.Sensor((16, 16), 0.01), 130.0), [[0.0, 0.0], [0.3, 0.0]]
    for call, said in (
        (lambda: lens_rows(blank(bare), turn=True), "has no microlenses"),
        (lambda: lens_rows(pl.Exposure(np.ones((2, 2, 1))), turn=True), "names no camera"),
        (lambda: lens_rows(blank(camera(pl.Lattice.FREE, centres=two)), turn=True), "lie on no lattice"),
        (lambda: lens_rows(blank(camera(), (0, 8, 0, 8)), turn=True), "fewer than three"),
        (lambda: toolbox(tmp_path, blank(camera(SQUARE))), "hexagonal arrays only"),
        (lambda: toolbox(tmp_path, blank(focused(pattern=[[0, 1, 2, 2]]))), "do not repeat"),
        (lambda: pl.export.plenopticam(tmp_path, shot, shot, name="../a"), "name is '../a'"),
        (lambda: pl.export.plenpy(tmp_path, shot, blank(camera(), (0, 90, 0, 180))), "render it for the same region"),
    ):
        with pytest.raises(InvalidValueError, match=said):
            call()

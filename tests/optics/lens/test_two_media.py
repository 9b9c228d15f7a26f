"""Lenses with one medium in front and another behind: Gaussian optics, ideal models, wavefronts and files."""

import dataclasses
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

import plenoptic as pl
from plenoptic import paraxial
from plenoptic.core.files.serialization import from_tree, to_tree
from plenoptic.errors import PrescriptionError
from plenoptic.optics.lens.analysis import best_focus

AIR, WATER, VITREOUS = pl.optics.AIR, pl.ConstantMedium(1.333), pl.ConstantMedium(1.336)
CASE = Path(os.environ["PLENOPTIC_SHARED"]) / "cases" / "files" / "13_water_in_front.zmx"
D = 587.6


def between(name, front, rear):
    """A bundled lens with other media around it."""
    lens = pl.load_lens(name)
    elements = list(lens.elements)
    last = max(i for i, element in enumerate(elements) if isinstance(element, pl.Surface))
    elements[last] = dataclasses.replace(elements[last], medium=rear)
    return dataclasses.replace(lens, elements=elements, front_medium=front, rear_medium=rear, specification=None)


def water_case(folder):
    """The lens of the case file: a lens in air behind a curved port, with water in front."""
    text = (
        "MODE SEQ;UNIT MM;ENPD 2.6;FTYP 0 0 1 1 0 0 0;XFLN 0;YFLN 0;WAVM 1 0.5875618 1;PWAV 1;SURF 0;DISZ INFINITY;"
        "GLAS ___BLANK 1 0 1.333 55;SURF 1;CURV 0.02;DISZ 5;GLAS ___BLANK 1 0 1.52 60;DIAM 20 1 0 0 1;SURF 2;"
        "CURV 0.022;DISZ 30;DIAM 18 1 0 0 1;SURF 3;STOP;DISZ 0.1;DIAM 1.3 1 0 0 1;SURF 4;CURV 0.4385;DISZ 0.7;"
        "GLAS ___BLANK 1 0 1.545 56;DIAM 1.38 1 0 0 1;SURF 5;CURV 0.05;DISZ 3;DIAM 1.38 1 0 0 1;SURF 6"
    )
    path = folder / "water.zmx"
    path.write_text(text.replace(";", "\n"))
    lens = pl.load_lens(path)
    if CASE.exists():
        assert pl.load_lens(CASE).elements == lens.elements
    return lens


MEDIA = ((WATER, AIR), (AIR, VITREOUS), (WATER, VITREOUS))
NAMES = [name for name in pl.lens_names() if not name.startswith(("mirror", "zoom"))][:11]
LENSES = [between(name, *MEDIA[k % 3]) for k, name in enumerate(NAMES)]


def matrix(lens, first, last):
    """(height, angle) behind element `last` from those before `first`: Snell's law and straight lines, as in books."""
    n, total = [float(medium.index(D)) for medium in lens.gap_media], np.eye(2)
    for i in range(first, last + 1):
        element = lens.elements[i]
        if isinstance(element, pl.Surface):
            c = 0.0 if math.isinf(element.radius) else 1.0 / element.radius
            c += 2.0 * (element.aspheric[0] if element.aspheric else 0.0)
            total = np.array([[1, 0], [(n[i] - n[i + 1]) * c / n[i + 1], n[i] / n[i + 1]]]) @ total
        if i < last:
            total = np.array([[1, element.thickness], [0, 1]]) @ total
    return total.tolist()


def test_cardinal_points_follow_from_two_by_two_matrices(tmp_path):
    lenses = [*LENSES, water_case(tmp_path)]
    assert len(lenses) == 12 and len({(lens.front_medium, lens.rear_medium) for lens in lenses}) >= 3
    for lens in lenses:
        points, n, m = paraxial.cardinal_points(lens, D), lens.front_medium.index(D), lens.rear_medium.index(D)
        z, last, iris = lens.vertices, len(lens.elements) - 1, lens.iris_index
        (a, b), (c, d) = matrix(lens, 0, last)
        expected = {
            "efl": -1 / c, "front_efl": -n / m / c, "power": -m * c,
            "rear_focus": z[-1] - a / c, "front_focus": z[0] + d / c,
            # Unit magnification, n / n' over C s + D at the distance s in front, and A + C t at t behind.
            "front_principal": z[0] - (n / m - d) / c, "rear_principal": z[-1] + (1 - a) / c,
            # The same angle on both sides: C s + D = 1; the ray leaves at the height A s + B.
            "front_nodal": z[0] - (1 - d) / c, "rear_nodal": z[-1] - (a * (1 - d) / c + b),
        }  # fmt: skip
        (a, b), _ = matrix(lens, 0, iris)
        expected |= {"entrance_pupil": z[0] + b / a, "entrance_pupil_semi_diameter": lens.stop.semi_diameter / abs(a)}
        (a, b), (c, d) = matrix(lens, iris, last)
        expected |= {"exit_pupil": z[-1] - b / d, "pupil_magnification": a - c * b / d}
        for name, value in expected.items():
            size = max(abs(value), 0.0 if name in ("power", "pupil_magnification") else abs(points.efl))
            assert abs(getattr(points, name) - value) <= 1e-12 * size, (lens.name, name)


def test_conjugates_apertures_and_the_invariant_follow_from_matrices(tmp_path):
    for lens in (*LENSES, water_case(tmp_path)):
        n, m = lens.front_medium.index(D), lens.rear_medium.index(D)
        points, last, z = paraxial.cardinal_points(lens, D), len(lens.elements) - 1, lens.vertices
        z_object = float(z[0]) - 5.0 * abs(points.efl)
        s, ((a, b), (c, d)) = float(z[0]) - z_object, matrix(lens, 0, last)
        t = -(a * s + b) / (c * s + d)
        image, scale = paraxial.image_position(lens, z_object, D), paraxial.magnification(lens, z_object, D)
        assert image == pytest.approx(z[-1] + t, rel=1e-11) and scale == pytest.approx(a + c * t, rel=1e-11)
        assert paraxial.object_position(lens, image, D) == pytest.approx(z_object, rel=1e-10)
        assert paraxial.conjugates(lens, scale, D) == pytest.approx((z_object, image), rel=1e-10)
        marginal, chief = paraxial.marginal_ray(lens, z_object, D), paraxial.chief_ray(lens, 1.0, z_object, D)
        u = lens.stop.semi_diameter / (np.array(matrix(lens, 0, lens.iris_index))[0] @ [s, 1.0])
        before, behind = paraxial.numerical_apertures(lens, z_object, D)
        assert [before, behind] == pytest.approx([abs(n * u), abs(m * (c * s + d) * u)], rel=1e-11)
        assert before == pytest.approx(behind * abs(scale), rel=1e-11)
        height = chief.height[-1] + chief.angle[-1] * t
        invariants = [paraxial.lagrange_invariant(marginal, chief), m * marginal.angle[-1] * height]
        assert invariants == pytest.approx([n * marginal.angle[0]] * 2, rel=1e-9)


def test_ideal_models_map_slopes_and_heights_by_the_matrix():
    rng = np.random.default_rng(4)
    for lens in LENSES[:4]:
        points = paraxial.cardinal_points(lens, D)
        n, m, f = lens.front_medium.index(D), lens.rear_medium.index(D), points.efl
        for model in (pl.LensModel.PARAXIAL, pl.LensModel.THIN):
            ideal = lens.with_model(model)
            front = points.rear_principal if model is pl.LensModel.THIN else points.front_principal
            y, slope = rng.uniform(-1, 1, (40, 2)) * 0.2, rng.uniform(-1, 1, (40, 2)) * 0.02
            rays = pl.RayBundle(np.column_stack([y, np.full(40, front)]), np.column_stack([slope, np.ones(40)]), D)
            out = ideal.trace(rays)
            assert (out.status == 0).mean() > 0.3, lens.name
            passing = out.status == 0
            there = out.direction[:, :2] / out.direction[:, 2:]
            np.testing.assert_allclose(there[passing], (n / m * slope - y / f)[passing], rtol=0, atol=1e-14)
            back = ideal.trace_reverse(pl.RayBundle(out.origin, -out.direction, D).selected(passing))
            np.testing.assert_allclose(back.direction, -rays.direction[passing], rtol=0, atol=1e-14)
            focus = best_focus.front_focus(ideal, D)
            assert abs(best_focus.paraxial_focus(ideal, focus, D)) > 1e10 * abs(f)
            # The image of a point, and equal optical paths to it.
            z_object = points.front_focus - 3.0 * abs(f)
            image = best_focus.paraxial_focus(ideal, z_object, D)
            start = np.array([0.3, -0.2, z_object])
            rim = np.column_stack([y, np.full(40, front)])
            behind, path = pl.aberrations.optical_path(
                ideal, pl.RayBundle(np.tile(start, (40, 1)), rim - start, D), point=start
            )
            lit = behind.status == 0
            spot = behind.at_z(image)[lit]
            np.testing.assert_allclose(spot, np.tile(spot[0], (len(spot), 1)), rtol=0, atol=1e-10 * abs(f))
            beyond = ((spot - behind.origin[lit]) * behind.direction[lit]).sum(axis=1)
            assert np.ptp(path[lit] + m * beyond) < 1e-11 * abs(f), (lens.name, model)
            assert best_focus.working_f_number(ideal, z_object, D) == pytest.approx(
                0.5 / paraxial.numerical_apertures(lens, z_object, D)[1],
                rel=0.2 if model is pl.LensModel.THIN else 1e-12,
            )


def eye(conic):
    """One surface from air to the vitreous."""
    return pl.LensStack([pl.CircularStop(2.0), pl.Surface(8.0, 0.0, VITREOUS, semi_diameter=4.0, conic=conic)],
                        name="eye", rear_medium=VITREOUS)  # fmt: skip


def test_an_ellipsoid_has_no_aberration_in_its_medium():
    # Descartes: from a distant point, the conic constant -(n / n')^2 images without aberration.
    lens = eye(-1.0 / 1.336**2)
    wave = pl.aberrations.wavefront(lens, wavelength=D)
    assert wave.peak_to_valley < 1e-7 and wave.strehl == pytest.approx(1.0, abs=1e-10)
    assert wave.index == pytest.approx(1.336)
    # The first dark ring, 0.61 lambda / NA' for small angles: sin u' = 2 / f' to 1 %.
    aperture = paraxial.numerical_apertures(lens, wavelength=D)[1]
    radii = np.linspace(0.5, 0.72, 221) * 1e-6 * D / aperture
    dark = wave.point_spread(np.column_stack([radii, 0 * radii, 0 * radii]))
    assert radii[np.argmin(dark)] * aperture / (1e-6 * D) == pytest.approx(0.61, abs=0.005)
    # The image of a distant point lies at f tan(field) with the front focal length: rays through the front focus.
    heights = pl.aberrations.distortion(eye(0.0), [0.0, 1e-4]).ideal
    assert abs(heights[1]) == pytest.approx(8.0 / 0.336 * math.tan(1e-4), rel=1e-12)


def test_seidel_sums_predict_real_rays_between_two_media():
    # Welford's transverse spherical aberration; the next order is smaller by (y / r)^2.
    sphere = eye(0.0)
    small = dataclasses.replace(sphere, elements=[pl.CircularStop(0.05), sphere.elements[1]])
    sums, focus = pl.aberrations.seidel_sums(small, field=0.0), paraxial.cardinal_points(small, D).rear_focus
    ray = small.trace(pl.RayBundle([[0.0, 0.05, -1.0]], [[0.0, 0.0, 1.0]], D)).at_z(focus)[0, 1]
    assert ray == pytest.approx(sums.transverse[0], rel=1e-3) and sums.wavefront[0] > 0


def test_files_hold_both_media(tmp_path):
    for lens in (*LENSES[:3], eye(-0.5), water_case(tmp_path)):
        pl.save_lens(lens, tmp_path / "lens.json")
        assert pl.load_lens(tmp_path / "lens.json") == lens == from_tree(to_tree(lens))
    case = water_case(tmp_path)
    assert case.front_medium.index(D) == pytest.approx(1.333, abs=1e-5) and case.rear_medium == AIR
    assert case.specification.entrance_pupil_diameter == pytest.approx(2.6)
    for lens in (case, eye(-0.5), between("cooke-triplet-50mm-f5", WATER, VITREOUS)):
        pl.save_lens(lens, tmp_path / "lens.zmx")
        read = pl.load_lens(tmp_path / "lens.zmx")
        ours, theirs = (paraxial.cardinal_points(one, 587.5618) for one in (lens, read))
        assert (read.front_medium == AIR, read.rear_medium == AIR) == (
            lens.front_medium == AIR,
            lens.rear_medium == AIR,
        )
        for name in ("efl", "front_efl", "front_nodal", "entrance_pupil", "entrance_pupil_semi_diameter"):
            assert getattr(theirs, name) == pytest.approx(getattr(ours, name), rel=1e-9, abs=1e-9), (lens.name, name)
    table = "radius;thickness;material;index;v-no;sa\n;1.0;;;;2.0\n8.0;23.8;;1.336;;4.0\n"
    (tmp_path / "eye.csv").write_text(table)
    read = pl.load_lens(tmp_path / "eye.csv")
    assert (read.front_medium, read.rear_medium) == (AIR, VITREOUS)


def test_an_f_number_in_a_zemax_file_is_that_of_the_power(tmp_path):
    # OpticStudio's effective focal length is that in air, 1 / power, whatever the media.
    case = water_case(tmp_path)
    text = (tmp_path / "water.zmx").read_text().replace("ENPD 2.6", "FNUM 3.0 0")
    (tmp_path / "f3.zmx").write_text(text)
    points = paraxial.cardinal_points(pl.load_lens(tmp_path / "f3.zmx"), 587.5618)
    power = paraxial.cardinal_points(case, 587.5618).power
    assert 2 * points.entrance_pupil_semi_diameter == pytest.approx(1 / power / 3.0, rel=1e-12)
    # An image in the paraxial focus, which is solved for another configuration.
    text = (tmp_path / "water.zmx").read_text().replace("DISZ 3\n", "DISZ 9\nMAZH 0 0\n")
    (tmp_path / "solved.zmx").write_text(text + "\nMNUM 2 1\nCRVT 5 2 0.04\n")
    solved = pl.load_lens(tmp_path / "solved.zmx", configuration=2)
    focus = paraxial.cardinal_points(solved, 587.5618).rear_focus
    assert solved.specification.z_image == pytest.approx(focus, rel=1e-12)
    # Fields as image heights: an object in water at the angle whose tangent is height over f = n / power.
    text = (tmp_path / "water.zmx").read_text().replace("FTYP 0", "FTYP 2").replace("YFLN 0", "YFLN 0.5")
    (tmp_path / "heights.zmx").write_text(text)
    lens = pl.load_lens(tmp_path / "heights.zmx")
    index = lens.front_medium.index(587.5618)
    assert abs(np.tan(lens.specification.fields)).max() == pytest.approx(0.5 * power / index, rel=1e-12)


def test_earlier_files_with_one_medium_open(tmp_path):
    lens = dataclasses.replace(between("singlet-100mm-f4", WATER, WATER), name="wet")
    pl.save_lens(lens, tmp_path / "lens.json")
    data = json.loads((tmp_path / "lens.json").read_text())
    data["ambient"] = data.pop("front_medium")
    assert data.pop("rear_medium") == data["ambient"]
    (tmp_path / "lens.json").write_text(json.dumps(data))
    assert pl.load_lens(tmp_path / "lens.json") == lens
    tree = to_tree(lens)
    fields = tree["value"][1]
    fields["ambient"] = fields.pop("front_medium")
    assert fields.pop("rear_medium") == fields["ambient"]
    assert from_tree(tree) == lens


def test_media_that_do_not_fit_are_refused():
    elements = pl.load_lens("singlet-100mm-f4").elements
    for call, message in (
        (lambda: pl.LensStack(elements, rear_medium=WATER), "the sensor is in ConstantMedium.*rear_medium"),
        (lambda: pl.LensStack(elements, front_medium=1.3), "front_medium"),
        (lambda: LENSES[0].with_model(pl.LensModel.NONE), "NONE, which refracts no light"),
    ):
        with pytest.raises(PrescriptionError, match=message):
            call()
    # Neither medium around a lens is glass, nor is air inside.
    lens = between("cooke-triplet-50mm-f5", WATER, VITREOUS)
    assert lens.glasses == pl.load_lens("cooke-triplet-50mm-f5").glasses
    assert lens.inserted(pl.CircularStop(9.0), z=float(lens.vertices[-1]) + 1.0).gap_media[-1] == VITREOUS

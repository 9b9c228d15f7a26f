import dataclasses
import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

from plenoptic import CircularStop, ConstantMedium, LensStack, ModelGlass, PolygonStop, Surface, load_lens
from plenoptic.errors import InvalidValueError, PrescriptionError
from plenoptic.optics import AIR
from plenoptic.plots.lens import plot_lens

EPS = np.finfo(float).eps
GLASS = ConstantMedium(1.5)
FRONT = Surface(50.0, 4.0, GLASS, semi_diameter=10.0)
BACK = Surface(-50.0, 3.0, semi_diameter=10.0)
STOP = CircularStop(5.0, 2.0)
REFERENCE = load_lens("double-gauss-100mm-f2")


def two_lenses() -> LensStack:
    return LensStack([FRONT, BACK, STOP, FRONT, BACK], name="pair")


def test_vertices_are_counted_from_the_iris():
    assert two_lenses().vertices.tolist() == [-7.0, -3.0, 0.0, 2.0, 6.0] and two_lenses().length == 13.0
    # The table of the reference camera; sums of up to six gaps, each good to half an eps of 34.
    expected = [-33.77, -26.25, -26.01, -17.96, -11.41, 0.0, 9.00, 11.36, 23.49, 23.87, 30.31]
    assert REFERENCE.vertices == pytest.approx(expected, abs=6 * 34 * EPS) and REFERENCE.vertices[5] == 0.0


def test_indices_follow_the_gaps():
    inside = LensStack([FRONT, CircularStop(3.0, 1.0), BACK])
    assert inside.indices().tolist() == [1.0, 1.5, 1.5, 1.0]
    assert two_lenses().indices().tolist() == [1.0, 1.5, 1.0, 1.0, 1.5, 1.0]
    assert two_lenses().glasses == ((0, 1), (3, 4)) and inside.glasses == ((0, 2),)
    # Air is recognised whatever made it.
    assert LensStack([STOP, FRONT, dataclasses.replace(BACK, medium=ConstantMedium(1))]).gap_media[-1] == AIR

    # An index that no medium has is refused.
    class Odd:
        def index(self, wavelength: float) -> float:
            return math.nan

    lens = LensStack([STOP, Surface(50.0, 1.0, Odd(), semi_diameter=5.0), BACK])
    with pytest.raises(PrescriptionError, match="behind element 1 has the refractive index nan at 500 nm"):
        lens.indices(500.0)
    with pytest.raises(InvalidValueError, match="wavelength"):
        LensStack([STOP, Surface(50.0, 1.0, ModelGlass(1.5, 60), semi_diameter=5.0), BACK]).indices(200.0)


def test_the_first_stop_is_the_iris():
    lens = LensStack([STOP, FRONT, BACK, CircularStop(4.0)])
    assert (lens.iris_index, lens.stop) == (0, STOP) and lens == dataclasses.replace(lens, iris=0)
    behind = dataclasses.replace(lens, iris=3)
    assert behind.stop == CircularStop(4.0) and behind.vertices[-1] == 0.0 and lens != behind
    # The gap behind the lens is not part of it.
    assert LensStack([STOP, FRONT, BACK]) == LensStack([STOP, FRONT, dataclasses.replace(BACK, thickness=99.0)])


def test_an_inserted_stop_moves_nothing():
    before = two_lenses()
    for z in (-20.0, -7.0, -3.0, -1.5, 0.0, 1.0, 2.0, 6.0, 30.0):
        after = before.inserted(CircularStop(3.0, 55.0), z)
        place = [i for i, e in enumerate(after.elements) if e.semi_diameter == 3.0]
        assert after.stop == dataclasses.replace(STOP, thickness=after.stop.thickness), z
        assert after.vertices[place].tolist() == [z]
        assert np.delete(after.vertices, place).tolist() == before.vertices.tolist(), z
        # It always stands in air.
        assert after.indices()[place[0]] == after.indices()[place[0] + 1] == 1.0, z
    # A new iris stands in the same place.
    lens = two_lenses().with_stop(PolygonStop(6, 4.0, thickness=77.0))
    assert lens.stop == PolygonStop(6, 4.0, thickness=2.0)
    assert lens.vertices.tolist() == two_lenses().vertices.tolist() and lens.with_stop(STOP) == two_lenses()


def test_what_is_impossible_says_why():
    for iris in (0, -1, 17, 2.0, True):
        with pytest.raises(InvalidValueError, match="iris is"):
            LensStack([FRONT, BACK, STOP], iris)
    lens = two_lenses()
    for z in (-6.99, -5.0, 3.0):
        with pytest.raises(PrescriptionError, match=r"lies in glass from .* mm"):
            lens.inserted(CircularStop(3.0), z)
    for z in (math.nan, math.inf):
        with pytest.raises(InvalidValueError, match="z is"):
            lens.inserted(CircularStop(3.0), z)
    with pytest.raises(PrescriptionError, match="stop is"):
        lens.inserted(FRONT, 0.0)
    with pytest.raises(InvalidValueError, match=r"rays is a list; give a RayBundle, such as pl\.RayBundle"):
        lens.trace_reverse([[0, 0, -1]])


def test_profiles_and_plot_are_to_scale():
    assert len(plot_lens(REFERENCE).patches) == len(REFERENCE.glasses) == 6
    lens = two_lenses()
    assert repr(lens) == "<LensStack 'pair': 4 surfaces, 1 stop, 13 mm long>"
    ax = plot_lens(lens.inserted(CircularStop(3.0), 9.0))
    assert ax.get_aspect() == 1.0 and ax.get_title() == "pair" and plot_lens(lens, ax) is ax
    plt.close("all")
    for z, element, profile in zip(lens.vertices, lens.elements, lens.profiles(5), strict=True):
        assert profile.shape == (5, 2)
        assert profile[[0, -1], 1].tolist() == [-element.semi_diameter, element.semi_diameter]
        assert profile[2].tolist() == [z, 0.0]
    assert lens.profiles(5)[2][:, 0].tolist() == [0.0] * 5

"""Lenses as rayoptics (M. Hayford) has them, which was written independently."""

import math
import warnings

import pytest

import plenoptic as pl

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what its own dependencies deprecate
    # Not from rayoptics.environment, which asks for Qt.
    optical = pytest.importorskip("rayoptics.optical.opticalmodel", reason="the extra `validation` installs it")
    spec = pytest.importorskip("rayoptics.raytr.opticalspec")
    profiles = pytest.importorskip("rayoptics.elem.profiles")

WAVELENGTH = 587.6

FAR = 1e9
"""mm. rayoptics has objects at infinity at a large distance: this one leaves a beam parallel to 100 / FAR, and rounds
heights to eps FAR = 2e-7 mm of some 10 mm."""

GLASS = pl.ConstantMedium(1.6)
ASPHERIC = pl.LensStack(
    [pl.Surface(45.0, 6.0, GLASS, semi_diameter=14.0, conic=-0.7, aspheric=(0.0, 2e-6, -1e-9)),
     pl.Surface(-200.0, 9.0, semi_diameter=14.0, conic=2.0), pl.CircularStop(4.0, thickness=5.0),
     pl.Surface(-60.0, 4.0, GLASS, semi_diameter=14.0, aspheric=(0.0, -1e-6)),
     pl.Surface(-50.0, semi_diameter=14.0, conic=-3.0)], name="aspheric",
)  # fmt: skip
# All in air: rayoptics 0.9.8 finds the entrance pupil elsewhere if the object is in another medium, dividing by its
# index where it should multiply.
LENSES = [*(pl.load_lens(name) for name in pl.lens_names() if not name.startswith("mirror")), ASPHERIC]


def model(lens, field, z_object):
    """The same elements, iris, aperture and field in rayoptics, by indices at one wavelength."""
    made = optical.OpticalModel()
    stack, about = made["seq_model"], made["optical_spec"]
    diameter = 2 * pl.paraxial.cardinal_points(lens, WAVELENGTH).entrance_pupil_semi_diameter
    # Its angles are those of rays that rise towards the lens, ours those of points above the axis.
    far = math.isinf(z_object)
    kind, size = ("angle", -math.degrees(field)) if far else ("height", field)
    about["pupil"] = spec.PupilSpec(about, key=["object", "epd"], value=diameter)
    about["fov"] = spec.FieldSpec(about, key=["object", kind], value=size, flds=[0.0, 1.0], is_relative=True)
    about["wvls"] = spec.WvlSpec([(WAVELENGTH, 1.0)], ref_wl=0)
    made.radius_mode = True
    n = lens.indices(WAVELENGTH)
    stack.gaps[0].thi = FAR if far else float(lens.vertices[0]) - z_object
    behind = pl.paraxial.image_position(lens, z_object, WAVELENGTH) - float(lens.vertices[-1])
    for i, element in enumerate(lens.elements):
        radius = getattr(element, "radius", math.inf)
        gap = element.thickness if i + 1 < len(lens.elements) else behind
        stack.add_surface([radius if math.isfinite(radius) else 0.0, gap, float(n[i + 1])])  # 0: a plane
        if i == lens.iris_index:
            stack.set_stop()
        if getattr(element, "conic", 0.0) or getattr(element, "aspheric", ()):
            stack.ifcs[stack.cur_surface].profile = profiles.EvenPolynomial(
                r=radius, cc=element.conic, coefs=[*element.aspheric, 0.0, 0.0]
            )
    made.update_model()
    return made

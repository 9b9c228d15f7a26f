"""Spectra of red, green and blue: the table behind `spectra.rgb_basis`.

Millionths at 380, 385, ... 730 nm; each row adds up to 1e6 exactly. With x the three spectra at these 71 wavelengths,
linear between and constant beyond, the table is the x that solves

    minimise    sum over colours k and steps i of (x[i + 1, k] - x[i, k])^2
    subject to  x >= 0,  sum over k of x[i, k] = 1,
                integral of s_c(wavelength) x_k(wavelength) = 1 if c = k, otherwise 0

with s_c the three sensitivities of `sensitivities.linear_srgb`, normalised; then rounded to millionths, keeping the
sums. It is a convex quadratic problem with one solution. `tests/core/test_spectra.py` solves it again.
"""

import numpy as np

from plenoptic.core.values import Floats

# fmt: off
_ROWS = (
    (8684, 0, 991316), (8715, 0, 991285), (8829, 0, 991171), (9053, 0, 990947), (9398, 0, 990602), (9834, 0, 990166),
    (10275, 0, 989725), (10618, 0, 989382), (10852, 0, 989148), (11185, 0, 988815), (12053, 0, 987947),
    (13895, 0, 986105), (16818, 0, 983182), (20794, 0, 979206), (26387, 0, 973613), (34545, 0, 965455),
    (34866, 23140, 941994), (28004, 70712, 901284), (17385, 138163, 844452), (6724, 219955, 773321),
    (0, 310038, 689962), (0, 403023, 596977), (0, 498613, 501387), (0, 593537, 406463), (0, 684817, 315183),
    (0, 769630, 230370), (0, 845166, 154834), (0, 908582, 91418), (0, 957096, 42904), (0, 988207, 11793),
    (0, 1000000, 0), (0, 1000000, 0), (0, 1000000, 0), (0, 1000000, 0), (0, 1000000, 0), (0, 1000000, 0),
    (0, 997563, 2437), (0, 980421, 19579), (31228, 935254, 33518), (95641, 863565, 40794), (185582, 771815, 42603),
    (293148, 666659, 40193), (410487, 554694, 34819), (530089, 442215, 27696), (645057, 334988, 19955),
    (749352, 238039, 12609), (838225, 155294, 6481), (908524, 89316, 2160), (958655, 41345, 0), (988485, 11515, 0),
    (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0),
    (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0), (1000000, 0, 0),
    (999941, 0, 59), (999737, 139, 124), (999498, 319, 183), (999278, 492, 230), (999098, 636, 266), (998962, 746, 292),
    (998865, 825, 310), (998798, 880, 322), (998754, 916, 330),
)
# fmt: on

PARTS: Floats = np.array(_ROWS, dtype=np.float64)
WAVELENGTHS: Floats = np.linspace(380.0, 730.0, len(PARTS))
for _array in (PARTS, WAVELENGTHS):
    _array.flags.writeable = False

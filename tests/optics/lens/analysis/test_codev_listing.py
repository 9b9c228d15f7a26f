"""A double Gauss lens against the listing of CODE V 10.8: first order, third order, real rays, aberrations and OPD.

Source of all numbers: "Double Gauss F/2 - Available Glasses", src/rayoptics/codev/tests/ag_dblgauss.lis of ray-optics
(https://github.com/mjhoptics/ray-optics). Lengths have six decimals, OPD three.
"""

import math

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.optics.lens.analysis.few_rays import few_unclipped_rays

WAVE, SHORT, LONG = 587.6, 486.1, 656.3
ANGLES = 10.0000000023, 14.0000000032
SEQUENCE = """RDM N; LEN
TITLE 'Double Gauss'; EPD 50.0; DIM M; WL 656.3 587.6 486.1; REF 2
XAN 0.0 0.0 0.0; YAN 0.0 10.0000000023 14.0000000032
SO 0.0 993938392063.0
S 0.01779284094091543 8.75 NSSK2_SCHOTT
S 0.006566600536925569 0.5
S 0.02653743294670983 12.5 NSK2_SCHOTT
S 0.0 3.8 F5_SCHOTT
S 0.04126892878570084 16.36944492653564
S 0.0 13.74795696388906
  STO
S -0.03523942654429074 3.8 F5_SCHOTT
S 0.0 11.0 NSK16_SCHOTT
S -0.02636750828657709 0.5
S 0.005636604951748545 7.0 NSK16_SCHOTT
S -0.0125926458590576 61.4875364179821
  PIM
SI 0.0 -0.4002686453541377
GO
"""
PARAXIAL = """
25.000000 -0.170628 0.444821 -14.439084 0.252237 -0.007584
23.507005 -0.180751 -0.026390 -12.232008 0.359218 0.278896
23.416630 -0.347265 0.440667 -12.052399 0.344338 0.039378
19.075817 -0.348123 -0.558186 -7.748170 0.345189 0.553482
17.752950 -0.116096 0.616549 -6.436452 0.393199 0.127574
15.852527 -0.116096 -0.116096 0.000000 0.393199 0.393199
14.256448 0.116660 -0.618485 5.405685 0.316914 0.202706
14.699756 0.115437 0.187054 6.609960 0.313591 0.508146
15.969559 -0.074185 -0.495263 10.059465 0.343587 0.078344
15.932466 -0.080166 0.015620 10.231259 0.189957 0.401257
15.371307 -0.249991 -0.443556 11.560961 0.217488 0.071905
0.100063 -0.249991 nan 24.846684 0.217488 nan
"""
"""HMY UMY N*IMY HCY UCY N*ICY at the surfaces and in the image plane; 14 degrees."""
THIRD_ORDER = """
-1.040587 0.053227 -0.531277 -0.530672 -0.530370 0.009048 -0.320428 0.005463 -0.006825
-0.002474 0.078453 -0.633384 -0.080636 0.195737 0.852194 -0.017875 0.188905 0.002519
-0.320986 -0.086051 -0.786925 -0.781799 -0.779236 -0.069862 -0.275440 -0.024614 -0.010028
-0.012707 0.037799 -0.037480 -0.012493 0.000000 0.012388 0.137441 -0.136283 0.000000
1.363481 0.846376 1.382005 1.265253 1.206876 0.261800 0.433452 0.089688 0.015531
0.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000
2.059866 -2.025339 1.694345 1.251814 1.030548 -0.410277 0.349174 -0.114441 0.013262
-0.001561 -0.012725 -0.034567 -0.011522 0.000000 -0.031301 0.039049 0.106081 0.000000
-1.139327 0.540680 -0.870024 -0.813005 -0.784496 0.128607 -0.200884 0.031777 -0.010095
0.000192 0.014807 0.212677 -0.040909 -0.167702 -1.050920 -0.006321 -0.162376 -0.002158
-1.212851 0.589843 -0.470280 -0.406534 -0.374661 0.065903 -0.173172 0.028073 -0.004821
-0.306954 0.037071 -0.074910 -0.160505 -0.203302 -0.232420 -0.035003 0.012274 -0.002616
"""
"""SA TCO TAS SAS PTB DST AX LAT PTZ of the surfaces and their sums."""
RAYS = """
25.000000 0 5.866433 -0.185302 0 5.866433
24.109772 0 1.920632 -0.200953 0 4.885983
22.844992 0 7.714534 -0.394267 0 6.419725
20.958242 0 0 -0.395393 0 5.143978
16.784894 0 6.754936 -0.112583 0 11.350044
15.702464 0 0 -0.112583 0 9.675248
14.610682 0 -4.050377 0.153430 0 9.758844
15.815163 0 0 0.151784 0 7.942241
16.882946 0 -3.965091 -0.057039 0 7.115484
16.583956 0 0.776812 -0.071127 0 5.250422
16.261006 0 -1.682704 -0.258832 0 4.551955

0 -10.199122 0.933171 0 0.179473 0.947567
0 -8.751050 0.251646 0 0.258633 8.197390
0 -8.439261 0.957169 0 0.247689 1.245190
0 -5.580229 0 0 0.248339 11.891636
0 -4.530431 0.427286 0 0.284179 4.355688
0 0 0 0 0.284179 16.573390
0 3.832982 -0.260056 0 0.227286 14.021955
0 4.755774 0 0 0.224781 4.163604
0 7.078566 -0.666442 0 0.246647 10.591401
0 7.404392 0.154581 0 0.132552 1.360612
0 8.254743 -0.430202 0 0.150057 6.471330

0 9.787772 0.858843 0 0.037696 0.872093
0 10.097867 0.335157 0 0.103286 8.232156
0 10.261995 1.424224 0 -0.043732 1.597520
0 9.777629 0 0 -0.043840 11.086362
0 9.525512 1.950803 0 0.199164 5.756327
0 12.397180 0 0 0.199164 14.701827
0 14.358409 -3.900632 0 0.336566 10.040729
0 16.950182 0 0 0.332644 8.125085
0 18.926111 -5.059933 0 0.194862 6.260087
0 20.235135 1.157762 0 0.073273 6.844046
0 20.466642 -2.682741 0 -0.046251 3.167968

0 -27.814923 7.365534 0 0.318993 7.479159
0 -26.625064 2.345576 0 0.414152 3.915224
0 -23.861803 8.517672 0 0.552822 7.221667
0 -21.660286 0 0 0.554607 4.550342
0 -16.138458 6.156286 0 0.384678 11.385000
0 -12.209678 0 0 0.384678 10.942757
0 -7.287205 -0.951622 0 0.115385 13.710468
0 -6.738941 0 0 0.114159 4.783148
0 -5.529458 -0.405257 0 0.291165 10.663556
0 -5.243314 0.077499 0 0.187265 1.023566
0 -3.965527 -0.099074 0 0.350427 6.942038

25.000000 -9.180390 6.710684 -0.188276 0.179744 6.814207
24.207033 -8.423361 2.172405 -0.205955 0.260639 4.352066
22.813382 -6.659673 8.439190 -0.404777 0.249244 7.130374
21.169658 -5.647541 0 -0.406004 0.250000 4.496267
16.783340 -2.946639 7.003625 -0.112775 0.290747 11.968833
15.727108 -0.223552 0 -0.112775 0.290747 9.810679
14.651350 2.549878 -4.208988 0.162435 0.219842 9.992051
15.952291 4.310591 0 0.160607 0.217368 8.302798
16.995052 5.721879 -4.507368 -0.052651 0.245651 6.725575
16.682332 7.180915 0.932110 -0.069185 0.132600 6.124049
16.407589 7.707488 -2.096743 -0.258813 0.154776 4.015317

0 -14.406114 1.877695 0 0.255397 1.935178
0 -12.519301 0.515474 0 0.372517 7.624915
0 -11.816984 1.900799 0 0.356410 2.011889
0 -8.039321 0 0 0.357403 11.252280
0 -6.376000 0.853906 0 0.410943 4.942214
0 0 0 0 0.410943 16.774544
0 5.433835 -0.525108 0 0.326061 14.295814
0 6.844083 0 0 0.322285 4.549215
0 9.960168 -1.331259 0 0.354160 10.158472
0 10.723612 0.324390 0 0.184778 2.286846
0 11.794375 -0.880748 0 0.206467 5.892958

0 0.125759 0.000141 0 0.149905 0.000145
0 1.438429 0.006794 0 0.254352 8.854494
0 1.572223 0.032813 0 0.138480 0.542768
0 3.298678 0 0 0.138829 12.586159
0 3.869395 0.310939 0 0.342921 4.150365
0 9.376192 0 0 0.342921 16.976467
0 13.008043 -3.157030 0 0.405728 11.196342
0 15.830703 0 0 0.400786 7.507841
0 18.343202 -4.731070 0 0.313311 6.753675
0 20.349002 1.170872 0 0.139488 6.708807
0 20.776271 -2.766001 0 0.059524 3.092783

0 -28.010010 7.477162 0 0.367431 7.706065
0 -26.677096 2.354825 0 0.500636 3.864789
0 -23.491264 8.218398 0 0.604450 7.116502
0 -20.903251 0 0 0.606492 5.002992
0 -15.299002 5.440438 0 0.496308 10.807095
0 -9.874843 0 0 0.496308 12.201012
0 -3.137991 -0.174035 0 0.237605 15.153763
0 -2.193740 0 0 0.234975 4.084674
0 0.390516 -0.002011 0 0.390820 11.297529
0 0.587092 0.000971 0 0.229102 0.540030
0 2.183703 -0.030030 0 0.366650 7.149553

25.000000 -12.986720 7.570573 -0.191290 0.255919 7.802336
24.308178 -12.061158 2.437190 -0.211138 0.375690 3.796736
22.783140 -9.347566 9.160149 -0.415726 0.358991 7.865141
21.394677 -8.148589 0 -0.417065 0.360147 3.810510
16.783147 -4.166402 7.257112 -0.112921 0.421165 12.624728
15.754175 -0.328604 0 -0.112921 0.421165 9.940930
14.695540 3.619826 -4.372943 0.171784 0.315011 10.227497
16.099525 6.194395 0 0.169755 0.311290 8.683120
17.109703 8.046817 -5.049217 -0.048037 0.352610 6.313774
16.790182 10.392211 1.102304 -0.067266 0.184927 7.060148
16.563765 11.014676 -2.531694 -0.258613 0.213120 3.430554
"""
"""X Y Z TAN-X TAN-Y LENGTH at the surfaces: the rim on axis; at 10 and 14 degrees the chief ray, three of the rim."""
ABERRATIONS = (
    (0, 0, 0.014138, 0.000000, -3.137),
    (2, 1, 0.000000, 0.031363, -3.972),
    (3, 1, 0.000000, -0.010062, -2.241),
    (4, 1, 0.054750, 0.001022, 1.889),
    (6, 5, 0.000000, -0.011679, 0.894),
    (7, 5, 0.000000, 0.003625, 0.361),
    (8, 5, 0.111063, -0.015573, 3.840),
)
"""Ray, its chief ray (itself: the axis), DELTA X, DELTA Y in mm, OPD in waves."""


def table(text: str) -> np.ndarray:
    return np.array([[float(word) for word in line.split()] for line in text.strip().splitlines() if line])


@pytest.fixture(scope="module")
def lens(tmp_path_factory):
    path = tmp_path_factory.mktemp("codev") / "double_gauss.seq"
    path.write_text(SEQUENCE)
    return pl.load_lens(path)


def test_first_order(lens):
    """Four decimals; pupils from the first and from the last surface."""
    points, specification = pl.paraxial.cardinal_points(lens, wavelength=WAVE), lens.specification
    last = float(lens.vertices[-1])
    figures = {
        100.0038: points.efl,
        61.4875: points.bfl,
        -29.3208: points.ffl,
        2.0001: points.f_number,
        61.0873: specification.z_image - last,
        77.9674: last - float(lens.vertices[0]),
        50.0: 2.0 * points.entrance_pupil_semi_diameter,
        57.9120: points.entrance_pupil - float(lens.vertices[0]),
        57.3201: 2.0 * points.exit_pupil_semi_diameter,
        -53.1569: points.exit_pupil - last,
    }
    np.testing.assert_allclose(list(figures.values()), list(figures), atol=5.1e-5, rtol=0)
    assert specification.wavelengths == (WAVE, LONG, SHORT)
    np.testing.assert_allclose(-specification.fields[:, 1], np.radians([0.0, *ANGLES]), rtol=1e-14)


def test_indices(lens):
    glasses = [element.medium for element in (lens.elements[i] for i in (0, 2, 3, 7))]
    indices = [[glass.index(wave) for wave in (LONG, WAVE, SHORT)] for glass in glasses]
    listed = (
        (1.618769, 1.622292, 1.630455),
        (1.604134, 1.607379, 1.614860),
        (1.598744, 1.603417, 1.614617),
        (1.617271, 1.620408, 1.627559),
    )
    np.testing.assert_allclose(indices, listed, atol=1.1e-6, rtol=0)


def test_paraxial_rays(lens):
    """The reduced angle of incidence is n (h c + u)."""
    listed = table(PARAXIAL)
    marginal, chief = (
        pl.paraxial.marginal_ray(lens, wavelength=WAVE),
        pl.paraxial.chief_ray(lens, -math.radians(ANGLES[1]), wavelength=WAVE),
    )
    curvatures = np.array([getattr(element, "vertex_curvature", 0.0) for element in lens.elements])
    gap = lens.specification.z_image - float(lens.vertices[-1])
    for column, ray in ((0, marginal), (3, chief)):
        height = np.append(ray.height, ray.height[-1] + gap * ray.angle[-1])
        incidence = ray.index[:-1] * (ray.height * curvatures + ray.angle[:-1])
        np.testing.assert_allclose(height, listed[:, column], atol=1.1e-6, rtol=0)
        np.testing.assert_allclose([*ray.angle[1:], ray.angle[-1]], listed[:, column + 1], atol=1.1e-6, rtol=0)
        np.testing.assert_allclose(incidence, listed[:-1, column + 2], atol=1.1e-6, rtol=0)


def test_third_order_by_surface(lens):
    """Transverse, S_i / (2 n' u'); colours C_i / (n' u') from 486.1 to 656.3 nm; the Petzval curvature."""
    field = -math.radians(ANGLES[1])
    sums = pl.aberrations.seidel_sums(lens, field=field, wavelength=WAVE)
    s1, s2, s3, s4, s5 = sums.table.T
    colours = pl.aberrations.colour_sums(lens, field=field, wavelengths=(SHORT, WAVE, LONG))
    columns = np.column_stack([s1, 3 * s2, 3 * s3 + s4, s3 + s4, s4, s5]) / (2.0 * sums.aperture)
    columns = np.column_stack([columns, np.reshape(colours, (-1, 2)) / sums.aperture])
    invariant = pl.paraxial.lagrange_invariant(
        pl.paraxial.marginal_ray(lens, wavelength=WAVE), pl.paraxial.chief_ray(lens, field, wavelength=WAVE)
    )
    columns = np.column_stack([columns, -s4 / invariant**2])
    columns = np.vstack([columns, columns.sum(axis=0)])
    np.testing.assert_allclose(columns, table(THIRD_ORDER), atol=2e-6, rtol=0)


def paths(lens) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (9, 12, 3) of the listed rays on the surfaces and in the image plane, directions, and field slopes."""
    listed = table(RAYS).reshape(9, 11, 6)
    slopes = np.tan(np.radians(np.repeat([0.0, *ANGLES], [1, 4, 4])))
    direction = np.column_stack([0 * slopes, slopes, 1.0 + 0 * slopes])
    z = float(lens.vertices[0]) + listed[:, 0, 2]
    start = np.column_stack([listed[:, 0, 0], listed[:, 0, 1], z]) - 20.0 * direction
    on_surfaces = few_unclipped_rays(lens, start, direction, WAVE)[:, 1:]
    out = lens.trace(pl.RayBundle(start, direction / np.linalg.norm(direction, axis=1)[:, None], wavelength=WAVE))
    return on_surfaces, out, direction


def test_real_rays(lens):
    """The start has errors of 5e-7 mm, which the lens magnifies by less than 4."""
    listed = table(RAYS).reshape(9, 11, 6)
    points, out, _ = paths(lens)
    local = points - np.array([[0.0, 0.0, float(z)] for z in lens.vertices])
    np.testing.assert_allclose(local, listed[..., :3], atol=2e-6, rtol=0)
    steps = np.diff(points, axis=1)
    slopes = np.concatenate([steps, out.direction[:, None]], axis=1)
    np.testing.assert_allclose(slopes[..., :2] / slopes[..., 2:], listed[..., 3:5], atol=1e-6, rtol=0)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=2), listed[:, 1:, 5], atol=2e-6, rtol=0)


@pytest.mark.parametrize("ray, chief, delta_x, delta_y, opd", ABERRATIONS)
def test_ray_aberrations_and_optical_path_differences(lens, ray, chief, delta_x, delta_y, opd):
    """Against the chief ray; OPD on the sphere about its image point through the paraxial exit pupil."""
    points, out, direction = paths(lens)
    image = lens.specification.z_image
    targets = out.at_z(image)
    target = targets[chief] if ray else np.array([0.0, 0.0, image])
    np.testing.assert_allclose((targets[ray] - target)[:2], (delta_x, delta_y), atol=4e-6, rtol=0)
    exit_pupil = pl.paraxial.cardinal_points(lens, wavelength=WAVE).exit_pupil
    indices = [1.0, *(n for n in pl.paraxial.marginal_ray(lens, wavelength=WAVE).index[1:])]
    unit = direction[ray] / np.linalg.norm(direction[ray])
    on_axis = few_unclipped_rays(lens, np.array([[0.0, 0.0, -20.0]]), np.array([[0.0, 0.0, 1.0]]), WAVE)[:, 1:]
    central = on_axis[0] if ray == 0 else points[chief]
    central_out = np.array([0.0, 0.0, 1.0]) if ray == 0 else out.direction[chief]
    pupil_point = central[-1] + (exit_pupil - central[-1][2]) / central_out[2] * central_out
    radius = np.linalg.norm(target - pupil_point)

    def path(on_surfaces, leaving):
        length = float(on_surfaces[0] @ unit)
        length += sum(
            n * np.linalg.norm(step) for n, step in zip(indices[1:-1], np.diff(on_surfaces, axis=0), strict=True)
        )
        across = on_surfaces[-1] - target
        b = float(across @ leaving)
        return length - b - math.sqrt(b * b - float(across @ across) + radius**2)

    difference = (path(central, central_out) - path(points[ray], out.direction[ray])) / (WAVE * 1e-6)
    # Half a digit, a start that is wrong by 5e-7 mm, and 5 % of the radius of the sphere, which the listing omits.
    miss = delta_x**2 + delta_y**2
    assert difference == pytest.approx(opd, abs=1e-3 + 0.05 * miss / (2.0 * radius * WAVE * 1e-6))

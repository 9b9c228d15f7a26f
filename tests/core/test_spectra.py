"""Colour by wavelength: laws of the basis and of the tables, round trips, and the table's own optimisation."""

import itertools
import pickle

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plenoptic.core.color import rgb_basis as basis_table
from plenoptic.core.color import sensitivities
from plenoptic.core.color.spectra import Sensitivity, colour_tables, rgb_basis, rgb_to_spectrum
from plenoptic.errors import InvalidValueError
from plenoptic.plots.sensor import plot_sensitivity

matplotlib.use("Agg")

EPS = np.finfo(float).eps
PRESETS = {name: getattr(sensitivities, name) for name in sensitivities.__all__}
LINES = (610.0, 550.0, 465.0)
ANYWHERE = st.floats(300.0, 1100.0)
UNIT = st.floats(0.0, 1.0)
EVERYWHERE = np.linspace(300.0, 1000.0, 7001)


def product_integral(sensitivity, spectra, nodes):
    """Integrals (C, K) of the normalised response times spectra (wavelengths -> (m, K)), both linear between `nodes`.

    Simpson's rule is exact for the product of two linear functions. Middles are taken as means of the ends, so that
    nothing depends on what either function is at a jump.
    """
    r, s = sensitivity.normalised.at(nodes), spectra(nodes)
    ends = np.einsum("ic,ik->ick", r, s)
    middle = np.einsum("ic,ik->ick", r[1:] + r[:-1], s[1:] + s[:-1])
    return np.einsum("i,ick->ck", np.diff(nodes) / 6.0, ends[1:] + ends[:-1] + middle)


def exact(sensitivity, spectra=rgb_basis):
    return product_integral(sensitivity, spectra, np.union1d(sensitivity.wavelengths, basis_table.WAVELENGTHS))


def probability(tables):
    return np.diff(tables.cdf, prepend=0.0)


def test_response_is_linear_between_samples_and_zero_beyond():
    sensitivity = Sensitivity([500.0, 520.0, 600.0], [[1.0, 0.0, -1.0], [3.0, 1.0, 2.0], [2.0, 0.5, 2.0]])
    response = sensitivity.at([499.9, 500.0, 505.0, 560.0, 600.0, 600.1])
    assert response == pytest.approx(
        np.array([[0, 0, 0], [1, 0, -1], [1.5, 0.25, -0.25], [2.5, 0.75, 2], [2, 0.5, 2], [0, 0, 0]])
    )


def test_normalised_channels_integrate_to_one():
    for name, make in PRESETS.items():
        sensitivity, scaled = make(), make().normalised
        integral = np.diff(scaled.wavelengths) @ (scaled.response[1:] + scaled.response[:-1]) / 2
        # A sum of n positive numbers errs by n eps at most; those of linear_srgb cancel by a factor below 3.
        assert integral == pytest.approx(1.0, abs=3 * len(sensitivity.wavelengths) * EPS), name
        assert scaled.response == pytest.approx(scaled.normalised.response, rel=1e-12), name
        shape = sensitivity.response / sensitivity.response.max(axis=0)
        assert scaled.response / scaled.response.max(axis=0) == pytest.approx(shape, abs=1e-12), name


def test_the_range_ends_where_nothing_is_seen():
    table = np.zeros((7, 3))
    table[2, 0] = table[3, 1] = table[4, 2] = 1.0
    assert Sensitivity(np.arange(400.0, 540.0, 20.0), table).wavelength_range == (420.0, 500.0)
    assert Sensitivity([400.0, 700.0], [1.0, 1.0]).wavelength_range == (400.0, 700.0)
    assert Sensitivity.lines(LINES).wavelength_range == (465.0, 610.0)


def test_sensitivities_have_one_channel_or_three():
    flat, column = Sensitivity([400.0, 700.0], [1.0, 2.0]), Sensitivity([400.0, 700.0], [[1.0], [2.0]])
    assert flat == column and flat.channels == PRESETS["silicon"]().channels == 1
    lines = Sensitivity.lines(LINES)
    assert lines.channels == PRESETS["colour_camera"]().channels == 3 and lines.normalised is lines
    for sensitivity in (*(make() for make in PRESETS.values()), lines):
        assert pickle.loads(pickle.dumps(sensitivity)) == sensitivity and not sensitivity.wavelengths.flags.writeable


def test_what_cannot_be_is_refused():
    for wavelengths, response, message in (
        ([0.4, 0.7], [1.0, 1.0], "0.4 nm; it must be from 10"),
        ([500.0, 500.0], [1.0, 1.0], "ascend"),
        ([500.0], [1.0], "2 or more"),
        ([400.0, 500.0], [[1.0, 1.0], [1.0, 1.0]], "2 channels; it must have 1 or 3"),
        ([400.0, 500.0], [0.0, 0.0], "channel 0 has the integral 0"),
        ([400.0, 500.0], [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]], "channel 1 has the integral 0"),
        ([400.0, 500.0], [-1.0, 0.0], "must be above 0"),
        ([400.0, 500.0], None, "lines have 1 or 3"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            Sensitivity(wavelengths, response)
    for rgb, wavelengths, message in (
        ((0.5, 0.5), [500.0], "last axis must be 3"),
        ((0.5, 0.5, 0.5), [0.55], "nanometres"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            rgb_to_spectrum(rgb, wavelengths)
    for make, message in (
        (lambda: Sensitivity.lines(LINES).at([500.0]), "no response"),
        (lambda: colour_tables(PRESETS["silicon"](), step=0.0), "step"),
        (lambda: sensitivities.silicon(depth=0.0), "depth"),
        (lambda: sensitivities.silicon(band=(365.0, 700.0)), "within 370 to 1090 nm"),
        (lambda: sensitivities.silicon(band=(700.0, 400.0)), "ascend"),
        (lambda: sensitivities.colour_camera(band=(500.0, 510.0)), "at least 20 nm wide"),
        (lambda: sensitivities.colour_camera(widths=(1.0, 0.0, 1.0)), "a width"),
        (lambda: sensitivities.colour_camera(peaks=(0.6, 0.5, 0.4)), "nanometres"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            make()


def test_the_basis_is_a_partition_of_unity_within_bounds():
    basis = rgb_basis(EVERYWHERE)
    assert basis.min() >= 0.0 and basis.max() <= 1.0
    # Three interpolations and their sum, each rounded to 1/2 eps of at most 1.
    assert np.abs(basis.sum(axis=1) - 1.0).max() <= 3 * EPS and (basis_table.PARTS.sum(axis=1) == 1e6).all()
    assert (rgb_basis([100.0, 379.0]) == rgb_basis([380.0])).all()  # constant beyond the table
    assert (rgb_basis([731.0, 2000.0]) == rgb_basis([730.0])).all()


@given(st.tuples(UNIT, UNIT, UNIT), st.lists(ANYWHERE, min_size=1, max_size=5))
def test_reflectances_are_energy_conserving(rgb, wavelengths):
    spectrum = rgb_to_spectrum(rgb, wavelengths)
    assert spectrum.shape == (len(wavelengths),)
    # Convex combinations, up to the rounding of three products and their sum.
    assert (spectrum >= min(rgb) * (1 - 6 * EPS)).all() and (spectrum <= max(rgb) * (1 + 6 * EPS)).all()


@given(st.tuples(UNIT, UNIT, UNIT), st.tuples(UNIT, UNIT, UNIT), st.floats(0.0, 100.0))
def test_spectra_are_linear_in_the_colour(a, b, scale):
    wavelengths = [380.0, 487.0, 541.3, 666.0, 730.0]
    together = rgb_to_spectrum(np.add(a, np.multiply(scale, b)), wavelengths)
    combined = rgb_to_spectrum(a, wavelengths) + scale * rgb_to_spectrum(b, wavelengths)
    assert together == pytest.approx(combined, rel=1e-14, abs=1e-300)


def test_images_of_colours_become_images_of_spectra():
    for shape in ((3,), (2, 4, 3), (0, 3)):
        rgb = np.random.default_rng(1).random(shape)
        spectra = rgb_to_spectrum(rgb, [450.0, 550.0])
        assert spectra.shape == (*shape[:-1], 2)
        for place in np.ndindex(shape[:-1]):
            assert spectra[place] == pytest.approx(rgb_to_spectrum(rgb[place], [450.0, 550.0]), rel=1e-15), shape


def test_colours_come_back_through_linear_srgb():
    # Millionths in the table, times integrals of |response| below 2.1: about 1e-6 at worst.
    assert exact(sensitivities.linear_srgb()) == pytest.approx(np.eye(3), abs=1e-6)
    tables = colour_tables(sensitivities.linear_srgb())
    measured = np.einsum("w,wc,wk->ck", probability(tables), tables.weights, tables.basis)
    # With steps of 1 nm, midpoints err by h^2/12 times the integral of the product of both slopes: 4e-5 here.
    assert measured == pytest.approx(np.eye(3), abs=1e-4)


def test_colours_keep_their_chromaticity():
    # X, Y and Z of the primaries are those of sRGB for daylight, adapted to equal energy: their chromaticities lie
    # where red, green and blue are, and the sum is the white (1, 1, 1).
    tristimulus = exact(sensitivities.cie_1931())
    assert tristimulus.sum(axis=1) == pytest.approx(np.ones(3), abs=1e-12)
    x, y, _ = tristimulus / tristimulus.sum(axis=0)
    assert x[0] > 0.6 and y[1] > 0.55 and x[2] < 0.2 and y[2] < 0.1
    # Luminances of the primaries under daylight are 0.2126, 0.7152, 0.0722; the adaptation shifts them a little.
    assert tristimulus[1] == pytest.approx([0.2126, 0.7152, 0.0722], abs=0.012)


def solved():
    """The problem in `rgb_basis` by the active-set method: its solution (71, 3), what measures it, multipliers."""
    nodes = basis_table.WAVELENGTHS
    n = len(nodes)
    fine = np.arange(380.0, 781.0)
    hats = np.stack([np.interp(fine, nodes, e) for e in np.eye(n)], axis=-1)
    measure = product_integral(sensitivities.linear_srgb(), lambda _: hats, fine)
    slopes = np.diff(np.eye(n), axis=0)
    cost = np.kron(np.eye(3), slopes.T @ slopes)
    # What blue measures follows from the sums and from what red and green measure.
    laws = np.vstack([np.kron(np.eye(3), measure)[:6], np.tile(np.eye(n), 3)])
    targets = np.append(np.eye(3).ravel()[:6], np.ones(n))
    zero = np.zeros(3 * n, bool)
    for _ in range(30):
        kkt = np.block([[cost[~zero][:, ~zero], laws[:, ~zero].T], [laws[:, ~zero], np.zeros((len(laws),) * 2)]])
        solution = np.linalg.solve(kkt, np.append(np.zeros((~zero).sum()), targets))
        x = np.zeros(3 * n)
        x[~zero] = solution[: (~zero).sum()]
        pull = cost @ x + laws.T @ solution[(~zero).sum() :]
        negative, released = x < -1e-13, zero & (pull < -1e-12)
        if not negative.any() and not released.any():
            return x.reshape(3, n).T, laws @ x - targets, pull, zero
        zero = (zero | negative) & ~released
    raise AssertionError("the active set does not settle")


def test_the_table_is_the_smoothest_that_measures_right():
    x, broken, pull, zero = solved()
    # First the conditions of Karush, Kuhn and Tucker: sufficient, since the problem is convex.
    assert np.abs(broken).max() < 1e-12 and x.min() >= -1e-13 and np.abs(pull[~zero]).max() < 1e-12
    assert pull[zero].min() > -1e-12
    # Then the table, in whole millionths; the largest remainders are rounded up, so each is off by less than one.
    assert np.abs(basis_table.PARTS - 1e6 * x).max() < 1.0
    assert (np.round(basis_table.PARTS) == basis_table.PARTS).all()


STEPS = [[1, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 1, 1], [0, 1, 2]]
SAMPLED = [*(make() for make in PRESETS.values()), Sensitivity([500.0, 500.4, 700.0], [0.0, 1.0, 0.0])]
SAMPLED += [Sensitivity([400.0, 450.0, 451.0, 600.0, 601.0, 700.0], STEPS)]


def test_white_is_measured_as_one_in_every_channel():
    for sensitivity, step in itertools.product(SAMPLED, (0.3, 1.0, 7.0, 1000.0)):
        tables = colour_tables(sensitivity, step=step)
        drawn, case = probability(tables), (sensitivity, step)
        assert tables.cdf[-1] == 1.0 and (drawn > 0).all(), case
        # Sums of n terms of at most `max_weight` together.
        shares = drawn[:, None] * tables.weights
        max_weight = np.abs(shares).sum()
        assert drawn @ tables.weights == pytest.approx(1.0, abs=len(drawn) * EPS * max_weight), case
        assert shares.T @ tables.basis.sum(axis=1) == pytest.approx(1.0, abs=1e-12), case
        low, high = sensitivity.wavelength_range
        assert low < tables.wavelengths[0] and tables.wavelengths[-1] < high, case
        assert (np.diff(tables.wavelengths) > 0).all(), case
        assert tables.basis == pytest.approx(rgb_basis(tables.wavelengths), abs=0.0), case


def test_no_weight_exceeds_the_sum_of_all_magnitudes():
    for sensitivity in SAMPLED:
        tables = colour_tables(sensitivity)
        total = np.abs(probability(tables)[:, None] * tables.weights).sum()
        # The cdf is rounded by eps, which is 1e-6 of the probability of the rarest bins (1e-7 / 400).
        assert np.abs(tables.weights).sum(axis=1) == pytest.approx(total, rel=1e-5), sensitivity
        if sensitivity.response.min() >= 0:
            assert total == pytest.approx(sensitivity.channels, rel=1e-12), sensitivity


def test_shares_are_integrals_over_bins():
    for sensitivity in SAMPLED:
        tables = colour_tables(sensitivity, step=5.0)
        low, high = sensitivity.wavelength_range
        width = (high - low) / np.ceil((high - low) / 5.0)
        fine = low + (np.arange(round((high - low) / width) * 2000) + 0.5) * width / 2000
        heights = sensitivity.normalised.at(fine).reshape(-1, 2000, sensitivity.channels)
        middles = fine.reshape(-1, 2000).mean(axis=1)
        significant = np.abs(middles[:, None] - tables.wavelengths).min(axis=1) < 0.5 * width
        assert tables.wavelengths == pytest.approx(middles[significant], rel=1e-12), sensitivity
        # A midpoint sum errs by its step times the height of a kink's cell: width / 2000 squared times the steepest
        # slope.
        slopes = np.diff(sensitivity.normalised.response, axis=0) / np.diff(sensitivity.wavelengths)[:, None]
        tolerance = 1e-6 + (width / 2000) ** 2 * np.abs(slopes).max()
        shares = probability(tables)[:, None] * tables.weights
        assert shares == pytest.approx(heights.mean(axis=1)[significant] * width, abs=tolerance), sensitivity


@given(st.tuples(UNIT, UNIT, UNIT))
def test_the_mean_is_what_channels_see_of_a_colour(rgb):
    for sensitivity, tables, expected in COMPILED:
        mean = (probability(tables)[:, None] * tables.weights).T @ (tables.basis @ np.asarray(rgb))
        # See test_colours_come_back_through_linear_srgb, for each of three colours.
        assert mean == pytest.approx(expected @ np.asarray(rgb), abs=3e-4)
        if sensitivity.response.min() >= 0:
            assert (mean >= min(rgb) - 1e-12).all() and (mean <= max(rgb) + 1e-12).all()


COMPILED = [(s, colour_tables(s), exact(s)) for s in (make() for make in PRESETS.values())]


def test_a_channel_of_lines_sees_the_channel_of_the_scene():
    for lines in (LINES, (550.0, 550.0, 550.0)):
        tables = colour_tables(Sensitivity.lines(lines))
        assert tables.wavelengths.tolist() == list(lines) and tables.cdf[-1] == 1.0
        assert probability(tables) == pytest.approx(1 / 3) and (tables.basis == np.eye(3)).all()
        rgb = np.array([0.2, 0.5, 3.0])
        mean = (probability(tables)[:, None] * tables.weights).T @ (tables.basis @ rgb)
        assert mean == pytest.approx(rgb, rel=4 * EPS), lines
    # A single line sees the spectrum.
    tables = colour_tables(Sensitivity.lines([632.8]))
    assert tables.weights.tolist() == [[1.0]] and (tables.basis == rgb_basis([632.8])).all()


def test_the_observer_follows_the_tables_of_the_cie():
    # CIE 15:2018, table of the 1931 observer at 400, 450, ... 700 nm.
    table = [
        *([0.01431, 0.000396, 0.06785], [0.3362, 0.0380, 1.7721], [0.0049, 0.3230, 0.2720], [0.4334, 0.9950, 0.0087]),
        *([1.0622, 0.6310, 0.0008], [0.2835, 0.1070, 0.0], [0.01136, 0.0041, 0.0]),
    ]
    assert sensitivities.cie_1931().at(np.arange(400.0, 701.0, 50.0)) == pytest.approx(np.array(table), abs=0.01)


def test_camera_channels_peak_where_they_should():
    camera = sensitivities.colour_camera(peaks=(610.0, 540.0, 450.0), widths=(60.0, 100.0, 80.0))
    assert camera.wavelengths[camera.response.argmax(axis=0)].tolist() == [610.0, 540.0, 450.0]
    assert camera.at([580.0, 490.0, 490.0])[[0, 1, 2], [0, 1, 2]] == pytest.approx(0.5, abs=1e-12)


def test_cut_filters_transmit_half_at_their_limits():
    for make in [sensitivities.colour_camera, sensitivities.silicon]:
        wide, narrow = make(band=(400.0, 1000.0)), make(band=(500.0, 600.0))
        assert narrow.wavelength_range == (490.0, 610.0), make
        ratio = narrow.at([500.0, 510.0, 550.0, 590.0, 600.0]) / wide.at([500.0, 510.0, 550.0, 590.0, 600.0])
        inside = ratio[2]
        assert ratio == pytest.approx(np.array([0.5, 1.0, 1.0, 1.0, 0.5])[:, None] * inside, rel=1e-9), make


def test_silicon_absorbs_less_red_than_blue():
    thin, thick = (sensitivities.silicon(depth=depth, band=(400.0, 1000.0)) for depth in (1e-6, 10.0))
    # A thick layer absorbs every photon: the response to energy is the wavelength itself.
    inside = np.arange(420.0, 981.0, 40.0)
    assert thick.at(inside)[:, 0] / thick.at([700.0]) == pytest.approx(inside[None] / 700.0, rel=1e-12)
    # A thin one absorbs depth alpha = 4 pi k depth / wavelength: the response is k, which falls all the way.
    assert (np.diff(thin.at(inside)[:, 0]) < 0).all()


def test_a_figure_draws_each_channel():
    for sensitivity in (PRESETS["colour_camera"](), PRESETS["silicon"](), Sensitivity.lines(LINES)):
        ax = plot_sensitivity(sensitivity)
        curves = [line for line in ax.lines if line.get_label().startswith("channel")]
        assert len(curves) == sensitivity.channels and (ax.get_legend() is not None) == (sensitivity.channels == 3), (
            sensitivity
        )
        for channel, curve in enumerate(curves):
            if sensitivity.response is None:
                assert set(curve.get_xdata()) == {sensitivity.wavelengths[channel]}
            else:
                assert (curve.get_xdata() == sensitivity.wavelengths).all()
                assert (curve.get_ydata() == sensitivity.normalised.response[:, channel]).all()
        plt.close(ax.figure)

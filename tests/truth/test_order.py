"""Orders: what is chosen and why, from fewer lines, pruned subspaces and poles held where lines tell them."""

import functools
from itertools import combinations

import gimbal_record
import numpy as np
import pytest

from middeck import estimate_response
from middeck.identification.model.fit_options import FitOptions, decided
from middeck.identification.order.best_start import race
from middeck.identification.order.order_choice import TriedOrder, choose, is_settled
from middeck.identification.order.recommended_order import recommend_states
from middeck.identification.order.thinning import take_lines, thin_lines
from middeck.identification.problem.data import Data
from middeck.identification.problem.unknowns_layout import Layout, Point, Start, pack, unpack
from middeck.identification.search.least_squares_costs import weighted
from middeck.identification.search.refine_and_reweigh import bound_theta, bounded, polish
from middeck.identification.spectra.excess_variance import ExcessVariance, spread_of
from middeck.identification.start.frequency_subspace import prune
from middeck.identification.start.start import drive_vectors


def data_of(measured):
    spread = spread_of(measured, relative=False)
    weight = 1.0 / np.sqrt(spread.at(1e-3))
    return Data(s=2j * np.pi * measured.frequency_hz, H=np.moveaxis(measured.H, 0, 1), weight=weight), spread


def tried(*rows, noise=True):
    return [TriedOrder(states, length, held_out, noise) for states, length, held_out in rows]


def test_the_shortest_description_is_chosen_where_there_is_one():
    found = choose(tried((2, 50.0, 0.5), (4, 10.0, 0.1), (6, 18.0, 0.05), (8, 20.0, 0.2)))
    assert found.states == 4
    # The lines kept out are said to disagree, and do not decide.
    assert "4 states have the minimum description length" in found.reason
    assert "8 below the next" in found.reason
    assert "ask for 6" in found.reason


@pytest.mark.parametrize("more", [-5.0, 5.0])
def test_the_smallest_of_orders_that_no_length_distinguishes_is_chosen(more):
    found = choose(tried((2, 50.0, 0.5), (4, 10.0, 0.1), (6, 10.0 + more, 0.1), (8, 30.0, 0.1)))
    assert found.states == 4
    assert "6 do as well" in found.reason


@pytest.mark.parametrize("chance", [0.9, 1.0, 1.1])
def test_lengths_of_what_is_no_noise_do_not_decide(chance):
    """Each order tells more, one of them at random; lines kept out ask for no more than six states."""
    rows = (2, 90.0, 0.5), (4, 60.0, 0.2), (6, 50.0, 0.1), (8, 40.0, 0.1 * chance)
    found = choose(tried(*rows, (10, 20.0 * chance, 0.11), (12, 19.0, 0.1 / chance), noise=False))
    assert found.states == 6
    assert "8, 10, 12 do as well" in found.reason
    assert choose(tried(*rows, (10, 20.0, 0.01), noise=False)).states == 10


def test_without_an_end_the_lines_kept_out_decide():
    found = choose(tried((2, 50.0, 0.5), (4, 40.0, 0.21), (6, 30.0, 0.105), (8, 20.0, 0.1), (10, 10.0, 0.1)))
    assert found.states == 6
    assert "10.50%" in found.reason


def test_a_search_ends_three_sizes_after_the_best():
    assert not is_settled([3.0, 1.0, 2.0, 2.0])
    assert is_settled([3.0, 1.0, 2.0, 2.0, 2.0])


def test_pruning_drops_what_is_missed_least():
    """One by one, the best of all subsets of one fewer; here also of all subsets at once."""
    rng = np.random.default_rng(1)
    A, size = rng.standard_normal((60, 8)), np.array([4.0, 0.2, 3.0, 1.0, 0.1, 2.0, 0.5, 5.0])
    y = (A * size) @ rng.standard_normal((8, 2)) + 0.1 * rng.standard_normal((60, 2))
    blocks = [[0, 1], [2, 3], [4], [5], [6]]
    kept = prune(A, y, blocks, [2, 2, 1, 1, 1], 4)

    def left(subset):
        columns = [c for k in subset for c in blocks[k]] + [7]
        return np.linalg.lstsq(A[:, columns], y, rcond=None)[1].sum()

    states = [2, 2, 1, 1, 1]
    subsets = [s for n in (2, 3) for s in combinations(range(5), n) if sum(states[k] for k in s) == 4]
    assert left(kept) == min(left(s) for s in subsets)
    # Five states of two pairs and three real poles: three pairs' worth cannot be kept of pairs alone.
    assert prune(A[:, :4], y, [[0, 1], [2, 3]], [2, 2], 3) is None


def test_lines_are_left_out_only_where_the_response_is_smooth():
    f = np.arange(1.0, 4001.0) / 8.0
    s = 2j * np.pi * f
    w = 2.0 * np.pi * np.array([100.0, 300.0])[:, None]

    def kept(zeta):
        H = np.sum(w**2 / (s**2 + 2.0 * zeta * w * s + w**2), axis=0)[None, :, None]
        data = Data(s=s, H=np.repeat(H, 4, axis=2), weight=np.ones((1, len(s), 4)))
        spread = ExcessVariance(variance=np.zeros((1, len(s), 4)), size=np.ones((1, len(s), 4)))
        return data, thin_lines(data, spread)

    data, wide = kept(0.02)
    _, narrow = kept(1e-4)
    assert len(wide) < 0.3 * len(s)
    # Half-power bandwidths of 0.02 and 0.06 Hz are narrower than the lines are apart: none below the higher
    # mode can be spared, and few above it.
    assert np.all(np.diff(f[narrow][f[narrow] < 301.0]) < 0.126)
    part, _ = take_lines(data, ExcessVariance(variance=np.abs(data.H) ** 2, size=np.abs(data.H) ** 2), wide)
    np.testing.assert_array_equal(part.H, data.H[:, wide])


def a_layout(period_s):
    return Layout(
        pair=np.array([True, False]),
        fixed_imag=np.array([0.0, np.pi / period_s]),
        pivot=np.array([0, 0]),
        inputs=1,
        outputs=1,
        options=FitOptions(constants="complex", direct=True, sample_hz=1.0 / period_s),
    )


def test_a_pole_outside_the_band_stays_where_the_band_cannot_tell_it_from_less_damping():
    """A record whose pole at half the sampling rate is unstable, as noise may have it."""
    T = 0.01
    layout = a_layout(T)
    s = 2j * np.pi * np.linspace(1.0, 45.0, 300)
    z = np.exp(s * T)
    p = np.exp((-3.0 + 120j) * T)
    H = 1.0 / (z - p) + 1.0 / (z - p.conj()) + 0.1 / (z + 1.02) + 0.3
    data = Data(s=s, H=H[None, :, None], weight=np.full((1, 300, 1), 1e3))
    point = Point(
        np.array([-2.0 + 121j, -5.0 + 1j * np.pi / T]), np.ones((2, 1), dtype=complex), np.zeros((1, 1))
    )
    spread = ExcessVariance(variance=np.full((1, 300, 1), 1e-6), size=np.ones((1, 300, 1)))
    found = polish(data, Start(layout, pack(layout, point)), spread, steps=40, rounds=2)
    poles = unpack(layout, found.refined.theta).poles
    distance = np.pi / T - 2.0 * np.pi * 45.0
    assert -poles[1].real >= 0.25 * distance * (1.0 - 1e-12)
    assert poles[0] == pytest.approx(-3.0 + 120j, rel=1e-2)


def test_bounds_change_nothing_inside_them():
    layout = a_layout(0.01)
    rng = np.random.default_rng(0)
    s = 2j * np.pi * np.linspace(1.0, 45.0, 50)
    data = Data(s=s, H=rng.standard_normal((1, 50, 1)) + 0j, weight=np.ones((1, 50, 1)))
    point = Point(
        np.array([-2.0 + 121j, -50.0 + 100j * np.pi]), np.ones((2, 1), dtype=complex), np.zeros((1, 1))
    )
    theta = pack(layout, point)
    np.testing.assert_array_equal(bound_theta(layout, data, theta), theta)
    free = weighted(layout, data, theta)
    held = bounded(layout, data, functools.partial(weighted, layout, data))(theta, np.inf)
    np.testing.assert_array_equal(free.gradient, held.gradient)
    far = bound_theta(layout, data, theta + np.array([900.0, -900.0, 900.0]))
    assert np.isfinite(np.exp(far)).all()
    assert np.exp(far[2]) < np.pi / 0.01


def test_no_numpy_warning_on_a_short_band_with_too_many_states():
    """Noise in a narrow band drives spare poles to the edges of what floats can hold."""
    rng = np.random.default_rng(5)
    measured = estimate_response(gimbal_record.multisine(0), band_hz=(6.0, 10.0))
    data, spread = data_of(measured)
    noisy = Data(
        s=data.s,
        H=data.H + 0.3 * np.abs(data.H).mean() * rng.standard_normal(data.H.shape),
        weight=data.weight,
    )
    options = decided(measured, FitOptions(states=12, sample_hz=256.0))
    # Warnings are errors in this suite.
    found = race(noisy, spread, options)
    assert np.isfinite(found.refined.theta).all()


def test_two_inputs_and_three_outputs_ask_for_ten_states():
    measured = estimate_response(gimbal_record.multisine(2, outputs=3, inputs=2), band_hz=(0.5, 20.0))
    data, spread = data_of(measured)
    options = decided(measured, FitOptions())
    choice = recommend_states(measured, data, spread, options)
    assert choice.states == 10
    by_states = {t.states: t.held_out for t in choice.tried}
    # Four modes of five leave a whole mode unexplained on lines kept out as well; five leave the noise.
    assert by_states[10] < 0.1 * by_states[8]


def test_input_vectors_follow_from_output_vectors_where_poles_are_close():
    """Three modes far below the band, closer than it can tell apart, and one within; a constant besides."""
    rng = np.random.default_rng(7)
    s = 2j * np.pi * np.geomspace(0.5, 20.0, 120)
    poles = np.array([-0.2 + 0.30j, -0.21 + 0.31j, -0.1 + 0.33j, -0.4 + 40.0j])
    c, b = (rng.standard_normal(n) + 1j * rng.standard_normal(n) for n in ((4, 4), (4, 3)))
    b = b / b[np.arange(4), np.argmax(np.abs(b), axis=1)][:, None]
    up, low = 1.0 / (s[:, None] - poles), 1.0 / (s[:, None] - poles.conj())
    H = np.einsum("om,lm,mi->oli", c, up, b) + np.einsum("om,lm,mi->oli", c.conj(), low, b.conj())
    data = Data(s=s, H=H + rng.standard_normal((4, 1, 3)), weight=np.ones(H.shape))
    measured = estimate_response(gimbal_record.multisine(0, outputs=3, inputs=2))
    options = decided(measured, FitOptions(states=8, constants="complex", delay=False, direct=True))
    found = drive_vectors(data, options, poles, np.ones(4, dtype=bool), c)
    # Exact data: rounding times the condition of the close modes, some 1e6 with known output vectors.
    np.testing.assert_allclose(found, b, atol=1e-8)

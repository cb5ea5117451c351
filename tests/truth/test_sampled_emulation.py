"""Emulated laws: where each rule is exact, and what it does to poles, zeros and gain."""

import warnings

import numpy as np
import pytest
import sampled_cases as cases
import scipy.linalg as sla

from middeck.control.law.compensator import Compensator
from middeck.control.lqg.design import design_lqg
from middeck.control.sampled.emulation import emulate
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.transmission_zeros import transmission_zeros
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.statespace import StateSpace, gain_system, poles

T = 0.004
RULES = ("hold", "tustin", "matched")


def law_of(A, B, C, D):
    D = np.atleast_2d(D)
    inputs, outputs = (
        tuple(Port(f"{c}{i}", "m") for i in range(n)) for c, n in (("y", D.shape[1]), ("u", len(D)))
    )
    return Compensator(StateSpace(A, B, C, D), inputs, outputs)


@pytest.fixture(scope="module")
def lqg():
    return design_lqg(cases.gimbal(), cases.gimbal_weights(), 100.0)


def response(law, hz):
    return statespace_response(law.dynamics, 2.0 * np.pi * np.atleast_1d(hz))[:, 0, 0]


def test_hold_is_exact_for_an_input_that_stands_still(lqg):
    held = emulate(lqg, T, "hold")
    steps = np.random.default_rng(0).standard_normal((20, 1))
    found, _ = simulate(held.sampled, steps)
    A, B, C = lqg.system.A, lqg.system.B, lqg.system.C
    n = len(A)
    e = sla.expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * T / 10.0)
    x, wanted = np.zeros(n), []
    for u in steps[:, 0]:
        wanted.append(C @ x)
        for _ in range(10):
            x = (e @ np.append(x, u))[:n]
    np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-10 * np.abs(wanted).max())


@pytest.mark.parametrize("hz", [0.3, 5.0, 9.0, 100.0])
@pytest.mark.parametrize("rule", ["tustin", "matched"])
def test_response_is_met_where_it_is_asked_for(lqg, rule, hz):
    law = emulate(lqg, T, rule, match_hz=hz)
    wanted, found = response(lqg, hz)[0], response(law, hz)[0]
    if rule == "tustin":  # in phase too: the rule is a map of frequency
        assert found == pytest.approx(wanted, rel=1e-9)
    assert abs(found) == pytest.approx(abs(wanted), rel=1e-9)


def test_tustin_without_prewarp_meets_zero_frequency(lqg):
    assert response(emulate(lqg, T), 0.0)[0] == pytest.approx(response(lqg, 0.0)[0], rel=1e-9)


def test_roots_of_a_matched_law():
    # Real and complex poles and zeros, one of the zeros in the right half plane; two more poles than zeros.
    p, z = [-3.0, -4.0, -200.0, complex(-0.1, 8.0), complex(-5.0, 60.0)], [-1.0, 2.5, complex(-0.2, 30.0)]
    law = from_roots(p, z)
    matched = emulate(law, T, "matched").sampled
    wanted = np.exp(np.array(all_of(p)) * T)
    np.testing.assert_allclose(np.sort_complex(poles(matched)), np.sort_complex(wanted), rtol=1e-10)
    zeros = np.concatenate([np.exp(np.array(z) * T), [-1.0, -1.0, -1.0]])
    found = transmission_zeros(matched)
    apart = np.abs(found[:, None] - zeros[None])
    # Three zeros at -1 are known to the third root of rounding.
    np.testing.assert_array_less(apart.min(axis=0), [1e-9, 1e-9, 1e-9, 1e-4, 1e-4, 1e-4])
    assert apart.min(axis=1).max() < 1e-4
    assert statespace_response(matched, np.array([0.0]))[0, 0, 0] == pytest.approx(
        statespace_response(law.system, np.array([0.0]))[0, 0, 0], rel=1e-9
    )


@pytest.mark.parametrize("hz", [0.0, 100.0, 124.0])
def test_a_mode_beyond_half_the_rate_does_not_turn_the_sign(hz):
    # 150 Hz at 250 Hz: its sampled pole is met long before 124 Hz, the continuous one is not.
    w = 2.0 * np.pi * 150.0
    law = law_of([[0.0, w], [-w, -0.02 * w]], [[0.0], [w]], [[1.0, 0.0]], 0.0)
    with pytest.warns(UserWarning, match="rings at 150 Hz, half the rate is 125 Hz"):
        sampled = emulate(law, T, "matched", match_hz=hz)
    assert (response(sampled, 0.0)[0] / response(law, 0.0)[0]).real > 0.0
    assert abs(response(sampled, hz)[0]) == pytest.approx(abs(response(law, hz)[0]), rel=1e-9)


def all_of(roots):
    return [r for root in roots for r in ((root, root.conjugate()) if isinstance(root, complex) else (root,))]


def from_roots(p, z):
    """In controller form, for a few roots only."""
    below, above = (np.real(np.poly(all_of(roots))) for roots in (p, z))
    n = len(below) - 1
    A = np.eye(n, k=1)
    A[-1] = -below[:0:-1]
    C = np.zeros((1, n))
    C[0, : len(above)] = above[::-1]
    return law_of(A, np.eye(n)[:, -1:], C, [[0.0]])


def test_slow_roots_keep_their_digits():
    # At 0.01 Hz and 10 kHz a coefficient of z^2 - 2 r cos z + r^2 would keep six digits of the damping.
    w, zeta = 2.0 * np.pi * 0.01, 1e-4
    section = law_of([[0.0, w], [-w, -2.0 * zeta * w]], [[0.0], [w]], [[1.0, 0.3]], [[0.0]])
    found = np.log(poles(emulate(section, 1e-4, "matched").sampled)) / 1e-4
    assert -found.real.max() == pytest.approx(zeta * w, rel=1e-5)  # rounding of z, 1e-16, over 6e-10


@pytest.mark.parametrize("rule", RULES)
def test_all_rules_go_to_the_law_as_the_period_goes_to_zero(lqg, rule):
    hz = np.array([0.5, 3.0, 9.0])
    laws = [emulate(lqg, period, rule) for period in (2.5e-5, 6.25e-6)]
    error = [np.abs(response(law, hz) / response(lqg, hz) - 1.0).max() for law in laws]
    # A hold is late by T/2; Tustin errs by T^2, and so do matched roots with one zero at infinity, at -1.
    assert error[0] / error[1] == pytest.approx(4.0 if rule == "hold" else 16.0, rel=0.15)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("match_hz", [None, 3.0])
def test_a_gain_is_a_gain(rule, match_hz):
    law = Compensator(gain_system(np.array([[-2.5]])), (Port("y", "m"),), (Port("u", "N"),))
    system = emulate(law, T, rule, match_hz=match_hz).sampled
    assert len(system.A) == 0
    np.testing.assert_allclose(system.D, [[-2.5]], rtol=1e-15)


def test_matched_integrator():
    # No gain at zero frequency to meet: beside it.
    law = law_of([[0.0]], [[2.0]], [[-1.0]], [[0.0]])
    assert response(emulate(law, T, "matched"), 0.01)[0] == pytest.approx(response(law, 0.01)[0], rel=1e-3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"period_s": 0.0}, "period"),
        ({"match_hz": 125.0}, "half the rate"),
        ({"match_hz": -1.0}, "half the rate"),
        ({"rule": "euler"}, "no rule"),
    ],
)
def test_what_cannot_be_emulated(lqg, given, message):
    with pytest.raises(ConfigError, match=message):
        emulate(lqg, **{"period_s": T, **given})


@pytest.mark.parametrize("rule", RULES)
def test_a_law_that_rings_faster_than_half_the_rate_is_reported(rule):
    w = 2.0 * np.pi * 7.0
    law = law_of([[0.0, w], [-w, -0.2 * w]], [[0.0], [w]], [[1.0, 0.0]], 0.0)
    emulate(law, 0.5 / 7.1, rule)
    with pytest.warns(
        UserWarning, match=r"rings at 6.965 Hz, half the rate is 6.9 Hz: sampled, it is another"
    ):
        emulate(law, 0.5 / 6.9, rule)


def test_what_rings_too_fast_is_reported_only_where_it_counts():
    w, silent, loud = 2.0 * np.pi * 7.0, [[0.0], [0.0], [1.0]], [[0.0], [5.0], [1.0]]
    for damping, B, reported in ((0.2, loud, True), (-0.8, loud, True), (0.2, silent, False)):
        A = sla.block_diag([[0.0, w], [-w, -damping * w]], 0.0)  # beside an integrator
        law = law_of(A, B, [[1.0, 0.0, 1.0]], 0.0)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            emulate(law, 0.5 / 6.0, "hold")
        assert bool(caught) == reported


def test_matched_is_for_one_channel():
    with pytest.raises(ConfigError, match="one of each"):
        emulate(law_of([[-1.0]], [[1.0, 0.0]], [[1.0]], [[0.0, 0.0]]), T, "matched")
    with pytest.raises(ConfigError, match="zero"):
        emulate(law_of([[-1.0]], [[0.0]], [[1.0]], [[0.0]]), T, "matched")

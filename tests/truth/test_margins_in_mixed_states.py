"""Verdicts and margins in states that mix all modes: integrators that no loop moves, infinite zeros."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.signal
from scipy.optimize import brentq

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.sampled.emulation import emulate
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays
from middeck.systems.poles.stability import growth_rates
from middeck.systems.poles.verdict import is_stable
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system
from repeats import repeats

pytestmark = pytest.mark.kernels

FORCES = (Port("f0", "N"), Port("f1", "N"))
SEEN = tuple(Port(name, unit) for name, unit in (("y0", "m"), ("y1", "m"), ("v0", "m/s"), ("v1", "m/s")))


def mixed(plant: Plant, rng: np.random.Generator) -> Plant:
    """The same in states of which none is a mode's own."""
    system = remove_delays(plant).system
    turn = rng.standard_normal(system.A.shape) * 10.0 ** rng.uniform(-0.5, 0.5, len(system.A))
    A, B = np.linalg.solve(turn, system.A @ turn), np.linalg.solve(turn, system.B)
    return delay_plant(
        dataclasses.replace(remove_delays(plant), dynamics=StateSpace(A, B, system.C @ turn, system.D)),
        plant.delay_s,
    )


def two_bodies_and_a_third(rng: np.random.Generator, unmoved: str) -> Plant:
    """Each force moves a body of 1 kg that its sensors see. A third is pushed by both and seen by none, or
    seen and pushed by none; or there is one of each."""
    more = 2 if unmoved == "both" else 1
    psi = np.vstack([np.eye(2), rng.standard_normal((more, 2))])
    seen = np.hstack([np.eye(2), rng.standard_normal((2, more))])
    if unmoved in ("unseen", "both"):
        seen[:, 2] = 0.0
    if unmoved in ("unpushed", "both"):
        psi[-1] = 0.0
    none = np.zeros_like(seen)
    modal = ModalSystem(
        omega=np.zeros(2 + more),
        zeta=np.zeros(2 + more),
        psi=psi,
        phi=np.vstack([seen, none]),
        phi_rate=np.vstack([none, seen]),
        names=tuple(f"body {k}" for k in range(2 + more)),
    )
    return Plant(dynamics=modal, inputs=FORCES, outputs=SEEN)


def pd(kp: float, kd: float) -> Compensator:
    return Compensator(gain_system(-np.hstack([kp * np.eye(2), kd * np.eye(2)])), SEEN, FORCES)


@pytest.mark.parametrize("unmoved", ["unseen", "unpushed", "both"])
@pytest.mark.parametrize("seed", repeats(range(40), 3))
def test_bodies_that_no_loop_moves_limit_no_gain(seed: int, unmoved: str) -> None:
    """kp + kd s on 1/s^2 bears every gain, and the delay phase / omega where its gain is one."""
    rng = np.random.default_rng([21, seed])
    kp, kd = 10.0 ** rng.uniform(-1.0, 1.0, 2)
    margins = measure_margins(mixed(two_bodies_and_a_third(rng, unmoved), rng), pd(kp, kd))
    w = np.sqrt((kd**2 + np.sqrt(kd**4 + 4.0 * kp**2)) / 2.0)
    assert margins.stable
    for one in margins.loops:
        assert one.gain_limits == (0.0, np.inf)
        assert one.delay_limit_s == pytest.approx(np.arctan2(kd * w, kp) / w, rel=1e-6)


@pytest.mark.parametrize("seed", repeats(range(20), 2))
def test_no_gain_of_an_undamped_position_loop_is_a_limit(seed: int) -> None:
    """Springs between bodies and the ground: omega^2 are eigenvalues of a symmetric matrix at every gain, and
    positive ones. Nothing leaves the axis, and any delay lets it."""
    rng = np.random.default_rng([29, seed])
    count, m = int(rng.integers(1, 4)), 3
    psi = rng.standard_normal((m + count, m))
    modal = ModalSystem(
        omega=np.append(np.zeros(m), rng.uniform(2.0, 40.0, count)),
        zeta=np.zeros(m + count),
        psi=psi,
        phi=psi.T,
        phi_rate=np.zeros_like(psi.T),
        names=tuple(f"mode {k}" for k in range(m + count)),
    )
    forces, seen = (tuple(Port(f"{n}{k}", unit) for k in range(m)) for n, unit in (("f", "N"), ("y", "m")))
    plant = Plant(dynamics=modal, inputs=forces, outputs=seen)
    plant = mixed(plant, rng) if seed % 2 else plant
    law = Compensator(gain_system(-np.diag(rng.uniform(0.5, 5.0, m))), seen, forces)
    margins = measure_margins(plant, law)
    assert margins.stable
    for one in margins.loops:
        assert one.gain_limits == (0.0, np.inf)
        assert one.phase_limit_rad == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("seed", repeats(range(20), 2))
def test_where_poles_of_an_undamped_loop_meet_is_its_limit_of_gain(seed: int, sign: float) -> None:
    """A force on one of two equal bodies, the other seen: s^2 = -a +- (b^2 - k b)^1/2, stable where
    0 <= b^2 - k b <= a^2."""
    rng = np.random.default_rng([30, seed])
    b = 10.0 ** rng.uniform(-2.0, 2.0)
    a = b * (1.0 + 10.0 ** rng.uniform(-1.0, 1.0))
    limit = b if sign > 0.0 else (a * a - b * b) / b
    share = rng.uniform(0.1, 0.9)
    A = np.zeros((4, 4))
    A[:2, 2:], A[2:, :2] = np.eye(2), [[-a, b], [b, -a]]
    pair = StateSpace(A, np.eye(4)[:, 2:3], np.eye(4)[1:2], np.zeros((1, 1)))
    plant = Plant(dynamics=pair, inputs=FORCES[:1], outputs=SEEN[:1])
    plant = mixed(plant, rng) if seed % 2 else plant
    law = Compensator(gain_system(np.array([[-sign * share * limit]])), SEEN[:1], FORCES[:1])
    margins = measure_margins(plant, law)
    assert margins.stable
    assert margins.loops[0].gain_limits == pytest.approx((0.0, 1.0 / share), rel=1e-9)


def test_thousands_of_crossings_on_one_side_of_a_gain_of_one_hide_none_on_the_other() -> None:
    """A late force that damps a growing body, and is seen itself: L = (0.2 s/(s^2 - 0.02 s + 1) + 0.9)
    exp(-s tau) needs a gain that damps, and from 1/0.9 on every half turn of the delay is a limit."""
    tau = 0.05
    grows = StateSpace(
        np.array([[0.0, 1.0], [-1.0, 0.02]]), np.eye(2)[:, 1:], np.array([[0.0, 0.2]]), np.array([[0.9]])
    )
    plant = delay_plant(Plant(dynamics=grows, inputs=FORCES[:1], outputs=SEEN[:1]), tau)
    law = Compensator(gain_system(np.array([[-1.0]])), SEEN[:1], FORCES[:1])
    margins = measure_margins(plant, law)

    def L(w: float) -> complex:
        return (0.2j * w / (1.0 - w * w - 0.02j * w) + 0.9) * np.exp(-1j * w * tau)

    first = brentq(lambda w: L(w).imag, 0.99, 1.01)
    assert margins.stable
    assert margins.loops[0].gain_limits[0] == pytest.approx(-1.0 / L(first).real, rel=1e-9)
    assert margins.loops[0].gain_limits[1] == pytest.approx(1.0 / 0.9, rel=1e-4)


@pytest.mark.parametrize("seed", repeats(range(10), 1))
def test_of_thousands_of_crossings_those_nearest_to_one_are_found(seed: int) -> None:
    """A late force on a damped body: -k L is real and negative where atan(w/c) + w tau is odd half turns."""
    rng = np.random.default_rng([31, seed])
    c, tau = 10.0 ** rng.uniform(-1.0, 0.0), 10.0 ** rng.uniform(0.0, 0.5)
    body = StateSpace(np.array([[-c]]), np.array([[1.0]]), np.array([[1.0]]), np.zeros((1, 1)))
    plant = delay_plant(Plant(dynamics=body, inputs=FORCES[:1], outputs=SEEN[:1]), tau)
    law = Compensator(gain_system(np.array([[-0.5 * c]])), SEEN[:1], FORCES[:1])
    (one,) = measure_margins(plant, law).loops
    turns = np.pi * np.arange(1, 4000, 2)
    w = turns / tau
    for _ in range(60):
        w = (turns - np.arctan2(w, c)) / tau
    exact = np.hypot(w, c) / (0.5 * c)
    assert one.gain_limits[1] == pytest.approx(exact[0], rel=1e-9)
    # 300 at most, and none beyond 80 dB.
    assert one.gain == pytest.approx(exact[exact < 1e4][:300], rel=1e-9)


@pytest.mark.parametrize("unmoved", ["unseen", "unpushed", "both"])
@pytest.mark.parametrize("delay", [0.0, 0.013])
@pytest.mark.parametrize("seed", repeats([24, 29, 9, *range(100, 140)], 2))
def test_bodies_that_no_sampled_loop_moves_change_no_verdict(seed: int, delay: float, unmoved: str) -> None:
    """A body held over T under kp and kd has roots of its own; the gain at which one leaves the circle."""
    rng = np.random.default_rng([22, seed])
    period, (kp, kd) = 0.02, 10.0 ** rng.uniform(-0.5, 0.8, 2)

    def growth(gain: float) -> float:
        """Largest root of one body, its force held and late by less than a period."""
        step, rest = period - delay, np.array([[1.0, period], [0.0, 1.0]])
        now = np.array([0.5 * step**2, step])
        before = np.array([delay * (period - 0.5 * delay), delay])
        A = np.block([[rest, before[:, None]], [np.zeros((1, 3))]])
        A[:, :2] -= gain * np.outer(np.append(now, 1.0), [kp, kd])
        return float(np.abs(np.linalg.eigvals(A)).max()) - 1.0

    plant = mixed(delay_plant(two_bodies_and_a_third(rng, unmoved), delay), rng)
    law = emulate(pd(kp, kd), period)
    assert growth(1.0) < 0.0
    found = decide_stability(plant, law)
    assert (found.stable, found.growing) == (True, 0)
    upper = brentq(growth, 1.0, 1e3, xtol=1e-12)
    for one in measure_margins(plant, law, delays=False).loops:
        assert one.gain_limits[0] == 0.0
        assert one.gain_limits[1] == pytest.approx(upper, rel=1e-6)


def light_body(rng: np.random.Generator, hidden: int) -> tuple[Plant, StateSpace]:
    """Two light modes between two ports, with ``hidden`` bodies that no sensor sees and as many that no force
    pushes; and the modes alone."""
    none, one = np.zeros((2, 2 * hidden)), rng.standard_normal((2, 2 * hidden))
    psi = rng.standard_normal((2, 2))
    unseen = np.arange(2 * hidden) < hidden
    modal = ModalSystem(
        omega=np.append(np.zeros(2 * hidden), 10.0 ** rng.uniform([0.0, 1.0], [0.6, 1.6])),
        zeta=np.append(np.zeros(2 * hidden), 10.0 ** rng.uniform(-2.7, -1.3, 2)),
        psi=np.vstack([np.where(unseen, one, none).T, psi]),
        phi=np.hstack([np.where(unseen, none, one), psi.T]),
        phi_rate=np.zeros((2, 2 * hidden + 2)),
        names=tuple(f"mode {k}" for k in range(2 * hidden + 2)),
    )
    w, z = modal.omega[2 * hidden :], modal.zeta[2 * hidden :]
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(w**2), -2.0 * np.diag(z * w)]])
    alone = StateSpace(A, np.vstack([0.0 * psi, psi]), np.hstack([psi.T, 0.0 * psi]), np.zeros((2, 2)))
    return Plant(dynamics=modal, inputs=FORCES, outputs=SEEN[:2]), alone


@pytest.mark.parametrize("hidden", [1, 2])
@pytest.mark.parametrize("seed", repeats(range(100), 8))
def test_bodies_beside_light_modes_change_no_sampled_verdict(seed: int, hidden: int) -> None:
    """The roots of the modes alone, held over the period by SciPy, decide."""
    rng = np.random.default_rng([24, seed])
    plant, alone = light_body(rng, hidden)
    period, gain, turn = 0.1, 10.0 ** rng.uniform(-1.5, 0.5), rng.choice([-1.0, 1.0])
    Ad, Bd, *_ = scipy.signal.cont2discrete((alone.A, alone.B, alone.C, alone.D), period)
    step = np.eye(2) * turn * gain
    # Velocity by differences: u[k] = g (y[k] - y[k - 1]).
    whole = np.block([[Ad + Bd @ step @ alone.C, -Bd @ step], [alone.C, np.zeros((2, 2))]])
    roots = np.abs(np.linalg.eigvals(whole))
    if np.any(np.abs(roots - 1.0) < 1e-6):
        pytest.skip("too near to the circle for any account")
    none = np.zeros((2, 2))
    law = Compensator(
        SampledStateSpace(none, np.eye(2), -step, step, period_s=period),
        SEEN[:2],
        FORCES,
        method="difference",
    )
    for one in (plant, mixed(plant, rng)):
        found = decide_stability(one, law)
        assert found.growing == int(np.sum(roots > 1.0))
        assert found.stable == (found.growing == 0)
        assert not found.decays


@pytest.mark.parametrize("seed", repeats(range(100), 8))
def test_an_infinite_zero_that_rounding_brings_back_hides_no_peak(seed: int) -> None:
    """Mixed states turn a zero at infinity into one at 1e12 rad/s; beside it every mode looked like rest."""
    rng = np.random.default_rng([25, seed])
    plant, alone = light_body(rng, 1)
    gain = 10.0 ** rng.uniform(-1.0, 0.0) * float(np.linalg.eigvals(alone.A).imag.min() ** 2)
    law = Compensator(gain_system(-0.1 * abs(gain) * np.eye(2)), SEEN[:2], FORCES)
    closed = alone.A - 0.1 * abs(gain) * alone.B @ alone.C
    near = np.abs(np.concatenate([np.linalg.eigvals(alone.A).imag, np.linalg.eigvals(closed).imag]))
    w = np.unique(
        np.concatenate([np.geomspace(1e-2, 1e3, 2000), *(n * np.linspace(0.9, 1.1, 8001) for n in near)])
    )
    G = np.linalg.solve(1j * w[:, None, None] * np.eye(4) - alone.A, alone.B.astype(complex))
    S = np.linalg.inv(np.eye(2) + 0.1 * abs(gain) * alone.C @ G)
    margins = measure_margins(mixed(plant, rng), law)
    for i, one in enumerate(margins.loops):
        # An entry of (1 + L)^-1 is the sensitivity of that loop, the other closed.
        assert one.sensitivity.gain == pytest.approx(np.abs(S[:, i, i]).max(), rel=2e-3)


@pytest.mark.parametrize("period", [0.1, 0.02])
@pytest.mark.parametrize("seed", repeats(range(100), 20))
def test_drifting_states_beside_states_that_decay_do_not_grow(seed: int, period: float) -> None:
    """Bodies at rest that drive, or are driven by, states that decay: their double roots are at one."""
    rng = np.random.default_rng([26, seed])
    bodies, others = int(rng.integers(1, 3)), int(rng.integers(1, 5))
    still = np.kron(np.eye(bodies), [[1.0, period], [0.0, 1.0]])
    decaying = np.diag(rng.uniform(-0.9, 0.9, others)) + np.triu(rng.standard_normal((others, others)), 1)
    driven = rng.standard_normal((others, 2 * bodies))
    A = np.block([[still, np.zeros((2 * bodies, others))], [driven, decaying]])
    A = A if seed % 2 else A[::-1, ::-1].T
    turn = rng.standard_normal(A.shape) * 10.0 ** rng.uniform(-0.5, 0.5, len(A))
    A = np.linalg.solve(turn, A @ turn)
    system = SampledStateSpace(
        A, np.zeros((len(A), 1)), np.zeros((1, len(A))), np.zeros((1, 1)), period_s=period
    )
    assert is_stable(system)
    assert np.sum(np.abs(growth_rates(system)) < 1e-9) == 2 * bodies

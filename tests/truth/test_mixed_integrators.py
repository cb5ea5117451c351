"""A body's place and rate, read through states that mix displacements with rates at random."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg as sla
from tests.repeats import repeats

import middeck as md
from middeck.control.analysis.loop.feedback_loop import At, evaluate_halves, form_loop, go_round
from middeck.control.analysis.margins.shared_gain import closed_round
from middeck.systems.poles.integrators import part_integrators
from middeck.systems.poles.stability import growth_rates
from middeck.systems.poles.verdict import is_stable
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system


def _mixture(rng: np.random.Generator, states: int) -> np.ndarray:
    while np.linalg.cond(T := rng.standard_normal((states, states))) > 300.0:
        pass
    return T


def _mixed_body(rng: np.random.Generator, read: str) -> tuple[StateSpace, float]:
    """A free body among light modes to 1000 rad/s, in mixed states; and the push on what is read of it."""
    count = int(rng.integers(2, 9))
    omega = np.concatenate([[0.0], 10.0 ** rng.uniform(2.5, 3.0, count - 1)])
    push, shape = rng.standard_normal(count), rng.standard_normal(count)
    A, C = np.zeros((2 * count, 2 * count)), np.zeros((1, 2 * count))
    A[::2, 1::2], A[1::2, ::2], A[1::2, 1::2] = np.eye(count), np.diag(-(omega**2)), np.diag(-0.002 * omega)
    C[0, 1::2] = shape * (omega > 0.0)
    C[0, 0 if read == "place" else 1] = shape[0]
    B = np.zeros((2 * count, 1))
    B[1::2, 0] = push
    T = _mixture(rng, 2 * count)
    mixed = StateSpace(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T, np.zeros((1, 1)))
    return mixed, float(shape[0] * push[0])


@pytest.mark.parametrize("read", ["place", "rate"])
@pytest.mark.parametrize("seed", repeats([474, *range(800)], 20))
def test_a_place_is_seen_and_a_rate_shows_none(read: str, seed: int) -> None:
    mixed, push = _mixed_body(np.random.default_rng(seed), read)
    residues = part_integrators(mixed).residues[:, 0, 0]
    assert len(residues) == 2
    if read == "rate":
        assert residues[0] == pytest.approx(push, rel=1e-4)
        assert residues[1] == 0.0
    else:
        assert residues[1] == pytest.approx(push, rel=0.05)


def _two_motors(
    rng: np.random.Generator, delay_s: float, period_s: float | None
) -> tuple[md.Plant, md.Compensator, float]:
    """A free body with a mode of 3.5 Hz in mixed states under u = K y, and K_1 b_1 / (K_2 b_2)."""
    A, B, C = np.zeros((4, 4)), np.zeros((4, 2)), np.zeros((1, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[3, 2:] = -490.0, -3.0
    B[1::2], C[0, ::2] = rng.standard_normal((2, 2)), (1.0, rng.standard_normal())
    K, T = np.array([[-2.0], [-3.0]]), _mixture(rng, 4)
    plant = md.make_plant(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T, delay_s=delay_s)
    system = gain_system(K)
    if period_s is not None:
        system = SampledStateSpace(system.A, system.B, system.C, K, period_s=period_s)
    return plant, md.Compensator(system, plant.outputs, plant.inputs), 2.0 * B[1, 0] / (3.0 * B[1, 1])


@pytest.mark.parametrize("delay_s", [0.0, 0.1])
@pytest.mark.parametrize("period_s", [None, 0.12])
@pytest.mark.parametrize("seed", repeats(range(40), 2))
def test_two_loops_share_a_free_body(seed: int, period_s: float | None, delay_s: float) -> None:
    """Alone both grow as b / s^2; with the other closed L_1 goes to K_1 b_1 / (K_2 b_2)."""
    plant, law, share = _two_motors(np.random.default_rng(seed), delay_s, period_s)
    L = md.control.trace_return_ratio(plant, law, frequency_hz=np.geomspace(1e-9, 1e-6, 7)).L
    assert L[:, 0] == pytest.approx(share, rel=1e-5)
    assert L[:, 1] == pytest.approx(1.0 / share, rel=1e-5)


@pytest.mark.parametrize("at", ["inputs", "outputs", "both"])
@pytest.mark.parametrize("period_s", [None, 0.12])
def test_the_closed_loop_gives_the_sensitivity_of_its_halves(period_s: float | None, at: At) -> None:
    plant, law, _ = _two_motors(np.random.default_rng(0), 0.1, period_s)
    loop, s = form_loop(plant, law), 2j * np.pi * np.geomspace(0.1, 1.5, 5)
    P = go_round(*evaluate_halves(loop)(s), at)
    one = np.eye(P.shape[1])
    assert closed_round(loop, at)(s) + one == pytest.approx(np.linalg.inv(one - P), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("unit", [1.0, 1e5])
@pytest.mark.parametrize(("share", "known"), [(1e-6, 1e-3), (1e-7, 0.1)])
@pytest.mark.parametrize("seed", range(5))
def test_a_slow_pole_of_mixed_states_is_no_integrator(
    seed: int, share: float, known: float, unit: float
) -> None:
    """A pole at ``share`` of the fastest grows: sigma of A is its square, and known to 1e-16."""
    rng = np.random.default_rng([11, seed])
    fast, slow = unit, share * unit
    A = np.diag([0.0, 0.0, -fast, -0.5 * fast, -0.2 * fast])
    A[0, 1], A[1, 0] = fast, slow**2 / fast
    turn, _ = np.linalg.qr(rng.standard_normal((5, 5)))
    mixed = StateSpace(turn @ A @ turn.T, np.ones((5, 1)), np.ones((1, 5)), np.zeros((1, 1)))
    assert growth_rates(mixed).real.max() == pytest.approx(slow, rel=known)
    assert not len(part_integrators(mixed).residues)


@pytest.mark.kernels
def test_a_sampled_free_body_of_mixed_states_does_not_grow(campaign: Callable[[int], range]) -> None:
    """At 10 kHz rounding of A - 1 is larger than of A, and beyond 1e4 nothing is known: 1 of 800 grows.

    Bodies among light modes to 16 Hz. With the threshold of A it was one of eight.
    """
    seeds, grow = campaign(800), 0
    for seed in seeds:
        rng = np.random.default_rng([6, seed])
        blocks = [np.eye(2, k=1)] * int(rng.integers(1, 4))
        for w in 10.0 ** rng.uniform(0.0, 2.0, 4):
            blocks.append(np.array([[0.0, w], [-w, -0.02 * w]]))
        A = sla.expm(1e-4 * np.asarray(sla.block_diag(*blocks)))
        turns = [np.linalg.qr(rng.standard_normal(A.shape))[0] for _ in "ab"]
        T = turns[0] @ np.diag(np.geomspace(1.0, 1e4, len(A))) @ turns[1]
        mixed, one = T @ A @ np.linalg.inv(T), np.ones((len(A), 1))
        grow += not is_stable(SampledStateSpace(mixed, one, one.T, [[0.0]], period_s=1e-4))
    assert grow <= 0.03 * len(seeds)


@pytest.mark.parametrize("delay_s", [0.0, 0.002])
@pytest.mark.parametrize("condition", [1.0, 30.0])
def test_rms_from_zero_of_what_sees_modes_only(delay_s: float, condition: float) -> None:
    """A body and a mode that one force moves: the place of the body drifts, a strain gauge has an rms."""
    rng = np.random.default_rng(3)
    U, V = (np.linalg.qr(rng.standard_normal((4, 4)))[0] for _ in range(2))
    T = U @ np.diag(np.geomspace(1.0, condition, 4)) @ V if condition > 1.0 else np.eye(4)
    w0, zeta = 7.0, 0.01
    A = np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, -(w0**2), -2.0 * zeta * w0]], dtype=float)
    B, C = np.array([[0.0], [1.0], [0.0], [0.6]]), np.array([[1.0, 0.0, 0.6, 0.0], [0.0, 0.0, 0.6, 0.0]])
    ports = ["place", "gauge"]
    mixed = np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T
    bare = md.make_plant(*mixed, inputs=["force"], outputs=ports, delay_s=delay_s)
    plant = md.systems.group_ports(bare, w=["force"], u=["force"], z=ports, y=ports)
    rms = md.measure_rms(plant, None, md.Performance(np.ones(2), np.eye(1), (0.0, 1e3)))
    assert rms[0] == np.inf
    # All of a light mode is within the band: the integral over all frequencies is 1 / (4 zeta w0^3).
    assert rms[1] == pytest.approx(0.36 / np.sqrt(4.0 * zeta * w0**3), rel=1e-6)


@pytest.mark.parametrize("condition", [1e2, 1e4, 1e5])
def test_parted_modes_respond_as_given_or_are_refused(condition: float) -> None:
    """Where rounding of mixed states hides a body's integrators, its modes came out at other frequencies."""
    rng, refused = np.random.default_rng(8), 0
    for _ in range(6):
        omega = np.sort(rng.uniform(1.0, 80.0, 3))
        A = sla.block_diag([[0.0, 1.0], [0.0, 0.0]], *([[0.0, 1.0], [-(w**2), -0.02 * w]] for w in omega))
        B, C = np.zeros((8, 1)), np.zeros((1, 8))
        B[1::2, 0], C[0, ::2] = rng.standard_normal(4), rng.standard_normal(4)
        U, V = (np.linalg.qr(rng.standard_normal((8, 8)))[0] for _ in range(2))
        T = U @ np.diag(np.geomspace(1.0, condition, 8)) @ V
        plant = md.make_plant(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T)
        try:
            found = md.systems.part_modes(plant)
        except md.MiddeckError:
            refused += 1
            continue
        moving = np.sort(np.imag(np.linalg.eigvals(found.system.A)))[-3:]
        assert moving == pytest.approx(omega * np.sqrt(1.0 - 0.01**2), rel=1e-2)
    assert refused == 0 or condition > 1e4


def test_peaks_of_a_body_in_strongly_mixed_states() -> None:
    """A body whose integrators rounding hides stays in the return ratio: the peak was 1 where it is 6.6."""
    rng = np.random.default_rng(21)
    law = StateSpace([[-6.0]], [[1.0]], [[1.0]], [[-0.2]])
    judged, s = 0, 1j * np.geomspace(1e-2, 1e3, 20001)
    for _ in range(12):
        omega, push = np.sort(rng.uniform(4.0, 80.0, 3)), rng.standard_normal(3)
        A = sla.block_diag([[0.0, 1.0], [0.0, 0.0]], *([[0.0, 1.0], [-(w**2), -0.02 * w]] for w in omega))
        B, C = np.zeros((8, 1)), np.zeros((1, 8))
        B[1::2, 0] = C[0, ::2] = [1.0, *push]
        U, V = (np.linalg.qr(rng.standard_normal((8, 8)))[0] for _ in range(2))
        T = U @ np.diag(np.geomspace(1.0, 1e5, 8)) @ V
        plant = md.make_plant(np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                found = md.measure_margins(plant, md.Compensator(law, plant.outputs, plant.inputs))
            except (md.MiddeckError, UserWarning):
                continue
        modes = np.sum(push**2 / (s[:, None] ** 2 + 0.02 * omega * s[:, None] + omega**2), axis=1)
        L = -(1.0 / s**2 + modes) * (1.0 / (s + 6.0) - 0.2)
        # Lines a thousandth apart: the peak, of width 0.2, to 1e-5.
        assert found.loops[0].sensitivity.gain == pytest.approx(np.max(1.0 / np.abs(1.0 + L)), rel=1e-2)
        judged += 1
    assert judged

"""Proofs beside a hold, where limits of the law act before those of the sum; of what swings on none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
from scipy.signal import fftconvolve
from test_gate import design_sampled_lqg, unit_weights
from test_recovery_proof import SLOW_S, STARTS, drawn

from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.gate import limited_loop, multipliers, reached_limits
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.package_with_hold import drives_of, with_hold
from middeck.realtime.gate.recovery_proof import why_unproved
from middeck.realtime.gate.steps_without_rig import GateMargins
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.package_law import package_law
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from repeats import repeats


def beside(seed, outputs):
    """The law of `drawn` without limits of slew beside gains that leave the loop stable, with and without it.

    Package beside the hold, its drives, plant, sampled matrices, the hold's gains and the drives' limits.
    """
    rng, p = np.random.default_rng([31, seed]), outputs
    package, plant, (F, G, C) = drawn(seed, p)
    package, c = dataclasses.replace(package, slew=np.full(p, np.inf), vectors=None), package.core
    while True:
        hold = tuple(
            LoopPath(
                i, int(rng.integers(p)), static_gain(rng.standard_normal() * 10.0 ** rng.uniform(-1.0, 1.5))
            )
            for i in range(p)
        )
        P = np.zeros((p, p))
        for path in hold:
            P[path.output, path.input] += path.section.b[0]
        loop = np.block([[F + G @ (P + c.D) @ C, G @ c.C], [c.B @ C, c.A]])
        radii = [np.abs(np.linalg.eigvals(M)).max() for M in (loop, F + G @ P @ C)]
        if radii[0] < 1.0 - 1e-3 and radii[1] < 1.0 - 1e-4:
            break
    drives = engine_of(package, hold, 10.0 ** rng.uniform(-1.5, 0.3, p), SLOW_S, 1.0)
    held = with_hold(package, drives)
    return held, drives_of(held, drives), plant, (F, G, C), P


def engine_of(package, hold, limits, period_s, reach):
    sensors = tuple(SensorTest(port=port, range=reach) for port in package.inputs)
    drives = tuple(
        Drive(port=port, lower=-limit, upper=limit)
        for port, limit in zip(package.outputs, limits, strict=True)
    )
    return EngineSettings(period_s=period_s, sensors=sensors, drives=drives, hold=hold)


def run(held, drives, matrices, P, x, samples):
    """Magnitudes of sensors, of the law's commands and of the sums, limited one after the other."""
    (F, G, C), c = matrices, held.core
    first, then = held.upper[:, None], np.array([drive.upper for drive in drives])[:, None]
    z, seen = np.zeros((len(c.A), x.shape[1])), np.empty((3, samples, len(C), x.shape[1]))
    for k in range(samples):
        y = C @ x
        own, hold = c.C @ z + c.D @ y, P @ y
        asked = hold + np.clip(own, -first, first)
        u = np.clip(asked, -then, then)
        seen[:, k] = y, own, asked
        z, x = c.A @ z + c.B @ y + c.E @ (u - hold - own), F @ x + G @ u
    return np.abs(seen)


def swinging(seed, outputs):
    """Peaks of the least motion that goes on; None where all of twelve come to rest."""
    held, drives, _, matrices, P = beside(seed, outputs)
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((4, STARTS)) * 10.0 ** rng.uniform(-2.0, 2.0, STARTS)
    seen = run(held, drives, matrices, P, x, 3000)
    first, last = seen[0, 1500:2000].max(axis=(0, 1)), seen[0, 2500:].max(axis=(0, 1))
    on = np.flatnonzero((last > 0.97 * first) & (last > 1e-6) & np.isfinite(last))
    return seen[:, 1500:, :, on[np.argmin(last[on])]].max(axis=1) if len(on) else None


FOUND = [(1054, 2), (1058, 2), (1094, 2)]


@pytest.mark.parametrize(
    ("seed", "outputs"), repeats([*FOUND, *((s, p) for s in range(20) for p in (1, 2))], 2)
)
def test_no_law_that_swings_on_beside_a_hold_is_proved_harmless(seed, outputs):
    """With the sensors' ranges no larger than the motion that goes on, whose commands are within bounds."""
    held, drives, plant, _, _ = beside(seed, outputs)
    found = swinging(seed, outputs)
    assert found is not None or (seed, outputs) not in FOUND
    if found is None:
        return
    reads, own, asked = found
    reached = dataclasses.replace(held, input_range=1.001 * reads, vectors=None)
    assert why_unproved(reached, plant, drives=drives)
    parts = limited_loop.split_loop(reached, plant)
    limits = np.array([drive.upper for drive in drives])
    bound = reached_limits.bound_commands(reached, parts, limits)
    assert np.all(np.concatenate([own, asked]) <= bound)
    assert np.all(bound < 20.0 * np.concatenate([own, asked]))


@pytest.mark.parametrize(("seed", "outputs"), repeats([(0, 2), (3, 1), (4, 2), (6, 1)], 2))
def test_laws_beside_a_hold_that_come_to_rest_are_proved(seed, outputs):
    """Limits of both kinds are reached within the ranges; a limit of slew beside a hold is refused."""
    held, drives, plant, _, _ = beside(seed, outputs)
    assert swinging(seed, outputs) is None
    assert why_unproved(held, plant, drives=drives) == ""
    slow = dataclasses.replace(held, slew=np.full(outputs, 0.1), vectors=None)
    assert why_unproved(slow, plant, drives=drives) == "beside a hold limits of slew are not proved"


def test_the_sum_of_both_limits_is_that_of_the_motions():
    """By Parseval, in time, of a loop that is simulated with what either limit holds back."""
    p, count = 2, 1 << 13
    held, _, plant, (F, G, C), P = beside(1058, p)
    first, rng = np.array([0.5, 2.0]), np.random.default_rng(2)
    loop = limited_loop.close_loop(limited_loop.split_loop(held, plant), first)
    limits = [reached_limits.Limit(i, False, 0.7 - 0.1 * i) for i in range(2 * p)]
    forces = np.zeros((count, 2 * p))
    forces[:30] = rng.standard_normal((30, 2 * p))
    x, c = np.zeros(len(F)), held.core
    z, asked = np.zeros(len(c.A)), np.zeros((count, 2 * p))
    for k in range(count):
        y = C @ x
        own, hold = c.C @ z + c.D @ y, P @ y
        through = own - first * forces[k, :p]
        u = hold + through - forces[k, p:]
        asked[k] = *(own / first), *(hold + through)
        z, x = c.A @ z + c.B @ y + c.E @ (u - hold - own), F @ x + G @ u
    moved = asked - forces
    weights = rng.uniform(0.0, 1.0, (2 * p, 64))
    weights[:, [1 + 15 * k + 6 + j for k in range(4) for j in range(6, 9)]] = 0.0  # longer than the sum
    weights[:, 62:] = 0.0  # forces of two kinds on one limit
    taps = np.arange(1, count)
    h = [np.eye(1, count, n)[0] for n in multipliers.DELAYS]
    h += [np.append(0.0, (1.0 - a) * a ** (taps - 1)) for a in multipliers.DECAYS]
    total = 0.0
    for limit, w, f, v, by in zip(limits, weights, forces.T, moved.T, asked.T, strict=True):
        late = [f @ fftconvolve(k, v)[:count] for k in h]
        early = [fftconvolve(k, f)[:count] @ v for k in h]
        both, one = np.array([*early, *late]), f @ v
        total += w[0] * one + w[1:31] @ (one - both) + w[31:61] @ (one + both)
        total += w[61] * f @ (limit.sector * by - f)
    omega, seen = 2.0 * np.pi * np.arange(count) / count, np.fft.fft(forces, axis=0)
    form = multipliers.form_sum(loop, limits, omega).sum(weights)
    found = 0.5 * np.real(np.einsum("zi,zij,zj->", seen.conj(), form, seen)) / count
    assert found == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize(("drive", "passes"), repeats([(0.3, False), (1.0, True)]))
def test_a_law_that_is_unstable_by_itself_passes_beside_a_hold_with_a_proof_only(drive, passes):
    """Poles outside the unit circle, a hold of a little stiffness, and drives that leave sums less room."""
    A = sla.block_diag(*([[0.0, w], [-w, -0.02 * w]] for w in (6.923, 29.18)))
    system = StateSpace(A, [[0.0], [1.0], [0.0], [0.7]], [[1.0, 0.0, -2.96, 0.0]], [[0.0]])
    way, push = (Port("way", "m"),), (Port("push", "N"),)
    named = {"w": ("push",), "u": ("push",), "z": ("way",), "y": ("way",)}
    plant = Plant(dynamics=system, inputs=push, outputs=way, **named)
    law = design_sampled_lqg(plant, unit_weights(("push",), 3.57e-4), 1.298e5, 0.04)
    package = package_law(law, "law", input_range=0.01, limit=1.0, unstable=True)
    engine = engine_of(package, (LoopPath(0, 0, static_gain(-0.5)),), [drive], 0.04, 0.01)
    margins = GateMargins(gain_db=3.0, phase_deg=5.0)
    verdict = examine_package(package, {"modes": plant}, margins, settings=engine)
    last = verdict.steps[-1]
    assert (verdict.passed, last.name) == (passes, "recovery modes")
    assert ("proved for limits that come and go, at full authority" in last.said) == passes
    assert ("not proved to recover: no multipliers are found" in last.said) != passes

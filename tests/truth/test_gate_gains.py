"""At each adaptive gain the gate judges the law that the engine runs, which learns what is applied."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
from test_gate import ANY, gain_package, one_port

from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.gate.gain_recovery import at_gain, stable_at_every_gain
from middeck.realtime.gate.gate import ONE_GAIN, examine_package
from middeck.realtime.gate.recovery_step import check_recovery
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.single_precision import to_single
from middeck.realtime.package.vectors import add_test_vectors
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from packaged_laws import ports, random_law
from repeats import repeats

SLOW_S = 0.02


def up_to(most, rate=0.01):
    return AdaptiveGain(maximum=most, rate=rate, sensor="y0", band_hz=(1.0, 5.0), quiet_rms=0.1, loud_rms=1.0)


def test_a_law_at_a_gain_is_what_the_engine_computes():
    """Sample by sample, with a filter, an inner loop and limits: u = p + g c, and e = u - p - c is learnt."""
    rng = np.random.default_rng(4)
    section = Section(np.array([0.2, 0.3, 0.1]), np.array([-0.5, 0.2]))
    package = package_law(random_law(rng, 5, 2, 2), "law", filters=(InputFilter(1, section),), form="dense")
    package = add_test_vectors(dataclasses.replace(package, paths=(LoopPath(0, 1, section),), vectors=None))
    for gain in (0.0, 0.3, 1.0, 2.5):
        silent = dataclasses.replace(package.core, C=0.0 * package.core.C, D=0.0 * package.core.D)
        inner, law = (
            ReferenceLaw(dataclasses.replace(package, core=silent, vectors=None)),
            ReferenceLaw(package),
        )
        limited = dataclasses.replace(at_gain(package, gain), upper=np.full(2, 2.0), lower=-np.full(2, 2.0))
        same = ReferenceLaw(limited)
        law.level = same.level = package.ramp
        for y in rng.standard_normal((80, 2)):
            law.compute(y)
            inner.compute(y)
            applied = np.clip(inner.wanted + gain * (law.wanted - inner.wanted), -2.0, 2.0)
            np.testing.assert_allclose(same.step(y), applied, rtol=1e-9, atol=1e-12)
            law.commit(applied)
            inner.commit(inner.wanted)


def observer(seed, crossed):
    """LQG of two motors and light modes; ``crossed``: one that mistakes what its motors do."""
    rng = np.random.default_rng([24, seed])
    k, p = rng.integers(1, 3), rng.integers(1, 3)
    w, d = 2.0 * np.pi * 10.0 ** rng.uniform(-0.5, 1.0, k), 10.0 ** rng.uniform(-2.5, -1.0, k)
    A = sla.block_diag(*([[0.0, f], [-f, -2.0 * q * f]] for f, q in zip(w, d, strict=True)))
    B, C = np.zeros((2 * k, p)), np.zeros((p, 2 * k))
    B[1::2], C[:, ::2] = rng.standard_normal((k, p)), rng.standard_normal((p, k))
    both = sla.expm(np.block([[A, B], [np.zeros((p, 2 * k + p))]]) * SLOW_S)
    F, G = both[: 2 * k, : 2 * k], both[: 2 * k, 2 * k :]
    R, N = np.eye(p) * 10.0 ** rng.uniform(-4.0, 0.0), np.eye(p) * 10.0 ** rng.uniform(-6.0, 0.0)
    P, S = sla.solve_discrete_are(F, G, C.T @ C, R), sla.solve_discrete_are(F.T, C.T, G @ G.T, N)
    K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    L = np.linalg.solve(N + C @ S @ C.T, C @ S @ F.T).T
    E = G @ (np.eye(p) + np.random.default_rng(seed).uniform(-2.0, 2.0, (p, p))) if crossed else G
    law = SampledStateSpace(F - L @ C - G @ K, L, -K, np.zeros((p, p)), period_s=SLOW_S)
    y, u = ports(0, p, p)
    package = package_law(Compensator(law, y, u, applied=E), "law", input_range=1.0, limit=1.0, form="dense")
    return package, Plant(dynamics=StateSpace(A, B, C, np.zeros((p, p))), inputs=u, outputs=y), (F, G, C)


def grown(package, matrices, gain, weak):
    """By what the motion grows in 12 s while a motor gives nothing, of the law sample by sample."""
    (F, G, C), law = matrices, ReferenceLaw(dataclasses.replace(package, input_range=np.full(2, np.inf)))
    x, seen = np.random.default_rng(0).standard_normal(len(F)), []
    for _ in range(600):
        y = C @ x
        law.compute(y)
        u = gain * law.wanted * (np.arange(2) != weak)
        law.commit(u)
        x = F @ x + G @ u
        seen.append(np.abs(y).max())
    return max(seen[-100:]) / max(seen[:100])


@pytest.mark.parametrize(
    ("seed", "crossed", "weak"),
    repeats([(5097, True, 0), (1, False, 0), (7167, True, 1), (7167, True, 0), (5, False, 1)], 3),
)
def test_recovery_at_a_gain_is_that_of_the_law_that_learns_what_is_applied(seed, crossed, weak):
    """Crossed, a weak motor is harmless at the gain of one and not at two; LQG recovers at each.

    Learnt as if the gain belonged to the law, both were judged the other way round.
    """
    package, plant, matrices = observer(seed, crossed)
    assert grown(package, matrices, 1.0, weak) < 0.9
    twice = {k: grown(package, matrices, 2.0, k) for k in (0, 1)}
    recovers = max(twice.values()) < 0.9
    assert recovers != crossed
    assert recovers or max(twice.values()) > 10.0
    found = check_recovery(at_gain(package, 2.0), "modes", plant, held=False, alone=None)
    assert found.passed == recovers, found.said


def own_growth(package, gain):
    """Of the law alone on a quiet article, over 400 samples after as many."""
    law, sizes = ReferenceLaw(package), []
    law.x = np.random.default_rng(1).standard_normal(len(law.x))
    for _ in range(800):
        law.compute(np.zeros(len(package.inputs)))
        law.commit(gain * law.wanted)
        sizes.append(np.linalg.norm(law.x))
    return max(sizes[-50:]) / max(sizes[350:400])


@pytest.mark.parametrize(("seed", "stable"), [(18, False), (137, False), (16, True), (7, True)])
def test_a_law_that_is_unstable_by_itself_at_one_of_its_gains_gets_none(seed, stable):
    """Poles inside the unit circle at a gain of one, of which the package is declared, and outside at two."""
    package, plant, _ = observer(seed, False)
    assert own_growth(package, 1.0) < 1.0
    assert (own_growth(package, 2.0) < 1.0) == stable
    assert stable_at_every_gain(package, up_to(2.0)) == stable
    assert stable_at_every_gain(package, up_to(1.0))
    if not stable:
        steps = examine_package(package, {"modes": plant}, ANY, gain=up_to(2.0)).steps
        assert [step.said for step in steps if not step.passed] == [ONE_GAIN]


def test_a_law_in_single_precision_is_judged_at_its_gains():
    """It was refused halfway as if its numbers at a gain, which are of no package, had too many digits."""
    package = to_single(gain_package(-0.1))
    lag = one_port(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]))
    verdict = examine_package(package, {"lag": lag}, ANY, gain=up_to(1.0))
    assert verdict.passed, verdict.steps
    assert verdict.steps[-1].name == "recovery lag at gains from 0 to 1"

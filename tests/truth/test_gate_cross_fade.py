"""The gate tries the fade from one package to another as the engine carries it out, on every model."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import scipy.linalg as sla

from engine_campaigns import seeds_of
from engine_cases import OUTPUTS, SENSORS, plain_settings, static_package, still_article
from middeck.control.law.compensator import Compensator
from middeck.realtime.engine.interface.adaptive_gain import AdaptiveGain
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.gate import cross_fade
from middeck.realtime.gate.adaptive import prove_gain
from middeck.realtime.gate.cross_fade import check_cross_fade, fade_points
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.linear_law import faded_laws
from middeck.realtime.gate.package_with_hold import with_hold
from middeck.realtime.gate.steps_on_rig import GateTrials
from middeck.realtime.gate.steps_without_rig import GateMargins
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.package_bytes import hash_package
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import fade_at
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from ungated import Supervisor

PERIOD_S = 0.01
ANY = GateMargins(gain_db=0.0, phase_deg=0.0)
WAY, RATE, PUSH, TURN = Port("way", "m"), Port("rate", "m/s"), Port("push", "N"), Port("turn", "N m")


def packaged(name, law, reads, drives, applied=None, **changes):
    compensator = Compensator(law, reads, drives, applied=applied)
    return package_law(compensator, name, form="dense", input_range=1.0, limit=1.0, **changes)


def engine_of(hold=(), **changes):
    return EngineSettings(
        period_s=PERIOD_S,
        sensors=tuple(SensorTest(port=port, range=1.0) for port in (WAY, RATE)),
        drives=tuple(Drive(port=port, lower=-1.0, upper=1.0) for port in (PUSH, TURN)),
        hold=hold,
        **changes,
    )


def observer(rng, reads, drives, *, gain=1.0):
    """A random law that estimates from the command applied."""
    m, p = len(reads), len(drives)
    A, E = 0.4 * rng.standard_normal((3, 3)), 0.3 * rng.standard_normal((3, p))
    law = SampledStateSpace(
        A, rng.standard_normal((3, m)), gain * rng.standard_normal((p, 3)),
        gain * rng.standard_normal((p, m)), period_s=PERIOD_S,
    )  # fmt: skip
    return law, E


def sample_by_sample(plant, parts, hold):
    """The map of a sample of the whole loop, column by column: what the engine does, written out here."""
    A, B, C = plant
    n = len(A)
    sizes = [n, *(len(law.A) for law, *_ in parts)]
    starts = np.cumsum([0, *sizes])

    def step(z):
        x = z[:n]
        y, s = C @ x, np.zeros(B.shape[1])
        states = [z[a:b] for a, b in itertools.pairwise(starts[1:])]
        wanted = []
        for (law, _, reads, drives, fade), own in zip(parts, states, strict=True):
            c = law.C @ own + law.D @ y[reads]
            wanted.append(c)
            s[drives] += fade * c
        then = [A @ x + B @ (s + hold @ y)]
        for (law, E, reads, drives, _), own, c in zip(parts, states, wanted, strict=True):
            then.append(law.A @ own + law.B @ y[reads] + E @ (s[drives] - c))
        return np.concatenate(then)

    return np.column_stack([step(column) for column in np.eye(int(starts[-1]))])


def test_the_mixture_is_what_the_engine_computes():
    """Random laws on other and on common ports, each learning what both apply, beside a hold."""
    rng = np.random.default_rng(2)
    plant = rng.standard_normal((4, 4)), rng.standard_normal((4, 2)), rng.standard_normal((2, 4))
    first, E = observer(rng, (WAY, RATE), (PUSH,))
    second, G = observer(rng, (RATE,), (TURN, PUSH))
    names = "first", "second"
    packages = [
        packaged(names[0], first, (WAY, RATE), (PUSH,), E, unstable=True),
        packaged(names[1], second, (RATE,), (TURN, PUSH), G, unstable=True),
    ]
    hold = np.array([[0.0, 0.3], [-0.4, 0.0]])
    paths = (LoopPath(1, 0, static_gain(0.3)), LoopPath(0, 1, static_gain(-0.4)))
    held = [with_hold(packages[0], engine_of(paths)), packages[1]]
    for old, new in ((1.0, 0.0), (0.784, 0.216), (0.3, 0.9)):
        made = faded_laws(held)([old, new])
        assert (made.inputs, made.outputs) == ((WAY, RATE), (PUSH, TURN))
        s = made.sampled
        A, B, C = plant
        loop = np.block([[A + B @ s.D @ C, B @ s.C], [s.B @ C, s.A]])
        by_hand = sample_by_sample(
            plant,
            [(first, E, [0, 1], [0], old), (second, G, [1], [1, 0], new)],
            hold,
        )
        expected = np.append(np.poly(by_hand), np.zeros(4))  # states of two static sections
        assert np.allclose(np.poly(loop), expected, rtol=1e-9, atol=1e-9)


def largest_pole(plant, parts):
    """Of the loop of sampled laws, each (law, E, reads, drives, fade)."""
    system, n = plant.dynamics, len(plant.dynamics.A)
    both = sla.expm(np.block([[system.A, system.B], [np.zeros((2, n + 2))]]) * PERIOD_S)
    own = both[:n, :n], both[:n, n:], system.C
    return np.abs(np.linalg.eigvals(sample_by_sample(own, parts, np.zeros((2, 2))))).max()


def cross(name, row, column, gain, **changes):
    """Drives one lag of two by the other, with ``gain``."""
    D = np.zeros((2, 2))
    D[row, column] = gain
    law = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), D, period_s=PERIOD_S)
    return packaged(name, law, (WAY, RATE), (PUSH, TURN), **changes)


LAGS = {"lags": Plant(
    dynamics=StateSpace(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2))),
    inputs=(PUSH, TURN), outputs=(WAY, RATE),
)}  # fmt: skip


def crossing(rng, row, gain):
    """A random observer beside a gain that drives one lag by the other."""
    law, E = observer(rng, (WAY, RATE), (PUSH, TURN), gain=0.03)
    D = law.D.copy()
    D[row, 1 - row] += gain
    return SampledStateSpace(0.8 * law.A, law.B, law.C, D, period_s=PERIOD_S), E


def test_no_cross_fade_that_grows_on_a_model_passes():
    """The gate agrees with the eigenvalues of loops written out here; both ends are stable."""
    points, places, judged = fade_points(0, 0, engine_of()), ([0, 1], [0, 1]), []
    for seed in seeds_of("cross-fades that grow"):
        rng = np.random.default_rng(seed)
        laws = [crossing(rng, row, rng.uniform(1.0, 3.0)) for row in (0, 1)]
        radii = [
            largest_pole(LAGS["lags"], [(*law, *places, fade) for law, fade in zip(laws, pair, strict=True)])
            for pair in points
        ]
        stable = max(radii) < 1.0
        if max(radii[0], radii[-1]) >= 1.0 or (stable and stable in judged):
            continue  # one that passes takes its time
        old, new = (
            packaged(name, law, (WAY, RATE), (PUSH, TURN), E, unstable=True)
            for name, (law, E) in zip(("old", "new"), laws, strict=True)
        )
        (step,) = check_cross_fade(old, new, LAGS, ANY, engine_of())
        assert step.passed == stable, (seed, step.said, max(radii))
        judged.append(stable)
    assert len(set(judged)) == 2


def test_two_stable_loops_whose_mean_is_not():
    """Two lags of 1/s, crossed one way or the other, decay; together they grow where g sqrt(f1 f2) > 1."""
    below, old, new = cross("old", 0, 1, 1.9), cross("old", 0, 1, 2.1), cross("new", 1, 0, 2.1)
    assert next(check_cross_fade(below, new, LAGS, ANY)).passed  # f1 f2 is at most a quarter
    alone = examine_package(old, LAGS, ANY)
    assert alone.passed
    assert not any("cross-fade" in step.name for step in alone.steps)
    verdict = examine_package(new, LAGS, ANY, engaged=old)
    assert verdict.engaged == hash_package(old)
    (refusal,) = [step for step in verdict.steps if not step.passed]
    assert refusal.name == "cross-fade from old on lags"
    assert refusal.said.startswith("old at 0.6, new at 0.4: a root at 0 Hz grows (0.028")


def test_an_adaptive_gain_of_two_laws_at_once_is_refused():
    """Either alone is triangular and decays at every gain; at one of 1.5 the mean of both grows."""
    old, new = cross("old", 0, 1, 1.9), cross("new", 1, 0, 1.9)
    gain = AdaptiveGain(
        maximum=1.5, minimum=0.2, rate=0.01, sensor="way", band_hz=(1.0, 5.0), quiet_rms=0.01, loud_rms=0.1
    )
    verdict = examine_package(new, LAGS, ANY, gain=gain, engaged=old)
    (refusal,) = [s for s in verdict.steps if not s.passed]
    assert refusal.name == "cross-fade from old"
    assert refusal.said.startswith("of two laws at once no adaptive gain is proved")
    assert verdict.proved_gain is None
    assert all(prove_gain(one, gain, LAGS)[0].proved for one in (old, new))
    louder = cross("old", 0, 1, 1.5 * 1.9), cross("new", 1, 0, 1.5 * 1.9)
    (both,) = check_cross_fade(*louder, LAGS, ANY)
    assert "a root at 0 Hz grows" in both.said


def test_ramps_of_other_lengths_bring_both_to_full_authority():
    """A law that leaves more slowly than the other rises is there whole beside it: then g > 1 grows."""
    slow, fast = {"ramp_s": 4.0}, {"ramp_s": 0.0}
    old, new = cross("old", 0, 1, 1.3, **slow), cross("new", 1, 0, 1.3, **fast)
    (step,) = check_cross_fade(old, new, LAGS, ANY)
    assert not step.passed
    assert next(check_cross_fade(new, old, LAGS, ANY)).passed
    swift = engine_of(leave_s=0.0)  # gone within twice the least ramp, whatever its own
    assert next(check_cross_fade(old, cross("new", 1, 0, 1.3, ramp_s=2.0), LAGS, ANY, swift)).passed


def test_the_fade_is_tried_beside_the_hold():
    """With lags of 0.4 and 4 1/s what grew decays; one hold too many would drive the first lag out."""
    old, new = cross("old", 0, 1, 2.1), cross("new", 1, 0, 2.1)
    hold = (LoopPath(0, 0, static_gain(0.6)), LoopPath(1, 1, static_gain(-3.0)))
    assert not next(check_cross_fade(old, new, LAGS, ANY, engine_of())).passed
    assert next(check_cross_fade(old, new, LAGS, ANY, engine_of(hold))).passed
    spoilt = [*check_cross_fade(old, new, LAGS, ANY, engine_of((LoopPath(0, 0, static_gain(2.0)),)))]
    assert "old at 1, new at 0" in spoilt[0].said


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"period_s": 0.02}, "50 Hz"),
        ({"paths": (LoopPath(0, 0, static_gain(-1.0)),)}, "an inner loop of its own"),
        ({"inputs": (WAY, Port("rate", "mm/s"))}, "rate in mm/s of one package, in m/s of another"),
    ],
)
def test_what_does_not_run_beside_it_is_refused(changes, said):
    other = add_test_vectors(dataclasses.replace(cross("old", 0, 1, 0.1), vectors=None, **changes))
    verdict = examine_package(cross("new", 1, 0, 0.1), LAGS, ANY, engaged=other)
    (refusal,) = [step for step in verdict.steps if not step.passed]
    assert refusal.name == "cross-fade from old"
    assert said in refusal.said


@pytest.mark.usefixtures("compiler")
def test_with_trials_the_way_to_their_share_is_tried_too(monkeypatch):
    """And on paper the one to full authority alone."""
    tried, plain = [], cross_fade.check_loops

    def look(name, plant, laws, least):
        tried.append({one.where.partition(", ")[2] for one in laws})
        return plain(name, plant, laws, least)

    monkeypatch.setattr(cross_fade, "check_loops", look)
    old, new = cross("old", 0, 1, 0.3), cross("new", 1, 0, 0.3)
    for trials in (None, GateTrials(dry_s=0.1, share=0.25)):
        examine_package(new, LAGS, ANY, engaged=old, trials=trials)
    paper, run = tried
    assert run - paper == {f"new at {fade_at(0.25):.3g}"}
    assert run > paper


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("share", [1.0, 0.25])
@pytest.mark.parametrize("ramps", [(0.0, 0.0), (0.9, 0.0), (0.0, 0.7), (9.0, 0.5)])
def test_the_points_lie_on_the_way_of_the_engine(ramps, share):
    """Sensors that stand still: what each law adds is its fade times one number."""
    settings = plain_settings(leave_s=0.8)
    gain = np.zeros((OUTPUTS, SENSORS))
    gain[0, 0] = 0.1
    old, new = (static_package(gain, name=name, ramp_s=ramp) for name, ramp in zip("ab", ramps, strict=True))
    with Supervisor(settings, still_article(np.ones(SENSORS))) as engine:
        assert engine.load(old).done
        assert engine.load(new, slot=1).done
        assert engine.reset().done
        engine.command("engage", slot=0, values=[1.0])
        engine.run(settings.samples(max(ramps) + 1.0), keep=False)
        engine.command("engage", slot=1, values=[share])
        records = engine.run(settings.samples(2.0))
    way = np.column_stack([records["added_0"][:, 0], records["added_1"][:, 0]]) / 0.1
    points = np.array(fade_points(old.ramp, new.ramp, settings, share))
    assert len(points) >= 11
    assert np.allclose(points[[0, -1]], [[1.0, 0.0], [0.0, fade_at(share)]])
    nearest = [np.abs(way - point).max(axis=1).min() for point in points]
    assert max(nearest) < 0.011  # the steepest step is 1.5 over 150 samples

"""Promises: bounds against optima, probabilities against counts, draws against the linear estimate."""

import dataclasses
import itertools
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import promise_case as case
import pytest
import scipy.linalg as sla
from scipy.signal import tf2ss
from scipy.stats import binomtest
from updating_case import DAMPING_STD, sheet, true_damping, true_modes

from middeck.campaign.confidence_of_draws import probability_interval
from middeck.campaign.encoding import decode_result, encode_result
from middeck.control.h2.noise_rms import NoiseOutcome
from middeck.control.law.compensator import Compensator
from middeck.control.law.delay_order import approximation_order
from middeck.control.law.pd_loops import PDLoops
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.noise import measure_noise_rms
from middeck.control.robust.verification.monte_carlo import noise_on, which_decay
from middeck.control.sampled.emulation import emulate
from middeck.errors import ConfigError, NotStabilisableError
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant, require_modal
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.state_space.modal_system import ModalSystem, select_modes
from middeck.systems.state_space.statespace import StateSpace
from middeck.updating.orbit.predicted_frequencies import predict_modes
from middeck.updating.promise import blocks_of_draws
from middeck.updating.promise.draws import DrawnPlants, LoopSpread, draw_plants
from middeck.updating.promise.left_out_modes import find_left_out
from middeck.updating.promise.performance_bound import bound_db, bound_worst
from middeck.updating.promise.plan import Ladder, Plan, close_inner, group_loop, plant_of, weights_of
from middeck.updating.promise.promise import design_ladder, promise, set_sites
from middeck.updating.promise.robustness_sweep import sweep_plants, try_sweep
from middeck.updating.promise.stability_probability import (
    LoopNoise,
    Outlook,
    highest_promised,
    look_ahead,
    risk_of,
)
from middeck.updating.promise.weak_cable import lost_to_cable
from middeck.updating.refinement.refine import Refined
from repeats import LONG, repeats

WEIGHTS = LQGWeights(output=[1.0], input=[1.0], disturbed=("f",), process=[[1.0]], sensor=[1e-4])


def oscillator(frequency: float, delay_s: float = 0.0) -> Plant:
    plant = make_plant(
        [[0.0, 1.0], [-(frequency**2), -0.04 * frequency]], [[0.0], [1.0]], [[1.0, 0.0]],
        inputs=["f"], outputs=["x"], w=["f"], u=["f"], z=["x"], y=["x"],
    )  # fmt: skip
    return delay_plant(plant, delay_s) if delay_s else plant


def gained(k: float) -> Plant:
    """k / (s + 1), which the law below closes to s^2 + 11 s + 10 - 10 k: stable below k = 1."""
    return make_plant(
        [[-1.0]], [[k]], [[1.0]], inputs=["f"], outputs=["x"], w=["f"], u=["f"], z=["x"], y=["x"]
    )


LAG = Compensator(StateSpace([[-10.0]], [[10.0]], [[1.0]], [[0.0]]), gained(1.0).outputs, gained(1.0).inputs)


STILL = dataclasses.replace(LAG, dynamics=StateSpace([[-1.0]], [[0.0]], [[0.0]], [[0.0]]))


@pytest.fixture(scope="module")
def refined() -> Refined:
    return case.refined(0)


@pytest.mark.parametrize("delay_s", [0.0, 0.1])
def test_the_best_compensator_of_a_plant_is_at_its_bound(delay_s: float):
    plant = oscillator(2.0, delay_s)
    model = approximate_delays(plant, approximation_order(plant))
    best = design_lqg(model, WEIGHTS, 30.0)
    ((own, least),) = bound_db([plant], best, WEIGHTS)
    assert least <= own + 1e-9
    assert own == pytest.approx(least, abs=1e-3)


def test_no_compensator_passes_the_bound_and_one_of_its_effort_comes_near():
    """A law for another frequency: the least rms at its effort is searched among optima of this plant."""
    plant, other = oscillator(2.0), design_lqg(oscillator(2.6), WEIGHTS, 3.0)
    ((own, least),) = bound_db([plant], other, WEIGHTS)
    effort = measure_noise_rms(plant, other, WEIGHTS).control_rms
    tried = [
        measure_noise_rms(plant, design_lqg(plant, WEIGHTS, a), WEIGHTS) for a in np.geomspace(0.3, 30.0, 75)
    ]
    at = int(np.argmin([abs(t.control_rms - effort) for t in tried]))
    alone = measure_noise_rms(plant, STILL, WEIGHTS).rms
    optimum = 20.0 * np.log10(tried[at].rms / alone)
    assert least == pytest.approx(optimum, abs=0.1)
    assert optimum < own


def test_the_bound_does_not_ask_how_a_compensator_was_designed():
    """An LQG with its numbers alone, and one whose authority was misstated."""
    plants = [oscillator(f) for f in (1.9, 2.0, 2.2)]
    law = design_lqg(plants[1], WEIGHTS, 30.0)
    bare = Compensator(law.dynamics, law.inputs, law.outputs)
    assert not hasattr(bare, "authority")
    found = bound_worst(plants, law, WEIGHTS)
    assert bound_worst(plants, bare, WEIGHTS) == found
    assert bound_worst(plants, dataclasses.replace(law, authority=1e9), WEIGHTS) == found
    # Two derivatives by hand, low-passed, that nobody would call optimal.
    rate = Compensator(StateSpace([[-20.0]], [[20.0]], [[20.0]], [[-20.0]]), law.inputs, law.outputs)
    slow = Compensator(StateSpace([[-1.0]], [[1.0]], [[-0.2]], [[0.0]]), law.inputs, law.outputs)
    for hand in (rate, slow):
        own, least = bound_db(plants[:1], hand, WEIGHTS)[0]
        assert np.isnan(least) or least <= own


def test_no_compensator_of_its_effort_is_better_on_all_plants_than_the_largest_bound():
    """Optima of each plant and of plants between, as strong as the effort on each of them lets them be."""
    plants = [oscillator(f) for f in (1.7, 2.0, 2.4)]
    law = design_lqg(plants[1], WEIGHTS, 3.0)
    bound = bound_worst(plants, law, WEIGHTS)
    assert bound.draws == 3
    own, still = ([measure_noise_rms(p, one, WEIGHTS) for p in plants] for one in (law, STILL))
    assert bound.worst_db == pytest.approx(_worst_db(own, still))
    assert bound.worst_db > bound.no_linear_law_below_db
    allowed = 0
    for f, authority in itertools.product((1.7, 1.9, 2.0, 2.2, 2.4), (0.3, 1.0, 2.0, 3.0)):
        other = design_lqg(oscillator(f), WEIGHTS, authority)
        came = [measure_noise_rms(p, other, WEIGHTS) for p in plants]
        if all(c.control_rms <= o.control_rms for c, o in zip(came, own, strict=True)):
            allowed += 1
            assert _worst_db(came, still) >= bound.no_linear_law_below_db
    assert allowed >= 3


def _worst_db(closed: Sequence[NoiseOutcome], still: Sequence[NoiseOutcome]) -> float:
    return max(20.0 * float(np.log10(c.rms / s.rms)) for c, s in zip(closed, still, strict=True))


def test_a_bound_is_of_the_plants_that_have_one():
    """A compensator that loses one of them has no worst, and others of its effort on the rest have."""
    plants = [gained(0.4), gained(1.5)]
    found = bound_worst(plants, LAG, WEIGHTS)
    assert found.worst_db == np.inf
    assert found.no_linear_law_below_db == bound_db(plants[:1], LAG, WEIGHTS)[0, 1]
    assert np.isnan(bound_worst((), LAG, WEIGHTS).no_linear_law_below_db)
    assert bound_db(plants[:1], STILL, WEIGHTS).tolist() == [[0.0, 0.0]]


def test_a_compensator_that_is_unstable_has_no_bound():
    assert np.isnan(bound_db([gained(1.5)], LAG, WEIGHTS)[0, 1])


def test_probabilities_are_counted_and_the_risk_is_named():
    rng = np.random.default_rng(3)
    k, idle = rng.uniform(0.2, 1.2, 400), rng.standard_normal(400)
    drawn = DrawnPlants(tuple(gained(x) for x in k), ("idle", "gain"), np.stack([idle, k], axis=1))
    alone = k * measure_noise_rms(gained(1.0), STILL, WEIGHTS).rms
    found = look_ahead("lag", LAG, drawn, LoopNoise(*noise_on(drawn.plants, LAG, WEIGHTS)), alone)
    np.testing.assert_array_equal(found.stable, k < 1.0)
    assert found.risk[0] == "gain"
    assert found.risk[1] > 0.95
    assert found.level_db(0.99) == np.inf
    assert found.level_db(0.5) == pytest.approx(np.median(found.db), abs=0.1)


@pytest.mark.parametrize("delay_s", [0.0, 0.05])
def test_bands_add_up_to_the_whole(delay_s: float):
    """Squares of the rms in three bands beside the rms over all frequencies."""
    law = design_lqg(approximate_delays(oscillator(3.0, delay_s), 3), WEIGHTS, 1.0)
    plants = [oscillator(f, delay_s) for f in (2.9, 3.2)]
    _, *whole = noise_on(plants, law, WEIGHTS)
    ends = (0.0, 0.3, 2.0, 1e5)
    parts = np.array([noise_on(plants, law, WEIGHTS, band)[1:] for band in itertools.pairwise(ends)])
    np.testing.assert_allclose(np.sqrt(np.sum(parts**2, axis=0)), whole, rtol=1e-5)
    assert np.all(parts < whole)


@pytest.mark.parametrize(("count", "of"), [(0, 10), (3, 10), (10, 10), (297, 300)])
def test_intervals_of_probabilities_are_those_of_clopper_and_pearson(count: int, of: int):
    exact = binomtest(count, of).proportion_ci(0.95, "exact")
    assert probability_interval(count, of) == pytest.approx((exact.low, exact.high), abs=1e-9)


def outlook(name: str, stable: int, of: int = 300) -> Outlook:
    held = np.arange(of) < stable
    return Outlook(
        name=name, stable=held, db=np.where(held, -20.0, np.inf), control_rms=np.ones(of),
        unstable_mode="", risk=("", 0.0),
    )  # fmt: skip


def test_levels_hold_for_one_more_draw():
    """As often as they say, whatever the distribution and however few the draws."""
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(2000):
        db = rng.exponential(size=40)
        reported = dataclasses.replace(outlook("a", 39, 39), db=db[:39], stable=np.ones(39, bool))
        inside += reported.level_db(0.025) <= db[39] <= reported.level_db(0.975)
    assert inside / 2000 == pytest.approx(0.95, abs=0.02)
    few = dataclasses.replace(outlook("a", 10, 10), db=np.arange(10.0))
    assert [few.level_db(s) for s in (0.01, 0.5, 0.99)] == [0.0, 5.0, 9.0]


def test_a_ladder_ends_below_the_first_that_is_not_promised():
    ladder = [outlook("a", 300), outlook("b", 300), outlook("c", 295), outlook("d", 300)]
    best = highest_promised(ladder)
    assert best is not None
    assert best.name == "b"
    assert highest_promised([outlook("few", 20, 20)]) is None


def test_damping_in_orbit_is_promised(refined: Refined):
    """The truth has the same ratio on the ground and in orbit; the pendulum modes lose more on the ground."""
    orbit = Environment.orbit()
    predicted, true = predict_modes(refined, orbit, count=10), true_modes(0, orbit)
    error = np.log(predicted.damping / true_damping(0, true, 18)[predicted.index])
    assert np.all(np.abs(error) < 3.0 * predicted.damping_std(0.3))
    assert np.abs(error).max() < 0.15


def test_draws_have_the_frequencies_of_the_linear_estimate(refined: Refined):
    """Its covariance, although some unknowns keep nearly all of their spread."""
    draws = 100 if LONG else 30
    asked = case.plan([1.0], draws)
    drawn = draw_plants(
        refined, Environment.orbit(), lambda modes: plant_of(asked, modes), draws=draws,
        rng=np.random.default_rng(1), loop=LoopSpread(gain_tolerance=0.01),
    ).plants(range(draws))  # fmt: skip
    predicted = predict_modes(refined, Environment.orbit(), count=10)
    logs = np.log([np.sort(require_modal(p).omega)[8:18] for p in drawn.plants])
    expected = np.sort(2.0 * np.pi * predicted.frequency_hz)
    assert np.abs(logs.mean(axis=0) - np.log(expected)).max() < 4.0 * predicted.log_std.max() / np.sqrt(draws)
    np.testing.assert_allclose(logs.std(axis=0), predicted.log_std, rtol=0.3)
    zeta = np.log([require_modal(p).zeta[8:18] for p in drawn.plants])
    np.testing.assert_allclose(zeta.std(axis=0), predicted.damping_std(0.3), rtol=0.3)
    # The first two share their shapes with the payload's pendulum modes on the ground.
    np.testing.assert_allclose(predicted.damping_std(0.3)[2:], DAMPING_STD, rtol=0.3)
    assert drawn.drawn.shape == (draws, len(drawn.names))
    normal, bounded = np.split(drawn.drawn, [drawn.names.index("delay")], axis=1)
    np.testing.assert_allclose(normal.std(axis=0), 1.0, atol=0.35)
    assert 0.9 < np.abs(bounded).max() <= 1.0


@pytest.mark.parametrize("name", repeats(["orbit", "lab"]))
def test_what_is_promised_comes(refined: Refined, name: str):
    """Against a truth with a finer mesh, shear, misplaced mass, an umbilical, its own delay and gains.

    On the ground as well, where the same compensators can be checked before flight.
    """
    place = {"orbit": Environment.orbit(), "lab": sheet()[1]}[name]
    asked = dataclasses.replace(case.plan([1e1, 1e5], 20, bounded=1), environments={name: place})
    laws = design_ladder(case.modes_in_orbit(refined), asked)
    (found,) = promise(refined, dataclasses.replace(asked, ladder=None, laws=laws)).values()
    truth = case.true_plant(0, place=place)
    for one, law in zip(found.outlooks, laws.values(), strict=True):
        came = case.true_db(truth, law, asked)
        assert abs(one.level_db(0.5) - came) < 0.3
        assert one.level_db(0.01) - 0.1 <= came <= one.level_db(0.99) + 0.1
        bound = found.bound[one.name]
        assert 0.0 <= bound.worst_db - bound.no_linear_law_below_db < 0.3


def pade(delay_s: float) -> tuple[np.ndarray, ...]:
    """exp(-s delay) by the fraction of degree 4 over 4 (Pade)."""
    powers = delay_s ** np.arange(4.0, -1.0, -1.0)
    even, odd = np.array([1.0, 0.0, 180.0, 0.0, 1680.0]), np.array([0.0, 20.0, 0.0, 840.0, 0.0])
    return tf2ss((even - odd) * powers, (even + odd) * powers)


def test_a_sweep_is_that_of_loops_closed_by_hand(refined: Refined):
    """Modes in orbit shifted, held by the inner loops and closed by each compensator, all written out."""
    asked = case.plan([1e1, 1e3], 1)
    predicted = predict_modes(refined, Environment.orbit(), count=asked.modes)
    swept = sweep_plants(predicted, asked)
    plant = plant_of(asked, predicted.modes)
    modal = require_modal(plant)
    omega, zeta = modal.omega.copy(), modal.zeta.copy()
    for k, i in enumerate(predicted.index.tolist()):
        if i < len(omega):
            omega[i], zeta[i] = 2.0 * np.pi * predicted.frequency_hz[k], predicted.damping[k]
    flexible = [n for n, kind in zip(modal.names, predicted.modes.kind, strict=False) if kind == "flexible"]
    first = [n for n in flexible if n.startswith("first bending")]
    by = {n: 0.1 if n in first else 0.2 for n in flexible}
    assert (first, len(flexible), len(swept.cases)) == (["first bending x-y", "first bending x-z"], 18, 40)
    factors = [
        {n: 1.0 + s * by[n]} for n in (*first, *(n for n in flexible if n not in first)) for s in (-1, 1)
    ]
    factors += [
        {n: 1.0 + (a if n in first else b) * by[n] for n in flexible} for a in (-1, 1) for b in (-1, 1)
    ]
    found = {}
    for name, law in design_ladder(case.modes_in_orbit(refined), asked).items():
        found[name] = try_sweep(swept, law, asked)
        by_hand = [not _grows(modal, omega, zeta, f, plant, law) for f in factors]
        assert found[name].stable.tolist() == by_hand
    assert found["LQG 1"].lost == ()
    assert "third bending x-y -20 %" in found["LQG 3"].lost


def _grows(
    modal: ModalSystem,
    omega: np.ndarray,
    zeta: np.ndarray,
    factors: dict[str, float],
    plant: Plant,
    law: Compensator,
) -> bool:
    held = np.array(["translation" not in name for name in modal.names])  # no torque moves a free article
    modal, omega, zeta = select_modes(modal, held), omega[held], zeta[held]
    moved = omega * np.array([factors.get(name, 1.0) for name in modal.names])
    n = len(moved)
    rows = [plant.output_indices([name])[0] for name in case.PD.names]
    columns = [plant.input_indices([name])[0] for name in case.PD.names]
    stiff = np.diag(moved**2) + modal.psi[:, columns] @ (case.PD.kp[:, None] * modal.phi[rows])
    drag = np.diag(2.0 * zeta * moved) + modal.psi[:, columns] @ (case.PD.kd[:, None] * modal.phi[rows])
    free = np.block([[np.zeros((n, n)), np.eye(n)], [-stiff, -drag]])
    push = np.concatenate([np.zeros(n), modal.psi[:, plant.input_indices([case.INPUT])[0]]])[:, None]
    read = np.concatenate([modal.phi[plant.output_indices([case.OUTPUT])[0]], np.zeros(n)])[None]
    P, Q, R, S = pade(case.DELAY_S / 3.0)
    for _ in range(3):  # each filter reads what the one before gives
        free = np.block([[free, np.zeros((len(free), len(P)))], [Q @ read, P]])
        push = np.vstack([push, np.zeros((len(P), 1))])
        read = np.hstack([S @ read, R])
    system = law.system
    whole = np.block([[free, push @ system.C], [system.B @ read, system.A]])
    return bool(np.linalg.eigvals(whole).real.max() > 0.0)


def test_what_a_block_warns_of_is_reported_with_its_draws(refined: Refined, monkeypatch: pytest.MonkeyPatch):
    """Also of one that comes out of a ledger, whose numbers are the same."""

    def doubtful(*given: Any) -> Any:
        warnings.warn("undecided", stacklevel=1)
        return noise_on(*given)

    asked = case.plan([1.0], 2)
    (site,) = set_sites(refined, asked).values()
    monkeypatch.setattr(blocks_of_draws, "noise_on", doubtful)
    found = blocks_of_draws.measure_block(site, 0)
    kept = encode_result(blocks_of_draws.values_of(found))
    again = blocks_of_draws.restore_block(decode_result(kept), site)
    assert again.drawn == found.drawn
    assert encode_result(blocks_of_draws.values_of(again)) == kept
    with pytest.warns(UserWarning, match="draws 0 to 1: undecided"):
        blocks_of_draws.join_blocks(site, [again])


def test_a_reading_whose_noise_is_not_stated_is_refused():
    asked = case.plan([1.0], 1)
    plant = case.true_plant(0)
    rate = [p for p in plant.outputs if p.name == "bus_x_rate"]
    with pytest.raises(ConfigError, match="rad/s"):
        weights_of(asked, plant.inputs[:1], rate)


def test_compensators_that_cannot_be_promised_are_refused(refined: Refined):
    """A direct term or a period would be left out without a word."""
    truth = case.true_plant(0)
    reads = (truth.outputs[truth.output_indices([case.OUTPUT])[0]],)
    drives = (truth.inputs[truth.input_indices([case.INPUT])[0]],)
    lag = StateSpace([[-10.0]], [[1.0]], [[-0.01]], [[-0.01]])
    direct = Compensator(lag, reads, drives)
    sampled = emulate(Compensator(dataclasses.replace(lag, D=np.zeros((1, 1))), reads, drives), 0.01)
    for law, what in ((direct, "direct term"), (sampled, "sampled")):
        asked = dataclasses.replace(case.plan([1.0], 1), ladder=None, laws={"own": law})
        with pytest.raises(ConfigError, match=what):
            promise(refined, asked)
    named = dataclasses.replace(case.plan([1.0], 1), laws={"LQG 0": direct})
    with pytest.raises(ConfigError, match="one of the ladder are both called"):
        promise(refined, named)
    with pytest.raises(ConfigError, match="rising"):
        case.plan([10.0, 1.0], 1)


def test_plants_of_rigid_modes_alone_are_refused(refined: Refined):
    """As where the numbers of modes were meant: modes = 3."""
    with pytest.raises(ConfigError, match=r"3 modes kept in each plant, of which 8 are rigid in"):
        promise(refined, dataclasses.replace(case.plan([1.0], 1), modes=3))


def test_a_performance_without_an_rms_has_no_decibels(refined: Refined):
    """Nothing holds the bus: its rotation does not decay."""
    held = PDLoops(("pri_rel_x", "pri_rel_z"), np.array([0.01, 0.014]), np.array([0.02, 0.028]))
    asked = dataclasses.replace(
        case.plan([1.0], 1), inner=held, performance=("bus_z",), disturbances=("bus_z",),
        ladder=Ladder(drives=("bus_z",), reads=("bus_z",), authority=np.ones(1)),
    )  # fmt: skip
    with pytest.raises((ConfigError, NotStabilisableError), match=r"no rms|does not decay"):
        promise(refined, asked)


def test_modes_that_the_plants_lack_are_reported_by_what_they_change(refined: Refined):
    """Ten modes in place of thirty: decibels move as by Lyapunov's equation on both loops, written out."""
    asked = dataclasses.replace(case.plan([1e1, 1e5], 1), modes=10, loop=LoopSpread())
    site = set_sites(refined, asked)["orbit"]
    narrow = [
        Outlook(
            name=name,
            stable=np.ones(2, dtype=bool),
            db=np.array([-9.0, -9.001]),
            control_rms=np.ones(2),
            unstable_mode="",
            risk=("", 0.0),
        )
        for name in site.laws
    ]
    found = find_left_out(site, narrow)
    assert found.modes == 30
    assert "LQG 5" in found.shift_db
    for name, law in site.laws.items():
        few, many = (
            _decibels_by_hand(dataclasses.replace(asked, modes=n), site.predicted.modes, law)
            for n in (10, 30)
        )
        assert found.shift_db.get(name, 0.0) == pytest.approx(many - few, rel=1e-5, abs=6e-4)
    wide = [dataclasses.replace(o, db=np.array([-99.0, 99.0])) for o in narrow]
    assert not find_left_out(site, wide).shift_db


def _decibels_by_hand(asked: Plan, modes: Modes, law: Compensator) -> float:
    plant = plant_of(asked, modes)
    modal = require_modal(plant)
    modal = select_modes(modal, np.array(["translation" not in name for name in modal.names]))
    n, system = len(modal.omega), law.system
    rows = [plant.output_indices([name])[0] for name in case.PD.names]
    columns = [plant.input_indices([name])[0] for name in case.PD.names]
    stiff = np.diag(modal.omega**2) + modal.psi[:, columns] @ (case.PD.kp[:, None] * modal.phi[rows])
    drag = np.diag(2 * modal.zeta * modal.omega) + modal.psi[:, columns] @ (
        case.PD.kd[:, None] * modal.phi[rows]
    )
    free = np.block([[np.zeros((n, n)), np.eye(n)], [-stiff, -drag]])
    push = np.concatenate([np.zeros(n), modal.psi[:, plant.input_indices([case.INPUT])[0]]])[:, None]
    read = np.concatenate([modal.phi[plant.output_indices([case.OUTPUT])[0]], np.zeros(n)])[None]
    whole = np.block([[free, push @ system.C], [system.B @ read, system.A]])
    drive = sla.block_diag(push * asked.intensity, system.B * asked.noise["rad"])
    seen = np.hstack([read, np.zeros((1, len(system.A)))])
    alone = sla.solve_continuous_lyapunov(free, -(push * asked.intensity) @ (push * asked.intensity).T)
    closed = sla.solve_continuous_lyapunov(whole, -drive @ drive.T)
    return 10.0 * np.log10(float((seen @ closed @ seen.T)[0, 0] / (read @ alone @ read.T)[0, 0]))


def test_a_cable_that_no_model_has_ends_a_ladder_that_the_model_does_not(refined: Refined):
    """Five motors at high authority: stable on every draw that floats, and not on all that hang by a cable.

    So it is on the truth, which has one of 0.02 Hz.
    """
    asked = case.with_all_motors(case.plan([1.0, 1e4], 1))
    asked = dataclasses.replace(asked, loop=dataclasses.replace(asked.loop, umbilical_hz=0.0))
    law = design_ladder(case.modes_in_orbit(refined), asked)["LQG 4"]
    weights = weights_of(asked, law.outputs, law.inputs)
    held, draws = [], 6 if LONG else 3
    for umbilical_hz in (0.0, 0.03):
        loop = dataclasses.replace(asked.loop, umbilical_hz=umbilical_hz)
        drawn = draw_plants(
            refined, Environment.orbit(), partial(plant_of, asked), draws=draws, rng=np.random.default_rng(2),
            loop=loop, finish=partial(close_inner, asked),
        ).plants(range(draws))  # fmt: skip
        plants = [group_loop(asked, p, case.PD.names, case.ALL_ANGLES) for p in drawn.plants]
        stable, rms, _ = noise_on(plants, law, weights)
        np.testing.assert_array_equal(which_decay(plants, law, weights), stable & np.isfinite(rms))
        held.append(int(np.count_nonzero(stable)))
    assert held[0] == draws
    assert held[1] < draws
    assert lost_to_cable(set_sites(refined, asked)["orbit"]) == ("LQG 4",)


@pytest.mark.parametrize(
    "changed", [{"weights": np.zeros(1)}, {"intensity": np.zeros(1)}, {"weights": [-1.0]}]
)
def test_a_performance_that_is_nothing_is_refused(changed: dict[str, list[float]]):
    with pytest.raises(ConfigError, match=r"(weights|intensities) of (0|-1)"):
        dataclasses.replace(case.plan([1.0], 1), **changed)


def test_a_plant_without_an_optimum_has_no_bound():
    """A double integrator that no sensor sees beside the oscillator."""
    seen = oscillator(3.0)
    A, B, C = seen.system.A, seen.system.B, seen.system.C
    drifts = make_plant(
        np.block([[A, np.zeros((2, 1))], [np.zeros((1, 2)), np.zeros((1, 1))]]), np.vstack([B, [[1.0]]]),
        np.hstack([C, [[0.0]]]), inputs=["f"], outputs=["x"], w=["f"], u=["f"], z=["x"], y=["x"],
    )  # fmt: skip
    law = design_lqg(seen, WEIGHTS, 1.0)
    both = bound_db([seen, drifts], law, WEIGHTS)
    assert np.all(np.isfinite(both[0]))
    assert not np.isfinite(both[1, 1])


def test_a_risk_that_chance_may_be_is_not_named():
    """Fifty names that have nothing to do with it: the largest correlation is 1 in 4 draws, 0.5 in 24."""
    rng = np.random.default_rng(4)
    for draws in (4, 6, 7, 24):
        named = 0
        for _ in range(40):
            drawn = DrawnPlants((), tuple(map(str, range(50))), rng.standard_normal((draws, 50)))
            named += risk_of(drawn, rng.standard_normal(draws))[0] != ""
        assert named <= 6
    drawn = DrawnPlants((), ("cause", "other"), rng.standard_normal((24, 2)))
    assert risk_of(drawn, 3.0 * drawn.drawn[:, 0])[0] == "cause"

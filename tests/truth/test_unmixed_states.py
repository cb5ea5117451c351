"""States of which each group belongs to its own poles: the same system, from states mixed at random."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Literal

import numpy as np
import pytest
import scipy.linalg as sla
from test_numbers_in_mixed_states import DESIGNS
from test_verdicts_in_mixed_states import _mixed

from middeck.control.law.rounding_of_results import moved_entries
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import KalmanFilter, design_filter
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError, NotStabilisableError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.mode_blocks import unmix_states
from middeck.systems.plants.plant import delay_plant, remove_delays
from middeck.systems.plants.response import statespace_response
from middeck.systems.poles.modal_states import modal_states
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import FORCE, WAY, grouped_plant, unit_weights
from repeats import repeats

OMEGA = np.geomspace(0.01, 30.0, 60)


def _system(rng: np.random.Generator) -> StateSpace:
    """A free body, two modes of equal frequency, a third, and a real pole."""
    blocks = [np.array([[0.0, 1.0], [0.0, 0.0]])]
    blocks += [np.array([[0.0, w], [-w, -2.0 * z * w]]) for w, z in ((2.0, 1e-3), (2.0, 0.02), (9.0, 1e-2))]
    blocks.append(np.array([[-0.3]]))
    A = sla.block_diag(*blocks)
    drive = np.array([0.0, 1.0] * 4 + [1.0])[:, None] * rng.uniform(0.5, 2.0, (9, 1))
    seen = np.array([1.0, 0.0] * 4 + [1.0]) * rng.uniform(0.5, 2.0, 9)
    return StateSpace(A, drive, seen[None], [[0.0]])


@pytest.mark.parametrize("seed", repeats(range(40), 4))
def test_unmixed_states_are_the_same_system_in_blocks(seed: int) -> None:
    rng = np.random.default_rng([96, seed])
    own = _system(rng)
    for condition in (1e2, 1e4, 1e5):
        plant = grouped_plant(_mixed(own, condition, rng), (FORCE,), (WAY,))
        parted, mixed = unmix_states(plant)
        found, asked = (statespace_response(one, OMEGA) for one in (parted.system, own))
        assert 0.1 * condition < mixed < 2.0 * condition
        # Stored, mixed entries have lost the square of the condition; a mode of 0.1 % multiplies it.
        assert found == pytest.approx(asked, rel=1e-11 * condition**2)
        size = np.abs(parted.system.A)
        group = np.array([0, 0, 1, 2, 2, 2, 2, 3, 3])
        assert np.max(size[group[:, None] != group]) < 1e-15 * condition**2 * size.max()
        assert parted.state_names[-1].startswith("mode of 1.432 Hz")


def test_states_that_are_not_mixed_stay() -> None:
    plant = grouped_plant(_system(np.random.default_rng(0)), (FORCE,), (WAY,))
    assert unmix_states(plant) == (plant, 1.0)
    assert modal_states(np.zeros((0, 0))) is None
    assert modal_states(np.array([[np.nan, 1.0], [0.0, 1.0]])) is None


def test_poles_that_share_an_eigenvector_stay_together() -> None:
    """Three equal real poles in one chain: no basis of eigenvectors, but one of the group."""
    chain = -np.eye(3) + np.diag([1.0, 1.0], 1)
    rng = np.random.default_rng(97)
    own = StateSpace(sla.block_diag(chain, [[-7.0]]), np.ones((4, 1)), np.ones((1, 4)), [[0.0]])
    found = modal_states(_mixed(own, 1e4, rng).A)
    assert found is not None
    assert np.linalg.cond(found.T) < 1e5
    assert found.rate == pytest.approx([1.0, 1.0, 1.0, 7.0], rel=0.05)


def test_approximated_delays_keep_their_digits() -> None:
    """Their bases of eigenvectors have a condition of 1e4 at order ten, and cost them four digits."""
    plant = delay_plant(grouped_plant(_system(np.random.default_rng(0)), (FORCE,), (WAY,)), 0.05)
    near = approximate_delays(plant, 10)
    assert unmix_states(near) == (near, 1.0)
    mixed = _mixed(remove_delays(plant).system, 1e4, np.random.default_rng(1))
    both, _ = unmix_states(approximate_delays(dataclasses.replace(plant, dynamics=mixed), 10))
    apart, _ = unmix_states(grouped_plant(mixed, (FORCE,), (WAY,)))
    assert sorted(both.state_names)[-9:] == sorted(apart.state_names)


def test_a_law_of_strongly_mixed_states_is_that_of_the_own_ones() -> None:
    """A free body among them; at 1e4 such laws were off by up to a tenth, or refused."""
    rng = np.random.default_rng(98)
    for seed in range(3):
        rng = np.random.default_rng([98, seed])
        own, weights = _system(rng), unit_weights(("force",), 1e-4)
        plant = grouped_plant(own, (FORCE,), (WAY,))
        law = design_lqg(plant, weights, 1e3)
        mixed = design_lqg(dataclasses.replace(plant, dynamics=_mixed(own, 1e4, rng)), weights, 1e3)
        one, other = (statespace_response(each.system, OMEGA).ravel() for each in (law, mixed))
        assert other == pytest.approx(one, rel=1e-4)
        assert mixed.cost == pytest.approx(law.cost, rel=1e-4)
        assert len(mixed.state_names) == len(own.A)


@pytest.mark.parametrize("seed", repeats(range(20), 3))
def test_a_free_body_in_the_most_mixed_states_is_not_taken_for_unreached(seed: int) -> None:
    """At 1e5 all such plants were refused: no measurement saw it."""
    rng = np.random.default_rng([99, seed])
    own, weights = _system(rng), unit_weights(("force",), 1e-4)
    plant = grouped_plant(own, (FORCE,), (WAY,))
    law = design_lqg(plant, weights, 1e2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what the stored entries have lost is told
        mixed = design_lqg(dataclasses.replace(plant, dynamics=_mixed(own, 1e5, rng)), weights, 1e2)
    assert mixed.cost == pytest.approx(law.cost, rel=1e-3)


def test_a_slow_state_that_no_input_reaches_decays_beside_fast_modes() -> None:
    """Wind through a filter of 100 s, which no torque moves: it was refused as what does not decay."""
    blocks = [np.array([[0.0, 1.0], [-w * w, -0.02 * w]]) for w in (3.0, 1e4)]
    A = sla.block_diag(*blocks, [[-0.01]])
    A[[1, 3], 4] = 1.0
    drive = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    own = StateSpace(A, drive, [[1.0, 0.0, 1e4, 0.0, 0.0]], [[0.0, 0.0]])
    groups = {"w": ("wind",), "u": (FORCE.name,)}
    plant = grouped_plant(own, (FORCE, Port("wind", "N")), (WAY,), **groups)
    law = design_lqg(plant, weights := unit_weights(("wind",), 1e-6), 10.0)
    mixed = dataclasses.replace(plant, dynamics=_mixed(own, 1e2, np.random.default_rng(1)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert design_lqg(mixed, weights, 10.0).cost == pytest.approx(law.cost, rel=1e-3)


@pytest.mark.parametrize("seed", repeats(range(20), 2))
def test_a_filter_first_fits_a_plant_that_differs_in_last_digits(seed: int) -> None:
    """Its gain was of other states of equal frequencies than the design's, which warned at 1e3."""
    rng = np.random.default_rng([100, seed])
    mixed, weights = _mixed(_system(rng), 1e3, rng), unit_weights(("force",), 1e-4)
    plant, twin = (grouped_plant(one, (FORCE,), (WAY,)) for one in (mixed, moved_entries(mixed, rng)))
    law = design_lqg(plant, weights, 1e2)
    for other in (plant, twin):
        found = design_lqg(plant, weights, 1e2, kalman=design_filter(other, weights))
        one, same = (statespace_response(each.system, OMEGA) for each in (law, found))
        assert same == pytest.approx(one, rel=1e-9)


def test_a_law_for_several_plants_takes_the_most_mixed_states() -> None:
    """All of them were refused at 1e5: of stable modes, too, no input reached what did not decay."""
    rng, own = np.random.default_rng(101), _system(np.random.default_rng(0))
    plants = (grouped_plant(one, (FORCE,), (WAY,)) for one in (own, _mixed(own, 1e5, rng)))
    costs = [
        design_multimodel(plant, unit_weights(("force",), 1e-4), 1e2, uncertainty=()).cost for plant in plants
    ]
    assert costs[1] == pytest.approx(costs[0], rel=1e-4)


@pytest.mark.parametrize("kind", DESIGNS)
def test_an_unstable_mode_that_no_input_reaches_is_refused(kind: str) -> None:
    """Rounding of mixed states reaches it: of 30 plants at 1e4 three had a law of gains that it made."""
    modes = sla.block_diag([[0.0, 3.0], [-3.0, 0.1]], [[0.0, 9.0], [-9.0, -0.1]])
    own = StateSpace(modes, [[0.0], [0.0], [0.0], [1.0]], [[1.0, 0.0, 1.0, 0.0]], [[0.0]])
    for seed in repeats(range(30), 3):
        for condition in (1e3, 1e4, 1e5):
            mixed = _mixed(own, condition, np.random.default_rng(seed))
            plant = grouped_plant(mixed, (FORCE,), (WAY,))
            with pytest.raises(NotStabilisableError, match="no control input"):
                DESIGNS[kind](plant, unit_weights(("force",), 1e-2), 10.0)


@pytest.mark.parametrize("seed", repeats(range(8), 2))
def test_a_state_that_a_user_calls_delay_is_unmixed_too(seed: int) -> None:
    """By this name the states of approximated delays are told; one amid others is none of them."""
    rng = np.random.default_rng([101, seed])
    own, weights = _system(rng), unit_weights(("force",), 1e-4)
    law = design_lqg(grouped_plant(own, (FORCE,), (WAY,)), weights, 1e3)
    mixed = grouped_plant(_mixed(own, 1e4, rng), (FORCE,), (WAY,))
    named = dataclasses.replace(mixed, state_names=("delay", *(f"part {k}" for k in range(8))))
    found = design_lqg(named, weights, 1e3)
    one, other = (statespace_response(each.system, OMEGA).ravel() for each in (law, found))
    assert other == pytest.approx(one, rel=1e-4)
    assert unmix_states(named)[1] == unmix_states(mixed)[1]


def test_a_filter_says_which_states_it_estimates() -> None:
    """Of strongly mixed states too: its innovations and an input make the estimate of the filter by hand."""
    rng = np.random.default_rng(102)
    own, weights = _system(rng), unit_weights(("force",), 1e-4)
    plant = grouped_plant(_mixed(own, 1e4, rng), (FORCE,), (WAY,))
    known, found = (design_filter(one, weights) for one in (grouped_plant(own, (FORCE,), (WAY,)), plant))
    assert len(found.state_names) == len(found.gain) == 9

    def estimated_way(kalman: KalmanFilter) -> np.ndarray:
        """From (y, u) to the estimate of the way."""
        A, B, C = kalman.model.A, kalman.model.B[:, 1:], kalman.model.C
        observer = StateSpace(A - kalman.gain @ C, np.hstack([kalman.gain, B]), C, np.zeros((1, 2)))
        return statespace_response(observer, OMEGA)

    assert estimated_way(found) == pytest.approx(estimated_way(known), rel=1e-4)


def test_a_filter_of_another_plant_is_refused() -> None:
    """Of as many states and the same intensities: its law was that of neither plant, and stated a cost."""
    rng = np.random.default_rng(103)
    own, other = _system(rng), _system(rng)
    weights = unit_weights(("force",), 1e-4)
    kalman = design_filter(grouped_plant(other, (FORCE,), (WAY,)), weights)
    plant = grouped_plant(own, (FORCE,), (WAY,))
    with pytest.raises(ConfigError, match="another plant"):
        design_lqg(plant, weights, 1.0, kalman=kalman)
    assert design_lqg(plant, weights, 1.0, kalman=design_filter(plant, weights)).cost > 0.0


def test_a_filter_of_the_same_plant_made_anew_is_taken() -> None:
    """Entries that should be zero are rounding then, and differ from each other by their own size."""
    rng = np.random.default_rng(104)
    weights = unit_weights(("force",), 1e-4)
    plant = grouped_plant(_system(rng), (FORCE,), (WAY,))
    own = plant.system
    anew = StateSpace(own.A + 1e-16 * np.abs(own.A).max() * (own.A == 0.0), own.B, own.C, own.D)
    law = design_lqg(
        grouped_plant(anew, (FORCE,), (WAY,)), weights, 1.0, kalman=design_filter(plant, weights)
    )
    assert law.cost == pytest.approx(design_lqg(plant, weights, 1.0).cost, rel=1e-9)


def _hardly_reached_or_seen(rng: np.random.Generator, *, at_input: bool) -> tuple[StateSpace, StateSpace]:
    """A free body reached, or seen, by 1e-6 of what two modes are: in its own states, and in mixed ones."""
    modes = [(rng.uniform(0.5, 2.0), 0.01), (rng.uniform(5.0, 20.0), 0.003)]
    A = sla.block_diag([[0.0, 1.0], [0.0, 0.0]], *([[0.0, w], [-w, -2.0 * z * w]] for w, z in modes))
    B = np.array([[0.0, 1.0] * 3]).T * rng.uniform(0.5, 2.0, (6, 1))
    C = np.array([[1.0, 0.0] * 3]) * rng.uniform(0.5, 2.0, 6)
    (B if at_input else C)[(1, 0) if at_input else (0, 0)] *= 1e-6
    turn = np.linalg.qr(rng.standard_normal((6, 6)))[0] * 10.0 ** rng.uniform(-1.0, 1.0, 6)
    return StateSpace(A, B, C, [[0.0]]), StateSpace(
        np.linalg.solve(turn, A @ turn), np.linalg.solve(turn, B), C @ turn, [[0.0]]
    )


@pytest.mark.parametrize("kind", DESIGNS)
@pytest.mark.parametrize("seed", repeats(range(40), 2))
def test_a_free_body_hardly_reached_or_seen_is_no_slight_mixture_of_states(kind: str, seed: int) -> None:
    """By 1e-6 of what modes are, in turned states of sizes within 10: sampled laws were off by up to 200 %,
    continuous ones by 1 %, all in silence, and a fifth of these were refused."""
    rng = np.random.default_rng([105, seed])
    plants = (
        grouped_plant(each, (FORCE,), (WAY,)) for each in _hardly_reached_or_seen(rng, at_input=seed % 2 == 0)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        laws = [DESIGNS[kind](plant, unit_weights(("force",), 1e-4), 100.0) for plant in plants]
    one, other = (statespace_response(law.dynamics, np.geomspace(1e-3, 100.0, 40)).ravel() for law in laws)
    assert np.abs(other - one).max() < 1e-6 * np.abs(one).max()


@pytest.mark.parametrize("seed", range(3))
def test_a_refusal_of_strongly_mixed_states_says_that_they_may_hide_what_is_reached(seed: int) -> None:
    """At a condition of 1e8 free bodies, driven and seen, are refused; to leave them out was advised, and
    that no input reaches them was stated as a fact."""
    rng = np.random.default_rng([106, seed])
    plant = grouped_plant(_mixed(_system(rng), 1e8, rng), (FORCE,), (WAY,))
    with pytest.raises(NotStabilisableError, match="rounding may hide what is reached") as refused:
        design_lqg(plant, unit_weights(("force",), 1e-4), 1e2)
    assert "does not decay, as far as rounding of these states shows: " in str(refused.value)


def test_a_refusal_of_states_that_are_not_mixed_is_a_fact() -> None:
    system = _system(np.random.default_rng(107))
    own = dataclasses.replace(system, B=np.where(np.arange(9)[:, None] == 1, 0.0, system.B))
    with pytest.raises(NotStabilisableError, match="reaches it, and it does not decay: state 1\n") as refused:
        design_lqg(grouped_plant(own, (FORCE,), (WAY,)), unit_weights(("force",), 1e-4), 1e2)
    assert "rounding" not in str(refused.value)


@pytest.mark.parametrize("kind", DESIGNS)
def test_a_free_body_with_a_stiffness_of_rounding_is_a_free_body(kind: str) -> None:
    """As modes of a mesh come: 1e-20 and -1e-17 in the place of zero. Balanced units made its link as weak as
    these, and all sampled laws, with 1e-20 continuous ones too, were refused: no input reached it."""
    own = _system(np.random.default_rng(108))
    plant, weights = grouped_plant(own, (FORCE,), (WAY,)), unit_weights(("force",), 1e-4)
    law = DESIGNS[kind](plant, weights, 1e2)
    for stiffness in (1e-20, -1e-17, 1e-16):
        A = own.A.copy()
        A[1, 0] = stiffness
        near = dataclasses.replace(plant, dynamics=StateSpace(A, own.B, own.C, own.D))
        found = DESIGNS[kind](near, weights, 1e2)
        one, other = (statespace_response(each.dynamics, OMEGA).ravel() for each in (law, found))
        assert np.abs(other - one).max() < 1e-9 * np.abs(one).max()


@pytest.mark.parametrize("form", ["predictor", "current"])
@pytest.mark.parametrize("seed", repeats([5, 6, 8, 9, *range(10, 40)], 4))
def test_fast_samples_hide_no_free_body(form: Literal["predictor", "current"], seed: int) -> None:
    """Reached or seen by 1e-6 of what modes are, in mixed states at 10 kHz: all were refused (A is near 1).

    The truth is the closed loop of the body in its own states, held by the matrix exponential.
    """
    rng = np.random.default_rng([105, seed])
    own, mixed = _hardly_reached_or_seen(rng, at_input=seed % 2 == 0)
    law = design_sampled_lqg(
        grouped_plant(mixed, (FORCE,), (WAY,)), unit_weights(("force",), 1e-4), 100.0, 1e-4, form
    ).dynamics
    held = sla.expm(1e-4 * np.block([[own.A, own.B], [np.zeros((1, 7))]]))
    A, B, C = held[:6, :6], held[:6, 6:], own.C
    closed = np.linalg.eigvals(np.block([[A + B @ law.D @ C, B @ law.C], [law.B @ C, law.A]]))
    assert np.abs(closed).max() < 1.0


@pytest.mark.parametrize("form", ["predictor", "current"])
@pytest.mark.parametrize("delay", [(0.013, 0.0), (0.013, 0.031)])
def test_a_delayed_plant_in_mixed_states_is_designed_for(
    form: Literal["predictor", "current"], delay: tuple[float, float]
) -> None:
    """All were refused, as plants with delays where one without was asked for. One delay, and two of the
    paths to two sensors."""
    rng = np.random.default_rng(109)
    one = _system(rng)
    own = StateSpace(one.A, one.B, np.vstack([one.C, one.C[:, ::-1]]), np.zeros((2, 1)))
    ports = (FORCE,), (WAY, Port("turn", "rad"))
    weights = unit_weights(("force",), np.array([1e-4, 1e-4]), outputs=2)
    laws = [
        design_sampled_lqg(
            dataclasses.replace(grouped_plant(system, *ports), delay_s=np.array(delay)[:, None]),
            weights, 100.0, 0.02, form,
        )
        for system in (own, _mixed(own, 1e3, rng))
    ]  # fmt: skip
    assert laws[1].cost == pytest.approx(laws[0].cost, rel=1e-6)
    one, other = (statespace_response(law.dynamics, OMEGA).ravel() for law in laws)
    assert np.abs(other - one).max() < 1e-4 * np.abs(one).max()


def test_a_free_body_behind_unlike_delays_is_seen_in_mixed_states() -> None:
    """Each input drives its own states through the approximation of such delays: a body that is at rest but
    for rounding was then two, and refused as unseen. Seen by two sensors, pushed by two forces."""
    rng = np.random.default_rng(110)
    one = _system(rng)
    own = StateSpace(one.A, one.B * rng.uniform(-2.0, 2.0, 2), np.vstack([one.C, -one.C]), np.zeros((2, 2)))
    ports = (FORCE, Port("torque", "N m")), (WAY, Port("turn", "rad"))
    weights = unit_weights(("force", "torque"), np.array([1e-4, 1e-4]), outputs=2, inputs=2)
    delay = np.array([[0.01, 0.02], [0.03, 0.035]])
    costs = [
        design_sampled_lqg(
            dataclasses.replace(grouped_plant(system, *ports), delay_s=delay), weights, 10.0, 0.02
        ).cost
        for system in (own, _mixed(own, 300.0, rng))
    ]
    assert costs[1] == pytest.approx(costs[0], rel=1e-8)

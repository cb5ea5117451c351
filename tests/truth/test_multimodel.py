"""One law for several plants: gradients, what one model must give, the frozen case, structure, bad input."""

import dataclasses

import numpy as np
import pytest
from multimodel_reference import (
    APART,
    AUTHORITY,
    TOGETHER,
    WEIGHTS,
    grid,
    reference_plant,
)

from middeck.control.h2.closed_cost import Law, evaluate_cost
from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.law_form import LawForm, Station
from middeck.control.law.uncertainty import (
    ModeShift,
    Uncertainty,
    corner_positions,
    finished_plants,
    without_delays,
)
from middeck.control.loop.closed_loop import close_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.robust.search.stabilising_continuation import HELPS
from middeck.control.robust.verification.monte_carlo import outcomes_on, verify_robustness, worst_db
from middeck.errors import ConfigError, NotStabilisableError, NumericalError
from middeck.signals.ports import Port
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.statespace import StateSpace
from plant_builders import sum_of_modes, unit_weights
from repeats import repeats


def random_plant(seed, states=6, w=2, u=2, z=2, y=3):
    """Stable, with direct terms from u to z and from both inputs to y."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((states, states))
    A -= (1.0 + np.linalg.eigvals(A).real.max()) * np.eye(states)
    D = rng.standard_normal((z + y, w + u))
    D[:z, :w] = 0.0
    system = StateSpace(
        A, rng.standard_normal((states, w + u)), rng.standard_normal((z + y, states)), 0.2 * D
    )
    inputs = tuple(Port(f"i{k}", "N") for k in range(w + u))
    outputs = tuple(Port(f"o{k}", "m") for k in range(z + y))
    names = [p.name for p in inputs], [p.name for p in outputs]
    plant = Plant(
        dynamics=system,
        inputs=inputs,
        outputs=outputs,
        w=tuple(names[0][:w]),
        u=tuple(names[0][w:]),
        z=tuple(names[1][:z]),
        y=tuple(names[1][z:]),
    )
    G = rng.standard_normal((w, w))
    weights = LQGWeights(
        output=rng.uniform(0.5, 2.0, z),
        input=rng.uniform(0.5, 2.0, u),
        disturbed=plant.w,
        process=G @ G.T,
        sensor=rng.uniform(0.1, 1.0, y),
    )
    return plant, weights


def law_of(compensator):
    return Law(compensator.system.A, compensator.system.B, compensator.system.C)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_is_that_of_finite_differences(seed):
    plant, weights = random_plant(seed)
    model, law = generalize(plant, weights, 3.0), law_of(design_lqg(plant, weights, 1.0))
    found = evaluate_cost(model, law)
    rng = np.random.default_rng(seed)
    for name in "ABC":
        matrix = getattr(law, name)
        way = rng.standard_normal(matrix.shape)
        # Central differences: truncation h^2 and rounding 1e-16/h are both about 1e-10 of the cost.
        ends = [
            evaluate_cost(model, dataclasses.replace(law, **{name: matrix + h * way})).cost
            for h in (1e-5, -1e-5)
        ]
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(np.sum(way * getattr(found, name)), rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_cost_is_that_of_lqg_and_its_gradient_vanishes_there(seed):
    plant, weights = random_plant(seed)
    lqg = design_lqg(plant, weights, 2.0)
    found = evaluate_cost(generalize(plant, weights, 2.0), law_of(lqg))
    # Riccati and Lyapunov solutions of well-conditioned systems agree to rounding with some digits lost.
    assert found.cost == pytest.approx(lqg.cost, rel=1e-10)
    for name in "ABC":
        assert np.abs(getattr(found, name)).max() < 1e-8 * found.cost


def test_one_model_at_full_order_returns_the_lqg_cost():
    plant = reference_plant()
    lqg = design_lqg(without_delays(plant), WEIGHTS, AUTHORITY)
    law = design_multimodel(plant, WEIGHTS, AUTHORITY, uncertainty=())
    assert law.cost == pytest.approx(lqg.cost, rel=1e-4)  # the level
    assert law.order == 13
    # From a weaker law, that costs half as much again. The least states of this LQG law hardly matter (eight
    # of thirteen do within 0.2 %), and a descent from afar ends where it makes no use of some of them.
    weak = design_lqg(without_delays(plant), WEIGHTS, AUTHORITY / 5.0)
    law = design_multimodel(plant, WEIGHTS, AUTHORITY, uncertainty=(), start=weak)
    assert law.cost == pytest.approx(lqg.cost, rel=2e-3)
    assert law.cost > lqg.cost * (1.0 - 1e-10)  # nothing is below the minimum


@pytest.fixture(scope="module")
def three_models():
    return design_multimodel(reference_plant(), WEIGHTS, AUTHORITY, uncertainty=TOGETHER)


def outcomes(law, positions=None):
    places = np.zeros((1, 2)) if positions is None else positions
    found = verify_robustness(reference_plant(), law, WEIGHTS, uncertainty=APART, positions=places)
    return found.outcomes[0]


def test_nominal_lqg_is_good_and_unstable_at_two_per_cent():
    lqg = design_lqg(without_delays(reference_plant()), WEIGHTS, AUTHORITY)
    assert outcomes(lqg).db[0] == pytest.approx(-34.0, abs=0.05)  # "about 34 dB"
    assert not outcomes(lqg, np.array([[1.0, 1.0]])).stable[0]


def test_three_models_hold_the_whole_grid_at_little_loss(three_models):
    lqg = design_lqg(without_delays(reference_plant()), WEIGHTS, AUTHORITY)
    assert outcomes(three_models).db[0] <= outcomes(lqg).db[0] + 0.2  # the level
    assert outcomes(three_models, grid()).stable.all()
    assert worst_db(outcomes(three_models, grid())) < -33.0
    # Every model costs at least what its own LQG law does.
    plants = finished_plants(reference_plant(), TOGETHER, np.array([[0.0], [-1.0], [1.0]]))
    best = [design_lqg(without_delays(p), WEIGHTS, AUTHORITY).cost for p in plants]
    assert np.all(three_models.costs > best)
    assert three_models.cost == pytest.approx(three_models.costs.mean())


def test_the_last_descent_is_restarted_until_that_does_not_help(three_models):
    last = [leg.cost for leg in three_models.history if leg.size == 1.0]
    assert len(last) >= 2
    assert last[-2] - last[-1] < HELPS * last[-2]


@pytest.mark.parametrize(("order", "loss"), repeats([(4, 0.6), (8, 0.1)]))  # the levels
def test_smaller_orders_lose_little(three_models, order, loss):
    small = design_multimodel(
        reference_plant(), WEIGHTS, AUTHORITY, uncertainty=TOGETHER, form=LawForm(order),
        tolerance=1e-4,
    )  # fmt: skip
    assert len(small.system.A) == small.order == order
    assert outcomes(small).db[0] <= outcomes(three_models).db[0] + loss
    assert outcomes(small, grid()).stable.all()
    assert small.cost > three_models.cost


def test_a_maximum_is_the_minimum_of_a_mean_by_its_dual_weights(three_models):
    law = design_multimodel(
        reference_plant(), WEIGHTS, AUTHORITY, uncertainty=TOGETHER, over="maximum", start=three_models
    )
    assert law.cost == law.costs.max() < three_models.costs.max()
    assert law.multipliers.sum() == pytest.approx(1.0)
    plants = finished_plants(reference_plant(), TOGETHER, np.array([[0.0], [-1.0], [1.0]]))
    models = [generalize(without_delays(p), WEIGHTS, AUTHORITY) for p in plants]
    each = [evaluate_cost(model, law_of(law)) for model in models]
    for name in "BC":
        parts = np.array([m * getattr(c, name) for m, c in zip(law.multipliers, each, strict=True)])
        # The parts cancel to what is left of the gradient when ten steps gain 1e-9.
        assert np.linalg.norm(parts.sum(axis=0)) < 0.05 * np.linalg.norm(parts, axis=(1, 2)).sum()


def test_more_states_than_the_plant_do_not_hurt(three_models):
    law = design_multimodel(
        reference_plant(), WEIGHTS, AUTHORITY, uncertainty=TOGETHER, form=LawForm(16), tolerance=1e-7
    )
    assert law.order == 16
    assert law.cost < three_models.cost * (1.0 + 1e-4)


def one_mode(omega=2.0, zeta=0.01, names=("mode",)):
    n = len(names)
    omega = np.broadcast_to(omega, n)
    modal = sum_of_modes(omega, zeta, np.ones((n, 2)), np.ones((2, n)), names=names)
    ports = (Port("w", "N"), Port("u", "N")), (Port("z", "m"), Port("y", "m"))
    return Plant(dynamics=modal, inputs=ports[0], outputs=ports[1], w=("w",), u=("u",), z=("z",), y=("y",))


def test_order_one_is_as_good_as_all_laws_of_one_state():
    plant = one_mode()
    weights = dataclasses.replace(WEIGHTS, sensor=np.array([1e-2]))
    law = design_multimodel(plant, weights, 10.0, uncertainty=(), form=LawForm(1), tolerance=1e-6)
    model = generalize(plant, weights, 10.0)

    # u = -g / (s + a) y: both numbers of all laws of one state, on a grid, and on a fine one about the best.
    def best(decays, gains):
        costs = {
            (a, g): evaluate_cost(model, Law([[-a]], [[1.0]], [[g]])).cost for a in decays for g in gains
        }
        return min(costs, key=costs.__getitem__), min(costs.values())

    wide = np.geomspace(0.01, 100.0, 8)  # a factor of four from one to the next
    (a, g), coarse = best(wide, np.concatenate([-wide, wide]))
    near = np.geomspace(0.45, 2.2, 9)
    _, fine = best(a * near, g * near)
    assert law.cost <= min(coarse, fine)
    assert law.cost == pytest.approx(fine, rel=0.02)  # steps of a fifth around a flat minimum


def test_decentralised_law_of_two_separate_plants_is_two_lqg_laws():
    alone = one_mode(), one_mode(omega=5.0)
    systems = [p.system for p in alone]
    zero = np.zeros((2, 2))
    joined = StateSpace(
        *(np.block([[getattr(systems[0], k), zero], [zero, getattr(systems[1], k)]]) for k in "ABCD")
    )
    inputs = tuple(Port(f"{p.name}{k}", p.unit) for k in (1, 2) for p in alone[0].inputs)
    outputs = tuple(Port(f"{p.name}{k}", p.unit) for k in (1, 2) for p in alone[0].outputs)
    plant = Plant(
        dynamics=joined,
        inputs=inputs,
        outputs=outputs,
        w=("w1", "w2"),
        u=("u1", "u2"),
        z=("z1", "z2"),
        y=("y1", "y2"),
    )
    weights = unit_weights(("w1", "w2"), np.full(2, 1e-3), outputs=2, inputs=2)
    stations = Station(("y1",), ("u1",), 2), Station(("y2",), ("u2",), 2)
    law = design_multimodel(plant, weights, 4.0, uncertainty=(), form=LawForm(stations=stations))
    single = dataclasses.replace(WEIGHTS, sensor=np.array([1e-3]))
    # Separate plants need nothing of each other: the constrained optimum is the unconstrained one.
    assert law.cost == pytest.approx(sum(design_lqg(p, single, 4.0).cost for p in alone), rel=1e-6)
    K = statespace_response(law.system, np.array([0.3, 3.0]))
    assert np.all(K[:, 0, 1] == 0.0)
    assert np.all(K[:, 1, 0] == 0.0)


def test_a_fixed_notch_is_kept():
    plant, at = one_mode(omega=np.array([2.0, 7.0]), names=("low", "high")), 7.0
    # (s^2 + at^2) / (s + at)^2: no command at 7 rad/s.
    notch = StateSpace([[-2.0 * at, -(at**2)], [1.0, 0.0]], [[1.0], [0.0]], [[-2.0 * at, 0.0]], [[1.0]])
    weights = dataclasses.replace(WEIGHTS, sensor=np.array([1e-3]))
    for place in ("before", "after"):
        law = design_multimodel(
            plant, weights, 10.0, uncertainty=(), form=LawForm(**{place: notch}), tolerance=1e-5
        )
        K = np.abs(statespace_response(law.system, np.array([at, at / 2.0]))[:, 0, 0])
        assert K[0] < 1e-9 * K[1]  # rounding
        assert close_loop(plant, law).stable
        assert len(law.system.A) == law.order + 2 == 8
        assert law.costs[0] >= design_lqg(plant, weights, 10.0).cost


def test_models_of_different_shape():
    """A gimbal at another angle: other modes, other frequencies, other shapes, and two modes fewer."""
    first = one_mode(omega=np.array([2.0, 4.5, 7.0, 9.0]), names=("a", "b", "c", "g"))
    second = one_mode(omega=np.array([2.3, 8.2]), names=("d", "e"))
    phi = np.array([[1.2, -0.6], [1.2, -0.6]])
    second = dataclasses.replace(second, dynamics=dataclasses.replace(second.dynamics, phi=phi))
    weights = dataclasses.replace(WEIGHTS, sensor=np.array([1e-4]))
    law = design_multimodel(first, weights, 10.0, uncertainty=[second], tolerance=1e-5)
    assert not close_loop(second, design_lqg(first, weights, 10.0)).stable  # there is something to do
    for plant, cost in zip((first, second), law.costs, strict=True):
        assert close_loop(plant, law).stable
        assert cost > design_lqg(plant, weights, 10.0).cost
    assert np.all(outcomes_on([first, second], law, weights)[0].db < -6.0)


def test_an_unstable_plant_of_more_states_than_the_law():
    """An inverted pendulum with a mode beside it, at order two: no LQG law reduces to a stabilising one."""
    A = np.array([[0.0, 1.0, 0.0, 0.0], [4.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 6.0], [0.0, 0.0, -6.0, -0.6]])
    B, C = np.array([[0.0], [1.0], [0.0], [0.3]]), np.array([[1.0, 0.0, 0.3, 0.0]])
    system = StateSpace(A, np.hstack([B, B]), np.vstack([C, C]), np.zeros((2, 2)))
    plant = dataclasses.replace(one_mode(), dynamics=system)
    weights = dataclasses.replace(WEIGHTS, sensor=np.array([1e-3]))
    law = design_multimodel(plant, weights, 1.0, uncertainty=(), form=LawForm(2))
    assert close_loop(plant, law).stable
    assert law.cost >= design_lqg(plant, weights, 1.0).cost


def test_a_box_with_a_loop_closed_after_the_shift(three_models):
    """`finish` closes the loop on the shifted plant: the same as shifting first and closing by hand."""
    plant = one_mode(names=("mode",))

    def spring(p):
        system = p.system
        return dataclasses.replace(
            p,
            dynamics=StateSpace(
                system.A - 0.5 * system.B[:, [1]] @ system.C[[1]], system.B, system.C, system.D
            ),
        )

    box = Uncertainty(shifts=(ModeShift(("mode",), 0.1),), finish=spring)
    found = finished_plants(plant, box, np.array([[1.0]]))[0]
    by_hand = spring(shift_modes(plant, {"mode": 1.1}))
    np.testing.assert_array_equal(found.system.A, by_hand.system.A)
    wide = np.block([[found.system.A, np.ones((2, 1))], [np.ones((1, 2)), -np.ones((1, 1))]])
    looped = StateSpace(wide, np.ones((3, 2)), np.ones((2, 3)), np.zeros((2, 2)))
    looped = dataclasses.replace(found, dynamics=looped, state_names=("m", "m", "k"))
    with pytest.raises(ConfigError, match="loop with other states"):
        shift_modes(looped, {"m": 1.1})


def test_bad_input_is_named():
    plant = reference_plant()

    def design(uncertainty=TOGETHER, weights=WEIGHTS, authority=AUTHORITY, **more):
        return design_multimodel(plant, weights, authority, uncertainty=uncertainty, **more)

    with pytest.raises(ConfigError, match=r"no mode named '8\.9 Hz'"):
        design(Uncertainty(shifts=(ModeShift(("8.9 Hz",), 0.02),)))
    with pytest.raises(ConfigError, match="authority"):
        design(authority=0.0)
    with pytest.raises(ConfigError, match="2 output weights for 1 ports"):
        design(weights=dataclasses.replace(WEIGHTS, output=np.ones(2)))
    with pytest.raises(ConfigError, match="3 numbers for 1 parameters"):
        design(positions=np.ones((2, 3)))
    with pytest.raises(ConfigError, match="as its group y"):
        design([dataclasses.replace(one_mode(), y=("z",))])
    weak = design_lqg(without_delays(plant), WEIGHTS, 1.0)
    with pytest.raises(ConfigError, match="does not fit"):
        design(start=weak, form=LawForm(5))
    with pytest.raises(ConfigError, match="mean or maximum"):
        design(over="worst")
    with pytest.raises(ConfigError, match="order = 0"):
        LawForm(0)
    with pytest.raises(ConfigError, match="two shifts name"):
        Uncertainty(shifts=(ModeShift(("a",), 0.1), ModeShift(("a",), 0.1)))
    with pytest.raises(ConfigError, match="random generator"):
        corner_positions(TOGETHER, count=3)
    with pytest.raises(ConfigError, match="not in the plant's group y"):
        design(form=LawForm(stations=(Station(("gyro",), ("u",), 4),)))


def test_a_mode_that_nothing_holds_is_named():
    plant = one_mode(zeta=-0.01, names=("flutter", "hidden"), omega=np.array([2.0, 3.0]))
    modal = plant.dynamics
    psi = modal.psi.copy()
    psi[1, 1] = 0.0
    plant = dataclasses.replace(plant, dynamics=dataclasses.replace(modal, psi=psi))
    with pytest.raises(NotStabilisableError) as error:
        design_multimodel(plant, WEIGHTS, 1.0, uncertainty=())
    assert error.value.data["modes"] == ("hidden",)


def test_plants_that_no_law_holds_are_an_error_with_the_way_so_far(monkeypatch):
    """The sign of the plant turns: a strictly proper law that holds both does not exist for these."""
    monkeypatch.setattr("middeck.control.robust.search.stabilising_continuation.ROUNDS", 5)
    monkeypatch.setattr("middeck.control.robust.search.starting_laws.SPREAD", 2)
    first = one_mode(zeta=-0.2)
    modal = first.dynamics
    turned = dataclasses.replace(first, dynamics=dataclasses.replace(modal, phi=-modal.phi))
    with pytest.raises(NumericalError, match="states"):
        design_multimodel(first, WEIGHTS, 1.0, uncertainty=[turned])

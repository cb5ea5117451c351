"""Plants of measurement models: responses, states, names, delays by Pade and exactly sampled, channels."""

import dataclasses

import gimbal_record
import numpy as np
import pytest
import scipy.linalg as sla
from pole_zero_form import response_of_form

from middeck.errors import ConfigError
from middeck.identification.model.channel_selection import select_channels
from middeck.identification.model.measurement_model import MeasurementModel, model_response, path_delay
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.plants.pole_zero_gain import pole_zero_gain
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, name_states
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.poles.transmission_zeros import balance
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.sampling.simulation import simulate
from middeck.systems.state_space.statespace import StateSpace

NAMES = [p.name for p in gimbal_record.OUTPUTS]
F = np.geomspace(0.05, 15.0, 200)


def a_model(*, outputs=3, inputs=2, delay_s=None, rigid=None, path_delay_s=None):
    omega, zeta = 2.0 * np.pi * gimbal_record.MODES_HZ, gimbal_record.ZETA
    pole = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    zero = np.zeros((outputs, inputs))
    return MeasurementModel(
        poles=pole,
        shapes=gimbal_record.PHI[:outputs] / (2j * pole.imag),
        participation=gimbal_record.PSI[:inputs].T,
        direct=zero,
        lower=zero,
        delay_s=gimbal_record.DELAY_S[:outputs] if delay_s is None else delay_s,
        inputs=gimbal_record.INPUTS[:inputs],
        outputs=gimbal_record.OUTPUTS[:outputs],
        path_delay_s=path_delay_s,
        rigid=rigid,
    )


RIGID = np.outer([0.3, 0.5, -0.2], [1.0, 0.4])
DELAYS = {
    "each output": None,
    "one for all": [0.01, 0.01, 0.01],
    "none": [0.0, 0.0, 0.0],
    "sums": np.array([[0.0, 0.004]]) + np.zeros((3, 1)),
    "every path": np.array([[0.0, 0.004], [0.003, 0.0], [0.0, 0.001]]),
}


@pytest.mark.parametrize("kind", DELAYS)
@pytest.mark.parametrize("rigid", [None, RIGID])
@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (1, 2), (3, 2)])
def test_the_plants_response_is_the_models(kind, rigid, shape):
    outputs, inputs = shape
    delay = DELAYS[kind]
    path = delay[:outputs, :inputs] if isinstance(delay, np.ndarray) else None
    model = a_model(
        outputs=outputs, inputs=inputs, path_delay_s=path,
        delay_s=None if path is not None or delay is None else delay[:outputs],
        rigid=None if rigid is None else rigid[:outputs, :inputs],
    )  # fmt: skip
    plant = approximate_delays(measured_plant(model), 6)
    # Pade 6 errs by (omega tau)^13 / 2.2e13 at most: 2 at 15 Hz and 18.5 ms, hence 4e-10; rounding beside.
    np.testing.assert_allclose(evaluate_plant(plant, F).H, model_response(model, F), rtol=1e-9, atol=1e-13)
    assert len(name_states(plant)) == len(plant.system.A)


@pytest.mark.parametrize(
    ("kind", "shape", "delays"),
    [
        ("one for all", (1, 1), 1),
        ("one for all", (3, 1), 1),  # SITO: the common delay is the torque's
        ("each output", (3, 1), 2),  # and the bus is later by one more
        ("one for all", (1, 2), 1),  # two inputs, one output: the output's
        ("one for all", (3, 2), 2),
        ("none", (3, 2), 0),
    ],
)
def test_a_delay_costs_as_few_states_as_it_can(kind, shape, delays):
    outputs, inputs = shape
    delay = DELAYS[kind]
    model = a_model(outputs=outputs, inputs=inputs, delay_s=None if delay is None else delay[:outputs])
    plant = approximate_delays(measured_plant(model), 3)
    assert len(plant.system.A) == 10 + 3 * delays
    assert sum(name == "delay" for name in name_states(plant)) == 3 * delays


def test_the_rigid_body_is_two_states_at_zero():
    plant = measured_plant(a_model(delay_s=[0.0] * 3, rigid=RIGID))
    poles = np.linalg.eigvals(plant.system.A)
    assert np.sum(poles == 0.0) == 2
    assert name_states(plant)[-2:] == ("rigid-body mode 1",) * 2
    assert len(poles) == 12


@pytest.mark.parametrize("kind", ["each output", "every path"])
@pytest.mark.parametrize("rigid", [None, RIGID])
def test_the_sampled_plants_steps_are_the_models(kind, rigid):
    """Against the closed form of the step response of each mode, at the instants less the delay."""
    delay = DELAYS[kind]
    model = a_model(path_delay_s=None if delay is None else delay, rigid=rigid)
    T = 0.002
    plant = sample_plant(
        measured_plant(model, w=("gimbal",), u=("gimbal", "wheel"), z=("payload",), y=("bus",)), T
    )
    t = T * np.arange(400)
    residue = 2j * model.poles.imag * model.shapes[:, :, None].swapaxes(1, 2)
    for i in range(2):
        u = np.zeros((400, 2))
        u[:, i] = 1.0
        y, _ = simulate(plant.sampled, u)
        for o in range(3):
            delays = t - path_delay(model)[o, i]
            on = np.maximum(delays, 0.0)
            phi_psi = np.real(residue[o, 0] * model.participation[:, i])
            omega, zeta = np.abs(model.poles), gimbal_record.ZETA
            decayed = np.exp(np.multiply.outer(on, model.poles))
            # 1 - e^{-zeta w t} (cos wd t + zeta / sqrt(1 - zeta^2) sin wd t), over w^2.
            step = 1.0 - decayed.real - zeta / np.sqrt(1.0 - zeta**2) * decayed.imag
            expected = step @ (phi_psi / omega**2) + (0.0 if rigid is None else rigid[o, i] * on**2 / 2.0)
            np.testing.assert_allclose(y[:, o], np.where(delays > -1e-12, expected, 0.0), atol=1e-12)
    assert len(plant.state_names) == len(plant.sampled.A)


def test_the_sampled_study_article_needs_eight_states_for_three_delays():
    """500 Hz, 10, 10 and 14.5 ms: one torque, eight past values of it."""
    plant = sample_plant(measured_plant(a_model(inputs=1)), 0.002)
    assert len(plant.sampled.A) == 10 + 8
    assert plant.state_names[-8:] == ("delay",) * 8
    # Far below half the rate the hold is all there is between the two.
    f = np.array([0.3, 1.0, 3.0])
    x = np.pi * f * 0.002
    hold = (np.sin(x) / x * np.exp(-1j * x))[:, None, None]
    H = statespace_response(plant.sampled, 2.0 * np.pi * f)
    # Aliases of modes of 1/s^2 fall-off: (f T)^2 or 4e-5.
    np.testing.assert_allclose(H, hold * model_response(a_model(inputs=1), f), rtol=1e-3)


def test_ports_may_be_in_several_groups_and_share_an_actuator():
    plant = measured_plant(
        a_model(), w=("gimbal",), u=("gimbal",), z=("payload", "bus"), y=("encoder", "bus")
    )
    assert (plant.w, plant.u, plant.z, plant.y) == (
        ("gimbal",), ("gimbal",), ("payload", "bus"), ("encoder", "bus")
    )  # fmt: skip


def test_channels_are_chosen_in_order_and_what_they_do_not_reach_is_named():
    participation = np.array(gimbal_record.PSI.T)
    participation[3, 0] = 0.0  # the 8.9 Hz mode: not moved by the gimbal
    model = dataclasses.replace(a_model(rigid=RIGID), participation=participation)
    chosen = select_channels(model, inputs=("gimbal",), outputs=("bus", "payload"))
    assert chosen.dropped == ("pole at 8.9 Hz",)
    assert [p.name for p in chosen.model.outputs] == ["bus", "payload"]
    np.testing.assert_allclose(
        model_response(chosen.model, F), model_response(model, F)[:, [2, 0]][:, :, [0]], rtol=1e-14
    )
    assert select_channels(model).dropped == ()
    with pytest.raises(ConfigError, match="one of gimbal, wheel"):
        select_channels(model, inputs=("motor",))


@pytest.mark.parametrize("real", [True, False])
def test_a_residue_of_rank_two_has_rank_one_on_a_path(real):
    """Two modes too close to be told apart: one pole twice; each path has it once, and its own zeros."""
    rng = np.random.default_rng(0)
    model = a_model()
    twice = np.append(model.poles, model.poles[3])
    more = rng.standard_normal((3, 1)) * model.shapes[0, 3] + (0.0 if real else 0.01 * rng.random((3, 1)))
    model = dataclasses.replace(
        model, poles=twice, shapes=np.hstack([model.shapes, more]),
        participation=np.vstack([model.participation, rng.standard_normal((1, 2))]),
    )  # fmt: skip
    assert model.states == len(measured_plant(dataclasses.replace(model, delay_s=np.zeros(3))).system.A) == 12
    assert select_channels(model).model.states == 12
    path = select_channels(model, outputs=("bus",), inputs=("wheel",)).model
    assert path.states == 10
    np.testing.assert_allclose(
        model_response(path, F)[:, 0, 0], model_response(model, F)[:, 2, 1], rtol=1e-12
    )
    form = pole_zero_gain(model, "bus", "wheel")
    # Relative degree two with real constants, one with any.
    assert np.sum(np.where(np.imag(form.zeros) > 0.0, 2, 1)) == (8 if real else 9)
    np.testing.assert_allclose(response_of_form(form, F), model_response(model, F)[:, 2, 1], rtol=1e-9)


@pytest.mark.parametrize("delay_s", [1e-4, 1e-3, 1e-2, 1e-1, 1.0])
@pytest.mark.parametrize("order", [3, 6, 10])
def test_delays_leave_the_plant_well_conditioned(delay_s, order):
    """No similarity brings cond(A) below the spread of the poles; ours adds one digit to that, not ten.

    The delay's own condition is below the square of its order (test_delay).
    """
    plant = approximate_delays(measured_plant(a_model(inputs=1, outputs=1, delay_s=[delay_s])), order)
    poles = np.linalg.eigvals(plant.system.A)
    spread = np.abs(poles).max() / np.abs(poles).min()
    cond = np.linalg.cond(balance(plant.system).A)
    assert cond < 10.0 * spread + order**2
    assert cond < 1e4 or spread > 1e3
    # The poles of both parts are those of the whole: what a companion form of order 10 cannot say.
    alone = np.linalg.eigvals(
        approximate_delays(measured_plant(a_model(inputs=1, outputs=1, delay_s=[0.0])), 3).system.A
    )
    assert max(np.abs(poles - p).min() / abs(p) for p in alone) < 1e-9


def test_a_controllers_equations_stay_solvable():
    """The Riccati equation of a plant with Pade 10 is solved to rounding."""
    plant = approximate_delays(measured_plant(a_model(inputs=1, outputs=1, delay_s=[0.01])), 10)
    A, B, C = plant.system.A, plant.system.B, plant.system.C
    X = sla.solve_continuous_are(A, B, C.T @ C, np.eye(1))
    residual = A.T @ X + X @ A - X @ B @ B.T @ X + C.T @ C
    assert np.abs(residual).max() < 1e-10 * np.abs(A.T @ X).max()


@pytest.mark.parametrize(
    "build", [measured_plant, lambda model, **ports: sample_plant(measured_plant(model, **ports), 0.01)]
)
def test_refuses_unknown_ports_and_sampled_models(build):
    with pytest.raises(ConfigError, match="gimbal, wheel"):
        build(a_model(), u=("motor",))
    with pytest.raises(ConfigError, match="payload, encoder, bus"):
        build(a_model(), y=("tip",))
    with pytest.raises(ConfigError, match="sampled"):
        build(dataclasses.replace(a_model(delay_s=[0.0] * 3), sample_hz=256.0))


def test_what_no_path_reaches_is_kept_once():
    """Three unlike delays: a mode on one path has a copy there alone, one on no path stays for the design."""
    system = StateSpace(
        np.diag([-1.0, -2.0, 3.0]), [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], [[1.0, 0.0, 1.0], [1.0, 1.0, 0.0]],
        np.zeros((2, 2)),
    )  # fmt: skip
    ports = (Port("a", "N"), Port("b", "N")), (Port("c", "m"), Port("d", "m"))
    delay = np.array([[0.01, 0.02], [0.02, 0.01]])
    plant = Plant(
        dynamics=system, inputs=ports[0], outputs=ports[1], state_names=("one", "two", "lost"), delay_s=delay
    )
    names = approximate_delays(plant, 2).state_names
    assert [names.count(name) for name in ("one", "two", "lost")] == [1, 1, 1]
    hz = np.array([0.1, 1.0])
    near, exact = (evaluate_plant(p, hz).H for p in (approximate_delays(plant, 6), plant))
    np.testing.assert_allclose(near, exact, rtol=1e-9)

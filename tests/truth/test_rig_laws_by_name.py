"""A sampled compensator on a rig: by the names of its ports, at the rig's own period."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from middeck.control.law.compensator import Compensator
from middeck.control.sampled.emulation import emulate
from middeck.errors import ConfigError
from middeck.laboratory.rig.parts.motors import Motor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler
from middeck.laboratory.rig.rig import Rig, build_rig
from middeck.laboratory.rig.runs import run_closed_loop
from middeck.laboratory.rig.ticks.simulate_rig import simulate_rig
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from plant_builders import sum_of_modes

RATE_HZ = 200.0
INPUTS = (Port("wheel", "N m"), Port("gimbal", "N m"))
OUTPUTS = (Port("bus", "rad"), Port("payload", "rad"), Port("encoder", "rad"))
U = np.random.default_rng(5).standard_normal((400, 2))


def _plant() -> Plant:
    shape = np.array([[1.0, 0.3], [-0.6, 0.9]])
    rows = np.array([[1.0, 0.3], [-0.6, 0.9], [-1.6, 0.6]])
    modal = sum_of_modes(2.0 * np.pi * np.array([1.0, 4.0]), 0.02, shape, rows)
    return Plant(dynamics=modal, inputs=INPUTS, outputs=OUTPUTS)


def _rig() -> Rig:
    return build_rig(
        _plant(),
        motors={"wheel": Motor(torque_limit=5.0), "gimbal": Motor(torque_limit=5.0)},
        sensors={"bus": Gyro(noise=1e-4), "payload": Gyro(noise=1e-4), "encoder": Encoder(1e-5)},
        sample_hz=RATE_HZ,
        delay_s=0.01,
    )


def _law() -> Compensator:
    """From encoder and bus, in this order, to the gimbal."""
    system = StateSpace([[-20.0]], [[20.0, 6.0]], [[-0.4]], [[-0.1, 0.0]])
    return Compensator(system, (OUTPUTS[2], OUTPUTS[0]), (INPUTS[1],))


def _by_hand(sampled: Compensator) -> Compensator:
    """The same, written out in the rig's order."""
    s = sampled.sampled
    B = np.column_stack([s.B[:, 1], 0.0 * s.B[:, 0], s.B[:, 0]])
    D = np.array([[0.0, 0.0, 0.0], [s.D[0, 1], 0.0, s.D[0, 0]]])
    system = SampledStateSpace(s.A, B, np.vstack([0.0 * s.C, s.C]), D, period_s=s.period_s)
    return Compensator(system, OUTPUTS, INPUTS)


@pytest.fixture(scope="module")
def sampled() -> Compensator:
    return emulate(_law(), 1.0 / RATE_HZ)


def test_ports_are_found_by_name_on_the_rig_as_hardware(sampled: Compensator) -> None:
    runs = [
        run_closed_loop(
            _rig(), law, U, periods=1, rng=np.random.default_rng(1), settle=1, rest_s=1.0, steady=True
        )
        for law in (sampled, _by_hand(sampled))
    ]
    first, second = (run.record for run in runs)
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.y, second.y)
    blocks = [
        next(simulate_rig(_rig(), law, [U], np.random.default_rng(1))) for law in (sampled, _by_hand(sampled))
    ]
    np.testing.assert_array_equal(blocks[0].control, blocks[1].control)
    assert np.any(blocks[0].control[:, 1])
    assert not np.any(blocks[0].control[:, 0])  # the wheel is not its


def test_ports_are_found_by_name_with_nothing_switched_on(sampled: Compensator) -> None:
    sensors = {p.name: Sampler(1e-4) for p in OUTPUTS}
    rig = build_rig(_plant(), sample_hz=RATE_HZ, delay_s=0.01, sensors=sensors)
    first, second = (
        run_closed_loop(rig, law, U, periods=1, rng=np.random.default_rng(1)).control
        for law in (sampled, _by_hand(sampled))
    )
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first, second)


def test_what_does_not_fit_is_named(sampled: Compensator) -> None:
    def run(law: Compensator) -> None:
        run_closed_loop(_rig(), law, U, periods=1, rng=np.random.default_rng(0))

    elsewhere = Compensator(
        sampled.sampled, (OUTPUTS[2], Port("mirror", "rad")), (INPUTS[1],), method="tustin"
    )
    with pytest.raises(ConfigError, match="reads mirror; the rig has no such output"):
        run(elsewhere)
    with pytest.raises(ConfigError, match="drives shaker; the rig has no such input"):
        run(Compensator(sampled.sampled, sampled.inputs, (Port("shaker", "N"),), method="tustin"))
    in_degrees = Port(OUTPUTS[2].name, "deg")
    with pytest.raises(ConfigError, match="in deg, the rig has it in rad"):
        run(Compensator(sampled.sampled, (in_degrees, OUTPUTS[0]), sampled.outputs))
    with pytest.raises(ConfigError, match=r"at 0\.01 s, the rig at 0\.005 s"):
        run(emulate(_law(), 0.01))
    with pytest.raises(ConfigError, match="a continuous compensator"):
        run(_law())


def test_a_law_that_is_no_law_is_refused_where_it_is_made(sampled: Compensator) -> None:
    s = sampled.sampled
    for bad in (np.nan, np.inf):
        with pytest.raises(ConfigError, match="a gain that is not finite"):
            dataclasses.replace(sampled, dynamics=dataclasses.replace(s, D=np.full_like(s.D, bad)))
    with pytest.raises(ConfigError, match="reads 'bus' twice"):
        dataclasses.replace(sampled, inputs=(OUTPUTS[0], OUTPUTS[0]))

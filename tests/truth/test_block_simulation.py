"""Simulation in blocks is stepping, to rounding: lightly damped, rigid, late, growing, ill-scaled systems."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.systems.sampling import simulation
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.sampling.simulation import find_periodic_state, simulate, stream
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace
from plant_builders import sum_of_modes

SAMPLES = 20_000


def stepped(system, u, start, kind=np.longdouble):
    """Sample after sample, in extended precision where the machine has it."""
    A, B, C, D = (m.astype(kind) for m in (system.A, system.B, system.C, system.D))
    u, x = u.astype(kind), start.astype(kind)
    y = np.empty((len(u), len(C)), dtype=kind)
    for k in range(len(u)):
        y[k] = C @ x + D @ u[k]
        x = A @ x + B @ u[k]
    return y.astype(float), x.astype(float)


def modes(zeta, low, high, count=8, inputs=2, outputs=3, delay=0.0, seed=0):
    rng = np.random.default_rng(seed)
    omega = 2.0 * np.pi * np.geomspace(low, high, count) if high else np.zeros(count)
    psi, phi = rng.standard_normal((count, inputs)), rng.standard_normal((outputs, count))
    names = tuple(map(str, range(count)))
    modal = ModalSystem(
        omega=omega, zeta=np.full(count, zeta), psi=psi, phi=phi, phi_rate=0.1 * phi, names=names
    )
    return sample_dynamics(modal, 1e-3, delay)


def grows():
    """Stable, but its powers grow to 1e5 first: a long chain of weakly damped states."""
    n = 6
    A = 0.9 * np.eye(n) + 0.5 * np.diag(np.ones(n - 1), 1)
    rng = np.random.default_rng(2)
    return SampledStateSpace(
        A, rng.standard_normal((n, 1)), rng.standard_normal((2, n)), np.ones((2, 1)), period_s=1.0
    )


SYSTEMS = {
    "damped": lambda: modes(0.01, 0.3, 60.0),
    "nearly undamped": lambda: modes(1e-5, 0.3, 400.0),
    "undamped": lambda: modes(0.0, 0.3, 60.0),
    "late by a part of a sample": lambda: modes(0.01, 0.3, 60.0, delay=0.0103),
    "powers that grow": grows,
    "unstable": lambda: modes(-0.001, 0.3, 3.0),
    "one input and output": lambda: modes(0.001, 1.0, 100.0, inputs=1, outputs=1),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_blocks_equal_steps(name):
    system = SYSTEMS[name]()
    rng = np.random.default_rng(1)
    u = rng.standard_normal((SAMPLES, system.B.shape[1]))
    start = rng.standard_normal(len(system.A))
    assert simulation._write_out(system, SAMPLES) is not None
    y, x = simulate(system, u, start)
    exact_y, exact_x = stepped(system, u, start)
    # The level: 1e-12 of the largest output. Rounding of 20,000 steps is some 1e-14 of it.
    assert np.abs(y - exact_y).max() < 1e-12 * np.abs(exact_y).max()
    assert np.abs(x - exact_x).max() < 1e-12 * np.abs(exact_x).max()


def test_a_block_is_as_good_as_stepping_over_a_long_run():
    """What rounding takes from the power would turn an undamped mode by the same angle in every block."""
    system = modes(0.0, 20.0, 400.0, count=3, inputs=1, outputs=1)
    u = np.zeros((40_000, 1))
    start = np.ones(6)
    exact, _ = stepped(system, u, start)
    of_blocks = np.abs(simulate(system, u, start)[0] - exact).max()
    of_steps = np.abs(stepped(system, u, start, float)[0] - exact).max()
    if np.finfo(np.longdouble).eps < 1e-18:
        assert of_blocks < 2.0 * of_steps + 1e-15 * np.abs(exact).max()


def test_rigid_modes_grow_as_they_should():
    """A unit torque held on a free inertia: angle (kT)^2/2, rate kT, to rounding of the sum."""
    modal = sum_of_modes(np.zeros(1), 0.0, [[1.0]], [[1.0], [0.0]], phi_rate=[[0.0], [1.0]], names=("spin",))
    y, _ = simulate(sample_dynamics(modal, 0.01), np.ones((5000, 1)))
    t = 0.01 * np.arange(5000)
    np.testing.assert_allclose(y, np.stack([0.5 * t**2, t], axis=1), rtol=0.0, atol=1e-12 * t[-1] ** 2)


def test_badly_scaled_states_do_not_shorten_the_block():
    """States in units a million times apart: the powers are those of the balanced matrix."""
    well = modes(0.01, 0.3, 60.0)
    units = np.logspace(-6.0, 6.0, len(well.A))
    badly = SampledStateSpace(
        well.A * units[:, None] / units,
        well.B * units[:, None],
        well.C / units,
        well.D,
        period_s=well.period_s,
    )
    u = np.random.default_rng(3).standard_normal((SAMPLES, 2))
    length = [simulation._write_out(s, SAMPLES).through.shape for s in (well, badly)]
    assert length[0] == length[1]
    np.testing.assert_allclose(simulate(badly, u)[0], simulate(well, u)[0], rtol=0.0, atol=1e-11)


def test_what_grows_at_once_is_stepped():
    system = SampledStateSpace([[100.0]], [[1.0]], [[1.0]], [[0.0]], period_s=1.0)
    u = np.ones((100, 1))
    assert simulation._write_out(system, len(u)) is None
    y, _ = simulate(system, u)
    assert np.array_equal(y[:4, 0], [0.0, 1.0, 101.0, 10101.0])


@pytest.mark.parametrize("samples", [0, 1, 7, 1000])
def test_short_inputs(samples):
    system = modes(0.01, 0.3, 60.0)
    u = np.random.default_rng(4).standard_normal((samples, 2))
    y, x = simulate(system, u)
    exact_y, exact_x = stepped(system, u, np.zeros(len(system.A)))
    assert y.shape == (samples, 3)
    np.testing.assert_allclose(y, exact_y, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(x, exact_x, rtol=0.0, atol=1e-13)


def test_no_states_is_a_gain():
    D = np.array([[2.0, -1.0]])
    gain = SampledStateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), D, period_s=1.0)
    u = np.random.default_rng(5).standard_normal((500, 2))
    np.testing.assert_allclose(simulate(gain, u)[0], u @ D.T)


def test_pieces_make_the_whole_and_memory_does_not_grow():
    system = modes(0.01, 0.3, 60.0)
    u = np.random.default_rng(6).standard_normal((5000, 2))
    whole, _ = simulate(system, u)
    pieces = np.vstack(list(stream(system, np.array_split(u, [17, 18, 3000]))))
    np.testing.assert_allclose(pieces, whole, rtol=0.0, atol=1e-13 * np.abs(whole).max())
    peaks = []
    for count in (4, 40):
        tracemalloc.start()
        for _ in stream(system, (np.zeros((5000, 2)) for _ in range(count))):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # Ten times as long, the same memory: a tenth for what the interpreter keeps.
    assert peaks[1] < 1.1 * peaks[0]


def test_the_periodic_state_repeats_itself():
    system = modes(0.002, 0.3, 60.0)
    u = np.random.default_rng(7).standard_normal((3000, 2))
    start = find_periodic_state(system, u)
    _, end = simulate(system, u, start)
    # The slowest mode keeps 0.989 of its state over a period: rounding is a hundredfold here.
    np.testing.assert_allclose(end, start, rtol=0.0, atol=1e-11 * np.abs(start).max())


def test_inputs_of_another_size_are_refused():
    system = modes(0.01, 0.3, 60.0)
    for u in (np.zeros((100, 3)), np.zeros(100)):
        with pytest.raises(ConfigError, match="2 inputs"):
            simulate(system, u)
        with pytest.raises(ConfigError, match="2 inputs"):
            list(stream(system, [u]))
    with pytest.raises(ConfigError, match="16 states"):
        simulate(system, np.zeros((100, 2)), np.zeros(3))

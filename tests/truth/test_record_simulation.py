import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError, DataError, NumericalError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.record_fit.simulate_record import record_nrmse, simulate_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

U2 = (Port("u0", "V"), Port("u1", "V"))
Y2 = (Port("y0", "m"), Port("y1", "m"))


def a_model(*, sample_hz=None, delay_s=(0.0, 0.0), rigid=None):
    rng = np.random.default_rng(3)
    poles = np.array([-0.4 + 9.0j, -0.2 + 21.0j, -3.0 + 0.0j])
    c = rng.standard_normal((2, 3)) + 1j * rng.standard_normal((2, 3))
    b = rng.standard_normal((3, 2)) + 1j * rng.standard_normal((3, 2))
    c[:, 2], b[2] = c[:, 2].real, b[2].real
    direct = np.array([[0.3, 0.0], [0.0, -0.2]])
    return MeasurementModel(
        poles=poles,
        shapes=c,
        participation=b,
        direct=direct,
        lower=0 * direct,
        delay_s=delay_s,
        inputs=U2,
        outputs=Y2,
        sample_hz=sample_hz,
        rigid=rigid,
    )


def stepped(A, B, C, D, u, x):
    """x[k+1] = A x + B u, y = C x + D u, sample by sample."""
    y = np.empty((len(u), len(C)))
    for k, row in enumerate(u):
        y[k], x = C @ x + D @ row, A @ x + B @ row
    return y


def real_form(model, T):
    """A, B, C of the states Re x and Im x, by the definition of the poles and residues."""
    pair = model.is_pair
    z = np.exp(model.poles * T)
    A, B, C = np.zeros((5, 5)), np.zeros((5, 2)), np.zeros((2, 5))
    k = 0
    for m in range(3):
        if pair[m]:
            A[k : k + 2, k : k + 2] = [[z[m].real, -z[m].imag], [z[m].imag, z[m].real]]
            B[k : k + 2] = model.participation[m].real, model.participation[m].imag
            C[:, k : k + 2] = np.stack([2 * model.shapes[:, m].real, -2 * model.shapes[:, m].imag], axis=1)
            k += 2
        else:
            A[k, k], B[k], C[:, k] = z[m].real, model.participation[m].real, model.shapes[:, m].real
            k += 1
    return A, B, C


def a_record(y, u, rate=100.0):
    return Record(sample_hz=rate, u=u[None, None], y=y[None, None], inputs=U2, outputs=Y2, periodic=False)


def test_a_sampled_model_is_its_recursion_from_any_state():
    rng = np.random.default_rng(0)
    model = a_model(sample_hz=100.0)
    u = rng.standard_normal((700, 2))
    A, B, C = real_form(model, 0.01)
    y = stepped(A, B, C, model.direct, u, rng.standard_normal(5) * 5.0)
    # A tenth of the samples tells the state; the rest follows to rounding, grown by the fit's condition.
    np.testing.assert_allclose(simulate_record(model, a_record(y, u), state_share=0.1)[0, 0], y, atol=1e-9)
    assert record_nrmse(model, a_record(y, u), state_share=0.1).max() < 1e-9


@pytest.mark.parametrize("delay_s", [(0.0, 0.0), (0.02, 0.02), (0.004, 0.013)])
def test_held_inputs_of_a_continuous_model_are_exact_with_any_delay(delay_s):
    rng = np.random.default_rng(1)
    fine, T = 1000, 0.01
    model = a_model(delay_s=delay_s)
    u = rng.standard_normal((400, 2))
    u[:10] = 0.0  # nothing before the record, so that a delay misses nothing
    # The same model at a thousandth of the period: inputs held over a step of it are exact there.
    small = T / fine
    A, _, C = real_form(model, small)
    step = np.expm1(model.poles * small) / model.poles
    scaled = dataclasses.replace(model, participation=model.participation * step[:, None])
    B = real_form(scaled, small)[1]
    x = np.zeros((5,))
    powers = np.linalg.matrix_power(A, fine)
    # A whole period in one: B summed over its steps, geometric.
    whole = np.linalg.solve(np.eye(5) - A, (np.eye(5) - powers) @ B)
    y = np.zeros((400, 2))
    states = [x]
    for row in u:
        states.append(powers @ states[-1] + whole @ row)
    for o, tau in enumerate(delay_s):
        n, d = divmod(round(tau / small), fine)
        for k in range(n + 1, 400):
            # At k T - tau: from the sample before, fine - d steps on.
            last = k - n - (d > 0)
            on = (fine - d) % fine
            P = np.linalg.matrix_power(A, on)
            there = P @ states[last] + np.linalg.solve(np.eye(5) - A, (np.eye(5) - P) @ B) @ u[last]
            y[k, o] = C[o] @ there + model.direct[o] @ u[last]
    found = simulate_record(model, a_record(y, u), between="hold")[0, 0]
    np.testing.assert_allclose(found, y, atol=1e-9 * np.abs(y).max())


def test_band_limited_inputs_are_exact_sines():
    model = a_model(delay_s=(0.013, 0.002))
    t = np.arange(1000) / 100.0
    # Whole periods of the record, so that its samples are the sines themselves.
    lines = np.array([0.7, 3.1, 11.9])
    phase = np.array([[0.1, 2.0], [1.0, 0.3], [2.5, 4.0]])
    u = sum(np.cos(2 * np.pi * f * t[:, None] + p) for f, p in zip(lines, phase, strict=True))
    y = np.zeros((1000, 2))
    for f, p in zip(lines, phase, strict=True):
        s = 2j * np.pi * f
        H = (model.shapes / (s - model.poles)) @ model.participation + model.direct
        pairs = model.is_pair
        H += (model.shapes[:, pairs].conj() / (s - model.poles[pairs].conj())) @ model.participation[
            pairs
        ].conj()
        H = H * np.exp(-s * model.delay_s)[:, None]
        y += np.real(np.exp(s * t)[:, None] * (H @ np.exp(1j * p)))
    # Free motion is seen late as well.
    free = np.real(np.exp(model.poles[0] * (t[:, None] - model.delay_s)) * model.shapes[:, 0]) * 3.0
    np.testing.assert_allclose(simulate_record(model, a_record(y + free, u))[0, 0], y + free, atol=1e-9)


def test_a_rigid_mode_drifts_from_any_position_and_rate():
    rigid = np.outer([1.0, 0.4], [1.0, -0.5])
    none = dataclasses.replace(a_model(rigid=rigid), shapes=np.zeros((2, 3)), direct=np.zeros((2, 2)))
    rng = np.random.default_rng(5)
    u = rng.standard_normal((300, 2)) + 0.3
    T, q, v = 0.01, 0.2, -0.1
    y = np.empty((300, 2))
    for k, row in enumerate(u):
        y[k] = q * np.array([1.0, 0.4])
        a = row @ [1.0, -0.5]
        q, v = q + T * v + 0.5 * T**2 * a, v + T * a
    found = simulate_record(none, a_record(y, u), between="hold")[0, 0]
    np.testing.assert_allclose(found, y, atol=1e-9 * np.abs(y).max())


def test_what_cannot_be_simulated_is_refused():
    rng = np.random.default_rng(2)
    u, y = rng.standard_normal((2, 64, 2))
    record = a_record(y, u)
    with pytest.raises(ConfigError, match="share"):
        simulate_record(a_model(), record, state_share=0.0)
    with pytest.raises(ConfigError, match="inputs"):
        simulate_record(a_model(), dataclasses.replace(record, inputs=Y2))
    with pytest.raises(ConfigError, match="sampled at 50 Hz"):
        simulate_record(a_model(sample_hz=50.0), record)
    with pytest.raises(DataError, match="initial states"):
        simulate_record(a_model(), record, state_share=0.02)
    with pytest.raises(NumericalError, match="does not decay"):
        simulate_record(dataclasses.replace(a_model(), poles=[0.1 + 9j, -0.2 + 21j, -3.0 + 0j]), record)

"""Minimal realisation: what was added to a model and does nothing is found and taken out."""

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import MeasurementModel, model_response, natural_hz
from middeck.identification.plants.measured_plant import sampled_statespace
from middeck.identification.plants.reduction import minimal_model
from middeck.signals.ports import Port

PORTS = (Port("a", "N"), Port("b", "N")), (Port("x", "m"), Port("y", "m"))


def a_model(sample_hz=None):
    zero = np.zeros((2, 2))
    return MeasurementModel(
        poles=np.array([-0.4 + 40j, -0.9 + 90j, -7.0 + 0j]),
        shapes=np.array([[1.0 - 2.0j, 0.4j, 0.3], [0.5j, 1.0 + 0.2j, -1.0]]),
        participation=np.array([[1.0, 0.3 + 0.1j], [0.2, 1.0], [1.0, 1.0]]),
        direct=zero, lower=zero, delay_s=np.zeros(2), inputs=PORTS[0], outputs=PORTS[1],
        sample_hz=sample_hz,
    )  # fmt: skip


def with_modes(model, poles, shapes, participation):
    return dataclasses.replace(
        model,
        poles=np.append(model.poles, poles),
        shapes=np.hstack([model.shapes, shapes]),
        participation=np.vstack([model.participation, participation]),
    )


@pytest.mark.parametrize("sample_hz", [None, 100.0])
def test_a_pole_that_two_modes_share_with_opposite_residues_goes(sample_hz):
    model = a_model(sample_hz)
    c, b = np.array([[1.0 + 1j], [0.5]]), np.array([[1.0, 0.5j]])
    spoilt = with_modes(model, [-0.6 + 60j, -0.6 + 60j], np.hstack([c, -c]), np.vstack([b, b]))
    found = minimal_model(spoilt, error=1e-9)
    assert found.model.states == model.states == 5
    f = np.linspace(0.5, 40.0, 500)
    # The two cancel to rounding.
    np.testing.assert_allclose(model_response(found.model, f), model_response(model, f), atol=1e-9)
    # Nine states, five of them minimal; squares are known to rounding, so that values are to its root.
    assert np.sum(found.hankel > 1e-6 * found.hankel[0]) == 5


def test_the_error_is_what_it_says():
    model = a_model()
    weak = with_modes(model, [-0.6 + 60j], np.array([[0.02], [0.01j]]), np.array([[1.0, 0.5]]))
    found = minimal_model(weak, error=0.05)
    np.testing.assert_allclose(found.dropped_hz, natural_hz(weak)[-1:], rtol=1e-12)
    f = np.linspace(0.5, 40.0, 20001)
    H, less = model_response(weak, f), model_response(found.model, f)
    dense = np.max(np.abs(H - less), axis=0) / np.max(np.abs(H), axis=0)
    # The error's own lines lie on each resonance; 20001 even ones come within 1 % of a bandwidth of it.
    np.testing.assert_allclose(found.error, dense, rtol=0.01)
    assert found.error.max() <= 0.05
    # A smaller allowance leaves the mode where it is.
    kept = minimal_model(weak, error=0.5 * float(found.error.max()))
    assert kept.model.states == weak.states
    assert len(kept.dropped_hz) == 0


def test_two_poles_of_one_mode_become_one():
    model = a_model()
    split = dataclasses.replace(
        model,
        poles=np.append(model.poles, model.poles[0] * (1.0 + 1e-7)),
        shapes=np.hstack([model.shapes, 0.5 * model.shapes[:, :1]]),
        participation=np.vstack([model.participation, model.participation[:1]]),
    )
    found = minimal_model(split, error=1e-4)
    assert found.model.states == model.states
    f = np.linspace(0.5, 40.0, 500)
    change = np.abs(model_response(found.model, f) - model_response(split, f)).max(axis=0)
    assert np.all(change <= 1e-4 * np.abs(model_response(split, f)).max(axis=0))


def test_singular_values_of_a_sampled_model_are_those_of_its_state_space():
    model = a_model(100.0)
    found = minimal_model(model, error=1e-9)
    assert found.model.states == model.states
    system = sampled_statespace(model)
    f = np.unique(np.concatenate([np.geomspace(0.1, 50.0, 20000), natural_hz(model)]))
    size = np.abs(model_response(model, f)).max(axis=0)
    output = size.max(axis=1)
    B = system.B / (size / output[:, None]).max(axis=0)
    C = system.C / output[:, None]
    # Gramians as sums of powers, 4000 samples: 0.4 rad/s decays by exp(-16) in amplitude.
    columns, rows, power = [], [], np.eye(len(system.A))
    for _ in range(4000):
        columns.append(power @ B)
        rows.append(C @ power)
        power = system.A @ power
    reach, see = np.hstack(columns), np.vstack(rows)
    expected = np.sqrt(np.linalg.eigvals(reach @ reach.T @ see.T @ see).real)
    # The scales are read from other lines than the reduction's: to a share of a per cent.
    np.testing.assert_allclose(found.hankel, np.sort(expected)[::-1], rtol=0.01)


@pytest.mark.parametrize("error", [0.0, 1.0, np.nan])
def test_an_error_that_is_no_share(error):
    with pytest.raises(ConfigError):
        minimal_model(a_model(), error=error)

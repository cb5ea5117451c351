"""Modal parameters of a model against the mass, damping and stiffness it was made of."""

import numpy as np
import pytest
import scipy.linalg

from middeck.errors import ConfigError, FitError
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.plants.modal_parameters import modal_parameters
from middeck.signals.ports import Port

M = np.diag([2.0, 1.0, 3.0])
K = np.array([[500.0, -200.0, 0.0], [-200.0, 600.0, -400.0], [0.0, -400.0, 900.0]])
INPUTS = tuple(Port(f"force {k}", "N") for k in range(3))
OUTPUTS = tuple(Port(f"place {k}", "m") for k in range(3))


def model_of(C, sample_hz=None):
    """Displacements by forces of M q'' + C q' + K q = f: residues from the first-order eigenproblem."""
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles, right = np.linalg.eig(A)
    left = np.linalg.inv(right)
    upper = np.flatnonzero(poles.imag > 0.0)
    B = np.vstack([np.zeros((3, 3)), np.linalg.inv(M)])
    held = 1.0 if sample_hz is None else np.expm1(poles[upper] / sample_hz) / poles[upper]
    zero = np.zeros((3, 3))
    return MeasurementModel(
        poles=poles[upper],
        shapes=right[:3, upper] * held,
        participation=left[upper] @ B,
        direct=zero,
        lower=zero,
        delay_s=np.zeros(3),
        inputs=INPUTS,
        outputs=OUTPUTS,
        sample_hz=sample_hz,
    )


def proportional():
    return 0.02 * M + 1e-4 * K


@pytest.mark.parametrize("sample_hz", [None, 200.0])
def test_unit_modal_mass_shapes_are_the_eigenvectors(sample_hz):
    found = modal_parameters(model_of(proportional(), sample_hz), drive_point=("place 1", "force 1"))
    squares, phi = scipy.linalg.eigh(K, M)
    omega = np.sqrt(squares)
    # Eigenvalues in double precision, twice.
    np.testing.assert_allclose(found.natural_hz, omega / (2.0 * np.pi), rtol=1e-10)
    np.testing.assert_allclose(found.damping, 0.5 * (0.02 / omega + 1e-4 * omega), rtol=1e-8)
    np.testing.assert_allclose(found.modal_mass, 1.0 / phi[1] ** 2, rtol=1e-8)
    sign = np.sign(np.take_along_axis(phi, np.argmax(np.abs(phi), axis=0)[None], axis=0))
    np.testing.assert_allclose(found.real_shapes, phi * sign, atol=1e-9)
    np.testing.assert_allclose(found.shapes.imag, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.complexity, 1.0, atol=1e-9)
    expected = np.abs(phi.T @ phi) ** 2 / np.outer(np.sum(phi**2, axis=0), np.sum(phi**2, axis=0))
    np.testing.assert_allclose(found.mac, expected, atol=1e-8)
    for m in range(3):
        np.testing.assert_allclose(found.constants[m], np.outer(phi[:, m], phi[:, m]), atol=1e-8)


def test_without_a_drive_point_the_largest_entry_is_one():
    found = modal_parameters(model_of(proportional()))
    assert found.modal_mass is None
    np.testing.assert_allclose(np.max(found.real_shapes, axis=0), 1.0, rtol=1e-9)


def test_one_damper_makes_shapes_complex():
    found = modal_parameters(model_of(np.diag([8.0, 0.0, 0.0])))
    assert np.all(found.complexity < 1.0 - 1e-4)
    # Turned to be as real as they can be: sum phi^2 is real and positive.
    total = np.sum(found.shapes**2, axis=0)
    np.testing.assert_allclose(total.imag, 0.0, atol=1e-12)
    assert total.real.min() > 0.0
    # The definition of Juang and Pappa (1985) by the ratio of the principal axes of Re and Im.
    for phi, mpc in zip(found.shapes.T, found.complexity, strict=True):
        axes = np.linalg.eigvalsh(np.cov(phi.real, phi.imag, bias=True) + np.outer(*2 * (_mean(phi),)))
        assert mpc == pytest.approx(((axes[1] - axes[0]) / axes.sum()) ** 2, rel=1e-9)


def _mean(phi):
    return np.array([phi.real.mean(), phi.imag.mean()])


def test_a_point_that_is_not_driven_is_refused():
    with pytest.raises(FitError, match="not positive"):
        modal_parameters(model_of(proportional()), drive_point=("place 0", "force 2"))
    with pytest.raises(ConfigError, match="no output named"):
        modal_parameters(model_of(proportional()), drive_point=("tip", "force 2"))


def test_a_model_of_real_poles_has_no_mode():
    zero = np.zeros((1, 1))
    model = MeasurementModel(
        poles=np.array([-3.0 + 0j]),
        shapes=zero + 1.0,
        participation=zero + 1.0,
        direct=zero,
        lower=zero,
        delay_s=np.zeros(1),
        inputs=INPUTS[:1],
        outputs=OUTPUTS[:1],
    )
    with pytest.raises(ConfigError, match="no mode"):
        modal_parameters(model)

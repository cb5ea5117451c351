"""Rates under commands that were held, though the record does not say so: a hold turns their residues.

The truth is made here: modes by the matrix exponential under held commands, or by their response where the
inputs are band-limited.
"""

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.identification.fit.fit_result import FitResult
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.undeclared_hold import turned_by_half
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats

RATE, COUNT, SETTLED = 100.0, 500, 3000
VELOCITY, ACCELERATION = Port("gyro", "rad/s"), Port("felt", "m/s^2")
HZ, ZETA = np.array([8.4]), np.array([0.02])
OMEGA = 2.0 * np.pi * HZ
A = sla.block_diag(*([[0.0, 1.0], [-(w**2), -2.0 * z * w]] for w, z in zip(OMEGA, ZETA, strict=True)))
B, SHAPE = np.array([0.0, 1.0]), np.array([1.0, 0.0])


def commands(rng: np.random.Generator, last_hz: float) -> np.ndarray:
    """Periods of a multisine, until all is steady."""
    f = np.fft.rfftfreq(COUNT // 2, 1.0 / RATE)
    U = np.where((f > 1.0) & (f < last_hz), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    return np.tile(np.fft.irfft(U, COUNT // 2), (SETTLED + COUNT) // (COUNT // 2))


def measured(
    port: Port, seed: int, *, held: bool, late_s: float = 0.0, last_hz: float = 12.0
) -> tuple[Record, np.ndarray]:
    """A record that says nothing of a hold, and the residues of its modes, delayed.

    ``late_s`` is less than a sample. Without a delay an acceleration moves at once with its command.
    """
    rng, power = np.random.default_rng([4711, seed]), 1 if port is VELOCITY else 2
    C = SHAPE @ np.linalg.matrix_power(A, power)
    D = float(SHAPE @ A @ B) if power == 2 else 0.0
    poles, V = np.linalg.eig(A)
    up = np.flatnonzero(poles.imag > 0.0)
    up = up[np.argsort(poles[up].imag)]
    residues = ((C @ V) * np.linalg.solve(V, B))[up]
    u = commands(rng, last_hz)
    y = np.zeros(len(u))
    if held:

        def over(t: float) -> tuple[np.ndarray, np.ndarray]:
            step = sla.expm(t * np.block([[A, B[:, None]], [np.zeros((1, 3))]]))
            return step[:2, :2], step[:2, 2]

        (Ad, _), (after, new), (_, old) = over(1.0 / RATE), over(1.0 / RATE - late_s), over(late_s)
        x, last = np.zeros(2), 0.0
        for k, now in enumerate(u):
            y[k] = C @ x + D * (last if late_s else now)
            x, last = Ad @ x + after @ old * last + new * now, now
    else:
        s = 2j * np.pi * np.fft.rfftfreq(len(u), 1.0 / RATE)[:, None]
        H = np.sum(residues / (s - poles[up]) + residues.conj() / (s - poles[up].conj()), axis=1) + D
        y = np.fft.irfft(np.fft.rfft(u) * H * np.exp(-late_s * s[:, 0]), len(u))
    y = y[SETTLED:] + 1e-3 * y.std() * rng.standard_normal(COUNT)
    taken = Record(
        sample_hz=RATE,
        u=u[None, None, SETTLED:, None],
        y=y[None, None, :, None],
        inputs=(Port("force", "N"),),
        outputs=(port,),
        periodic=False,
    )
    return taken, residues * np.exp(-late_s * poles[up])


def off(fit: FitResult, residues: np.ndarray) -> float:
    """The largest error of a residue, in stated deviations."""
    known, model = parameters_of(fit.covariance), fit.model
    errors = []
    for w, residue in zip(OMEGA, residues, strict=True):
        m = int(np.argmin(np.abs(np.imag(model.poles) - w)))
        for part, true in (("re", residue.real), ("im", residue.imag)):
            (k,) = (k for k, name in enumerate(known.names) if name.startswith(f"residue_{part}[{m},"))
            errors.append((known.values[k] - true) / known.deviation[k])
    return float(np.max(np.abs(errors)))


@pytest.mark.kernels
@pytest.mark.parametrize("port", repeats([ACCELERATION, VELOCITY]))
def test_a_hold_that_turns_residues_of_rates_is_taken_out_or_told(port: Port) -> None:
    """Residues were turned by half a sample, 800 to 2900 deviations, in silence."""
    taken, residues = measured(port, 2, held=True)
    fit = fit_record(taken)
    if fit.model.hold_s is None:
        assert any("turned by half a sample period" in text for text in fit.warnings)
    else:
        assert fit.model.hold_s == 1.0 / RATE
        assert "turned by half a sample" in fit.order_reason
        assert off(fit, residues) < 4.5


@pytest.mark.kernels
@pytest.mark.parametrize("port", repeats([ACCELERATION, VELOCITY]))
def test_rates_under_band_limited_inputs_are_right_without_a_warning(port: Port) -> None:
    taken, residues = measured(port, 2, held=False)
    fit = fit_record(taken)
    assert fit.model.hold_s is None
    assert fit.warnings == ()
    assert off(fit, residues) < 4.5


def test_a_delay_other_than_that_of_a_hold_does_not_turn_residues_by_half_a_sample() -> None:
    taken, _ = measured(VELOCITY, 2, held=False, late_s=0.003)
    assert not turned_by_half(fit_record(taken), RATE)

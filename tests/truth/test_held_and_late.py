"""Commands held over each sample that move an article late: its modes and its delay, no poles for the delay.

The truth is made here: modes and a delay of any part of a sample, by the matrix exponential.
"""

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.record_fit.fit_record import fit_record
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats

HZ, ZETA = np.array([30.9, 58.1, 340.2]), np.array([0.0066, 0.010, 0.0031])
RATE = 1000.0


def commanded(seed: int, samples: float, noise: float, count: int = 1500) -> Record:
    """White commands, held, that move modes ``samples`` later; noise of a sensor, over its rms."""
    rng, period = np.random.default_rng(seed), 1.0 / RATE
    omega = 2.0 * np.pi * HZ
    A = sla.block_diag(*([[0.0, 1.0], [-(w**2), -2.0 * z * w]] for w, z in zip(omega, ZETA, strict=True)))
    B = np.tile([0.0, 1.0], len(HZ))
    C = np.ravel([(w * g, 0.0) for w, g in zip(omega, rng.uniform(0.4, 1.0, len(HZ)), strict=True)])

    def over(time_s: float) -> tuple[np.ndarray, np.ndarray]:
        step = sla.expm(time_s * np.block([[A, B[:, None]], [np.zeros((1, len(A) + 1))]]))
        return step[:-1, :-1], step[:-1, -1]

    whole = int(np.ceil(samples))
    (Ad, Bd), (Ap, Bp) = over(period), over((whole - samples) * period)
    u, x, y = rng.standard_normal(count), np.zeros(len(A)), np.zeros(count)
    for k in range(count - whole):
        y[k + whole] = C @ (Ap @ x + Bp * u[k])
        x = Ad @ x + Bd * u[k]
    y += noise * y.std() * rng.standard_normal(count)
    return Record(
        sample_hz=RATE,
        u=u[None, None, :, None],
        y=y[None, None, :, None],
        inputs=(Port("command", "N"),),
        outputs=(Port("angle", "rad"),),
        periodic=False,
        held=True,
    )


@pytest.mark.kernels
@pytest.mark.parametrize(
    ("samples", "noise", "seed"),
    repeats([(s, n, seed) for seed in range(1993, 2003) for s in (1.4, 0.3) for n in (1.5e-3, 1e-5)]),
)
def test_a_late_article_has_its_modes_and_its_delay(samples: float, noise: float, seed: int) -> None:
    """A sampled model had poles for the delay, above half the rate or doubtful, in all of these."""
    fit = fit_record(commanded(seed, samples, noise))
    model, of, order = fit.model, fit.uncertainty, np.argsort(natural_hz(fit.model))
    assert fit.warnings == ()
    assert set(fit.standing) == {"sound"}
    assert len(model.poles) == len(HZ)
    assert np.all(np.abs(natural_hz(model)[order] - HZ) < 4.0 * of.natural_hz[order])
    assert np.all(np.abs(damping_ratio(model)[order] - ZETA) < 4.0 * of.damping[order])
    assert abs(model.delay_s[0] - samples / RATE) < 4.0 * of.delay_s[0]
    assert model.hold_s == 1.0 / RATE


def test_without_a_delay_a_sampled_model_is_kept() -> None:
    fit = fit_record(commanded(1993, 0.0, 1e-3))
    assert fit.warnings == ()
    assert fit.model.sample_hz == RATE
    np.testing.assert_allclose(np.sort(natural_hz(fit.model)), HZ, rtol=1e-3)

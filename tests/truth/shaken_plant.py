"""A sampled plant of two inputs and two outputs, shaken by inputs, by forces, and under sensor noise."""

import dataclasses

import numpy as np

from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.record_fit.simulate_record import simulate_record
from middeck.signals.ports import Port
from middeck.signals.record import Record

U2, Y2 = (Port("u0", "V"), Port("u1", "V")), (Port("y0", "m"), Port("y1", "m"))
POLES = np.array([-0.02 + 0.6j, -0.03 + 1.4j])


def a_plant():
    rng = np.random.default_rng(7)
    c, b = (rng.standard_normal((2, 2)) + 1j * rng.standard_normal((2, 2)) for _ in "cb")
    direct = np.array([[0.2, 0.0], [0.1, -0.3]])
    return MeasurementModel(
        poles=POLES,
        shapes=c,
        participation=b,
        direct=direct,
        lower=0 * direct,
        delay_s=np.zeros(2),
        inputs=U2,
        outputs=Y2,
        sample_hz=1.0,
    )


def shaken(seed, count=400, *, experiments=1, noise=0.0, motion=0.0):
    """Records of the plant at rest before, with sensor noise or forces beside the inputs."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((experiments, 1, count + 200, 2))
    blank = Record(
        sample_hz=1.0, u=u + motion * rng.standard_normal(u.shape), y=u, inputs=U2, outputs=Y2, periodic=False
    )
    y = simulate_record(
        a_plant(), dataclasses.replace(blank, y=rng.standard_normal(u.shape)), state_share=0.05
    )
    y = y + noise * rng.standard_normal(y.shape)
    # The first samples are cut: the record begins in motion.
    return Record(sample_hz=1.0, u=u[:, :, 200:], y=y[:, :, 200:], inputs=U2, outputs=Y2, periodic=False)


def pole_error(model):
    found = model.poles[np.argsort(np.imag(model.poles))]
    return np.abs(found - POLES).max()

"""A mode of many outputs stands for two: what its lines leave follows the inputs, whatever its power."""

import numpy as np
import pytest

from middeck.identification.fit.unneeded_modes import pairs_of
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.problem.unknowns_layout import Point
from middeck.identification.record_fit.record_spectra import record_data
from middeck.identification.record_fit.reduced_record import has_many_outputs
from middeck.identification.record_fit.refine_record import refine_record
from middeck.identification.record_fit.unneeded_modes_and_sines import tidied
from middeck.identification.start.start import start_from_point
from middeck.signals.ports import Port
from middeck.signals.record import Record

RATE_HZ, SAMPLES, OUTPUTS, ZETA = 64.0, 4096, 8, 0.02
REAL = FitOptions(states=2, constants="real", delay=False, direct=False)


@pytest.mark.parametrize("apart_hz", [0.1, 0.0])
def test_what_the_lines_of_a_mode_leave_tells_whether_it_is_two(apart_hz: float) -> None:
    """A hundred lines wide: the variance of noise follows what one mode leaves, so that its power is none."""
    rng = np.random.default_rng(0)
    omega = 2.0 * np.pi * np.array([8.0, 8.0 + apart_hz])[: 2 if apart_hz else 1]
    f = np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    phi, psi = rng.standard_normal((OUTPUTS, len(omega))), rng.standard_normal((len(omega), 2))
    s = 2j * np.pi * f[:, None]
    H = np.einsum("om,lm,mi->loi", phi, 1.0 / (s**2 + 2.0 * ZETA * omega * s + omega**2), psi)
    drive = rng.standard_normal((len(f), 2)) + 1j * rng.standard_normal((len(f), 2))
    drive[(f < 1.0) | (f > 20.0)] = 0.0
    u, y = (np.fft.irfft(x, SAMPLES, axis=0) for x in (drive, np.einsum("loi,li->lo", H, drive)))
    record = Record(
        sample_hz=RATE_HZ,
        u=u[None, None],
        y=(y + 0.01 * y.std(axis=0) * rng.standard_normal(y.shape))[None, None],
        inputs=(Port("left", "N"), Port("right", "N")),
        outputs=tuple(Port(f"y{o}", "m") for o in range(OUTPUTS)),
        periodic=False,
    )
    data = record_data(record, (4.0, 15.0), whole=False)
    assert has_many_outputs(data)
    point = Point(np.array([-1.0 + 50.5j]), np.ones((1, 2)), np.zeros((OUTPUTS, 1)), np.zeros((0, 2)))
    start = start_from_point(REAL, np.array([True]), point, OUTPUTS)
    one = refine_record(data, start, "output", rounds=3, steps=20)
    assert one is not None
    found = np.sort(np.abs(pairs_of(tidied(record, data, one, sampled=False).run)))
    assert found == pytest.approx(omega, rel=2e-4)

"""A mode stands for two: what its lines leave follows the inputs, whatever its power."""

import numpy as np
import pytest
from struck_plant import shaken

from middeck.identification.fit.unneeded_modes import pairs_of
from middeck.identification.model.fit_options import FitOptions
from middeck.identification.model.measurement_model import damping_ratio, natural_hz
from middeck.identification.problem.unknowns_layout import Point
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.record_fit.record_spectra import record_data
from middeck.identification.record_fit.reduced_record import has_many_outputs
from middeck.identification.record_fit.refine_record import refine_record
from middeck.identification.record_fit.unneeded_modes_and_sines import tidied
from middeck.identification.start.start import start_from_point
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import repeats

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


CLOSE_HZ, CLOSE_ZETA = np.array([9.0, 9.027]), np.array([0.004, 0.005])


def beating(seed: int) -> Record:
    plant = (CLOSE_HZ, CLOSE_ZETA, [1.0, 0.8], 0.0)
    return shaken(plant, 2000, 40.0, (2.0, 18.0), noise=0.1, seed=seed)


@pytest.mark.parametrize("seed", repeats([1, 2]))
def test_two_modes_whose_lack_looks_like_noise_of_forces(seed: int) -> None:
    """Noise of a tenth: one mode beside a spare one was 37 deviations off, or both were one double pole."""
    fit = fit_record(beating(seed), band_hz=(4.0, 16.0), sampled=False, states=4)
    order = np.argsort(natural_hz(fit.model))
    f, of = natural_hz(fit.model)[order], fit.uncertainty.natural_hz[order]
    zeta, of_zeta = damping_ratio(fit.model)[order], fit.uncertainty.damping[order]
    assert np.all(np.abs(f - CLOSE_HZ) < 4.0 * of)
    assert np.all(np.abs(zeta - CLOSE_ZETA) < 4.0 * of_zeta)
    assert of.max() < 0.008


def test_a_mode_that_two_describe_better_is_reported_where_its_order_was_asked_for() -> None:
    fit = fit_record(beating(1), band_hz=(4.0, 16.0), sampled=False, states=2)
    assert [w.split(":")[0] for w in fit.warnings if "two modes in its place" in w] == ["mode at 9.009 Hz"]
    assert fit.standing == ("doubtful",)


def shaken_modes(hz: list[float], seed: int) -> Record:
    """Modes of nearly one frequency, of like signs: a thousand samples, 3 % noise."""
    plant = (hz, [0.005, 0.004][: len(hz)], [1.0, 0.8][: len(hz)], 0.0)
    return shaken(plant, 1000, 40.0, (2.0, 18.0), noise=0.03, seed=seed)


@pytest.mark.parametrize(("hz", "doubted"), [([9.0, 9.009], True), ([9.0], False)])
def test_two_modes_that_a_record_does_not_distinguish_are_doubted(hz: list[float], doubted: bool) -> None:
    """A tenth of a per cent apart, one mode was up to 30 deviations off either, in silence."""
    for seed in (1, 3, 4):
        record = shaken_modes(hz, seed)
        data = record_data(record, (2.0, 18.0), whole=False)
        point = Point(np.array([-0.25 + 56.6j]), np.ones((1, 1)), np.zeros((1, 1)), np.zeros((0, 1)))
        start = start_from_point(REAL, np.array([True]), point, 1)
        one = refine_record(data, start, "output", rounds=3, steps=20)
        assert one is not None
        found = tidied(record, data, one, sampled=False)
        assert len(found.perhaps_two) == doubted
        assert found.run.layout.pairs == 1


def repeating(hz: list[float], seed: int) -> Record:
    """Three periods of a multisine on 200 lines through displacements, exact; 0.8 % noise."""
    rng, f = np.random.default_rng([260, seed]), np.fft.rfftfreq(512, 1.0 / RATE_HZ)
    w, zeta = 2.0 * np.pi * np.array(hz), np.array([0.004, 0.003])[: len(hz)]
    U = np.where((f > 0.0) & (f < 0.4 * RATE_HZ), np.exp(2j * np.pi * rng.random(len(f))), 0.0)
    s = 2j * np.pi * f[:, None]
    H = np.sum(w**2 / (s**2 + 2.0 * zeta * w * s + w**2), axis=1)
    u, y = (np.tile(np.fft.irfft(X), 3).reshape(1, 3, 512, 1) for X in (U, U * H))
    y = y + 0.008 * y.std() * rng.standard_normal(y.shape)
    ports = (Port("f", "N"),), (Port("d", "m"),)
    return Record(sample_hz=RATE_HZ, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=True, held=False)


@pytest.mark.parametrize(("hz", "doubted"), [([7.777, 7.787], True), ([7.777], False)])
def test_two_modes_that_periods_do_not_distinguish_are_doubted(hz: list[float], doubted: bool) -> None:
    """Between the lines of a signal that repeats is silence: one mode was 16 deviations off, in silence."""
    for seed in (1, 3, 4):
        record = repeating(hz, seed)
        data = record_data(record, (1.0, 25.0), whole=False)
        point = Point(np.array([-0.15 + 48.9j]), np.ones((1, 1)), np.zeros((1, 1)), np.zeros((0, 1)))
        start = start_from_point(REAL, np.array([True]), point, 1)
        one = refine_record(data, start, "output", rounds=3, steps=20)
        assert one is not None
        assert data.driven is not None
        assert len(tidied(record, data, one, sampled=False).perhaps_two) == doubted


def test_a_mode_that_may_be_two_is_doubted_alone() -> None:
    """The other mode of the record stays sound, and what is said names the one that is not."""
    plant = ([5.0, 9.0, 9.009], [0.01, 0.005, 0.004], [0.3, 1.0, 0.8], 0.0)
    fit = fit_record(shaken(plant, 1000, 40.0, (2.0, 18.0), noise=0.03, seed=1), sampled=False, states=4)
    assert [w.split(":")[0] for w in fit.warnings if "may be two modes" in w] == ["mode at 9.005 Hz"]
    standing = dict(zip(np.round(natural_hz(fit.model)), fit.standing, strict=True))
    assert standing == {5.0: "sound", 9.0: "doubtful"}

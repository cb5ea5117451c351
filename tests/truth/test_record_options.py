"""What the fit of one long record may be told about the article, and channels that drift."""

import dataclasses

import numpy as np
import pytest

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import damping_ratio, natural_hz, path_delay
from middeck.identification.record_fit.fit_record import fit_record
from middeck.identification.uncertainty.parameter_deviations import parameters_of
from middeck.signals.ports import Port
from middeck.signals.record import Record
from repeats import LONG, repeats

INPUTS = (Port("torque", "N m"), Port("wheel", "N m"))
OUTPUTS = (Port("payload", "rad"), Port("bus", "rad"))
RATE_HZ, BAND_HZ = 128.0, (0.3, 40.0)
HZ, ZETA = np.array([2.5, 9.0]), 0.01
W = 2.0 * np.pi * HZ
PHI, PSI = np.array([[1.0, 0.7], [0.6, -0.8]]), np.array([[1.0, -0.5], [0.4, 0.9]])
RANK_ONE = np.outer([0.9, 0.7], [1.2, -0.5])
FREE = {"rigid": 30.0 * RANK_ONE, "integrators": 3.0 * RANK_ONE}
PATHS = np.array([[0.010, 0.018], [0.013, 0.004]])


def moving(seed, samples=1024, *, rigid=None, integrators=None, paths=None, noise=0.01):
    """A quarter of a longer run under noise in the band: what moved before is its unknown initial state."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(4 * samples, 1.0 / RATE_HZ)
    on = (f > BAND_HZ[0]) & (f < BAND_HZ[1])
    U = on[:, None] * (rng.standard_normal((len(f), 2)) + 1j * rng.standard_normal((len(f), 2)))
    s = np.where(on, 2j * np.pi * f, 1.0)[:, None, None]
    G = np.einsum("om,km,im->koi", PHI, W**2 / (s[:, :, 0] ** 2 + 2 * ZETA * W * s[:, :, 0] + W**2), PSI)
    for residue, power in ((rigid, 2), (integrators, 1)):
        G = G if residue is None else G + residue / s**power
    G = G if paths is None else G * np.exp(-s * paths)
    u, y = (
        np.fft.irfft(X, n=4 * samples, axis=0)[samples : 2 * samples]
        for X in (U, np.einsum("koi,ki->ko", G, U))
    )
    if rigid is not None:
        # A free body that also drifts, as none of the sines above does.
        y = y + np.linspace(0.3, 1.0, samples)[:, None] * rigid[:, 0] * y.std()
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    return Record(
        sample_hz=RATE_HZ, u=u[None, None], y=y[None, None], inputs=INPUTS, outputs=OUTPUTS, periodic=False
    )


def deviations(fitted):
    """How far frequencies and damping are off, each in its stated deviation."""
    order = np.argsort(natural_hz(fitted.model))
    return np.concatenate(
        [
            (natural_hz(fitted.model)[order] - HZ) / fitted.uncertainty.natural_hz[order],
            (damping_ratio(fitted.model)[order] - ZETA) / fitted.uncertainty.damping[order],
        ]
    )


def entries_off(fitted, kind, truth):
    """How far the entries of R, Q or of delays are off, in their deviations."""
    p = parameters_of(fitted.covariance)
    at = [k for k, name in enumerate(p.names) if name.startswith(kind + "[")]
    return (p.values[at] - truth.ravel()) / p.deviation[at]


@pytest.mark.parametrize(
    ("kind", "entry", "states", "samples"),
    repeats(
        [("rigid", "rigid", 6, 8320), ("integrators", "integral", 5, 1024), ("rigid", "rigid", 6, 1024)], 2
    ),
)
def test_a_free_body_is_found_beside_its_modes(kind, entry, states, samples):
    """A long record starts from local models, a short one from its samples."""
    record = moving(0, samples, **{kind: FREE[kind]})
    fitted = fit_record(record, states=states, delay=False, **{kind: 1})
    assert fitted.model.states == states
    # Eight unit normals of a run: all below four with probability 0.9995.
    assert np.abs(deviations(fitted)).max() < 4.0
    assert np.abs(entries_off(fitted, entry, FREE[kind])).max() < 4.0
    assert np.linalg.matrix_rank(getattr(fitted.model, entry), rtol=1e-9) == 1


def test_the_order_of_a_free_body_is_that_of_its_flexible_modes():
    fitted = fit_record(moving(0, rigid=FREE["rigid"]), rigid=1, delay=False)
    assert fitted.model.states == 6
    assert "6 states have the minimum description length" in fitted.order_reason
    assert np.abs(deviations(fitted)).max() < 4.0


@pytest.mark.parametrize("samples", repeats([1024, 8320]))
def test_two_paths_have_delays_of_their_own(samples):
    fitted = fit_record(moving(1, samples, paths=PATHS), states=4, delay="path")
    assert np.abs(deviations(fitted)).max() < 4.0
    at = [k for k, name in enumerate(parameters_of(fitted.covariance).names) if "delay" in name]
    deviation = parameters_of(fitted.covariance).deviation[at].max()
    # The delay of a path is that of its output and what is beyond: their deviations add up at most.
    assert np.abs(path_delay(fitted.model) - PATHS).max() < 4.0 * 2.0 * deviation
    assert deviation < 1e-3


def test_a_common_delay_of_a_stated_relative_degree():
    record = moving(2, paths=np.full((2, 2), 0.011))
    fitted = fit_record(record, states=4, constants="complex", delay="common", relative_degree=2)
    c, b = fitted.model.shapes, fitted.model.participation
    # Rounding: the residues of each path add up to nothing.
    assert np.abs(np.real(c @ b)).max() < 1e-10 * np.abs(c).max() * np.abs(b).max()
    assert np.abs(deviations(fitted)).max() < 4.0
    assert np.ptp(fitted.model.delay_s) == 0.0
    assert np.abs(fitted.model.delay_s - 0.011).max() < 4.0 * fitted.uncertainty.delay_s.max()


@pytest.mark.parametrize("sampled", repeats([True, False]))
def test_residues_of_any_rank(sampled):
    fitted = fit_record(
        moving(3), states=4, constants="complex", full_rank=True, sampled=sampled, weighting="output"
    )
    # Each pole has a residue of rank two, and counts once among the states asked for.
    assert len(fitted.model.poles) == 4
    assert np.allclose(np.sort(natural_hz(fitted.model))[::2], HZ, rtol=1e-3)


@pytest.mark.parametrize("kind", repeats(["path", "rigid", "integrators", "full"]))
def test_stated_deviations_are_those_of_repeated_records(kind, campaign):
    options = {
        "rigid": {"states": 6, "rigid": 1, "delay": False},
        "integrators": {"states": 5, "integrators": 1, "delay": False},
        "path": {"states": 4, "delay": "path"},
        "full": {"states": 4, "constants": "complex", "full_rank": True},
    }[kind]
    truth = {kind: FREE[kind]} if kind in FREE else {"paths": PATHS} if kind == "path" else {}
    z = []
    for seed in campaign(40):
        fitted = fit_record(moving(seed, **truth), weighting="output", **options)
        if kind == "full":
            fitted = _poles_once(fitted)
        z += list(deviations(fitted))
    # n unit normals: their mean square is known to sqrt(2 / n), four of which are allowed; weights estimated
    # from the same lines add a tenth.
    assert abs(np.mean(np.square(z)) - 1.0) < 4.0 * np.sqrt(2.0 / len(z)) + 0.1


def _poles_once(fitted):
    """A residue of rank two has its pole twice."""
    keep = np.unique(fitted.model.poles, return_index=True)[1]
    model, of = fitted.model, fitted.uncertainty
    once = dataclasses.replace(
        model, poles=model.poles[keep], shapes=model.shapes[:, keep], participation=model.participation[keep]
    )
    deviation = dataclasses.replace(of, natural_hz=of.natural_hz[keep], damping=of.damping[keep])
    return dataclasses.replace(fitted, model=once, uncertainty=deviation)


@pytest.mark.parametrize(
    ("options", "within"),
    [({"states": 4}, 1e-6), ({"states": 4, "sampled": True, "weighting": "output"}, 1e-2)],
    ids=str,
)
def test_an_offset_and_a_ramp_of_any_channel_change_nothing(options, within):
    """A ramp of fifty times the response is in the span of the transient: what is left is rounding.

    A sampled fit keeps small ramps, as slow response: its weights differ by those of the still record.
    """
    record = moving(4, 1024 if LONG else 512)
    t = np.linspace(0.0, 1.0, record.u.shape[2])[:, None]
    drifting = dataclasses.replace(
        record,
        y=record.y + (50.0 * t + 20.0) * record.y.std(axis=(0, 1, 2)),
        u=record.u + (3.0 * t - 7.0) * record.u.std(axis=(0, 1, 2)),
    )
    still, moved = fit_record(record, **options), fit_record(drifting, **options)
    np.testing.assert_allclose(
        natural_hz(moved.model), natural_hz(still.model), atol=within * still.uncertainty.natural_hz.min()
    )
    np.testing.assert_allclose(
        damping_ratio(moved.model), damping_ratio(still.model), atol=within * still.uncertainty.damping.min()
    )
    np.testing.assert_allclose(moved.error, still.error, rtol=within)


def test_a_drifting_free_body_keeps_its_poles():
    record = moving(5, 1024 if LONG else 512, rigid=FREE["rigid"])
    t = np.linspace(-1.0, 1.0, record.u.shape[2])[:, None]
    # Sensors of a plant at zero may drift too: a parabola is free motion of its double pole.
    drift = (30.0 * t + 20.0 * t**2) * record.y.std(axis=(0, 1, 2))
    options = {"states": 6, "rigid": 1, "delay": False}
    still = fit_record(record, **options)
    moved = fit_record(dataclasses.replace(record, y=record.y + drift), **options)
    # A search ends within a twentieth of a deviation of the least cost (`refine.SMALLEST_GAIN`).
    np.testing.assert_allclose(
        natural_hz(moved.model), natural_hz(still.model), atol=0.05 * still.uncertainty.natural_hz.min()
    )


@pytest.mark.parametrize(
    "options",
    [
        {"rigid": 3},
        {"integrators": 1, "rigid": 1},
        {"rigid": 1, "sampled": True},
        {"integrators": 1, "relative_degree": 2},
        {"delay": "path", "sampled": True},
        {"states": 5, "constants": "real"},
        {"weighting": "sensor"},
    ],
    ids=str,
)
def test_options_that_exclude_each_other(options):
    with pytest.raises(ConfigError):
        fit_record(moving(0), **options)

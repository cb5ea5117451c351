"""One signal of every design, on a period of 8 s at 256 Hz."""

import numpy as np

from middeck.signals.excitation.band_noise import design_burst, design_noise
from middeck.signals.excitation.binary_signals import design_binary, design_mls
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine
from middeck.signals.excitation.signal import Excitation, repeat_periods
from middeck.signals.excitation.sweep import design_sweep
from middeck.signals.ports import Port
from middeck.signals.record import Record

BAND, PERIOD_S, RATE = (1.0, 60.0), 8.0, 256.0


def signals(seed=0):
    rng, unit, where = np.random.default_rng(seed), Limits(peak=1.0), (BAND, PERIOD_S, RATE)
    narrow = ((8.0, 10.0), PERIOD_S, RATE)
    return {
        "random": design_multisine(*where, unit, rng),
        "schroeder": design_multisine(*where, unit, rng, phases="schroeder"),
        "compact": design_multisine(*where, unit, rng, phases="compact"),
        "odd": design_multisine(*where, unit, rng, grid="odd"),
        "odd-odd": design_multisine(*where, unit, rng, grid="odd-odd", phases="compact"),
        "random-odd": design_multisine(*where, unit, rng, grid="random-odd"),
        "narrow": design_multisine(*narrow, unit, rng),
        "pink": design_multisine(*where, unit, rng, amplitude=lambda f: 1.0 / f),
        "three inputs": design_multisine(*where, unit, rng, inputs=3, realisations=2),
        "noise": design_noise(BAND, 24.0, RATE, unit, rng),
        "narrow noise": design_noise(narrow[0], 24.0, RATE, unit, rng),
        "slow noise": design_noise((0.1, 2.0), 24.0, RATE, unit, rng),
        "burst": design_burst(*where, unit, rng),
        "sweep": design_sweep(*where, unit),
        "logarithmic sweep": design_sweep(*where, unit, law="logarithmic"),
        "narrow sweep": design_sweep(*narrow, unit),
        "stepped": stepped_sine(np.linspace(5.0, 15.0, 11), 2.0),
        "mls": design_mls(11, RATE, unit, rng),
        "held mls": design_mls(9, RATE, unit, rng, hold=4),
        "binary": design_binary(*where, unit, rng),
    }


def stepped_sine(frequency_hz, dwell_s):
    """One sine after the other, in whole cycles each."""
    samples = round(dwell_s * RATE)
    u = np.sin(2.0 * np.pi * np.outer(frequency_hz * dwell_s, np.arange(samples) / samples)).ravel()
    return Excitation(
        kind="stepped sine",
        what="sines",
        sample_hz=RATE,
        u=u[None, :, None] / np.abs(u).max(),
        lines=np.round(frequency_hz * dwell_s * len(frequency_hz)).astype(int),
        periodic=True,
    )


def run_of(made, *, periods=3, noise=0.0, leave_out=0, seed=1):
    """The signal as a record of one run that says nothing of periods; its output is half its first input."""
    rng = np.random.default_rng(seed)
    command = repeat_periods(made, periods if made.periodic else 1)
    u = command.reshape(len(made.u), -1, made.u.shape[2])[:, leave_out:]
    u = u + noise * u.std() * rng.standard_normal(u.shape)
    inputs = tuple(Port(f"u{i}", "V") for i in range(u.shape[2]))
    return Record(
        sample_hz=made.sample_hz,
        u=u[:, None],
        y=0.5 * u[:, None, :, :1],
        inputs=inputs,
        outputs=(Port("y", "m"),),
        periodic=False,
    )

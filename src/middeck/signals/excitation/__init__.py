"""Test signals: designed for a band and for limits, and recognised in records.

signal = design_multisine((0.1, 60.0), 64.0, 256.0, Limits(rms=0.1), rng)
found = recognise_excitation(record)
steady = cut_periods(record)
"""

from middeck.signals.excitation.binary import design_binary, design_mls
from middeck.signals.excitation.limits import Limits
from middeck.signals.excitation.multisine import design_multisine, random_multisine
from middeck.signals.excitation.noise import design_burst, design_noise
from middeck.signals.excitation.recognition import Recognised, cut_periods, recognise_excitation
from middeck.signals.excitation.signal import Excitation, detection_lines, repeat_periods
from middeck.signals.excitation.sweep import design_stepped_sine, design_sweep

__all__ = [
    "Excitation",
    "Limits",
    "Recognised",
    "cut_periods",
    "design_binary",
    "design_burst",
    "design_mls",
    "design_multisine",
    "design_noise",
    "design_stepped_sine",
    "design_sweep",
    "detection_lines",
    "random_multisine",
    "recognise_excitation",
    "repeat_periods",
]

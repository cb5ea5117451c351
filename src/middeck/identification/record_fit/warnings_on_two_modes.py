"""Warnings for modes that may be two."""

import numpy as np

from middeck.identification.fit.unneeded_modes import CLEARLY
from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.identification.record_fit.unneeded_modes_and_sines import BY_CHANCE, Tidied


def warnings_on_two(fit: Tidied) -> list[str]:
    """Warnings for modes that two would describe better, where the given order allows no more."""
    return [
        f"mode at {hz:.4g} Hz: two modes in its place describe the record better (by over {CLEARLY:g} of "
        "description length); the stated standard deviations are too small; ask for two more states"
        for hz in fit.as_two
    ]


def warnings_on_perhaps_two(fit: Tidied) -> list[str]:
    """Warnings for modes that are likelier as two than chance explains."""
    return [
        f"mode at {hz:.4g} Hz: it may be two modes, or one that is not linear; two in its place are likelier "
        f"than chance explains (once in {1.0 / BY_CHANCE:g}), but the record does not tell them apart; its "
        "standard deviations are too small if it is two; record longer, or with less noise"
        for hz in fit.perhaps_two
    ]


def modes_perhaps_two(fit: Tidied, model: MeasurementModel) -> list[int]:
    """The modes of the model that may be two."""
    f = natural_hz(model)
    near = [f[np.argmin(np.abs(f - hz))] for hz in fit.perhaps_two]
    return [m for m, hz in enumerate(f) if hz in near]

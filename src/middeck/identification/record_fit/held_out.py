"""Simulation error of a model on parts of a record that it was not fitted to.

It is refined on the first two thirds and simulates the last, and the other way round, as it will be used:
only the initial state is fitted there, to half of the part, so that poles too slow to be seen do not pass.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.errors import DataError, NumericalError
from middeck.identification.fit.fitted_model import model_of
from middeck.identification.problem.data import Transient
from middeck.identification.record_fit.search import RecordRun, refine_record
from middeck.identification.record_fit.simulation import record_nrmse
from middeck.identification.record_fit.spectra import cut_samples, record_data
from middeck.signals.record import Record

# Steps from the model of all samples to that of a part.
STEPS = 15
# Share of the part held out to which the initial state is fitted.
STATE_SHARE = 0.5


def error_held_out(
    record: Record, band_hz: tuple[float, float] | None, run: RecordRun, transient: Transient | None = None
) -> float:
    """rms over both parts of the error of the simulation, over that of the outputs, outputs alike.

    ``transient`` has the free samples of a continuous model. Infinite where the model cannot be refined or
    simulated.
    """
    count = record.u.shape[1] * record.u.shape[2]
    third = count // 3
    errors: list[float] = []
    for seen, unseen in (((0, count - third), (count - third, count)), ((third, count), (0, third))):
        data = record_data(cut_samples(record, *seen), band_hz, whole=True)
        data = dataclasses.replace(data, transient=transient or data.transient)
        part = refine_record(data, run.start, run.weighting, rounds=1, steps=STEPS)
        if part is None:
            return np.inf
        model = model_of(part, record.inputs, record.outputs)
        try:
            left = record_nrmse(model, cut_samples(record, *unseen), state_share=STATE_SHARE)
        except (NumericalError, DataError):
            return np.inf
        errors += list(left**2)
    return float(np.sqrt(np.mean(errors)))

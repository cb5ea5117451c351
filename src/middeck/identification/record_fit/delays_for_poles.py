"""Whether heavily damped poles of a record's model, which has no delays, stand for some.

With little noise, poles that follow a delay bend the modes, too, so that these with a delay fit worse than
`modes_that_stand_for_delay` allows. Here they are refined, from the best delay of each output.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from middeck.identification.fit.fitted_model import model_of
from middeck.identification.fit.modes_that_stand_for_delay import (
    damped_poles,
    delays_with,
    stands_for_delay,
)
from middeck.identification.fit.poles_beyond_the_band import UNDECIDED
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.problem.data import Data
from middeck.identification.record_fit.poles_for_delay import ROUNDS, STEPS
from middeck.identification.record_fit.record_order import record_length
from middeck.identification.record_fit.refine_record import RecordRun, refine_record
from middeck.identification.start.start import start_from_point
from middeck.signals.record import Record


class DelaysInstead(NamedTuple):
    """Delays in place of poles.

    Attributes:
        poles: Those in the band that stand for a delay.
        delay_s: The longest delay.
        length: Length of the description by the other poles with refined delays; infinite without one.
    """

    poles: Int[np.ndarray, " mode"]
    delay_s: float
    length: float


def delays_instead(record: Record, data: Data, run: RecordRun) -> DelaysInstead:
    """The delays for which poles of ``run`` stand, as far as a model with them may be as good."""
    if run.layout.options.delay:
        return DelaysInstead(np.array([], dtype=int), 0.0, np.inf)
    model = model_of(run, record.inputs, record.outputs)
    fitted = data.s, data.U, run.residual(data), 1.0 / np.sqrt(run.variance)
    poles, delay_s = stands_for_delay(model, *fitted)
    damped = damped_poles(model)
    light = np.setdiff1d(np.flatnonzero(model.is_pair), damped)
    continuous = model.sample_hz is None and not run.layout.options.full_rank
    if not continuous or not len(damped) or not len(light):
        return DelaysInstead(poles, delay_s, np.inf)
    late_s = delays_with(model, *fitted, light)[0]
    length = _length_with(data, run, light, late_s)
    if not len(poles) and length < record_length(data, run) + UNDECIDED:
        last_hz = float(data.omega[-1]) / (2.0 * np.pi)
        poles, delay_s = damped[natural_hz(model)[damped] <= last_hz], float(late_s.max())
    return DelaysInstead(poles, delay_s, length)


def _length_with(
    data: Data, run: RecordRun, kept: Int[np.ndarray, " mode"], late_s: Float[np.ndarray, " output"]
) -> float:
    """Length of the description by the pairs ``kept`` with a delay of each output."""
    assert data.transient is not None
    first = int(np.ceil(late_s.max() / data.period_s)) + 1
    free = dataclasses.replace(data.transient, first=max(first, data.transient.first))
    behind, point = dataclasses.replace(data, transient=free), run.start.point
    states = 2 * len(kept) + run.layout.options.at_zero
    options = dataclasses.replace(run.layout.options, states=states, delay="output")
    at = dataclasses.replace(point, poles=point.poles[kept], b=point.b[kept], delay_s=late_s[:, None])
    start = start_from_point(options, np.ones(len(kept), dtype=bool), at, len(data.H))
    found = refine_record(behind, start, run.weighting, rounds=ROUNDS, steps=STEPS)
    return np.inf if found is None else record_length(behind, found)

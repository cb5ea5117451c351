"""Whether a delay fitted to a record represents poles beyond the band (`fit.poles_beyond_the_band`).

The sound modes and one or two pairs beyond the band, of complex constants and without delays, are refined on
the same lines.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from middeck.identification.fit.mode_trust import Standing
from middeck.identification.fit.poles_beyond_the_band import PAIRS, PolesInstead, instead_of
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.problem.data import Data
from middeck.identification.record_fit.record_order import record_length
from middeck.identification.record_fit.record_starts import start_of
from middeck.identification.record_fit.refine_record import RecordRun, refine_record

# Where the pairs start, over the last line, and how far from the axis: those of a low-pass filter.
BEYOND = (1.4, 2.5)
LEFT = -0.7 + 0.7j
ROUNDS, STEPS = 3, 20


def poles_instead(
    data: Data, run: RecordRun, model: MeasurementModel, standing: Sequence[Standing]
) -> PolesInstead | None:
    """Poles that describe the record as shortly as ``run`` with its delay; None without such.

    Where all modes are sound only what is shorter counts: a short delay and a far pole look alike.
    """
    sound = np.array([one == "sound" for one in standing])
    kept = model.poles[sound & model.is_pair]
    found: list[tuple[float, int]] = []
    for pairs in PAIRS:
        states = 2 * (len(kept) + pairs)
        options = dataclasses.replace(
            run.layout.options,
            states=states + run.layout.options.at_zero,
            constants="complex",
            delay=False,
            direct=True,
            relative_degree=None,
        )
        poles = np.append(kept, float(data.omega[-1]) * LEFT * np.array(BEYOND[:pairs]))
        start = start_of(data, options, poles, np.ones(len(poles), dtype=bool))
        other = (
            None if start is None else refine_record(data, start, run.weighting, rounds=ROUNDS, steps=STEPS)
        )
        if other is not None:
            found.append((record_length(data, other), options.states or states))
    instead = instead_of(record_length(data, run), found)
    return instead if instead is None or instead.shorter or not sound.all() else None

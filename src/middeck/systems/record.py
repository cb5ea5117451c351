"""Time data: synchronised inputs and outputs of one or several experiments."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.systems.ports import Port
from middeck.values import record


@record
class Record:
    """Sampled inputs and outputs.

    Parameters
    ----------
    sample_hz:
        Sampling rate, common to all channels.
    u, y:
        Input and output samples. Several experiments share the test article, not the signals. With
        ``periodic`` true, the samples of an experiment are whole steady periods of one repeated input;
        otherwise there is one period, the record itself.
    """

    sample_hz: float
    u: Float[np.ndarray, "experiment period sample input"]
    y: Float[np.ndarray, "experiment period sample output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    periodic: bool

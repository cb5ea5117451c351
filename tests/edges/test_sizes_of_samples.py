"""Samples whose squares are no numbers: files keep them, and what computes refuses them in words."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.errors import DataError
from middeck.identification.faults.detect import detect_faults
from middeck.signals.ports import Port
from middeck.signals.record import Record


@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_samples_without_squares_are_refused(scale: float):
    u, y = np.random.default_rng(0).standard_normal((2, 1, 1, 200, 1))
    ports = {"inputs": (Port("force", "N"),), "outputs": (Port("tip", "m"),)}
    detect_faults(Record(sample_hz=100.0, u=u, y=1e90 * y, periodic=False, **ports))
    with pytest.raises(DataError, match="channel tip"):
        detect_faults(Record(sample_hz=100.0, u=u, y=scale * y, periodic=False, **ports))

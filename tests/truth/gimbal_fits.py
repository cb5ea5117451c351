"""Fits of the simulated gimbal, made once for all tests that ask for the same seed."""

import functools

import gimbal_record
import numpy as np

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.spectra.estimate import estimate_response


def measured(seed, outputs=1, moved=1.0, mode=4):
    """The response of one record; ``moved`` scales the frequency of a mode, as a warm week may."""
    return _measured(seed, outputs, moved, mode)


def fit(seed, outputs=1, moved=1.0):
    return _fit(seed, outputs, moved)


# A cache tells a default from the same value given: what is kept is asked for in one way.
@functools.cache
def _measured(seed, outputs, moved, mode):
    hz = gimbal_record.MODES_HZ
    gimbal_record.MODES_HZ = np.where(np.arange(len(hz)) == mode, moved, 1.0) * hz
    try:
        return estimate_response(gimbal_record.multisine(seed, outputs=outputs))
    finally:
        gimbal_record.MODES_HZ = hz


@functools.cache
def _fit(seed, outputs, moved):
    return fit_response(measured(seed, outputs, moved), states=10)

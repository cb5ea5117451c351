"""Score of blows that differ: of a gain of each blow of its own, from the residual of a record's fit.

A hammer that strikes a little beside its place, or in another direction, excites each mode more or less than
before. Where blows follow each other so soon that the article never rests, what is left is as large at all
times, and grows with no response; but it has the form of the response to each blow.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Complex

from middeck.identification.faults.equal_runs import runs_of
from middeck.identification.model.measurement_model import model_response
from middeck.identification.problem.data import Data
from middeck.identification.record_fit.folded_blows import BESIDE, BLOW, SPARSE
from middeck.identification.record_fit.record_covariance import Rows
from middeck.identification.record_fit.record_terms import parts_of_noise
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.record_fit.residual_tests import Heard
from middeck.identification.record_fit.sensor_or_force_noise import likelier_variance
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.lacking_terms import TermRows, joint_score
from middeck.signals.record import Record

# More blows than these tell of each other by what is left where the response is large, and take long.
MOST = 40
# Deviations of a normal variate that chance passes as often: once in 3e5.
UNLIKE = 4.5


def score_of_unlike_blows(
    measured: Record, record: Record, data: Data, run: RecordRun, covariance: ModelCovariance, heard: Heard
) -> float:
    """Deviations by which the gains of the blows differ; zero where the input is no blows.

    ``measured`` tells when they are, ``record`` what was fitted: without a ramp, or a hold.
    """
    each = _spectra_of_blows(measured, record, data)
    if not 1 < len(each) <= MOST:
        return 0.0
    residual, model = run.residual(data), covariance.model
    variance = likelier_variance(residual, run.denominator(data), driven=data.driven)
    rows_of = Rows(dataclasses.replace(run, variance=variance), data, model, covariance.structure)
    H = model_response(model, data.omega / (2.0 * np.pi))[:, :, 0].T
    outputs, lines, columns = residual.shape
    count, line = len(each) - 1, np.tile(np.repeat(np.arange(lines), 2), columns)

    def rows() -> Iterator[TermRows]:
        for o, left in enumerate(residual):
            J, own = rows_of.of(o)
            place = np.flatnonzero(J.any(axis=(1, 2)))
            lacking = np.zeros((count * outputs, lines, columns), complex)
            lacking[count * o : count * (o + 1)] = H[o, :, None] * each[1:]
            slopes, terms, (rest,) = (own.removed(part) for part in (J[place], lacking, left[None]))
            noise = parts_of_noise(heard[o], own, columns)
            yield TermRows(place=place, slopes=slopes, terms=terms, left=rest, line=line, heard=noise)

    # A chi-squared variate as a normal one (Wilson and Hilferty 1931).
    within = 2.0 / (9.0 * count * outputs)
    share = joint_score(rows, covariance) / (count * outputs)
    return float((np.cbrt(share) - 1.0 + within) / np.sqrt(within))


def _spectra_of_blows(
    measured: Record, record: Record, data: Data
) -> Complex[np.ndarray, "blow line column"]:
    """The spectrum of each blow of a single input alone, in the column of its experiment."""
    read, force = (x.u.reshape(len(x.u), -1, x.u.shape[3]) for x in (measured, record))
    off = np.abs(read[..., 0] - np.median(read[..., 0], axis=1, keepdims=True))
    on = off > BLOW * off.max()
    found = [np.zeros((0, *data.U[:, 0].shape), complex)]
    if read.shape[2] == 1 and np.mean(on) <= SPARSE:
        for e, own in enumerate(on):
            for a, b in runs_of(np.convolve(own, np.ones(2 * BESIDE + 1))[BESIDE:-BESIDE] > 0.0):
                alone = np.zeros((1, *data.U[:, 0].shape), complex)
                alone[0, :, e] = np.fft.rfft(force[e, a:b, 0], read.shape[1])[data.lines]
                alone[0, :, e] *= np.exp(-2j * np.pi * data.lines * a / read.shape[1])
                found.append(alone)
    return np.concatenate(found)


def warnings_on_unlike(score: float) -> list[str]:
    """A warning for blows that differ."""
    if score < UNLIKE:
        return []
    return [
        f"the blows differ: a gain of each follows the residual ({score:.0f} standard deviations of noise): "
        "blows beside their place or in another direction, that reach beyond half the sampling rate, or a "
        "sensor that clips; the stated standard deviations are too small; strike one place alike"
    ]

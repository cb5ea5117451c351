"""Faults seen by comparing the experiments of one session: swapped outputs, turned signs, other gains."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from middeck.identification.faults.equal_runs import FaultDraft, fault
from middeck.identification.faults.gains_of_experiments import gains_of_experiments
from middeck.identification.faults.lost_samples_and_feedback import (
    ANSWER,
    FEWEST_SAMPLES,
    correlation,
    whitened,
)
from middeck.signals.fault import RecordFault
from middeck.signals.record import Record

# Correlation of two responses that are one (or, negative, one turned round), and by how much another
# output's must be better.
ALIKE, BETTER = 0.6, 0.2
# Power of a response over that of noise from which it is compared.
HEARD = 4.0
# Share of their power by which inputs differ at least where their responses are told apart.
LEAST_APART = 0.1
# Correlation of two inputs from which their responses cannot be distinguished, and of that with its opposite
# in another experiment.
ONE_INPUT, TURNED = 0.3, 0.3
# Probability by chance of any gain of a record below which it is reported, and the least size; the median of
# windows agrees with it within a half.
BY_CHANCE, SHARE, AGREE = 1e-3, 0.005, 0.5


def find_unlike_experiments(record: Record) -> list[RecordFault]:
    """Outputs that respond to the inputs otherwise than in the first experiment."""
    experiments, periods, samples, _ = record.u.shape
    if experiments < 2 or periods * samples < FEWEST_SAMPLES:
        return []
    inputs, outputs = _white(record.u), _white(record.y)
    a = np.stack([_own(correlation(u, y, 0, ANSWER), u) for u, y in zip(inputs, outputs, strict=True)])
    found: list[RecordFault] = []
    for e in range(1, experiments):
        apart = _apart(inputs[0], inputs[e])[:, None]
        alike = np.array([[_cosine(y * apart, z * apart) for z in a[e]] for y in a[0]])
        for o, port in enumerate(record.outputs):
            what = _swapped(record, alike, o) or _turned(record, a[0, o] * apart, a[e, o] * apart)
            found += [] if what is None else [what.at("output", port, e)]
    return found or _gains(record)


def _white(x: np.ndarray) -> Float[np.ndarray, "experiment channel sample"]:
    return np.array([[whitened(channel) for channel in e.reshape(-1, e.shape[2]).T] for e in x])


def _apart(
    first: Float[np.ndarray, "input sample"], here: Float[np.ndarray, "input sample"]
) -> Bool[np.ndarray, " input"]:
    """Inputs whose responses in two experiments are their own, not those of inputs that move with them.

    Experiments that drive several inputs by one signal, or by several of which some are turned round in the
    other one (orthogonal multisines), show the responses together only.
    """
    C, D = (correlation(u, u, -ANSWER, ANSWER) for u in (first, here))
    largest = np.maximum(np.abs(C), np.abs(D)).max(axis=2) / np.sqrt(first.shape[1])
    size = np.sqrt(np.sum(C**2, axis=2) * np.sum(D**2, axis=2))
    turned = np.sum(C * D, axis=2) < -TURNED * size
    return ~np.any((turned | (largest > ONE_INPUT)) & ~np.eye(len(first), dtype=bool), axis=1)


def _own(
    a: Float[np.ndarray, "output input lag"], u: Float[np.ndarray, "input sample"]
) -> Float[np.ndarray, "output input lag"]:
    """Responses to each input alone, over their deviations.

    Inputs are a little alike by chance, so that a strong response shows in the correlation with another
    input: a_i = sum_j R_ij * h_j, here for white inputs, R_ii = 1.
    """
    inputs, lags = len(u), np.arange(ANSWER + 1)
    R = correlation(u, u, -ANSWER, ANSWER) / np.sqrt(u.shape[1])
    R[np.diag_indices(inputs)] = np.arange(-ANSWER, ANSWER + 1) == 0
    T = R.transpose(1, 0, 2)[:, :, lags[:, None] - lags + ANSWER].swapaxes(1, 2)
    size, V = np.linalg.eigh(T.reshape(inputs * len(lags), -1))
    inverse = V / np.maximum(size, LEAST_APART) @ V.T
    h = a.reshape(len(a), -1) @ inverse / np.sqrt(np.diag(inverse))
    return h.reshape(a.shape)


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation of two responses; zero where one is lost in noise."""
    power = np.array([np.sum(a**2), np.sum(b**2)])
    return float(np.sum(a * b) / np.sqrt(np.prod(power))) if power.min() > HEARD * a.size else 0.0


def _swapped(record: Record, alike: Float[np.ndarray, "output output"], o: int) -> FaultDraft | None:
    for p, port in enumerate(record.outputs):
        other = min(abs(alike[o, p]), abs(alike[p, o]))
        if p != o and other > ALIKE and other > max(abs(alike[o, o]), abs(alike[p, p])) + BETTER:
            what = f"answers the inputs as {port.name} does in experiment 0, and that one as this: swapped"
            return fault("unlike", what, "check the wiring of both experiments, and exchange the channels")
    return None


def _turned(record: Record, first: np.ndarray, here: np.ndarray) -> FaultDraft | None:
    """The input whose response has the other sign; ``first`` and ``here`` are responses [input, lag]."""
    inputs = [p.name for p, a, b in zip(record.inputs, first, here, strict=True) if _cosine(a, b) < -ALIKE]
    if not inputs:
        return None
    what = f"answers {', '.join(inputs)} with the opposite sign of experiment 0"
    return fault("unlike", what, "turn the sign in one of the two: this sensor's, or the input's if all do")


def _gains(record: Record) -> list[RecordFault]:
    """Other gains of outputs, where windows of lines agree on them."""
    found = gains_of_experiments(record)
    if found is None:
        return []
    size = np.abs(found.change)
    sure = (found.chance < BY_CHANCE / size.size) & (size > SHARE)
    other = sure & (np.abs(found.median - found.change) < AGREE * size)
    hint = "check range, amplifier and level; scale one of the two, or fit them apart"
    return [
        fault(
            "unlike",
            f"has {np.exp(found.change[e, o]):.3f} times the gain of experiment 0, on all lines",
            hint,
        ).at("output", record.outputs[o], int(e) + 1)
        for e, o in np.argwhere(other)
    ]

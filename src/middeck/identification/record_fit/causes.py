"""Why the numbers of a fit of a record do not hold: what it leaves still follows the inputs, or a fault.

What is left of a model that holds is noise: no input, earlier or later, tells it (Ljung 1999, sec. 16.6), and
no part of the record asks for another delay than the rest. Where it is not so, the faults of the record are
looked for.
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.errors import FitError
from middeck.identification.faults import detect_faults
from middeck.identification.problem.data import Data
from middeck.identification.problem.design import residual_of
from middeck.identification.record_fit.noise import negative_log_likelihood, noise_variance
from middeck.identification.record_fit.search import RecordRun, all_poles
from middeck.signals.fault import Fault
from middeck.signals.record import Record

# Above this share of an output's rms, what is left is looked into; above the second, and told by the inputs,
# it makes the modes doubtful.
LEFT, MUCH = 0.05, 0.1
# Deviations of a correlation with the inputs, and of a delay's step, above which what is left is no noise:
# chance makes the largest of 1e4 four.
TOLD, STEPS = 6.0, 5.0
# Deviations by which an output leads that are no chance.
LEADS = 6.0
# A step of the delay is looked for so many samples, and this share of the record, from both ends.
EDGE, EDGE_SHARE = 16, 0.01
# Faults by which a fit is wrong in all parts of the record.
BIASING = ("shift", "joint", "feedback", "delay", "truncated")


def causes_of(
    record: Record,
    data: Data,
    run: RecordRun,
    lead: Float[np.ndarray, " output"],
    left: Float[np.ndarray, " output"],
) -> list[str]:
    """What is to be said of a fit whose numbers do not hold; empty where they do.

    ``record`` is as it was measured; ``lead`` is by how many of its deviations each output leads its input;
    ``left`` is what the fit leaves, over the output, in rms.
    """
    white, response = _whitened(data, run)
    moved = np.array([_step_score(w, y, data.s) for w, y in zip(white, response, strict=True)])
    told = np.array([_told_by_inputs(w, data) for w in white])
    leads = lead > LEADS
    wrong = np.any(left > LEFT) or np.any(moved > STEPS) or leads.any()
    faults = _biasing_faults(record) if wrong else []
    found = [
        f"{f.side} {f.channel}: {f.what}; so no stated deviation holds. {f.hint[0].upper()}{f.hint[1:]}"
        for f in faults
    ]
    named = {f.channel for f in faults}
    for o, port in enumerate(record.outputs):
        if port.name in named:
            continue
        if moved[o] > STEPS:
            found.append(
                f"output {port.name}: its delay is not the same throughout the record ({moved[o]:.0f} "
                "standard deviations of noise): samples lost or repeated, two runs joined, a clock that "
                "drifts, or an article that changes; no stated deviation holds"
            )
        elif told[o] > TOLD and left[o] > MUCH:
            found.append(
                f"output {port.name}: what the fit leaves still follows the inputs ({told[o]:.0f} standard "
                "deviations of noise), so that it is no noise: more states, a delay, feedback or a fault of "
                "the record; no stated deviation holds"
            )
        elif leads[o]:
            found.append(
                f"output {port.name}: it leads its input by {lead[o]:.0f} deviations, as no article does: "
                "feedback, an input recorded late, or modes the model lacks; no stated deviation holds"
            )
    return found


@contextlib.contextmanager
def named_cause(record: Record) -> Generator[None]:
    """A refused fit with the fault of the record that may be why, where there is one."""
    try:
        yield
    except FitError as error:
        faults = _biasing_faults(record)
        if not faults:
            raise
        why = "; ".join(f"{f.side} {f.channel} {f.what}" for f in faults)
        raise FitError(f"{error.what}: {why}", where=error.where, hint=faults[0].hint) from error


def _biasing_faults(record: Record) -> list[Fault]:
    return [f for f in detect_faults(record) if f.kind in BIASING]


def _whitened(
    data: Data, run: RecordRun
) -> tuple[Complex[np.ndarray, "output line column"], Complex[np.ndarray, "output line column"]]:
    """What is left, and the model's outputs, both over the deviation of the likelier noise."""
    r = residual_of(run.layout, data, run.refined.theta, run.refined.step.linear)
    assert data.transient is not None
    poles = all_poles(run.layout, run.refined.theta)
    kinds = (noise_variance(r, kind, data.s, poles, data.transient.period_s) for kind in ("output", "motion"))
    size = np.sqrt(min(kinds, key=lambda v: negative_log_likelihood(r, v)))
    return r / size, (data.H - r) / size


def _step_score(white: np.ndarray, response: np.ndarray, s: np.ndarray) -> float:
    """Deviations by which a delay of the later part of a record differs from that of the earlier.

    The score of a delay, the residual times the response's rate of change, summed up to each sample: a
    bridge for one delay (Andrews 1993).
    """
    x, slope = _signals(white, s), _signals(response * s[:, None], s)
    information = np.cumsum(slope**2, axis=1)
    best = 0.0
    for own, known, noise in zip(
        np.cumsum(x * slope, axis=1), information, np.mean(x**2, axis=1), strict=True
    ):
        edge = max(EDGE, int(EDGE_SHARE * len(own)))
        inner = slice(edge, len(own) - edge)
        share = known[inner] / max(known[-1], np.finfo(float).tiny)
        spread = noise * known[-1] * share * (1.0 - share)
        use = spread > 0.0
        bridge = np.abs(own[inner] - share * own[-1])[use]
        best = max(best, float(np.max(bridge / np.sqrt(spread[use]), initial=0.0)))
    return best


def _told_by_inputs(white: Complex[np.ndarray, "line column"], data: Data) -> float:
    """The largest correlation with an input, earlier or later, in deviations of noise."""
    assert data.drive is not None
    assert data.transient is not None
    U = np.moveaxis(data.drive, 1, 0)
    size = np.sqrt(noise_variance(U, "output", data.s, np.zeros(0, complex), data.transient.period_s))
    spread = np.sqrt(0.5 * np.sum(np.abs(white * U / size) ** 2, axis=(1, 2)))
    step = _lines_of(data.s)
    best = 0.0
    for u, deviation in zip(U / size, spread, strict=True):
        cross = np.zeros(step[-1] + 1, dtype=complex)
        cross[step] = np.sum(white * u.conj(), axis=1)
        told = np.fft.irfft(cross, 2 * len(cross)) * len(cross)
        best = max(best, float(np.abs(told).max() / max(deviation, np.finfo(float).tiny)))
    return best


def _signals(
    spectra: Complex[np.ndarray, "line column"], s: Complex[np.ndarray, " line"]
) -> Float[np.ndarray, "column sample"]:
    """In time, on a grid just fine enough for the lines."""
    lines = _lines_of(s)
    full = np.zeros((spectra.shape[1], lines[-1] + 1), dtype=complex)
    full[:, lines] = spectra.T
    return np.fft.irfft(full, 2 * full.shape[1], axis=1)


def _lines_of(s: Complex[np.ndarray, " line"]) -> Int[np.ndarray, " line"]:
    """Numbers of the lines, counted from zero frequency."""
    step = float(np.min(np.diff(np.imag(s)))) if len(s) > 1 else float(np.imag(s[0]))
    return np.round(np.imag(s) / step).astype(int)

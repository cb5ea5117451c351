"""Tests of the residual of a record's fit: whether its standard deviations hold, or a fault of the record.

If the model is right, the residual is noise: uncorrelated with the inputs (Ljung 1999, sec. 16.6), and no
part of the record asks for another delay, gain, frequency or damping than the rest.

Short noise of an input, such as that of a blow under its window, causes free motion; where it is known, the
scores leave it out.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Generator

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import FitError
from middeck.identification.faults.detect import biasing_faults
from middeck.identification.fit.fitted_model import model_of
from middeck.identification.model.fit_options import is_rate
from middeck.identification.model.measurement_model import model_response
from middeck.identification.problem.data import Data
from middeck.identification.problem.residual_and_slopes import Terms
from middeck.identification.problem.transient_projection import TransientProjection
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.record_fit.sensor_or_force_noise import likelier_variance, noise_variance
from middeck.signals.record import Record

Heard = Complex[np.ndarray, "output line part"]
Law = Callable[[np.ndarray, Data], tuple[np.ndarray, np.ndarray, np.ndarray]]
# Share of an output's rms above which the residual is tested; above the second, a residual that is
# correlated with the inputs makes the modes doubtful.
LEFT, MUCH = 0.05, 0.1
# Scores above which the residual is not noise: of its correlation with the inputs, and of a step in delay or
# gain (by chance the largest of 1e4 is four); and of the correlation, if the residual is small.
TOLD, STEPS, CLEARLY_TOLD = 6.0, 5.0, 8.0
# Lines taken together, over which what a model lacks has one phase to the response; and the deviations of
# noise above which their sums are none: chance passes it once in 3e5; and the fewest sums.
TOGETHER, TOGETHER_TOLD, FEWEST_SUMS = (20, 40), 4.5, 4
# Octaves of lines, from the first so many lines on, over which what is left falls by so much from each to the
# next if a sensor drifts at random (a random walk falls by four), and the share of it that they then have.
OCTAVES, FIRST_LINES, FALLS, WANDERS = 3, 6, 1.8, 0.5
WANDERING = FIRST_LINES * 2**OCTAVES  # lines
# Standard deviations of a lead that chance does not explain.
LEADS = 6.0
# Rates have complex modal constants; a rate is recognised by its unit.
NO_UNIT = ", a velocity or an acceleration (the output has no unit: give it, or --constants complex)"
# A held force changes a rate within the sample, as a continuous model does not.
AT_ONCE = "a velocity or an acceleration that a held force moves within a sample (take a sampled model), "
# Relative step of a pole for its derivative.
SHIFT = 1e-6
# Samples, and share of the record, at both ends in which no step of delay or gain is looked for.
EDGE, EDGE_SHARE = 16, 0.01


# Messages for the first score of an output above its limit.
OF_DIRECTION = (
    "the residual follows the sign of the velocity ({:.0f} standard deviations of noise): play, backlash "
    "or dry friction; the stated standard deviations are too small; excite more, or remove the play"
)
OF_CUBE = (
    "the residual follows the cube of a force or of the motion ({:.0f} standard deviations of noise): a "
    "saturating amplifier or sensor, or a nonlinear article; the model is valid at this level only, and the "
    "stated standard deviations are too small; excite less"
)
OF_LEVEL = (
    "the residual follows the cube of a force or of the motion ({:.0f} standard deviations of noise): a "
    "saturating amplifier or sensor, or a nonlinear article; its gains are valid at this level only, and "
    "their standard deviations are too small; excite less"
)
OF_DELAY = (
    "its delay changes during the record ({:.0f} standard deviations of noise): samples lost or repeated, "
    "two runs joined, a clock that drifts, or an article that changes; the stated standard deviations are "
    "too small"
)
OF_GAIN = (
    "its gain changes during the record ({:.0f} standard deviations of noise): a range that was switched, "
    "or an article that changes; the stated standard deviations are too small"
)
OF_INPUTS = (
    "the residual is correlated with the inputs ({:.0f} standard deviations of noise), so it is not noise: "
    "{}too few states, no delay, feedback{} or a fault of the record; the stated standard deviations are "
    "too small"
)
OF_WANDER = (
    "what the model leaves falls with frequency, and {:.0%} of it lies below {:.3g} Hz: a sensor that drifts "
    "at random, or a slow mode or free motion that the model lacks; let it warm up, fit a band above that "
    "(--band), or add states or --rigid"
)
OF_LEAD = (
    "it leads its input by {:.0f} standard deviations, as no article does: feedback, a delayed input "
    "channel{}, or modes that the model lacks; the stated standard deviations are too small"
)


def causes_of(
    record: Record,
    data: Data,
    run: RecordRun,
    lead: Float[np.ndarray, " output"],
    left: Float[np.ndarray, " output"],
    heard: Heard,
    *,
    late: bool,
) -> list[str]:
    """Warnings for a fit whose standard deviations are too small; empty if there is no such sign.

    ``record`` is as it was measured; ``lead`` is by how many of its deviations each output leads its input;
    ``left`` is the rms residual over the output. ``late``: poles stand for a delay, with its own warning.
    """
    size, noise = _size_and_noise(data, run, heard)
    white, response = run.residual(data) / size, (data.H - run.residual(data)) / size
    each = list(zip(white, response, noise, strict=True))
    moved = np.array([_step_score(w, y * data.s[:, None], n, data) for w, y, n in each])
    scaled = np.array([_step_score(w, y, n, data, uneven=True) for w, y, n in each])
    steps = bool(np.any(np.maximum(moved, scaled) > STEPS))
    changed = {} if steps else _changed_modes(record, data, run, size, noise)
    quiet = white.copy()
    for o, r in enumerate(run.residual(data)):
        if _wander(r, data):  # its few lowest lines outweigh all others, and are correlated with anything
            quiet[o, :WANDERING] = 0.0
    told = np.array([_told_by_inputs(w, data, n) for w, n in zip(quiet, noise, strict=True)])
    together = np.zeros(len(white)) if late else _told_together(record, data, run, quiet, noise)
    play = _scores_of_law(_by_direction, record, data, run, size, noise)
    cube = (
        np.zeros(len(play)) if _repeats(record) else _scores_of_law(_by_cube, record, data, run, size, noise)
    )
    leads = lead > LEADS
    wrong = np.any(left > LEFT) or steps or bool(changed) or leads.any()
    most = [port.name for port, share in zip(record.outputs, left, strict=True) if share > MUCH]
    faults = biasing_faults(record, most) if wrong else []
    found = [
        f"{f.side} {f.channel}: {f.what}; the stated standard deviations are too small. "
        f"{f.hint[0].upper()}{f.hint[1:]}"
        for f in faults
    ]
    named = {f.channel for f in faults}
    real = run.layout.options.constants == "real"
    unknown = [NO_UNIT if real and not port.unit else "" for port in record.outputs]
    held = record.held and run.layout.options.period_s == 0.0
    at_once = [AT_ONCE if held and is_rate(port) else "" for port in record.outputs]
    found += [
        f"mode at {hz:.4g} Hz: its frequency or damping changes during the record ({z:.0f} standard "
        "deviations of noise): an article that changes; the stated standard deviations are too small"
        for hz, z in changed.items()
        if not faults
    ]
    for o, port in enumerate(record.outputs):
        if port.name in named:
            continue
        enough = TOLD if at_once[o] or left[o] > MUCH else CLEARLY_TOLD
        scores = (
            (play[o] > max(STEPS, moved[o], scaled[o], cube[o]), OF_DIRECTION.format(play[o])),
            (cube[o] > max(STEPS, moved[o], scaled[o], told[o]), OF_CUBE.format(cube[o])),
            (moved[o] > STEPS, OF_DELAY.format(moved[o])),
            (scaled[o] > STEPS, OF_GAIN.format(scaled[o])),
            (
                told[o] > enough or together[o] > TOGETHER_TOLD,
                OF_INPUTS.format(max(told[o], together[o]), at_once[o], unknown[o]),
            ),
            (leads[o], OF_LEAD.format(lead[o], unknown[o])),
        )
        what = next((text for is_cause, text in scores if is_cause), "")
        found += [f"output {port.name}: {what}"] if what else []
    return found


def warnings_on_level(record: Record, data: Data, run: RecordRun, heard: Heard) -> list[str]:
    """Warnings for a repeated, distorted signal: its residual repeats with it.

    The fit counts that on each line, so that modes and their standard deviations are valid.
    """
    if not _repeats(record):
        return []
    cube = _scores_of_law(_by_cube, record, data, run, *_size_and_noise(data, run, heard))
    each = zip(record.outputs, cube, strict=True)
    return [f"output {port.name}: {OF_LEVEL.format(score)}" for port, score in each if score > STEPS]


def _wander(r: Complex[np.ndarray, "line column"], data: Data) -> tuple[float, float] | None:
    """Share of the residual in the lowest lines, and their end [Hz]; None if it does not fall.

    Medians do not mind a mode that lacks.
    """
    power = np.sum(np.abs(r) ** 2, axis=1)
    ends = FIRST_LINES * 2 ** np.arange(OCTAVES + 1)
    if len(power) < 2 * WANDERING or data.lines[0] > FIRST_LINES:
        return None
    levels = [float(np.median(power[a:b])) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
    share = float(power[:WANDERING].sum() / max(power.sum(), np.finfo(float).tiny))
    falls = all(b * FALLS < a for a, b in itertools.pairwise(levels))
    return (share, float(data.omega[WANDERING]) / (2.0 * np.pi)) if falls and share > WANDERS else None


def warnings_on_wander(
    record: Record, data: Data, run: RecordRun, left: Float[np.ndarray, " output"]
) -> list[str]:
    """Warnings for outputs that drift at random: noise that the deviations count."""
    found = [
        (port.name, _wander(r, data) if share > LEFT else None)
        for port, r, share in zip(record.outputs, run.residual(data), left, strict=True)
    ]
    return [f"output {name}: {OF_WANDER.format(*wander)}" for name, wander in found if wander]


def _repeats(record: Record) -> bool:
    return record.periodic and record.u.shape[1] > 1


def _size_and_noise(data: Data, run: RecordRun, heard: Heard) -> tuple[np.ndarray, Heard]:
    """The standard deviation of each line, and the response to noise of the inputs there, over it."""
    size = np.sqrt(likelier_variance(run.residual(data), run.denominator(data), driven=data.driven))
    return size, without_transients(heard, data, run, size)


@contextlib.contextmanager
def named_cause(record: Record) -> Generator[None]:
    """The error of a refused fit with the fault of the record that may be its cause, if there is one."""
    try:
        yield
    except FitError as error:
        faults = biasing_faults(record)
        if not faults:
            raise
        why = "; ".join(f"{f.side} {f.channel} {f.what}" for f in faults)
        raise FitError(f"{error.what}: {why}", where=error.where, hint=faults[0].hint) from error


def heard_of(
    record: Record, data: Data, run: RecordRun, noise: Float[np.ndarray, "part sample input"] | None
) -> Heard:
    """Responses of the outputs to parts of noise of the inputs; empty where it is unknown."""
    if noise is None or not len(noise):
        return np.zeros((*data.H.shape[:2], 0), dtype=complex)
    N = np.fft.rfft(noise, axis=1)[:, data.lines] / np.sqrt(noise.shape[1])
    return np.einsum("koi,pki->okp", _response(record, data, run), N)


def without_transients(
    heard: Heard, data: Data, run: RecordRun, size: Float[np.ndarray, "output line column"]
) -> Heard:
    """``heard``, the responses to input noise, over the deviation ``size``, without transients."""
    B = Terms(run.layout, data, run.refined.theta).B
    found = np.zeros(heard.shape, dtype=complex)
    for o in range(len(heard) if heard.size else 0):
        left = TransientProjection(B, 1.0 / size[o, :, :1]).removed(heard[o].T[:, :, None])
        found[o] = left.view(complex).T
    return found


def _step_score(
    white: np.ndarray, change: np.ndarray, heard: np.ndarray, data: Data, *, uneven: bool = False
) -> float:
    """Deviations by which a delay, or a gain, of the later part of a record differs from that of the earlier,
    or that of one experiment from that of the others.

    The score of a delay, the residual times ``change``, the response's rate, summed up to each sample: a
    bridge for one delay (Andrews 1993). For a gain the response itself. What is left of a distorted signal is
    largest where the response is, as if a gain changed: ``uneven`` scores count by their own squares, too
    (White 1980).
    """
    x, slope = signals(data, white), signals(data, change)
    parts = signals(data, heard)
    known = np.cumsum(slope**2, axis=1)
    power = np.mean(x**2, axis=1, keepdims=True) * known
    if uneven:
        power = np.stack([power, np.cumsum((x * slope) ** 2, axis=1)])
    power = power.reshape(-1, *known.shape)
    own, best = np.cumsum(x * slope, axis=1), 0.0
    edge = max(EDGE, int(EDGE_SHARE * x.shape[1]))
    inner, count = slice(edge, x.shape[1] - edge), max(len(parts), 1)
    for c, by in enumerate(slope):
        share = known[c, inner] / max(known[c, -1], np.finfo(float).tiny)
        of_parts = np.cumsum(parts * by, axis=1)
        of_parts = of_parts[:, inner] - share * of_parts[:, -1:]
        spread = _bridged(power[:, c, inner], share, power[:, c, -1:]) + np.sum(of_parts**2, axis=0) / count
        best = max(best, _largest(own[c, inner] - share * own[c, -1], spread))
    ends = power[..., -1] + np.sum((parts @ slope.T) ** 2, axis=0) / count
    share = known[:, -1] / max(known[:, -1].sum(), np.finfo(float).tiny)
    between = own[:, -1] - share * own[:, -1].sum()
    return max(best, _largest(between, _bridged(ends, share, ends.sum(axis=1, keepdims=True))))


def _bridged(some: np.ndarray, share: np.ndarray, whole: np.ndarray) -> Float[np.ndarray, " place"]:
    """Variance of a part of a sum less its share of the whole, the larger by both rows."""
    return np.max((1.0 - 2.0 * share) * some + share**2 * whole, axis=0)


def _largest(bridge: Float[np.ndarray, " place"], spread: Float[np.ndarray, " place"]) -> float:
    use = spread > 0.0
    return float(np.max(np.abs(bridge[use]) / np.sqrt(spread[use]), initial=0.0))


def _changed_modes(
    record: Record, data: Data, run: RecordRun, size: Float[np.ndarray, "output line column"], heard: Heard
) -> dict[float, float]:
    """Modes [Hz] whose pole is not the same throughout the record, and by how many deviations of noise."""
    model, lines = model_of(run, record.inputs, record.outputs), data.omega / (2.0 * np.pi)
    H, white, found = model_response(model, lines), run.residual(data) / size, dict[float, float]()
    for m, pole in enumerate(model.poles):
        hz = abs(pole) / (2.0 * np.pi)
        if not model.is_pair[m] or not lines[0] <= hz <= lines[-1]:
            continue
        for way in (SHIFT * pole, 1j * SHIFT * pole):
            moved = np.where(np.arange(len(model.poles)) == m, pole + way, model.poles)
            change = (model_response(dataclasses.replace(model, poles=moved), lines) - H) / SHIFT
            each = np.einsum("koi,kic->okc", change, data.U) / size
            z = max(
                _step_score(w, by, n, data, uneven=True) for w, by, n in zip(white, each, heard, strict=True)
            )
            if z > STEPS:
                found[hz] = max(z, found.get(hz, 0.0))
    return found


def _scores_of_law(
    law: Law, record: Record, data: Data, run: RecordRun, size: np.ndarray, heard: Heard
) -> Float[np.ndarray, " output"]:
    """Deviations by which the residual follows a ``law`` of an input or output, as no linear one.

    Play in a sensor and a cubic one are laws of the output; play and saturation before the article are of an
    input, dry friction and a cubic spring of the motion, and their force moves the article as an input does.
    What a linear model makes of that, and noise, does not know it.
    """
    H = _response(record, data, run)
    left, of_inputs = run.residual(data), [law(u, data) for u in np.moveaxis(data.U, 1, 0)]
    found = np.zeros(len(left))
    for o, r in enumerate(left):
        of_output = law(data.H[o] - r, data)
        for gain, terms in [
            (np.ones(len(H)), of_output),
            *zip(H[:, o].T, of_inputs, strict=True),
            *((gain, of_output) for gain in H[:, o].T),
        ]:
            by, *linear = ((gain[:, None] * term / size[o]).ravel().view(float) for term in terms)
            basis = np.column_stack(linear)
            by = by - basis @ np.linalg.lstsq(basis, by, rcond=None)[0]
            white = (r / size[o]).ravel().view(float)
            parts = np.real(heard[o].conj().T @ by.view(complex).reshape(r.shape))
            # Where one variance for all lines is not that of those that count, their own, what goes by the
            # law apart (White 1980).
            rest = white - by * (white @ by) / max(by @ by, np.finfo(float).tiny)
            own = max(np.mean(white**2) * np.sum(by**2), np.sum((rest * by) ** 2))
            spread = own + np.sum(parts**2) / max(len(parts), 1)
            found[o] = max(found[o], abs(white @ by) / np.sqrt(max(spread, np.finfo(float).tiny)))
    return found


def _by_direction(x: np.ndarray, data: Data) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectra of the sign of a signal's rate, of the signal and of its rate."""
    rate = data.s[:, None] * x
    signs = np.sign(signals(data, rate))
    return np.fft.rfft(signs, axis=1)[:, data.lines].T, x, rate


def _by_cube(x: np.ndarray, data: Data) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spectra of the cube of a signal, on a grid so fine that none of it folds back, of it and its rate."""
    cube = signals(data, x, finer=2) ** 3
    return np.fft.rfft(cube, axis=1)[:, data.lines].T, x, data.s[:, None] * x


def _told_by_inputs(
    white: Complex[np.ndarray, "line column"], data: Data, heard: Complex[np.ndarray, "line part"]
) -> float:
    """The largest correlation with an input, earlier or later, in deviations of noise.

    Noise of a blow's force is heard after it as the blow itself is, and there are few: by chance its sums are
    larger than those of noise that goes on through the record.
    """
    U = np.moveaxis(data.U, 1, 0)
    size = np.sqrt(noise_variance(U))
    spread = 0.5 * np.sum(np.abs(white * U / size) ** 2, axis=(1, 2))
    best = 0.0
    for u, power in zip(U / size, spread, strict=True):
        told = _correlated(np.sum(white * u.conj(), axis=1, keepdims=True), data)[0]
        parts = [_correlated(heard * column[:, None].conj(), data) for column in u.T] if heard.size else []
        of_force = sum((np.mean(part**2, axis=0) for part in parts), np.zeros(told.shape))
        deviation = np.sqrt(np.maximum(power + of_force, np.finfo(float).tiny))
        best = max(best, float(np.max(np.abs(told) / deviation)))
    return best


def _correlated(products: Complex[np.ndarray, "line part"], data: Data) -> Float[np.ndarray, "part lag"]:
    """Sums of products of spectra, at all lags."""
    cross = np.zeros((products.shape[1], data.lines[-1] + 1), dtype=complex)
    cross[:, data.lines] = products.T
    return np.fft.irfft(cross, 2 * cross.shape[1], axis=1) * cross.shape[1]


def _told_together(
    record: Record,
    data: Data,
    run: RecordRun,
    white: Complex[np.ndarray, "output line column"],
    heard: Heard,
) -> Float[np.ndarray, " output"]:
    """Deviations of noise by which sums of the residual, turned by the response to an input, are too large.

    What a model lacks has much the same phase to the response on some lines beside each other, a gain that is
    not the same at all frequencies among it; noise has any. Squares of sums over those of their terms are
    exponential variates. Noise that is ``heard`` counts as it is.
    """
    at = slice(None) if data.driven is None else data.driven
    parts = _response(record, data, run)[..., None] * data.U[:, None]
    unit = np.exp(1j * np.angle(parts))[at]
    turned = white.swapaxes(0, 1)[at, :, None] * unit.conj()
    known = heard.swapaxes(0, 1)[at, :, None, :, None] * unit.conj()[..., None, :]
    found = np.zeros(len(white))
    for width in TOGETHER:
        count = len(turned) // width
        if count < FEWEST_SUMS:
            continue
        blocks = turned[: count * width].reshape(count, width, *turned.shape[1:])
        own = np.sum(np.abs(blocks) ** 2, axis=(1, -1))
        forced = known[: count * width].reshape(count, width, *known.shape[1:]).sum(axis=1)
        own += np.sum(np.abs(forced) ** 2, axis=(-1, -2)) / max(known.shape[-2], 1)
        over = np.abs(np.sum(blocks, axis=(1, -1))) ** 2 / np.maximum(own, np.finfo(float).tiny)
        # A mean of exponential variates is a gamma variate (Wilson and Hilferty 1931).
        z = 3.0 * np.sqrt(count) * (np.cbrt(over.mean(axis=0)) - 1.0 + 1.0 / (9.0 * count))
        found = np.maximum(found, z.max(axis=1))
    return found


def _response(record: Record, data: Data, run: RecordRun) -> Complex[np.ndarray, "line output input"]:
    return model_response(model_of(run, record.inputs, record.outputs), data.omega / (2.0 * np.pi))


def signals(
    data: Data, spectra: Complex[np.ndarray, "line column"], *, finer: int = 1
) -> Float[np.ndarray, "column sample"]:
    """The spectra as signals in time, on the coarsest grid for the lines, or ``finer`` times as fine."""
    lines = data.lines
    full = np.zeros((spectra.shape[1], finer * (lines[-1] + 1)), dtype=complex)
    full[:, lines] = spectra.T
    return np.fft.irfft(full, 2 * full.shape[1], axis=1)

"""Score tests of terms that a fitted model lacks: a delay of one input or path, or a filter of one output.

The score of a further unknown is the residual times its derivative, less the part that the fitted unknowns
follow (Rao 1948; Engle 1984, section 5): nothing is fitted again. For a complete model it is normal with the
deviation of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.identification.uncertainty import orthogonal
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, ties
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.systems.plants.response import FrequencyResponse

Kind = Literal["input", "path", "output", "filter", "drift"]
# Deviations above which a term is lacking: of a hundred terms chance passes it in one fit of 2e4, if the
# variance of the noise is known; more often if it is estimated with the response.
TOLD = 5.0
# Powers of s of a filter's terms: its delay is the output's, of the first.
FILTER = (2, 3)
# Deviations by which a lacking term must move an unknown of the fit before it is reported.
MOVED = 1.0
# Share of a term that the fitted unknowns must leave, in squares, for it to be distinguished from them.
APART = 1e-9
# Lines whose squares are taken together: neighbouring estimates of a local model share their data.
WIDTH = 8
BY = "({z:.0f} standard deviations of noise)"
SMALL = "; the stated standard deviations are too small. "
UNEQUAL = (
    f" {BY}: a card or a filter of its own, or unequal delays{SMALL}Shift it, or fit a delay of each path "
    "(--delay path, delay='path')"
)
SAID = {
    "input": "input {input}: is recorded {ms:.3g} ms {later} than the others" + UNEQUAL,
    "path": "output {output}: answers to input {input} {ms:.3g} ms {later} than to the others" + UNEQUAL,
    "output": "output {output}: is recorded {ms:.3g} ms {later} than the delay that all have in common "
    f"{BY}{SMALL}Fit a delay of each output (--delay output, delay='output')",
    "drift": "output {output}: its gain changes during the record, by {value:+.2%} from end to end "
    f"{BY}: a sensor or an amplifier that drifts, or an article that changes{SMALL}Let it warm up, or fit "
    "shorter parts",
    "filter": "output {output}: what is left goes with a power of frequency times the response "
    f"{BY}: a filter before this channel alone, a clock that jitters, or modes beyond the band{SMALL}Filter "
    "inputs and outputs alike, narrow the band, or take more states",
}


class Term(NamedTuple):
    """A delay of an input, of a path or of an output, or a power of s of an output's filter.

    A gain of an output that drifts is a term of records alone: their samples tell when it answers.
    """

    kind: Kind
    output: int = -1
    input: int = -1
    power: int = 1

    def of(
        self, output: int, parts: Complex[np.ndarray, "line input column"], s: Complex[np.ndarray, " line"]
    ) -> Complex[np.ndarray, "line column"]:
        """Derivative of an output's spectra, the ``parts`` of which respond to each input."""
        if self.output not in {-1, output}:
            return np.zeros_like(parts[:, 0])
        some = parts.sum(axis=1) if self.input < 0 else parts[:, self.input]
        return -some * (s * (abs(s[-1]) ** (1 - self.power) * s ** (self.power - 1)))[:, None]


def terms_of(outputs: int, inputs: int, structure: ModelStructure) -> list[Term]:
    """The terms to test.

    Without delays, what is left may well be one (`fit.missing_delay`); terms for what is beyond the band
    follow a filter, as they follow modes.
    """
    alone = structure.with_delay and not (structure.with_direct or structure.with_lower)
    filters = FILTER if alone else ()
    found = [Term("filter", o, power=power) for o in range(outputs) for power in filters]
    if structure.common_delay:
        found += [Term("output", o) for o in range(outputs)]
    if inputs > 1:
        found += [Term("input", input=i) for i in range(inputs)]
        found += [Term("path", o, i) for o in range(outputs) for i in range(inputs)]
    return found


class TermRows(NamedTuple):
    """Real numbers of one output or entry over their deviations.

    ``place`` are the unknowns of ``slopes``, ``line`` the line of each number. ``left`` is what the
    fit leaves; complex numbers have deviations of one, so that each of their parts has half its square.
    """

    place: Int[np.ndarray, " unknown"]
    slopes: Float[np.ndarray, "unknown number"]
    terms: Float[np.ndarray, "term number"]
    left: Float[np.ndarray, " number"]
    line: Int[np.ndarray, " number"]


class TermScores(NamedTuple):
    """Distance ``z`` of each term from zero, in standard deviations, and its likeliest ``value``.

    ``moves``: largest shift of an unknown by that value, in its deviations; ``of_modes``: the same for each
    mode, without terms beyond the band, which stand for anything there. All are zero where a term cannot be
    distinguished from the unknowns.
    """

    z: Float[np.ndarray, " term"]
    value: Float[np.ndarray, " term"]
    moves: Float[np.ndarray, " term"]
    of_modes: Float[np.ndarray, "mode term"]


class Lacking(NamedTuple):
    """Missing terms of a model, in words, and the modes that they move by more than their deviations.

    The deviations of the other modes hold: to first order the missing terms change them by less.
    """

    said: list[str]
    modes: Int[np.ndarray, " mode"]


NOTHING = Lacking([], np.array([], dtype=int))


def term_scores(rows: Callable[[], Iterable[TermRows]], covariance: ModelCovariance) -> TermScores:
    """The scores of all terms at the end of a fit.

    ``rows`` are made anew twice, for they are large. The deviation is that of noise of the assumed size, or
    of the squares of the scores of some lines together, if those are more (White 1980).
    """
    by_terms, follow = _followed(rows, covariance)
    count = by_terms.shape[1]
    scores, powers = np.zeros((2, count, 1))
    for r in rows():
        apart = r.terms - follow[r.place].T @ r.slopes
        scores, powers = scores + _by_line(r, apart * r.left), powers + _by_line(r, apart**2)
    power = powers.sum(axis=1)
    told = power > APART * np.sum(by_terms**2, axis=0)
    value = np.divide(scores.sum(axis=1), power, out=np.zeros(count), where=told)
    rest = np.cumsum(np.pad(scores - value[:, None] * powers, ((0, 0), (WIDTH, WIDTH - 1))), axis=1)
    spread = np.sum((rest[:, WIDTH:] - rest[:, :-WIDTH]) ** 2, axis=1) / WIDTH
    spread = np.sqrt(np.maximum(0.5 * power, spread))
    z = np.divide(value * power, spread, out=np.zeros(count), where=told)
    known = np.linalg.norm(covariance.root, axis=1, keepdims=True)
    moves = np.abs(follow * value) / np.maximum(known, np.finfo(float).tiny)
    at = covariance.at
    of_modes = np.zeros((len(at.sigma), count))
    for m in range(len(at.sigma)):
        own = np.concatenate([at.sigma[[m]], at.omega[[m]], at.b[m].ravel(), at.c[:, m].ravel()])
        of_modes[m] = moves[own[own >= 0]].max(axis=0, initial=0.0)
    late = np.concatenate([at.delay, at.path.ravel()])
    most = np.vstack([of_modes, moves[late[late >= 0]]]).max(axis=0, initial=0.0)
    return TermScores(z, value, most, of_modes)


def joint_score(rows: Callable[[], Iterable[TermRows]], covariance: ModelCovariance) -> float:
    """Square of the scores of all terms together: chi-squared of as many degrees of freedom as terms.

    Under noise of the assumed size. ``rows`` are made anew twice, as for `term_scores`.
    """
    by_terms, follow = _followed(rows, covariance)
    size = np.linalg.norm(by_terms, axis=0) + np.finfo(float).tiny
    count = len(size)
    score, power = np.zeros(count), np.zeros((count, count))
    for r in rows():
        apart = (r.terms - follow[r.place].T @ r.slopes) / size[:, None]
        score, power = score + apart @ r.left, power + 0.5 * apart @ apart.T
    return float(score @ np.linalg.pinv(power, rcond=APART, hermitian=True) @ score)


def _followed(
    rows: Callable[[], Iterable[TermRows]], covariance: ModelCovariance
) -> tuple[Float[np.ndarray, "number term"], Float[np.ndarray, "unknown term"]]:
    """An orthogonal factor of the terms, and by how much each moves the fitted unknowns."""
    held = ties(covariance.model, covariance.structure)
    size = held.shape[1]
    factor = orthogonal.triangle(np.vstack([_factor(r, size) for r in rows()]))
    F, by_terms = factor[:, :size], factor[:, size:]
    W, loose = orthogonal.inverse_root(F, held)
    W = W[:, : W.shape[1] - loose]
    return by_terms, W @ (W.T @ (F.T @ by_terms))


def _by_line(r: TermRows, numbers: Float[np.ndarray, "term number"]) -> Float[np.ndarray, "term line"]:
    return np.array([np.bincount(r.line, by) for by in numbers])


def _factor(r: TermRows, size: int) -> Float[np.ndarray, "few column"]:
    """Orthogonal factor of the derivatives by all unknowns and terms, of which an output has few."""
    own = np.flatnonzero(r.terms.any(axis=1))
    R = orthogonal.triangle(np.vstack([r.slopes, r.terms[own]]).T)
    found = np.zeros((len(R), size + len(r.terms)))
    found[:, np.concatenate([r.place, size + own])] = R
    return found


def lacking_of(terms: list[Term], found: TermScores, model: MeasurementModel) -> Lacking:
    """The kind of term that is most clearly lacking, as the residual may follow others, too."""
    z = np.where(found.moves > MOVED, np.abs(found.z), 0.0)
    order = sorted(range(len(z)), key=lambda k: (-round(z[k], 6), found.value[k]))
    told = [k for k in order if terms[k].kind == terms[order[0]].kind and z[k] > TOLD]
    if not told:
        return NOTHING
    said: dict[int, str] = {}
    for k in told:
        term = terms[k]
        if term.output in said:
            continue
        late = found.value[k] * (-1.0 if term.kind == "input" else 1.0)  # late inputs make outputs early
        said[term.output] = SAID[term.kind].format(
            input=model.inputs[term.input].name,
            output=model.outputs[term.output].name,
            ms=1e3 * abs(late),
            later="later" if late > 0.0 else "earlier",
            value=found.value[k],
            z=z[k],
        )
    modes = np.flatnonzero(found.of_modes[:, told].sum(axis=1) > MOVED)
    f = ", ".join(f"{hz:.4g}" for hz in np.unique(natural_hz(model)[modes]))
    which = [f"modes at {f} Hz: doubtful, what the model lacks moves them by more than their deviations"]
    return Lacking([*said.values(), *(which if len(modes) else [])], modes)


def response_lacks(
    covariance: ModelCovariance, measured: FrequencyResponse, assumed: Float[np.ndarray, "output line input"]
) -> Lacking:
    """Missing terms of a fit of a response, weighted by the ``assumed`` variance."""
    model, structure = covariance.model, covariance.structure
    s, (outputs, inputs) = 2j * np.pi * measured.frequency_hz, model.direct.shape
    terms = terms_of(outputs, inputs, structure)
    if not terms:
        return NOTHING
    line = np.repeat(np.arange(len(s)), 2)

    def rows() -> Iterator[TermRows]:
        for o, i in np.ndindex(outputs, inputs):
            entry, size = entry_slopes(model, structure, s, o, i), np.sqrt(assumed[o, :, i])
            part = np.zeros((len(s), inputs, 1), complex)
            part[:, i, 0] = entry.H
            each = np.stack([term.of(o, part, s)[:, 0] for term in terms])
            left = measured.H[:, o, i] - entry.H
            yield TermRows(entry.place, *((x / size).view(float) for x in (entry.by, each, left)), line)

    return lacking_of(terms, term_scores(rows, covariance), model)

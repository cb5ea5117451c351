"""Score tests of terms that a fitted model lacks: a delay of one input or path, a filter, or a coupling
that blocks the mean.

The score of a further unknown is the residual times its derivative, less the part that the fitted unknowns
follow (Rao 1948; Engle 1984, section 5): nothing is fitted again. For a complete model it is normal with the
deviation of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from middeck.identification.model.measurement_model import MeasurementModel, natural_hz
from middeck.identification.uncertainty import orthogonal
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, ties
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

Kind = Literal["input", "path", "output", "filter", "drift", "coupled", "coupled input", "hold"]
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
# A channel that is AC-coupled has the factor s tau / (1 + s tau), 1 - 1 / (s tau) to the first order.
COUPLED = (
    "AC-coupled, as ICP (IEPE) sensors and charge amplifiers are, or filtered by a high-pass that the other "
    f"side lacks; its time constant is some {{tau:.2g}} s {BY}. Delays, gains and low modes follow its phase"
    f"{SMALL}Record DC-coupled, divide by s tau / (1 + s tau) with the sensor's time constant, or raise the "
    "lower end of the band (--band)"
)
COUPLED_TOLD = f"{{channel}}: is {COUPLED}"
SAID = {
    "input": "input {input}: is recorded {ms:.3g} ms {later} than the others" + UNEQUAL,
    "path": "output {output}: answers to input {input} {ms:.3g} ms {later} than to the others" + UNEQUAL,
    "output": "output {output}: is recorded {ms:.3g} ms {later} than the delay that all have in common "
    f"{BY}{SMALL}Fit a delay of each output (--delay output, delay='output')",
    "drift": "output {output}: its gain changes during the record, by {value:+.2%} from end to end "
    f"{BY}: a sensor or an amplifier that drifts, or an article that changes{SMALL}Let it warm up, or fit "
    "shorter parts",
    "coupled": COUPLED_TOLD,
    "coupled input": COUPLED_TOLD,
    "filter": "output {output}: what is left goes with a power of frequency times the response "
    f"{BY}: a filter before this channel alone, a clock that jitters, or modes beyond the band{SMALL}Filter "
    "inputs and outputs alike, narrow the band, or take more states",
}


@record(kw_only=True)
class LackingTerm:
    """A delay of an input, of a path or of an output, a power of s of an output's filter, or its coupling.

    A gain of an output that drifts is a term of records alone: their samples tell when it answers. So is the
    hold of the inputs at ``rate_hz``, less its delay of half a period, which delays follow.
    """

    kind: Kind
    output: int = -1
    input: int = -1
    power: int = 1
    rate_hz: float = np.inf

    def of(
        self, output: int, parts: Complex[np.ndarray, "line input column"], s: Complex[np.ndarray, " line"]
    ) -> Complex[np.ndarray, "line column"]:
        """Derivative of an output's spectra, the ``parts`` of which respond to each input."""
        if self.output not in {-1, output}:
            return np.zeros_like(parts[:, 0])
        some = parts.sum(axis=1) if self.input < 0 else parts[:, self.input]
        if self.kind in {"coupled", "coupled input"}:
            return -some / s[:, None]
        if self.kind == "hold":
            return some * np.log(np.sinc(np.abs(s) / (2.0 * np.pi * self.rate_hz)))[:, None]
        return -some * (s * (abs(s[-1]) ** (1 - self.power) * s ** (self.power - 1)))[:, None]


def terms_of(outputs: int, inputs: int, structure: ModelStructure) -> list[LackingTerm]:
    """The terms to test.

    A filter is no candidate without delays, since a missing delay may be the cause (`fit.missing_delay`), nor
    with terms for modes beyond the band, which follow a filter too.
    """
    alone = structure.with_delay and not (structure.with_direct or structure.with_lower)
    filters = FILTER if alone else ()
    found = [LackingTerm(kind="filter", output=o, power=power) for o in range(outputs) for power in filters]
    # Without delays, poles beyond the band follow them, and no phase at low frequencies is theirs.
    if structure.with_delay:
        found += [LackingTerm(kind="coupled", output=o) for o in range(outputs)]
        several = outputs > 1 or inputs > 1
        found += [LackingTerm(kind="coupled input", input=i) for i in range(inputs) if several]
    if structure.common_delay:
        found += [LackingTerm(kind="output", output=o) for o in range(outputs)]
    if inputs > 1:
        found += [LackingTerm(kind="input", input=i) for i in range(inputs)]
        found += [LackingTerm(kind="path", output=o, input=i) for o in range(outputs) for i in range(inputs)]
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class TermRows:
    """Real numbers of one output or entry over their deviations.

    ``place`` are the unknowns of ``slopes``, ``line`` the line of each number. ``left`` is what the
    fit leaves; complex numbers have deviations of one, so that each of their parts has half its square.
    ``heard`` are parts of noise of the inputs, each the same in all outputs and another in each experiment.
    """

    place: Int[np.ndarray, " unknown"]
    slopes: Float[np.ndarray, "unknown number"]
    terms: Float[np.ndarray, "term number"]
    left: Float[np.ndarray, " number"]
    line: Int[np.ndarray, " number"]
    heard: Float[np.ndarray, "part experiment some"] | None = None


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
    heard = np.zeros((count, 1, 1))
    for r in rows():
        apart = r.terms - follow[r.place].T @ r.slopes
        scores, powers = scores + _by_line(r, apart * r.left), powers + _by_line(r, apart**2)
        if r.heard is not None:
            each = apart.reshape(count, r.heard.shape[1], -1)
            heard = heard + np.einsum("ten,pen->tpe", each, r.heard)
    power = powers.sum(axis=1)
    told = power > APART * np.sum(by_terms**2, axis=0)
    value = np.divide(scores.sum(axis=1), power, out=np.zeros(count), where=told)
    rest = np.cumsum(np.pad(scores - value[:, None] * powers, ((0, 0), (WIDTH, WIDTH - 1))), axis=1)
    spread = np.sum((rest[:, WIDTH:] - rest[:, :-WIDTH]) ** 2, axis=1) / WIDTH
    spread = np.sqrt(np.maximum(0.5 * power, spread) + np.sum(heard**2, axis=(1, 2)) / heard.shape[1])
    z = np.divide(value * power, spread, out=np.zeros(count), where=told)
    moves = _in_deviations(follow * value, covariance)
    of_modes, at = _of_modes(moves, covariance), covariance.at
    late = np.concatenate([at.delay, at.path.ravel()])
    most = np.vstack([of_modes, moves[late[late >= 0]]]).max(axis=0, initial=0.0)
    return TermScores(z, value, most, of_modes)


def _in_deviations(
    shifts: Float[np.ndarray, "unknown term"], covariance: ModelCovariance
) -> Float[np.ndarray, "unknown term"]:
    known = np.linalg.norm(covariance.root, axis=1, keepdims=True)
    return np.abs(shifts) / np.maximum(known, np.finfo(float).tiny)


def _of_modes(
    moves: Float[np.ndarray, "unknown term"], covariance: ModelCovariance
) -> Float[np.ndarray, "mode term"]:
    """The most that an unknown of each mode moves."""
    at = covariance.at
    of_modes = np.zeros((len(at.sigma), moves.shape[1]))
    for m in range(len(at.sigma)):
        own = np.concatenate([at.sigma[[m]], at.omega[[m]], at.b[m].ravel(), at.c[:, m].ravel()])
        of_modes[m] = moves[own[own >= 0]].max(axis=0, initial=0.0)
    return of_modes


def joint_score(rows: Callable[[], Iterable[TermRows]], covariance: ModelCovariance) -> float:
    """Square of the scores of all terms together: chi-squared of as many degrees of freedom as terms."""
    return float(joint_scores(rows, covariance, [slice(None)]).squares[0])


class JointScores(NamedTuple):
    """Squares of the scores of groups of terms, each term of a group beside the others.

    Each square is chi-squared, of as many degrees as its group has terms. ``of_modes``: by how many of its
    deviations the likeliest values of the group move an unknown of each mode.
    """

    squares: Float[np.ndarray, " group"]
    of_modes: Float[np.ndarray, "mode group"]


def joint_scores(
    rows: Callable[[], Iterable[TermRows]],
    covariance: ModelCovariance,
    groups: Sequence[Bool[np.ndarray, " term"] | slice],
) -> JointScores:
    """The scores of each group of terms together.

    Under noise of the assumed size, and that of the inputs beside it. ``rows`` are made anew twice, as for
    `term_scores`.
    """
    by_terms, follow = _followed(rows, covariance)
    size = np.linalg.norm(by_terms, axis=0) + np.finfo(float).tiny
    count = len(size)
    score, power, heard = np.zeros(count), np.zeros((count, count)), np.zeros((count, 1, 1))
    for r in rows():
        apart = (r.terms - follow[r.place].T @ r.slopes) / size[:, None]
        score, power = score + apart @ r.left, power + 0.5 * apart @ apart.T
        if r.heard is not None:
            each = apart.reshape(count, r.heard.shape[1], -1)
            heard = heard + np.einsum("ten,pen->tpe", each, r.heard)
    power += np.einsum("tpe,spe->ts", heard, heard) / heard.shape[1]
    values, squares = np.zeros((count, len(groups))), np.zeros(len(groups))
    for g, own in enumerate(groups):
        values[own, g] = np.linalg.pinv(power[own][:, own], rcond=APART, hermitian=True) @ score[own]
        squares[g] = score[own] @ values[own, g]
    shifts = follow @ (values / size[:, None])
    return JointScores(squares, _of_modes(_in_deviations(shifts, covariance), covariance))


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


def lacking_of(terms: list[LackingTerm], found: TermScores, model: MeasurementModel) -> Lacking:
    """The kind of term that is most clearly lacking, as the residual may follow others, too."""
    z = np.where(found.moves > MOVED, np.abs(found.z), 0.0)
    order = sorted(range(len(z)), key=lambda k: (-round(z[k], 6), found.value[k]))
    told = [k for k in order if terms[k].kind == terms[order[0]].kind and z[k] > TOLD]
    if not told:
        return NOTHING
    said: dict[tuple[int, int], str] = {}
    for k in told:
        term = terms[k]
        of = term.output, term.input if term.kind == "coupled input" else -1
        if of in said:
            continue
        late = found.value[k] * (-1.0 if term.kind == "input" else 1.0)  # late inputs make outputs early
        said[of] = SAID[term.kind].format(
            input=model.inputs[term.input].name,
            channel=coupled_channel(term, model, found.value[k]),
            tau=1.0 / max(abs(found.value[k]), np.finfo(float).tiny),
            output=model.outputs[term.output].name,
            ms=1e3 * abs(late),
            later="later" if late > 0.0 else "earlier",
            value=found.value[k],
            z=z[k],
        )
    return moved_by(list(said.values()), found.of_modes[:, told].sum(axis=1), model)


def moved_by(said: list[str], of_modes: Float[np.ndarray, " mode"], model: MeasurementModel) -> Lacking:
    """What a model lacks, with the modes that this moves by more than their deviations."""
    modes = np.flatnonzero(of_modes > MOVED)
    f = ", ".join(f"{hz:.4g}" for hz in np.unique(natural_hz(model)[modes]))
    which = [f"modes at {f} Hz: doubtful, what the model lacks moves them by more than their deviations"]
    return Lacking([*said, *(which if len(modes) else [])], modes)


def coupled_channel(term: LackingTerm, model: MeasurementModel, value: float) -> str:
    """The channel that is AC-coupled: the output itself, or what all outputs of one sign have in common."""
    if term.kind == "coupled" and (value > 0.0 or len(model.inputs) > 1):
        return f"output {model.outputs[term.output].name}"
    if value < 0.0:
        return f"input {model.inputs[max(term.input, 0)].name}"
    return f"all outputs beside input {model.inputs[term.input].name}"


def response_lacks(
    covariance: ModelCovariance, measured: FrequencyResponse, assumed: Float[np.ndarray, "output line input"]
) -> Lacking:
    """Terms that a fit of a response lacks; its lines are weighted by the ``assumed`` variance."""
    terms = terms_of(*covariance.model.direct.shape, covariance.structure)
    if not terms:
        return NOTHING
    return lacking_of(terms, response_scores(terms, covariance, measured, assumed), covariance.model)


def response_scores(
    terms: list[LackingTerm],
    covariance: ModelCovariance,
    measured: FrequencyResponse,
    assumed: Float[np.ndarray, "output line input"],
) -> TermScores:
    """Scores of ``terms`` at the end of a fit of a response."""
    model, structure = covariance.model, covariance.structure
    s, (outputs, inputs) = 2j * np.pi * measured.frequency_hz, model.direct.shape
    line = np.repeat(np.arange(len(s)), 2)

    def rows() -> Iterator[TermRows]:
        for o, i in np.ndindex(outputs, inputs):
            entry, size = entry_slopes(model, structure, s, o, i), np.sqrt(assumed[o, :, i])
            part = np.zeros((len(s), inputs, 1), complex)
            part[:, i, 0] = entry.H
            each = np.stack([term.of(o, part, s)[:, 0] for term in terms])
            left = measured.H[:, o, i] - entry.H
            slopes, own, rest = ((x / size).view(float) for x in (entry.by, each, left))
            yield TermRows(place=entry.place, slopes=slopes, terms=own, left=rest, line=line)

    return term_scores(rows, covariance)

"""Terms that the model of a record lacks (`uncertainty.lacking_terms`), from the residual of its fit."""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.model.measurement_model import model_response
from middeck.identification.problem.data import Data
from middeck.identification.problem.transient_projection import TransientProjection
from middeck.identification.record_fit.record_covariance import Rows
from middeck.identification.record_fit.refine_record import RecordRun
from middeck.identification.record_fit.residual_tests import Heard, signals
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.lacking_terms import (
    NOTHING,
    TOLD,
    Lacking,
    LackingTerm,
    TermRows,
    TermScores,
    joint_scores,
    lacking_of,
    moved_by,
    term_scores,
    terms_of,
)
from middeck.signals.record import Record

# Samples of an input, the present one among them, to which an output may answer beside its poles.
BEFORE = 6
OF_SAMPLES = (
    "it answers to single samples of an input, present or before, as the model does not ({z:.0f} standard "
    "deviations of noise): a delay, or modes that die out within a few samples; the stated standard "
    "deviations are too small; take more states, or a continuous model (sampled=False)"
)


def record_lacks(
    run: RecordRun, data: Data, covariance: ModelCovariance, heard: Heard | None = None
) -> Lacking:
    """The kind of term that is most clearly lacking; noise of the inputs that is ``heard`` is none."""
    terms = terms_of(*covariance.model.direct.shape, covariance.structure)
    terms += [LackingTerm(kind="drift", output=o) for o in range(len(data.H))]
    return lacking_of(terms, record_scores(terms, run, data, covariance, heard), covariance.model)


def record_scores(
    terms: list[LackingTerm],
    run: RecordRun,
    data: Data,
    covariance: ModelCovariance,
    heard: Heard | None = None,
) -> TermScores:
    """Scores of ``terms`` at the end of a fit of a record."""
    H = model_response(covariance.model, data.omega / (2.0 * np.pi))
    residual = run.residual(data)

    def lacking(o: int) -> Complex[np.ndarray, "term line column"]:
        found = np.zeros((len(terms), *residual[o].shape), complex)
        for k, term in enumerate(terms):
            if term.kind != "drift":
                found[k] = term.of(o, H[:, o, :, None] * data.U, data.s)
            elif term.output == o:
                found[k] = _drifting(data.H[o] - residual[o], data)
        return found

    return term_scores(lambda: _rows(lacking, run, data, covariance, heard), covariance)


def lacks_samples_before(
    record: Record, run: RecordRun, data: Data, covariance: ModelCovariance, heard: Heard
) -> Lacking:
    """Outputs that answer to single samples of an input as their sampled model does not.

    A delay makes the response zero before it and a part of itself in the sample that it ends in: beside the
    poles, terms in powers of 1/z, which a model follows by as many poles at zero.
    """
    outputs, inputs = covariance.model.direct.shape
    of_output = np.repeat(np.arange(outputs), inputs * BEFORE)
    late = data.a_sample_late[:, None] ** np.arange(BEFORE)
    each = np.einsum("kn,kie->inke", late, data.U).reshape(inputs * BEFORE, *data.U.shape[::2])

    def lacking(o: int) -> Complex[np.ndarray, "term line column"]:
        return np.where((of_output == o)[:, None, None], np.tile(each, (outputs, 1, 1)), 0.0)

    def rows() -> Iterator[TermRows]:
        return _rows(lacking, run, data, covariance, heard)

    groups = [of_output == o for o in range(outputs)]
    # A chi-squared variate as a normal one (Wilson and Hilferty 1931).
    within = 2.0 / (9.0 * inputs * BEFORE)
    found = joint_scores(rows, covariance, groups)
    z = (np.cbrt(found.squares / (inputs * BEFORE)) - 1.0 + within) / np.sqrt(within)
    told = np.flatnonzero(z > TOLD)
    if not len(told):
        return NOTHING
    said = [f"output {record.outputs[o].name}: {OF_SAMPLES.format(z=z[o])}" for o in told]
    return moved_by(said, found.of_modes[:, told].sum(axis=1), covariance.model)


def _rows(
    lacking: Callable[[int], Complex[np.ndarray, "term line column"]],
    run: RecordRun,
    data: Data,
    covariance: ModelCovariance,
    heard: Heard | None,
) -> Iterator[TermRows]:
    """Rows of each output by the unknowns and by the terms that are ``lacking``, without transients."""
    each, residual = Rows(run, data, covariance.model, covariance.structure), run.residual(data)
    _, lines, columns = residual.shape
    line = np.tile(np.repeat(np.arange(lines), 2), columns)
    for o, left in enumerate(residual):
        J, own = each.of(o)
        place = np.flatnonzero(J.any(axis=(1, 2)))
        slopes, terms, (rest,) = (own.removed(part) for part in (J[place], lacking(o), left[None]))
        noise = None if heard is None else parts_of_noise(heard[o], own, columns)
        yield TermRows(place=place, slopes=slopes, terms=terms, left=rest, line=line, heard=noise)


def parts_of_noise(
    heard: Complex[np.ndarray, "line part"], own: TransientProjection, columns: int
) -> Float[np.ndarray, "part column some"] | None:
    """One output's responses to noise of the inputs, as `TermRows` has them; None where it is unknown."""
    if not heard.shape[1]:
        return None
    alike = np.repeat(heard.T[:, :, None], columns, axis=2)
    return own.removed(alike).reshape(len(alike), columns, -1)


def _drifting(answer: Complex[np.ndarray, "line column"], data: Data) -> Complex[np.ndarray, "line column"]:
    """Addition to an output's response if its gain grew by one from the first sample to the last."""
    x = signals(data, answer)
    return np.fft.rfft(x * np.linspace(-0.5, 0.5, x.shape[1]), axis=1)[:, data.lines].T

"""Terms that the model of a record lacks (`uncertainty.lacking_terms`), from the residual of its fit."""

from collections.abc import Iterator

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
    Lacking,
    LackingTerm,
    TermRows,
    TermScores,
    lacking_of,
    term_scores,
    terms_of,
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
    model, structure = covariance.model, covariance.structure
    each, residual = Rows(run, data, model, structure), run.residual(data)
    H = model_response(model, data.omega / (2.0 * np.pi))
    _, lines, columns = residual.shape
    line = np.tile(np.repeat(np.arange(lines), 2), columns)

    def rows() -> Iterator[TermRows]:
        for o, left in enumerate(residual):
            J, own = each.of(o)
            place = np.flatnonzero(J.any(axis=(1, 2)))
            lacking = np.zeros((len(terms), *left.shape), complex)
            for k, term in enumerate(terms):
                if term.kind != "drift":
                    lacking[k] = term.of(o, H[:, o, :, None] * data.U, data.s)
                elif term.output == o:
                    lacking[k] = _drifting(data.H[o] - left, data)
            parts = (J[place], lacking, left[None])
            slopes, by_terms, (rest,) = (own.removed(part) for part in parts)
            noise = None if heard is None else parts_of_noise(heard[o], own, columns)
            yield TermRows(place=place, slopes=slopes, terms=by_terms, left=rest, line=line, heard=noise)

    return term_scores(rows, covariance)


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

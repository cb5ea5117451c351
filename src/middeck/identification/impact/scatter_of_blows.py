"""What blows that differ make of a fit: its covariance by their scatter, in no direction less than stated.

Noise of the force lasts as long as its window. Its spectrum is then alike on many lines, those of a mode
among them, so that no residual over lines shows what it does to a model. From blow to blow it differs:
each blow's part of the averaged response moves the model by its own, and the mean of all scatters by what
these do (clustered sandwich, Liang and Zeger 1986), with one degree of freedom less than there are blows.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Complex

from middeck.identification.fit.fit_response import FitResult
from middeck.identification.impact.averaged_blows import ImpactTest, windowed_spectra
from middeck.identification.problem.transient_projection import as_real
from middeck.identification.spectra.excess_variance import spread_of
from middeck.identification.uncertainty import orthogonal
from middeck.identification.uncertainty.entry_factors import entry_slopes
from middeck.identification.uncertainty.model_unknowns import ties
from middeck.identification.uncertainty.parameter_deviations import uncertainty_of


def with_scatter(fit: FitResult, test: ImpactTest) -> FitResult:
    """``fit``, which is of the averaged response, with the covariance that the scatter of blows asks for."""
    known, apart = fit.covariance, _parts(test)
    s = 2j * np.pi * test.response.frequency_hz
    v = spread_of(test.response, relative=False).variance[:, :, 0] + fit.excess[:, None] ** 2
    J = np.zeros((len(known.root), len(v), len(s)), dtype=complex)
    for o in range(len(v)):
        entry = entry_slopes(known.model, known.structure, s, o, 0)
        J[entry.place, o] = entry.by
    rows, moved = (as_real(x / np.sqrt(v)) for x in (J, apart))
    W, loose = orthogonal.inverse_root(orthogonal.triangle(rows.T), ties(known.model, known.structure))
    W = W[:, : W.shape[1] - loose]
    by_blow = np.linalg.lstsq(known.fixed, W @ (W.T @ (rows @ moved.T)), rcond=None)[0]
    count = len(apart)
    more = orthogonal.root_of(count / (count - 1.0) * by_blow @ by_blow.T, least=1.0)
    free = known.root[:, known.root.shape[1] - known.loose :]
    covariance = dataclasses.replace(
        known,
        root=np.hstack([orthogonal.canonical_root(known.fixed @ more), free]),
        degrees=min(known.degrees, count - 1.0),
    )
    return dataclasses.replace(fit, covariance=covariance, uncertainty=uncertainty_of(covariance))


def _parts(test: ImpactTest) -> Complex[np.ndarray, "blow output line"]:
    """What each blow adds to the averaged response: by its force, how far its own is off."""
    hz, U, Y = windowed_spectra(test.blocks, test.window_s)
    kept = np.isin(hz, test.response.frequency_hz)
    U, Y = U[:, kept], Y[:, kept]
    power = np.sum(np.abs(U) ** 2, axis=0)
    H = np.sum(Y * U.conj(), axis=0) / power
    return ((Y - H * U) * U.conj() / power).swapaxes(1, 2)

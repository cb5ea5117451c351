"""Scores of a second mode in the place of each one, from the residual of a response's fit.

Two modes, sum phi_k / (s - p_k), leave of one with their mean pole p and the sum of their residues the sum of
phi_k (p_k - p)^2 / (s - p)^3. Nearer than their widths they are one to a subspace, and one to a description
length, long before the deviations of that one reach from one to the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.stats
from jaxtyping import Complex, Float

from middeck.identification.model.measurement_model import MeasurementModel, natural_hz, path_delay
from middeck.identification.spectra.excess_variance import INDEPENDENT
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.lacking_terms import TermRows, joint_scores
from middeck.identification.uncertainty.parameter_deviations import distinct_poles
from middeck.identification.uncertainty.response_derivatives import entry_slopes
from middeck.systems.plants.response import FrequencyResponse

# The coefficient of the term is complex: two unknowns of each output.
PARTS = (1.0, 1j)
# Chance by which the residual of one mode has that form: of a hundred fits of ten modes one is doubted.
BY_CHANCE = 1e-3


def second_modes(
    covariance: ModelCovariance, measured: FrequencyResponse, assumed: Float[np.ndarray, "output line input"]
) -> list[int]:
    """The modes that may be two; lines are weighted by the ``assumed`` variance.

    None of a response of whole periods: distortion that repeats with them leaves the same form.
    """
    model, structure, lines = covariance.model, covariance.structure, measured.frequency_hz
    f = natural_hz(model)
    modes = [m for m in distinct_poles(model) if model.is_pair[m] and lines[0] <= f[m] <= lines[-1]]
    if not modes or measured.alike == INDEPENDENT:
        return []
    s, (outputs, inputs) = 2j * np.pi * lines, model.direct.shape
    each = np.stack([second_mode_terms(model, s, m) for m in modes])
    count, line = len(PARTS) * len(modes), np.repeat(np.arange(len(s)), 2)

    def rows() -> Iterator[TermRows]:
        for o, i in np.ndindex(outputs, inputs):
            entry, size = entry_slopes(model, structure, s, o, i), np.sqrt(assumed[o, :, i])
            terms = np.zeros((outputs, count, len(s)), complex)
            terms[o] = each[:, :, :, o, i].reshape(count, -1)
            left = measured.H[:, o, i] - entry.H
            slopes, own, rest = ((x / size).view(float) for x in (entry.by, terms.reshape(-1, len(s)), left))
            yield TermRows(place=entry.place, slopes=slopes, terms=own, left=rest, line=line)

    of_mode = np.tile(np.repeat(np.arange(len(modes)), len(PARTS)), outputs)
    groups = [of_mode == k for k in range(len(modes))]
    scores = joint_scores(rows, covariance, groups).squares
    chance = scipy.stats.chi2.sf(scores, len(PARTS) * outputs)
    return [m for m, p in zip(modes, chance, strict=True) if p < BY_CHANCE]


def second_mode_terms(
    model: MeasurementModel, s: Complex[np.ndarray, " line"], mode: int
) -> Complex[np.ndarray, "part line output input"]:
    """The two parts of 1 / (s - p)^3 times the residue of ``mode``, in units of its decay rate."""
    pole, residue = model.poles[mode], np.outer(model.shapes[:, mode], model.participation[mode])
    s = s[:, None, None]
    late = np.exp(-s * path_delay(model)) * np.real(pole) ** 2
    return np.stack(
        [
            late * (part * residue / (s - pole) ** 3 + np.conj(part * residue) / (s - pole.conj()) ** 3)
            for part in PARTS
        ]
    )


def warnings_on_second_modes(model: MeasurementModel, modes: Sequence[int]) -> list[str]:
    """A warning for each mode that may be two."""
    return [
        f"mode at {hz:.4g} Hz: it may be two modes, or one that is not linear or that a window smoothed; "
        f"what it leaves has the form of a second one (by chance once in {1.0 / BY_CHANCE:g}); its standard "
        "deviations are too small if it is two; ask for two more states, record longer, or with less noise"
        for hz in np.sort(natural_hz(model)[list(modes)])
    ]

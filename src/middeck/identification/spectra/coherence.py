"""Share of an output's power that inputs explain, linearly and line by line (Bendat and Piersol 2010)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.identification.spectra.averages import Spectra
from middeck.identification.spectra.excited_lines import WORST_CONDITION, refuse_alike


def ordinary_coherence(spectra: Spectra) -> Float[np.ndarray, "line output input"]:
    """|S_yu|^2 / (S_uu S_yy) of each pair; a line without power has none: zero.

    Of n independent averages of unrelated signals its mean is 1/n, not zero.
    """
    _refuse_few(spectra, 1)
    return _share(np.abs(spectra.S_yu) ** 2, _diagonal(spectra.S_yy)[:, :, None] * _power(spectra)[:, None])


def multiple_coherence(spectra: Spectra) -> Float[np.ndarray, "line output"]:
    """S_yu S_uu^-1 S_uy / S_yy: the share that all inputs explain together."""
    _refuse_few(spectra, spectra.S_uu.shape[1])
    refuse_dependent(spectra)
    explained = spectra.S_yu @ np.linalg.solve(spectra.S_uu, spectra.S_yu.conj().mT)
    return _share(_diagonal(explained), _diagonal(spectra.S_yy))


def refuse_dependent(spectra: Spectra) -> None:
    """Raise `DataError` where inputs with power are copies of each other."""
    size = np.sqrt(np.maximum(_power(spectra), np.finfo(float).tiny))
    unit = spectra.S_uu / (size[:, :, None] * size[:, None, :])
    # Eigenvalues are powers: squares of the smallest distinguishable amplitude.
    least = np.linalg.eigvalsh(unit)[:, 0]
    refuse_alike(least * WORST_CONDITION**2 <= 1.0, spectra.frequency_hz)


def _refuse_few(spectra: Spectra, inputs: int) -> None:
    if spectra.averages <= inputs:
        raise DataError(
            f"{spectra.averages:.3g} averages of {inputs} inputs explain everything, noise included",
            hint=f"shorter segments or more experiments, for more than {inputs} averages",
        )


def _power(spectra: Spectra) -> Float[np.ndarray, "line input"]:
    return _diagonal(spectra.S_uu)


def _diagonal(S: np.ndarray) -> np.ndarray:
    return np.real(np.linalg.diagonal(S))


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    some = whole > 0.0
    # Rounding can take a share of one a little beyond it.
    return np.clip(np.where(some, np.real(part) / np.where(some, whole, 1.0), 0.0), 0.0, 1.0)

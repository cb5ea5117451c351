"""H1, H2 and Hv: three beliefs about where the noise is (Rocklin, Crowley and Vold 1985)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Bool, Complex

from middeck.errors import ConfigError, DataError
from middeck.identification.spectra.averages import Spectra
from middeck.identification.spectra.lines import (
    FAINTEST,
    WORST_CONDITION,
    in_band,
    refuse_alike,
    refuse_silence,
)
from middeck.identification.spectra.scatter import ResponseScatter, variance_of

Ratio = Literal["h1", "h2", "hv"]


def spectra_response(
    spectra: Spectra,
    ratio: Ratio = "h1",
    *,
    band_hz: tuple[float, float] | None = None,
    excited: Bool[np.ndarray, " line"] | None = None,
) -> ResponseScatter:
    """The response from averaged spectra.

    - ``"h1"``, S_yu S_uu^-1: right if only outputs are noisy. Noise M in an input pulls it down, by
      S_uu/(S_uu + S_mm).
    - ``"h2"``, S_yy S_uy^+: right if only inputs are noisy. Noise N in an output pushes it up, by
      1 + S_nn/S_yy. It needs at least as many outputs as inputs.
    - ``"hv"``, total least squares, one output at a time, every channel scaled by its power: right if
      noise is the same share of all channels. With one input |H1| <= |Hv| <= |H2|, their geometric mean.

    ``excited`` names the lines of use; by default those within 80 dB of the strongest.

    The variance, from what the response leaves of the outputs, is exact to first order for H1 with clean
    inputs; biases are not in it. Raises `DataError` for too few averages, inputs that are alike, or a band
    without excitation.
    """
    wide = spectra.S_uu.shape[1]
    free = spectra.averages - wide
    if free <= 0:
        raise DataError(
            f"{spectra.averages:.3g} averages cannot tell {wide} inputs from noise",
            hint=f"shorter segments or more experiments, for more than {wide} averages",
        )
    power = np.real(np.einsum("kii->k", spectra.S_uu))
    enough = power > FAINTEST**2 * power[1:].max()
    keep = (enough if excited is None else excited) & in_band(spectra.frequency_hz, band_hz)
    refuse_silence(keep, band_hz)
    S_uu, S_yu, S_yy = spectra.S_uu[keep], spectra.S_yu[keep], spectra.S_yy[keep]
    size = np.linalg.eigvalsh(S_uu)
    refuse_alike(size[:, 0] * WORST_CONDITION**2 <= size[:, -1], spectra.frequency_hz[keep])
    H = _RATIOS[ratio](S_uu, S_yu, S_yy)
    cross = H @ np.swapaxes(S_yu.conj(), 1, 2)
    left = S_yy - cross - np.swapaxes(cross.conj(), 1, 2) + H @ S_uu @ np.swapaxes(H.conj(), 1, 2)
    covariance = left * (spectra.averages / free)
    inverse_power = np.linalg.inv(S_uu).conj() / spectra.averages
    return ResponseScatter(
        spectra.frequency_hz[keep],
        H,
        None,
        variance_of(covariance, inverse_power),
        None,
        np.full(len(H), float(free)),
        None,
        covariance,
        inverse_power,
    )


def _h1(S_uu: np.ndarray, S_yu: np.ndarray, S_yy: np.ndarray) -> Complex[np.ndarray, "line output input"]:
    # H S_uu = S_yu, and S_uu is its own conjugate transpose.
    return np.swapaxes(np.linalg.solve(S_uu, np.swapaxes(S_yu.conj(), 1, 2)).conj(), 1, 2)


def _h2(S_uu: np.ndarray, S_yu: np.ndarray, S_yy: np.ndarray) -> Complex[np.ndarray, "line output input"]:
    outputs, inputs = S_yu.shape[1:]
    if outputs < inputs:
        raise ConfigError(
            f"h2 needs as many outputs as inputs; there are {outputs} and {inputs}", hint="hv, or h1"
        )
    # H S_uy = S_yy, outputs scaled alike: least squares where there are more of them than inputs.
    scale = 1.0 / _amplitude(S_yy)
    S_uy = np.swapaxes(S_yu.conj(), 1, 2) * scale[:, None, :]
    return (S_yy * scale[:, None, :]) @ np.linalg.pinv(S_uy)


def _hv(S_uu: np.ndarray, S_yu: np.ndarray, S_yy: np.ndarray) -> Complex[np.ndarray, "line output input"]:
    lines, outputs, inputs = S_yu.shape
    H = np.empty((lines, outputs, inputs), dtype=complex)
    by_input, by_output = _amplitude(S_uu), _amplitude(S_yy)
    for o in range(outputs):
        S = np.empty((lines, inputs + 1, inputs + 1), dtype=complex)
        size = np.concatenate([by_input, by_output[:, o : o + 1]], axis=1)
        S[:, :inputs, :inputs] = S_uu
        S[:, inputs, :inputs] = S_yu[:, o]
        S[:, :inputs, inputs] = S_yu[:, o].conj()
        S[:, inputs, inputs] = S_yy[:, o, o]
        # v^H (u, y) is as small as can be: of unit length, the eigenvector of the smallest eigenvalue.
        v = np.linalg.eigh(S / (size[:, :, None] * size[:, None, :]))[1][:, :, 0].conj()
        H[:, o] = -v[:, :inputs] / v[:, inputs:] * (size[:, inputs:] / size[:, :inputs])
    return H


_RATIOS = {"h1": _h1, "h2": _h2, "hv": _hv}


def _amplitude(S: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.real(np.einsum("kaa->ka", S)), np.finfo(float).tiny))

"""H1, H2 and Hv: three assumptions about where the noise is (Rocklin, Crowley and Vold 1985).

With e = y - H u each errs, to first order in the scatter of averaged spectra, as

    E[dH_oi conj(dH_pj)] = S_ee,op R_ij.

H1 and H2 solve <e v^H> = 0 with the instruments v = u and v = y: e and v are uncorrelated at the solution,
and R is the conjugate of S_uv^-H S_vv S_uv^-1 / averages (Soderstrom and Stoica 1989, section 8.2, on each
line). Hv is an eigenvector, and R its perturbation (Stewart and Sun 1990, section V.2) by a Wishart matrix S,
whose entries scatter by E[dS_ab conj(dS_cd)] = S_ac S_db / averages. For one pair of channels of coherence
g the relative variances are (1 - g)/g, (1 - g)/g and (1 - g)(1 + 1/g)/2 over the averages.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Complex

from middeck.errors import ConfigError, DataError
from middeck.identification.model.refused_data import check_word
from middeck.identification.spectra.averages import Spectra
from middeck.identification.spectra.excited_lines import (
    FAINTEST,
    WORST_CONDITION,
    in_band,
    refuse_alike,
    refuse_silence,
)
from middeck.identification.spectra.variance_of_lines import ResponseScatter, variance_of

Ratio = Literal["h1", "h2", "hv"]
# The response, and R times the averages: of each output, or one that all outputs share.
_Solved = tuple[Complex[np.ndarray, "line output input"], Complex[np.ndarray, "line each input input"]]


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

    The variance is the scatter about what each tends to, to first order in 1/averages, whether inputs or
    outputs are noisy (of H2 with more outputs than inputs: inputs only); the biases above are not in it. Hv
    is solved for each output alone: ``total`` has each its own variance, ``inverse_power`` their mean.

    Raises `DataError` for too few averages, inputs that are alike, or a band without excitation;
    `ConfigError` for H2 of fewer outputs than inputs.
    """
    check_word("ratio", ratio, get_args(Ratio))
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
    H, alone = _RATIOS[ratio](S_uu, S_yu, S_yy)
    cross = H @ S_yu.conj().mT
    left = S_yy - cross - cross.conj().mT + H @ S_uu @ H.conj().mT
    covariance = left * (spectra.averages / free)
    R = alone / spectra.averages
    return ResponseScatter(
        frequency_hz=spectra.frequency_hz[keep],
        H=H,
        total=_variance(covariance, R),
        total_dof=np.full(len(H), float(free)),
        total_covariance=covariance,
        inverse_power=R.mean(axis=1),
    )


def _variance(covariance: np.ndarray, R: np.ndarray) -> np.ndarray:
    """C_oo R_ii with the R of each output, or the one that they share."""
    each = np.broadcast_to(R, (len(R), covariance.shape[1], *R.shape[2:]))
    return np.concatenate(
        [variance_of(covariance[:, o : o + 1, o : o + 1], each[:, o]) for o in range(each.shape[1])], axis=1
    )


def _h1(S_uu: np.ndarray, S_yu: np.ndarray, S_yy: np.ndarray) -> _Solved:
    # H S_uu = S_yu, and S_uu is its own conjugate transpose.
    H = np.linalg.solve(S_uu, S_yu.conj().mT).conj().mT
    return H, np.linalg.inv(S_uu).conj()[:, None]


def _h2(S_uu: np.ndarray, S_yu: np.ndarray, S_yy: np.ndarray) -> _Solved:
    outputs, inputs = S_yu.shape[1:]
    if outputs < inputs:
        raise ConfigError(
            f"h2 needs as many outputs as inputs; there are {outputs} and {inputs}", hint="hv, or h1"
        )
    # H S_uy = S_yy, outputs scaled alike: least squares where there are more of them than inputs.
    scale = 1.0 / _amplitude(S_yy)
    pseudo = np.linalg.pinv(S_yu.conj().mT * scale[:, None, :])
    S_vv = S_yy * scale[:, :, None] * scale[:, None, :]
    R = pseudo.conj().mT @ S_vv @ pseudo
    return (S_yy * scale[:, None, :]) @ pseudo, R.conj()[:, None]


def _hv(S_uu: np.ndarray, S_yu: np.ndarray, S_yy: np.ndarray) -> _Solved:
    lines, outputs, inputs = S_yu.shape
    H = np.empty((lines, outputs, inputs), dtype=complex)
    R = np.empty((lines, outputs, inputs, inputs), dtype=complex)
    by_input, by_output = _amplitude(S_uu), _amplitude(S_yy)
    for o in range(outputs):
        S = np.empty((lines, inputs + 1, inputs + 1), dtype=complex)
        size = np.concatenate([by_input, by_output[:, o : o + 1]], axis=1)
        S[:, :inputs, :inputs] = S_uu
        S[:, inputs, :inputs] = S_yu[:, o]
        S[:, :inputs, inputs] = S_yu[:, o].conj()
        S[:, inputs, inputs] = S_yy[:, o, o]
        unit = S / (size[:, :, None] * size[:, None, :])
        # v^H (u, y) is as small as can be: of unit length, the eigenvector of the smallest eigenvalue.
        values, vectors = np.linalg.eigh(unit)
        ratio = vectors[:, :inputs, 0] / vectors[:, inputs:, 0]
        H[:, o] = -ratio.conj() * (size[:, inputs:] / size[:, :inputs])
        R[:, o] = _smallest_scatter(unit, values, vectors, ratio) / (
            size[:, :inputs, None] * size[:, None, :inputs]
        )
    return H, R


def _smallest_scatter(
    S: Complex[np.ndarray, "line channel channel"],
    values: np.ndarray,
    vectors: np.ndarray,
    ratio: Complex[np.ndarray, "line input"],
) -> Complex[np.ndarray, "line input input"]:
    """Covariance of conj(ratio) of the eigenvector x of the smallest eigenvalue, over that of its e = x^H z.

    S, of unit diagonal, is divided by powers that scatter as well: with the smallest eigenvalue l, the column
    q_a = sum_b dS_ab x_b - l dS_aa x_a has E[q_a conj(q_b)] = l S_ab (1 - l (|x_a|^2 + |x_b|^2 - x_a conj(x_b
    S_ab))), and dx = -(S - l)^+ q.
    """
    x, least = vectors[:, :, 0], values[:, :1, None]
    size = np.abs(x) ** 2
    cross = x[:, :, None] * x.conj()[:, None, :] * S.conj()
    Q = S * (1.0 - least * (size[:, :, None] + size[:, None, :] - cross))
    # A second eigenvalue as small leaves the result open: its scatter is beyond first order.
    gaps = np.maximum(values[:, 1:] - values[:, :1], np.finfo(float).eps)
    rest = vectors[:, :, 1:]
    T = (rest[:, :-1] - ratio[:, :, None] * rest[:, -1:]) / gaps[:, None, :] @ rest.conj().mT
    return (T @ Q @ T.conj().mT).conj()


_RATIOS = {"h1": _h1, "h2": _h2, "hv": _hv}


def _amplitude(S: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.real(np.linalg.diagonal(S)), np.finfo(float).tiny))

"""Several inputs at once: experiments that separate them with the least variance.

With U(k) = T diag(r(k)) over as many experiments as inputs and T unitary up to scale, the inputs are
orthogonal on every line, and the variance of a response is as small as that of one input alone at the same
amplitude, over so many experiments (Dobrowiecki, Schoukens and Guillaume 2006, eqs. 7 to 9).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float


def orthogonal_matrix(inputs: int) -> Complex[np.ndarray, "experiment input"]:
    """T with entries of size one: Hadamard's signs for 1, 2, 4, 8 ... inputs, otherwise the DFT's phases.

    >>> orthogonal_matrix(2).real.tolist()
    [[1.0, 1.0], [1.0, -1.0]]
    """
    if inputs & (inputs - 1) == 0:
        return np.asarray(scipy.linalg.hadamard(inputs), dtype=complex)
    k = np.arange(inputs)
    return np.exp(2j * np.pi * np.outer(k, k) / inputs)


def spread_signs(
    u: Float[np.ndarray, " sample"], inputs: int
) -> Float[np.ndarray, "experiment sample input"]:
    """One real signal for several inputs, with Hadamard's signs over the experiments.

    A binary signal or a sweep keeps its shape under a sign only; there are as many experiments as the next
    power of two.
    """
    order = 1 << (inputs - 1).bit_length()
    signs = np.asarray(scipy.linalg.hadamard(order), dtype=float)[:, :inputs]
    return signs[:, None, :] * u[None, :, None]

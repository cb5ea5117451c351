"""Usable lines, and the least-squares response at each of them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import DataError

# A line counts as excited when its amplitude exceeds this share of the strongest line: 80 dB below it.
FAINTEST = 1e-4
# Beyond this the inputs of one line cannot be distinguished in double precision and real noise.
WORST_CONDITION = 1e6


def in_band(frequency: Float[np.ndarray, " line"], band_hz: tuple[float, float] | None) -> np.ndarray:
    """Whether each line of a whole DFT is within the band, edges included; never zero and Nyquist."""
    low, high = band_hz or (0.0, np.inf)
    if not low < high:
        raise DataError(f"the band {band_hz} Hz is empty", hint="lowest frequency first")
    # A band edge that is a line belongs to the band, whatever the rounding of the line's frequency.
    slack = 1e-9 * frequency[1]
    # Zero and the Nyquist frequency have no phase.
    inner = (np.arange(len(frequency)) > 0) & (np.arange(len(frequency)) < len(frequency) - 1)
    return inner & (frequency >= low - slack) & (frequency <= high + slack)


def refuse_silence(excited: np.ndarray, band_hz: tuple[float, float] | None) -> None:
    """Raise `DataError` where no line is left."""
    if not excited.any():
        where = "above zero" if band_hz is None else f"in the band {band_hz[0]:g} to {band_hz[1]:g} Hz"
        raise DataError(f"no excited line {where}", hint="a band that the excitation covers")


def refuse_alike(bad: np.ndarray, frequency: np.ndarray) -> None:
    """Raise `DataError` if the inputs cannot be distinguished at the marked lines."""
    if bad.any():
        raise DataError(
            f"the inputs cannot be told apart at {bad.sum()} lines, first at {frequency[bad][0]:.6g} Hz",
            hint="experiments with independent inputs, such as orthogonal multisines",
        )


def solve_lines(
    U: Complex[np.ndarray, "line experiment input"],
    Y: Complex[np.ndarray, "line experiment output"],
    frequency: np.ndarray,
) -> tuple[Complex[np.ndarray, "line output input"], Complex[np.ndarray, "line input input"]]:
    """H = Y U^H (U U^H)^-1 per line, and the inverse power that scales its covariance."""
    experiments, inputs = U.shape[1:]
    if experiments < inputs:
        raise DataError(
            f"{experiments} experiments cannot tell {inputs} inputs apart line by line",
            hint=f"at least {inputs} experiments with independent inputs, or a local polynomial",
        )
    left, size, right = np.linalg.svd(U, full_matrices=False)
    refuse_alike(size[:, -1] * WORST_CONDITION <= size[:, 0], frequency)
    pseudo = right.conj().mT / size[:, None, :] @ left.conj().mT
    return (pseudo @ Y).mT, pseudo @ pseudo.conj().mT

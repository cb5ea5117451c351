"""Least-squares complex frequency fit by sdypy-EMA on responses handed over as npz.

    python benchmarks/peers/sdypy_ema.py IN.npz OUT.npz

IN: frequency_hz (even steps), H (line, output, input), natural_hz (what an analyst picks on the
stabilisation diagram), order of the polynomial, at_hz. OUT: H at ``at_hz``, natural_hz, damping, seconds,
version. It has no delay: its residual terms and complex constants take that up.
"""

from __future__ import annotations

import sys
import time
import warnings
from importlib.metadata import version

import numpy as np
from sdypy import EMA


def main(source: str, target: str) -> None:
    given = np.load(source, allow_pickle=False)
    f, H = given["frequency_hz"], given["H"]
    step = f[1] - f[0]
    below = round(f[0] / step)
    # The tool wants all lines from zero on.
    freq = step * np.arange(below + len(f))
    frf = np.zeros((H.shape[1] * H.shape[2], len(freq)), dtype=complex)
    frf[:, below:] = H.reshape(len(f), -1).T
    size = np.abs(frf).max()
    begun = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = EMA.Model(
            structure=frf / size,
            frames=freq,
            lower=f[0],
            upper=f[-1],
            pol_order_high=int(given["order"]),
            frf_form="receptance",
        )
        fit.get_poles(method="lscf", show_progress=False)
        fit.pole_ind = [[len(fit.all_poles) - 1, k] for k in _nearest(fit.all_poles[-1], given["natural_hz"])]
        fit.get_constants(whose_poles="own")
    seconds = time.perf_counter() - begun
    poles = np.array([fit.all_poles[i][j] for i, j in fit.pole_ind])
    s = 2j * np.pi * given["at_hz"][:, None]
    A = size * np.asarray(fit.A)
    found = (1.0 / (s - poles)) @ A.T + (1.0 / (s - poles.conj())) @ A.conj().T
    found = found + size * (np.ravel(fit.LR) / s**2 + np.ravel(fit.UR))
    np.savez(
        target,
        H=found.reshape(-1, *H.shape[1:]),
        natural_hz=np.abs(poles) / (2.0 * np.pi),
        damping=-np.real(poles) / np.abs(poles),
        seconds=seconds,
        version=np.array(version("sdypy-EMA")),
    )


def _nearest(poles: np.ndarray, natural_hz: np.ndarray) -> list[int]:
    """Lightly damped, stable and of positive frequency; the tool's own search takes any."""
    hz = np.abs(poles) / (2.0 * np.pi)
    good = (np.imag(poles) > 0.0) & (np.real(poles) < 0.0) & (np.real(poles) > -0.1 * np.abs(poles))
    return [int(np.argmin(np.where(good, np.abs(hz - f), np.inf))) for f in natural_hz]


if __name__ == "__main__":
    main(*sys.argv[1:])

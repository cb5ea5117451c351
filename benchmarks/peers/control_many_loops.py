"""Stability and rms of the loops of in.npz, one after the other, with python-control and slycot.

python control_many_loops.py IN.npz OUT.npz     needs control, slycot
"""

from __future__ import annotations

import sys
import time

import numpy as np
import slycot

import control

REPEATS = 3


def main() -> None:
    given = dict(np.load(sys.argv[1]))
    loops = list(zip(given["A"], given["B"], given["C"], strict=True))
    rms_of(*loops[0])  # imports and first calls apart
    times, rms = [], []
    for _ in range(REPEATS):
        start = time.process_time()
        rms = [rms_of(*loop) for loop in loops]
        times.append((time.process_time() - start) / len(loops))
    version = f"{control.__version__} (slycot {slycot.__version__})"
    np.savez(sys.argv[2], rms=rms, seconds=np.median(times), version=version)


def rms_of(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    loop = control.ss(A, B, C, np.zeros((len(C), B.shape[1])))
    if loop.poles().real.max() > 1e-8:
        return np.full(len(C), np.inf)
    return np.sqrt(np.diag(C @ control.lyap(A, B @ B.T) @ C.T))


if __name__ == "__main__":
    main()

"""Slycot (through python-control) and SciPy on the Riccati equations of in.npz; CPU seconds and residual.

python control_riccati.py IN.npz OUT.npz     needs control, slycot, scipy
"""

from __future__ import annotations

import sys
import time

import numpy as np
import scipy
import scipy.linalg as sla
import slycot
from control.mateqn import care

import control


def residual(X: np.ndarray, A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> float:
    XB = X @ B
    terms = A.T @ X, X @ A, -XB @ XB.T, Q
    return float(np.linalg.norm(sum(terms)) / sum(np.linalg.norm(t) for t in terms))


def by_slycot(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> np.ndarray:
    return care(A, B, Q, np.eye(B.shape[1]), method="slycot")[0]


def by_scipy(A: np.ndarray, B: np.ndarray, Q: np.ndarray) -> np.ndarray:
    return sla.solve_continuous_are(A, B, Q, np.eye(B.shape[1]))


def main() -> None:
    with np.load(sys.argv[1]) as given:
        A, B, Q = given["A"], given["B"], given["Q"]
        programs = {"slycot": by_slycot, "scipy": by_scipy}
        which = str(given["program"])
    start = time.process_time()
    X = programs[which](A, B, Q)
    seconds = time.process_time() - start
    version = {"slycot": f"{slycot.__version__} (control {control.__version__})", "scipy": scipy.__version__}
    np.savez(sys.argv[2], seconds=seconds, residual=residual(X, A, B, Q), version=version[which])


if __name__ == "__main__":
    main()

"""dlqr and dlqe of the sampled problem of in.npz with python-control, by slycot and by its own solver.

python control_sampling.py IN.npz OUT.npz     needs control, slycot
"""

from __future__ import annotations

import sys
import time

import numpy as np
import slycot

import control


def main() -> None:
    given = dict(np.load(sys.argv[1]))
    found: dict = {"version": f"{control.__version__} (slycot {slycot.__version__})"}
    for method in ("slycot", "scipy"):
        times = []
        for _ in range(int(given["repeats"])):
            start = time.process_time()
            K, X, _ = control.dlqr(*(given[k] for k in ("A", "B", "Q", "R", "S")), method=method)
            noise = np.eye(len(given["A"])), given["C"], given["noise"], given["sensor"]
            L, _, _ = control.dlqe(given["A"], *noise, method=method)
            times.append(time.process_time() - start)
        found |= {f"K_{method}": K, f"L_{method}": L, f"seconds_{method}": np.median(times)}
        found[f"residual_{method}"] = residual(X, given)
    np.savez(sys.argv[2], **found)


def residual(X: np.ndarray, given: dict) -> float:
    A, B, Q, R, S = (given[k] for k in ("A", "B", "Q", "R", "S"))
    cross = A.T @ X @ B + S
    terms = [A.T @ X @ A, -X, -cross @ np.linalg.solve(R + B.T @ X @ B, cross.T), Q]
    return float(np.linalg.norm(sum(terms)) / sum(np.linalg.norm(t) for t in terms))


if __name__ == "__main__":
    main()

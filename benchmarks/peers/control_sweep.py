"""The sweep of in.npz with python-control and slycot: lqe once, lqr and a grid of |G|^2 a level and plant.

python control_sweep.py IN.npz OUT.npz     needs control, slycot
"""

from __future__ import annotations

import sys
import time

import numpy as np
import slycot

import control

REFERENCE = 1e-3


def main() -> None:
    given = dict(np.load(sys.argv[1]))
    sweep(given, given["levels"][:1], 20)  # imports and first calls apart
    times = []
    for _ in range(int(given["repeats"])):
        start = time.process_time()
        db = sweep(given, given["levels"], int(given["points"]))
        times.append(time.process_time() - start)
    version = f"{control.__version__} (slycot {slycot.__version__})"
    np.savez(sys.argv[2], db=db, seconds=np.median(times), version=version)


def sweep(given: dict, levels: np.ndarray, points: int) -> np.ndarray:
    plants = ["orbit", "lab"]
    A, G, Bu, Cz, Cy = (given[f"orbit_{k}"] for k in ("A", "G", "Bu", "Cz", "Cy"))
    L = control.lqe(A, G, Cy, given["process"], np.diag(given["sensor"]), method="slycot")[0]
    omega = 2.0 * np.pi * np.geomspace(*given["band_hz"], points)
    db = np.empty((len(plants), len(levels)))
    for k, level in enumerate(levels):
        K = control.lqr(A, Bu, Cz.T @ Cz, np.eye(Bu.shape[1]) / level, method="slycot")[0]
        law = control.ss(A - Bu @ K - L @ Cy, L, -K, np.zeros((len(K), len(Cy))))
        for i, name in enumerate(plants):
            db[i, k] = metric(name, given, law, omega)
    return db


def metric(name: str, given: dict, law: control.StateSpace, omega: np.ndarray) -> float:
    A, G, Bu, Cz, Cy = (given[f"{name}_{k}"] for k in ("A", "G", "Bu", "Cz", "Cy"))
    w = G.shape[1] - Bu.shape[1]
    loop = control.ss(
        np.block([[A, Bu @ law.C], [law.B @ Cy, law.A]]),
        np.vstack([G[:, :w], np.zeros((len(law.A), w))]),
        np.hstack([Cz, np.zeros((len(Cz), len(law.A)))]),
        np.zeros((len(Cz), w)),
    )
    if loop.poles().real.max() > 1e-8:
        return np.inf
    H = control.frequency_response(loop, omega).complex
    power = np.sum(np.abs(H) ** 2, axis=(0, 1)) * given["process"][0, 0]
    return 20.0 * np.log10(np.sqrt(np.trapezoid(power, omega) / np.pi) / REFERENCE)


if __name__ == "__main__":
    main()

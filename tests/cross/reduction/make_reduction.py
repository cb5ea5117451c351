"""Reduced systems and peak gains by slycot (SLICOT's AB09AD, AB09MD, AB13DD).

In an environment of its own with slycot 0.7.1 and scipy: python make_reduction.py.
Writes numbers.npz beside it.
"""

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import scipy.linalg as sla
import slycot

OMEGA = np.geomspace(0.1, 100.0, 40)


def system(rigid: bool) -> tuple[np.ndarray, ...]:
    """Seven modes of 1 % from 1 to 30 rad/s, a real pole, and where ``rigid`` a double integrator."""
    rng = np.random.default_rng(1984)
    blocks = [np.array([[0.0, w], [-w, -0.02 * w]]) for w in np.geomspace(1.0, 30.0, 7)] + [
        np.array([[-5.0]])
    ]
    if rigid:
        blocks.append(np.array([[0.0, 1.0], [0.0, 0.0]]))
    A = sla.block_diag(*blocks)
    turn, _ = np.linalg.qr(rng.standard_normal(A.shape))
    B, C, D = (rng.standard_normal(shape) for shape in ((len(A), 2), (3, len(A)), (3, 2)))
    return turn @ A @ turn.T, turn @ B, C @ turn.T, D


def response(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> np.ndarray:
    return np.array([C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D for w in OMEGA])


def ask(routine: str, *arguments: object, **options: object) -> tuple:
    """One call in a process of its own: several in one have ended in a corrupted heap."""
    with ProcessPoolExecutor(1) as alone:
        return alone.submit(call, routine, arguments, options).result()


def call(routine: str, arguments: tuple, options: dict) -> tuple:
    return getattr(slycot, routine)(*arguments, **options)


def peak(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> np.ndarray:
    head = "C", "I", "N", "D", len(A), B.shape[1], len(C)
    return np.array(ask("ab13dd", *head, A, np.eye(len(A)), B, C, D))


def reduced(name: str, order: int, A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> dict:
    head = "C", "B", "N", len(A), B.shape[1], len(C)
    if name == "rigid":
        nr, Ar, Br, Cr, _, hsv = ask("ab09md", *head, A, B, C, alpha=-1e-5, nr=order)
    else:
        nr, Ar, Br, Cr, hsv = ask("ab09ad", *head, A, B, C, nr=order)
    assert nr == order
    error = sla.block_diag(A, Ar), np.vstack([B, Br]), np.hstack([C, -Cr]), np.zeros(D.shape)
    return {
        f"{name}_hsv": hsv,
        f"{name}_truncate_{order}": response(Ar, Br, Cr, D),
    } | ({} if name == "rigid" else {f"{name}_peak_{order}": peak(*error)})


if __name__ == "__main__":
    found = {"omega": OMEGA}
    for name in ("stable", "rigid"):
        whole = system(name == "rigid")
        found |= {f"{name}_{k}": v for k, v in zip("ABCD", whole, strict=True)}
        for order in (10, 6):
            found |= reduced(name, order, *whole)
    found["stable_peak"] = peak(*system(rigid=False))
    np.savez(Path(__file__).parent / "numbers.npz", **found)

"""The loop of a sampled plant and a law, from what limits hold back to what the law asks for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.law.compensator import locate_ports
from middeck.control.qualification import align_plant
from middeck.realtime.gate.linear_law import linear_law
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.rounding_errors import unfold_law
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.balancing import balance

EPSILON = np.finfo(float).eps


class Parts(NamedTuple):
    """Plant x+ = A x + B u, y = C x, and law z+ = F z + G y + E (u - w), w = K z + D y, sample by sample."""

    A: Float[np.ndarray, "state state"]
    B: Float[np.ndarray, "state output"]
    C: Float[np.ndarray, "input state"]
    F: Float[np.ndarray, "own own"]
    G: Float[np.ndarray, "own input"]
    E: Float[np.ndarray, "own output"]
    K: Float[np.ndarray, "output own"]
    D: Float[np.ndarray, "output input"]
    direct: Float[np.ndarray, "input output"]


def split_loop(package: ControllerPackage, plant: Plant) -> Parts:
    """The sampled plant and the law; ``direct`` is what of the plant's outputs follows its inputs at once."""
    law, m, p = unfold_law(package, single=False), len(package.inputs), len(package.outputs)
    own = linear_law(package)
    aligned = align_plant(plant, own)
    sampled = aligned if aligned.period_s else sample_plant(aligned, package.period_s)
    drives, reads = locate_ports(own, sampled.inputs, sampled.outputs)
    P, wanted = sampled.sampled, list(law.wanted)
    return Parts(
        P.A, P.B[:, drives], P.C[reads],
        law.F, law.G[:, :m], law.G[:, m : m + p], law.H[wanted], law.J[wanted, :m],
        P.D[np.ix_(reads, drives)],
    )  # fmt: skip


class Loop(NamedTuple):
    """From what limits hold back to what the law asks for: the sum of residues / (z - poles).

    The loop that was meant differs from it by at most ``blur`` times the sum of ``out`` / |z - poles| times
    that of ``into`` / |z - poles|.
    """

    poles: Complex[np.ndarray, " pole"]
    residues: Complex[np.ndarray, "pole output output"]
    out: Float[np.ndarray, " pole"]
    into: Float[np.ndarray, " pole"]
    blur: float


def close_loop(parts: Parts) -> Loop | None:
    """The loop without limits; None where it is not found to be stable."""
    A, B, C, F, G, E, K, D, _ = parts
    states, outputs = len(A) + len(F), len(K)
    if not states:
        return Loop(np.zeros(0, complex), np.zeros((0, outputs, outputs)), np.zeros(0), np.zeros(0), 0.0)
    closed = np.block([[A + B @ D @ C, B @ K], [G @ C, F]])
    a, b, c, f, g, _, k, d, _ = (np.abs(M) for M in parts)
    size = np.block([[a + b @ d @ c, b @ k], [g @ c, f]])
    return _by_modes(closed, size, -np.vstack([B, E]), np.hstack([D @ C, K]), np.hstack([d @ c, k]))


def _by_modes(A: np.ndarray, size: np.ndarray, B: np.ndarray, C: np.ndarray, seen: np.ndarray) -> Loop | None:
    """C (z - A)^-1 B by poles; ``size``, ``seen``: sums of magnitudes of the products that made A and C.

    With Y for the inverse of the vectors V, the loop in their coordinates is poles + Y (A V - V poles), to
    1 / (1 - |1 - Y V|); all of these are measured, and each product may round by n units of its magnitudes.
    """
    balanced, scale = balance(A)
    size, B, C, seen = size / scale[:, None] * scale, B / scale[:, None], C * scale, seen * scale
    poles, V = np.linalg.eig(balanced)
    try:
        Y = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return None
    unit = 4.0 * (len(A) + 4) * EPSILON
    v, y = np.abs(V), np.abs(Y)
    inverse = np.linalg.norm(np.eye(len(A)) - Y @ V) + unit * np.linalg.norm(y @ v)
    off = np.abs(balanced @ V - V * poles) + unit * (size @ v + v * np.abs(poles))
    moved = np.linalg.norm(y @ off) / max(1.0 - inverse, EPSILON)
    if not (inverse < 0.1 and moved < 1e-3 * (1.0 - np.abs(poles).max())):
        return None
    into = Y @ B
    out, entering = np.linalg.norm(seen @ v, axis=0), np.linalg.norm(y @ np.abs(B), axis=1)
    entering = entering + 2.0 * inverse * np.linalg.norm(entering)  # Y is not quite the inverse: modes mix
    lost = y @ (np.abs(B - V @ into) + unit * (v @ np.abs(into) + np.abs(B)))
    with np.errstate(divide="ignore", invalid="ignore"):
        by_vectors = np.nanmax(np.linalg.norm(lost, axis=1) / entering, initial=0.0)
    residues = np.einsum("ik,kj->kij", C @ V, into)
    return Loop(poles, residues, out, entering, 2.0 * (moved + 3.0 * by_vectors + 3.0 * unit))

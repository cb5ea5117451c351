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
MOST_MIXED = 1e-3
"""Of what modes mix by, over their distance from instability."""


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
    own: tuple[Float[np.ndarray, "output own"], Float[np.ndarray, "output input"]]
    """K and D of the law's own commands c: beside a hold or an inner loop w = p + c."""


def split_loop(package: ControllerPackage, plant: Plant) -> Parts:
    """The sampled plant and the law; ``direct`` is what of the plant's outputs follows its inputs at once."""
    law, m, p = unfold_law(package, single=False), len(package.inputs), len(package.outputs)
    own = linear_law(package)
    aligned = align_plant(plant, own)
    sampled = aligned if aligned.period_s else sample_plant(aligned, package.period_s)
    drives, reads = locate_ports(own, sampled.inputs, sampled.outputs)
    P, wanted, commands = sampled.sampled, list(law.wanted), list(law.law)
    x = _moved_states(law.F, law.G[:, : m + p])
    return Parts(
        P.A, P.B[:, drives], P.C[reads],
        law.F[np.ix_(x, x)], law.G[x, :m], law.G[x, m : m + p], law.H[wanted][:, x], law.J[wanted, :m],
        P.D[np.ix_(reads, drives)], (law.H[commands][:, x], law.J[commands, :m]),
    )  # fmt: skip


def _moved_states(F: np.ndarray, G: np.ndarray) -> np.ndarray:
    """All but those that stay at zero, as of sections of lower order: chains of theirs have no modes."""
    x = np.arange(len(F))
    while True:
        moved = F[np.ix_(x, x)].any(axis=1) | G[x].any(axis=1)
        if moved.all():
            return x
        x = x[moved]


def in_units_of(parts: Parts, limits: Float[np.ndarray, " output"]) -> Parts:
    """Each output in units of its limit: wheels of 0.5 N m and gimbals of 5 N m weigh alike."""
    unit = limits[:, None]
    return parts._replace(
        B=parts.B * limits,
        E=parts.E * limits,
        K=parts.K / unit,
        D=parts.D / unit,
        direct=parts.direct * limits,
        own=(parts.own[0] / unit, parts.own[1] / unit),
    )


class Loop(NamedTuple):
    """From what limits hold back to what the law asks for: the sum of residues / (z - poles).

    The loop that was meant has, in coordinates of these modes, poles + F with |F| <= ``mixed``, and is
    entered with what differs by ``lost`` from ``into``: magnitudes, over the forces. ``out`` are those of
    what leaves, ``blur`` what their products round by. `bound_error` makes a bound of them.
    """

    poles: Complex[np.ndarray, " pole"]
    residues: Complex[np.ndarray, "pole output output"]
    out: Float[np.ndarray, " pole"]
    into: Float[np.ndarray, " pole"]
    mixed: Float[np.ndarray, "pole pole"]
    lost: Float[np.ndarray, " pole"]
    blur: Float[np.ndarray, " pole"]
    direct: Float[np.ndarray, "output output"]
    """What is held back at once of what is asked for later in the same sample."""


def close_loop(parts: Parts, first: Float[np.ndarray, " output"] | None = None) -> Loop | None:
    """The loop without limits; None where it is not found to be stable.

    Beside a hold limits of the law, ``first`` times those of the sum, act before them: c - n, then
    p + c - n - m. Forces and commands are then those of the law's own outputs, in units of their limits,
    followed by those of the sums.
    """
    A, B, C, F, G, E, K, D, _, own = parts
    states, outputs = len(A) + len(F), len(K) * (1 if first is None else 2)
    direct = np.zeros((outputs, outputs))
    if first is not None:
        direct[len(K) :, : len(K)] = -np.diag(first)
    if not states:
        none = np.zeros(0)
        nothing = np.zeros((0, outputs, outputs)), none, none, np.zeros((0, 0)), none, none
        return Loop(none + 0j, *nothing, direct)
    closed = np.block([[A + B @ D @ C, B @ K], [G @ C, F]])
    a, b, c, f, g, k, d = (np.abs(M) for M in (A, B, C, F, G, K, D))
    size = np.block([[a + b @ d @ c, b @ k], [g @ c, f]])
    unit = 2.0 * (states + len(C) + outputs + 4) * EPSILON
    into, out, seen = -np.vstack([B, E]), np.hstack([D @ C, K]), np.hstack([d @ c, k])
    if first is not None:
        into = np.hstack([into * first, into])
        K, D = own[0] / first[:, None], own[1] / first[:, None]
        out = np.vstack([np.hstack([D @ C, K]), out])
        seen = np.vstack([np.hstack([np.abs(D) @ c, np.abs(K)]), seen])
    return _by_modes(closed, size, into, out, seen, unit, direct)


def _by_modes(
    A: np.ndarray,
    size: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    seen: np.ndarray,
    unit: float,
    direct: np.ndarray,
) -> Loop | None:
    """C (z - A)^-1 B by poles; ``size``, ``seen``: sums of magnitudes of the products that made A and C.

    With Y for the inverse of the vectors V, so that V^-1 = (Y V)^-1 Y, the loop in their coordinates is
    poles + V^-1 (A V - V poles), entered by V^-1 B. Residuals are measured, and each sum of (complex)
    products may round by ``unit`` of its magnitudes. All bounds are of single entries: of modes of which one
    is a million times larger than the other no more is mixed than there is.
    """
    balanced, scale = balance(A)
    size, B, C, seen = size / scale[:, None] * scale, B / scale[:, None], C * scale, seen * scale
    poles, V = np.linalg.eig(balanced)
    try:
        Y = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return None
    v, y = np.abs(V), np.abs(Y)
    inverse = np.abs(np.eye(len(A)) - Y @ V) + unit * (y @ v)
    off = np.abs(balanced @ V - V * poles) + unit * (size @ v + v * np.abs(poles))
    if not np.linalg.norm(inverse) < 0.1:
        return None
    into = Y @ B
    entered = np.abs(B - V @ into) + unit * (v @ np.abs(into) + np.abs(B))
    # |(Y V)^-1| <= (1 - inverse)^-1, entry by entry: the sum of its powers.
    solved = 1.01 * np.linalg.solve(np.eye(len(A)) - inverse, y @ np.hstack([off, entered]))
    mixed, lost = solved[:, : len(A)], np.linalg.norm(solved[:, len(A) :], axis=1)
    if not np.linalg.norm(mixed) < MOST_MIXED * (1.0 - np.abs(poles).max()):
        return None
    out, entering = np.linalg.norm(np.abs(C @ V) + unit * (seen @ v), axis=0), np.linalg.norm(into, axis=1)
    blur = 3.0 * unit * np.linalg.norm(seen @ v, axis=0) * entering
    residues = np.einsum("ik,kj->kij", C @ V, into)
    return Loop(poles, residues, out, entering + lost, mixed, lost, blur, direct)


def bound_error(loop: Loop, near: Float[np.ndarray, "place pole"]) -> Float[np.ndarray, " place"]:
    """How far the loop that was meant may be from the sum, at places no nearer to the poles than ``near``.

    With d = 1 / near it is out d (F + F d F + ...) d into: two terms, and the rest by |d F| <= MOST_MIXED.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        d = 1.0 / near
        first = d * loop.into
        second = d * (first @ loop.mixed.T)
        leaving = (d * loop.out) @ loop.mixed
        rest = 2.0 * MOST_MIXED * np.linalg.norm(leaving, axis=1) * np.linalg.norm(second, axis=1)
        moved = np.sum(leaving * (first + second), axis=1) + rest
        return np.asarray(1.01 * (moved + 1.01 * (d * loop.out) @ loop.lost + d @ loop.blur))

"""Closed loops around the sliders of joints: responses to noise and to the sliders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Complex, Float

from middeck.control.law.compensator import Compensator, locate_ports
from middeck.control.robust.verification.batch import same_shapes
from middeck.control.robust.verification.many_loops import decide_many
from middeck.systems.delay.pade import pade
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import StateSpace, series
from middeck.values import record

LINES_AT_ONCE = 1024
"""Lines whose responses are found at once: what is made on the way stays near the processor."""
NEGLIGIBLE = 1e-6
"""Part of a pole in a response, relative to the largest response, below which it is left out."""
LOST, APART = 1e-9, (1e-8, 1e-10, 1e-12)
"""Part of a response that the parts of its poles may lack; by how much a loop is changed that lacks more.

Poles of little damping bear the least change, many that coincide ask for the most."""

FAINT = 1e-12
"""Part of the strongest response below which one is rounding: what a joint does to what it cannot move."""

Parts = tuple[
    Complex[np.ndarray, " state"], Complex[np.ndarray, "joint state"], Complex[np.ndarray, "output state"]
]
"""Poles, what torques do to each, and what outputs read of it."""


@record(kw_only=True)
class SlipPorts:
    """Names of the joints (torque and angle), the performance and the disturbances."""

    joints: tuple[str, ...]
    performance: tuple[str, ...]
    disturbances: tuple[str, ...]


@record
class SlipPoles:
    """Response of angles and performance to the sliders: Re sum of reads exp(poles t) drives."""

    poles: Complex[np.ndarray, " pole"]
    drives: Complex[np.ndarray, "joint pole"]
    reads: Complex[np.ndarray, "output pole"]


def around_sliders(plant: Plant, law: Compensator | None, wiring: SlipPorts, order: int) -> StateSpace:
    """The loop from the sliders' torques to the joints' angles and the performance, which have no delay.

    The plant's delay, the same on all paths, is within the loop alone, by a Pade approximation of ``order``.
    """
    columns, rows = _rows(plant, wiring)
    system = remove_delays(plant).system
    if law is None:
        return system.select(columns, rows)
    delay_s = float(plant.delay_s.max(initial=0.0))
    delayed = law.system
    if delay_s > 0.0:
        one = pade(delay_s, order)
        each = (np.asarray(sla.block_diag(*[getattr(one, k)] * len(law.outputs))) for k in "ABCD")
        delayed = series(delayed, StateSpace(*each))
    u, y = locate_ports(law, plant.inputs, plant.outputs)
    return feedback(system, delayed, u, y).select(columns, rows)


def hold_while_sticking(
    loops: Sequence[StateSpace], stiffness: Float[np.ndarray, "loop joint"]
) -> Bool[np.ndarray, " loop"]:
    """Whether each loop does not grow with all sliders as springs, as they are at small amplitude."""
    held = [p.A - p.B @ (k[:, None] * p.C[: len(k)]) for p, k in zip(loops, stiffness, strict=True)]
    holds = np.zeros(len(held), dtype=bool)
    for group in same_shapes([A.shape for A in held]):
        holds[group] = decide_many(np.array([held[i] for i in group]))
    return holds


def pole_form(loop: StateSpace) -> SlipPoles | None:
    """The loop by its poles, negligible ones left out; None where one does not decay.

    Poles that coincide have no parts of their own: those of a loop that differs by one of `APART` stand for
    them (Davies 2007, Approximate diagonalization), whichever responds most as this one does.
    """
    if not len(loop.A):
        return SlipPoles(np.zeros(0, complex), loop.B.T.astype(complex), loop.C.astype(complex))
    parts = _parts(loop, loop.A)
    if not np.all(np.real(parts[0]) < 0.0):
        return None
    if not _adds_up(loop, parts):
        parts = _closest(loop, [parts, *(_parts(loop, _apart(loop.A, change)) for change in APART)])
    values, drives, reads = parts
    peak = np.abs(_response(parts, 1j * np.imag(values))).max(axis=0)
    size = np.abs(reads[:, None] * drives) / np.abs(np.real(values))
    counts = np.any(size > NEGLIGIBLE * peak[:, :, None], axis=(0, 1)) & (np.imag(values) >= 0.0)
    reads = reads * np.where(np.imag(values) > 0.0, 2.0, 1.0)  # one of each pair
    return SlipPoles(values[counts], drives[:, counts], reads[:, counts])


def _parts(loop: StateSpace, A: Float[np.ndarray, "state state"]) -> Parts:
    """Poles of A, what torques do to each, and what outputs read of it."""
    values, vectors = solve_poles(A)
    return values, np.linalg.solve(vectors, loop.B.astype(complex)).T, loop.C @ vectors


def _apart(A: Float[np.ndarray, "state state"], share: float) -> Float[np.ndarray, "state state"]:
    """A with each state, in its own unit, and each link of two changed by about ``share`` of their rates."""
    balanced, (unit, _) = sla.matrix_balance(A, permute=False, separate=True)
    rate = np.sqrt(np.linalg.norm(balanced, axis=1))
    change = share * rate[:, None] * rate * np.random.default_rng(0).uniform(-1.0, 1.0, A.shape)
    return A + unit[:, None] * change / unit


def _response(parts: Parts, at: Complex[np.ndarray, " point"]) -> Complex[np.ndarray, "point output joint"]:
    values, drives, reads = parts
    return (reads / (at[:, None, None] - values)) @ drives.T


def _whole(loop: StateSpace, at: Complex[np.ndarray, " point"]) -> Complex[np.ndarray, "point output joint"]:
    """The sum of the parts of the poles, up to rounding."""
    return loop.C @ np.linalg.solve(at[:, None, None] * np.eye(len(loop.A)) - loop.A, loop.B)


def _closest(loop: StateSpace, found: Sequence[Parts]) -> Parts:
    """The parts of poles that decay whose response is closest to the loop's at its own frequencies."""
    at = 1j * np.unique(np.abs(np.imag(found[0][0])))
    whole = _whole(loop, at)
    peak = np.abs(whole).max(axis=0)
    counts = peak > FAINT * peak.max(initial=0.0)

    def lost(parts: Parts) -> float:
        if not np.all(np.real(parts[0]) < 0.0):
            return np.inf
        most = np.abs(_response(parts, at) - whole).max(axis=0)
        return float(np.sum(most[counts] / peak[counts]))

    return min(found, key=lost)


def _adds_up(loop: StateSpace, parts: Parts) -> bool:
    """Whether the parts have the loop's response where all respond: on the real axis, amid their sizes."""
    amid = np.array([np.median(np.abs(parts[0]))], dtype=complex)
    whole = _whole(loop, amid)
    lost = np.abs(_response(parts, amid) - whole)
    return bool(np.all(lost <= LOST * np.abs(whole).max(initial=0.0)))


def solve_poles(
    A: Float[np.ndarray, "state state"],
) -> tuple[Complex[np.ndarray, " state"], Complex[np.ndarray, "state state"]]:
    """Eigenvalues, and right eigenvectors as columns."""
    values, vectors = np.linalg.eig(A)
    return np.asarray(values, dtype=complex), np.asarray(vectors, dtype=complex)


def evaluate_open(
    plant: Plant, frequency_hz: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """The plant's response without its delay, all ports."""
    return evaluate_plant(remove_delays(plant), frequency_hz).H


def law_response(
    law: Compensator | None, frequency_hz: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line command read"] | None:
    """Response of ``law``, computed once for all plants as it takes long; None without a compensator."""
    return None if law is None else statespace_response(law.system, 2.0 * np.pi * frequency_hz)


def noise_response(
    plant: Plant,
    open_response: Complex[np.ndarray, "line output input"],
    law: Compensator | None,
    answer: Complex[np.ndarray, "line command read"] | None,
    wiring: SlipPorts,
    frequency_hz: Float[np.ndarray, " line"],
) -> Complex[np.ndarray, "line output noise"]:
    """Response of angles and performance to disturbances, then to noise read by ``law``; exact delay.

    ``answer`` is the law's `law_response` on these lines, and may be on more beyond them.
    """
    w, rows = plant.input_indices(wiring.disturbances), _rows(plant, wiring)[1]
    if law is None or answer is None:
        return open_response[:, np.array(rows)[:, None], w]
    u, y = locate_ports(law, plant.inputs, plant.outputs)
    delay_s = float(plant.delay_s.max(initial=0.0))
    reads, makes = np.array(y)[:, None], np.array(rows)[:, None]
    found = np.empty((len(frequency_hz), len(rows), len(w) + len(y)), dtype=complex)
    for first in range(0, len(found), LINES_AT_ONCE):
        piece = slice(first, first + LINES_AT_ONCE)
        G = open_response[piece]
        K = answer[: len(found)][piece] * np.exp(-2j * np.pi * frequency_hz[piece] * delay_s)[:, None, None]
        # Commands, by what is read without the law and by its noise.
        commands = np.linalg.solve(np.eye(len(u)) - K @ G[:, reads, u], K)
        commands = np.concatenate([commands @ G[:, reads, w], commands], axis=2)
        np.matmul(G[:, makes, u], commands, out=found[piece])
        found[piece, :, : len(w)] += G[:, makes, w]
    return found


def _rows(plant: Plant, wiring: SlipPorts) -> tuple[Sequence[int], Sequence[int]]:
    return (
        plant.input_indices(wiring.joints),
        [*plant.output_indices(wiring.joints), *plant.output_indices(wiring.performance)],
    )

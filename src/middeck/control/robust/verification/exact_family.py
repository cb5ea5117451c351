"""One compensator on many modal plants with exact delays: verified phase count, rms by quadrature.

If all modes decay, the unstable poles of the open loop are the P unstable poles of the compensator, the same
for all plants. With f = det(I - K G), which tends to one,

    Z = P - (change of the phase of f from rest to infinity) / pi

roots of the closed loop grow (argument principle). A step from line a to line b, h apart, is accepted where I
- L, L = K G, cannot come near to singular between them. |L''| is at most B there, from the distances to the
poles and the magnitudes of their residues, so that L is within B h^2 / 8 of the chord. Where

    |(I - L(a))^-1 (L(b) - L(a))| + |(I - L(a))^-1| B h^2 / 8 <= rho < 1

every eigenvalue of (I - L(a))^-1 (I - L(s)) stays within rho of one, and f turns by the principal value.
Lines are added until that is so everywhere, beside the lightest roots of the loop without knowing them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.loop.feedback_loop import resolve, transfer_of
from middeck.control.h2.generalized_plant import generalize
from middeck.control.h2.noise_rms import FAR, NoiseOutcome
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.weights import LQGWeights
from middeck.systems.norms.band_rms import RESPONSE_TOLERANCE, square_root
from middeck.systems.norms.quadrature import integrate
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.resolvent import Resolvent
from middeck.systems.poles.rounding import LIGHTEST, is_vague
from middeck.systems.poles.state_units import balance_states
from middeck.systems.state_space.modal_system import ModalSystem, output_rows
from middeck.values import record

RHO = 0.7
"""Largest distance of an eigenvalue from one between two lines, times the number of inputs."""
ROUNDS, MOST_LINES, SPLIT = 24, 40_000, 8
SMALL = 0.5
BESIDE = np.array([0.0, 3.0])
STRETCH, OCTAVES = 1.0, 17
"""Change of log f from edge to edge of the first panels, which a root near the axis makes short; and edges
beyond the last line."""


@record
class _Poles:
    """Poles, magnitudes of residues, and direct term of a transfer function."""

    poles: Complex[np.ndarray, " pole"]
    size: Float[np.ndarray, "pole entry"]
    direct: Float[np.ndarray, "output input"]


@dataclass(frozen=True, kw_only=True)  # holds a function, so no value to compare
class FamilyLaw:
    """A compensator prepared for many plants, with the weights and noise of the rms; ``unstable`` is P."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    law: _Poles
    unstable: int
    evaluate: Resolvent
    weights: LQGWeights
    noise: Float[np.ndarray, "wv wv"]
    weight: Float[np.ndarray, " zu"]


def family_law(compensator: Compensator, weights: LQGWeights) -> FamilyLaw | None:
    """The prepared compensator; None if `is_vague`, without roll-off, or with a pole on the axis."""
    system = balance_states(compensator.system)
    values, vectors = np.linalg.eig(system.A) if len(system.A) else (np.zeros(0), np.zeros((0, 0)))
    if np.any(system.D) or np.any(np.abs(np.real(values)) < LIGHTEST) or is_vague(system):
        return None
    into = np.linalg.solve(vectors.astype(complex), system.B)
    size = np.abs(into[:, None, :] * (system.C @ vectors).T[:, :, None]).reshape(len(values), system.D.size)
    root = square_root(weights.process)
    noise = np.zeros((len(root) + len(weights.sensor),) * 2)
    noise[: len(root), : len(root)] = root
    noise[len(root) :, len(root) :] = np.diag(np.sqrt(weights.sensor))
    return FamilyLaw(
        inputs=tuple(p.name for p in compensator.inputs),
        outputs=tuple(p.name for p in compensator.outputs),
        law=_Poles(values.astype(complex), size, np.zeros(system.D.shape)),
        unstable=int(np.sum(np.real(values) > 0.0)),
        evaluate=resolve(compensator.system),
        weights=weights,
        noise=noise,
        weight=np.concatenate([weights.output, np.sqrt(weights.input)]),
    )


def measure_in_family(
    plant: Plant, known: FamilyLaw, *, measured: bool = True, most_lines: int = MOST_LINES
) -> NoiseOutcome | None:
    """`integrate_noise` for a plant of decaying modes; None where undecided by ``most_lines``.

    Raises `ConfigError` for process noise that reaches z directly.
    """
    modal = plant.modal
    if modal is None or np.any(modal.zeta * modal.omega < LIGHTEST):
        return None
    if modal.direct is not None or modal.phi_acceleration is not None:
        generalize(remove_delays(plant), known.weights, 1.0)  # refuses a plant of infinite cost
    w, z = plant.input_indices(known.weights.disturbed), plant.output_indices(plant.z)
    u, y = plant.input_indices(known.outputs), plant.output_indices(known.inputs)
    delay_s = plant.delay_s
    path = _path(modal, delay_s, y, u)
    counted = _growing(_poles_of(modal, y, u), delay_s[np.ix_(y, u)], known, path, most_lines)
    if counted is None:
        return None
    grow, edges = counted
    if grow:
        return NoiseOutcome(False, np.inf, np.inf)
    if not measured:
        return NoiseOutcome(True, 0.0, 0.0)
    return NoiseOutcome(True, *_rms(_path(modal, delay_s, [*z, *y], [*w, *u]), len(z), len(w), known, edges))


def _path(modal: ModalSystem, delay_s: np.ndarray, rows: Sequence[int], columns: Sequence[int]) -> Resolvent:
    """Some rows and columns with their delays."""
    evaluate, delay = transfer_of(_part(modal, rows, columns)), delay_s[np.ix_(rows, columns)]
    return lambda s: evaluate(s) * np.exp(-s[:, None, None] * delay)


def _part(modal: ModalSystem, rows: Sequence[int], columns: Sequence[int]) -> ModalSystem:
    seen = output_rows(modal)
    return ModalSystem(
        omega=modal.omega,
        zeta=modal.zeta,
        psi=modal.psi[:, columns],
        phi=seen.position[rows],
        phi_rate=seen.rate[rows],
        names=modal.names,
        direct=seen.direct[np.ix_(rows, columns)],
    )


def _poles_of(modal: ModalSystem, rows: Sequence[int], columns: Sequence[int]) -> _Poles:
    part = _part(modal, rows, columns)
    half = modal.omega * np.sqrt(modal.zeta**2 - 1.0 + 0.0j)
    poles = np.concatenate([-modal.zeta * modal.omega + half, -modal.zeta * modal.omega - half])
    seen = np.hstack([part.phi, part.phi]) + np.hstack([part.phi_rate, part.phi_rate]) * poles
    # Near critical damping the two residues are unbounded: the lines run out and the plant stays undecided.
    apart = np.where(np.abs(half) > 0.0, 2.0 * half, np.finfo(float).tiny)
    scale = np.concatenate([1.0 / apart, -1.0 / apart])
    residue = np.abs(seen.T * scale[:, None])[:, :, None] * np.abs(np.tile(part.psi, (2, 1)))[:, None, :]
    assert part.direct is not None
    return _Poles(poles, residue.reshape(len(poles), part.direct.size), np.abs(part.direct))


def _growing(
    plant: _Poles, delay_s: np.ndarray, known: FamilyLaw, path: Resolvent, most_lines: int
) -> tuple[int, Float[np.ndarray, " line"]] | None:
    """Number of roots right of the axis, and edges of panels; None where lines run out or come too close."""
    top = _small_beyond(plant, delay_s, known.law)
    if top is None:
        return None
    omega = _first_lines(np.concatenate([plant.poles, known.law.poles]), top)
    loop = _returned(path, known.evaluate, omega)
    back = np.linalg.inv(loop)
    safe = np.zeros(len(omega), dtype=bool)  # the interval that begins at each line
    safe[-1] = True
    for _ in range(ROUNDS):
        at = np.flatnonzero(~safe)
        width = omega[at + 1] - omega[at]
        bent = 0.125 * width**2 * _most_bent(plant, delay_s, known.law, omega[at], omega[at + 1])
        turn = np.linalg.norm(back[at] @ (loop[at + 1] - loop[at]), axis=(1, 2))
        need = (turn + np.linalg.norm(back[at], axis=(1, 2)) * bent) * delay_s.shape[1] / RHO
        safe[at[need <= 1.0]] = True
        rough, pieces = at[need > 1.0], np.clip(np.ceil(np.sqrt(need[need > 1.0])), 2, SPLIT).astype(int)
        if not len(rough):
            phase, size = np.linalg.slogdet(loop)
            turn = np.angle(phase[1:] / phase[:-1])
            turns = (turn.sum() - np.angle(phase[-1])) / np.pi
            way = np.cumsum(np.abs(np.diff(size) + 1j * turn)) // STRETCH
            edges = np.union1d(_first_lines(plant.poles, top), omega[1:-1][np.diff(way) > 0.0])
            return known.unstable - round(float(turns)), edges
        width = omega[rough + 1] - omega[rough]
        if len(omega) + np.sum(pieces - 1) > most_lines or np.min(width) < LIGHTEST:
            return None
        within = np.concatenate([np.arange(1, n) / n for n in pieces])
        new = np.repeat(omega[rough], pieces - 1) + within * np.repeat(width, pieces - 1)
        more = _returned(path, known.evaluate, new)
        order = np.argsort(np.concatenate([omega, new]), kind="stable")
        omega, safe = _merged(omega, new, order), _merged(safe, np.zeros(len(new), dtype=bool), order)
        loop, back = _merged(loop, more, order), _merged(back, np.linalg.inv(more), order)
    return None


def _merged(lines: np.ndarray, new: np.ndarray, order: np.ndarray) -> np.ndarray:
    return np.concatenate([lines, new])[order]


def _first_lines(poles: np.ndarray, top: float) -> Float[np.ndarray, " line"]:
    """Frequency lines beside the open loop's poles, and in octaves."""
    upper = poles[np.imag(poles) >= 0.0]
    sides = np.abs(np.real(upper))[:, None] * np.concatenate([-BESIDE[1:], BESIDE])
    lines = np.concatenate([(np.imag(upper)[:, None] + sides).ravel(), top * 0.5 ** np.arange(24.0)])
    return np.unique(np.concatenate([[0.0], lines[(lines > 0.0) & (lines <= top)]]))


def _returned(path: Resolvent, law: Resolvent, omega: np.ndarray) -> Complex[np.ndarray, "line u u"]:
    """I - K G."""
    s = 1j * omega
    loop = -(law(s) @ path(s))
    return loop + np.eye(loop.shape[1])


def _most_bent(
    plant: _Poles, delay_s: np.ndarray, law: _Poles, low: np.ndarray, high: np.ndarray
) -> Float[np.ndarray, " interval"]:
    """A bound of the second derivative of K G between lines, from residues over powers of the distances."""
    g, dg, ddg = (x.reshape(len(low), *delay_s.shape) for x in _sizes(plant, low, high))
    k, dk, ddk = (x.reshape(len(low), *delay_s.shape[::-1]) for x in _sizes(law, low, high))
    g = g + plant.direct
    g, dg, ddg = g, dg + delay_s * g, ddg + 2.0 * delay_s * dg + delay_s**2 * g
    return np.linalg.norm(ddk @ g + 2.0 * dk @ dg + k @ ddg, axis=(1, 2))


def _sizes(of: _Poles, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds of the transfer function, its slope and its bend, entry by entry."""
    centre = np.imag(of.poles)
    beside = np.maximum(np.maximum(low[:, None] - centre, centre - high[:, None]), 0.0)
    square = 1.0 / (beside**2 + np.real(of.poles) ** 2)
    near = np.sqrt(square)
    return near @ of.size, square @ of.size, 2.0 * (square * near) @ of.size


def _small_beyond(plant: _Poles, delay_s: np.ndarray, law: _Poles) -> float | None:
    """Frequency above which K G is smaller than one half, so that f keeps to the right of one half."""
    top = 2.0 * float(np.abs(np.concatenate([plant.poles, law.poles])).max())
    for _ in range(ROUNDS):
        ends = np.array([top]), np.array([np.inf])
        g, k = (_sizes(of, *ends)[0].reshape(-1, *shape) for of, shape in
                ((plant, delay_s.shape), (law, delay_s.shape[::-1])))  # fmt: skip
        if np.linalg.norm(k[0] @ (g[0] + plant.direct)) < SMALL:
            return top
        top *= 2.0
    return None


def _rms(path: Resolvent, nz: int, nw: int, known: FamilyLaw, edges: np.ndarray) -> tuple[float, float]:
    """Rms of the weighted outputs and inputs, and FAR beyond."""

    def power(omega: np.ndarray) -> Float[np.ndarray, "line zu"]:
        s = 1j * omega
        H, K = path(s), known.evaluate(s)
        reads = np.concatenate(
            [H[:, nz:, :nw], np.broadcast_to(np.eye(K.shape[2]), (len(s), *[K.shape[2]] * 2))], 2
        )
        loop = np.eye(K.shape[1]) - K @ H[:, nz:, nw:]
        u = K @ reads / loop if K.shape[1] == 1 else np.linalg.solve(loop, K @ reads)
        z = H[:, :nz, nw:] @ u
        z[:, :, :nw] += H[:, :nz, :nw]
        seen = np.concatenate([z, u], axis=1) @ known.noise
        return known.weight**2 * np.sum(np.abs(seen) ** 2, axis=2)

    top = FAR * edges[-1]
    edges = np.append(edges[:-1], np.geomspace(edges[-1], top, OCTAVES))
    square = integrate(power, edges, RESPONSE_TOLERANCE) + top * power(np.array([top]))[0]
    rms = np.sqrt(square / np.pi)
    return float(np.linalg.norm(rms[:nz])), float(np.linalg.norm(rms[nz:]))

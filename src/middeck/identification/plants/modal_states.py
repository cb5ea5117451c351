"""Real states of a measurement model without its delays: 2x2 blocks of its pairs, balanced."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import (
    RANK,
    MeasurementModel,
    double_pole,
    natural_hz,
    path_delay,
    rank_of,
)
from middeck.systems.modal import ModalSystem
from middeck.systems.statespace import SampledStateSpace, StateSpace

# A pair whose pole is closer to the real axis than this share of its size is near critical damping.
CRITICAL = 0.5
# Parts of b out of phase below this share are rounding of a fit of real modes.
IN_PHASE = 1e-12
# Integrators in a row: 1/s^2 and 1/s.
DOUBLE, SINGLE = np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros((1, 1))


def sampled_statespace(model: MeasurementModel) -> SampledStateSpace:
    """Real block-modal form of a sampled model, of ``model.states`` states."""
    if model.sample_hz is None or np.any(path_delay(model)):
        raise ConfigError(
            "only a sampled model without a delay has this state space",
            hint="sample_plant(measured_plant(model), period_s)",
        )
    A, B, C = _modal_blocks(model, np.exp(model.poles / model.sample_hz))
    return SampledStateSpace(A, B, C, model.direct, 1.0 / model.sample_hz)


def modal_statespace(model: MeasurementModel) -> StateSpace:
    """Real block-modal form of a continuous model without its delays, of ``model.states`` states.

    Rigid-body modes come last but for integrators, each with the states q and q'.
    """
    modes = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    modes = modes if model.rigid is None else _beside(modes, model.rigid, DOUBLE)
    return modes if model.integral is None else _beside(modes, model.integral, SINGLE)


def modal_form(model: MeasurementModel) -> ModalSystem | None:
    """A continuous model without its delays as real modes; None where it has no such form.

    A pair c b' / (s - p) and its conjugate is q'' + 2 zeta omega q' + omega^2 q = psi u read by
    phi q + phi_rate q' where b is a real vector times a number, which c may as well have. So it always is
    with one input, and for modes in phase.
    """
    single, overdamped = ~model.is_pair, np.abs(model.poles.imag) == 0.0
    if np.any(single | overdamped) or model.integral is not None:
        return None
    turn = np.exp(-0.5j * np.angle(np.sum(model.participation**2, axis=1)))
    b, c = model.participation * turn[:, None], model.shapes / turn
    size = np.linalg.norm(b, axis=1)
    if np.any(np.linalg.norm(b.imag, axis=1) > IN_PHASE * size):
        return None
    omega = np.abs(model.poles)
    psi, rate, way = b.real, 2.0 * c.real, -2.0 * np.real(c * np.conj(model.poles))
    # States of like size at both ends: B = psi / omega, C = (phi, phi_rate omega).
    seen = np.hypot(np.linalg.norm(way, axis=0), omega * np.linalg.norm(rate, axis=0))
    ratio = np.where(
        (seen > 0.0) & (size > 0.0), np.sqrt(seen * omega / np.where(size > 0.0, size, 1.0)), 1.0
    )
    psi, way, rate = psi * ratio[:, None], way / ratio, rate / ratio
    rigid_psi, rigid_phi = _rank_factors(model.rigid, psi.shape[1], len(way))
    still = len(rigid_psi)
    return ModalSystem(
        np.append(omega, np.zeros(still)),
        np.append(-model.poles.real / omega, np.zeros(still)),
        np.vstack([psi, rigid_psi]),
        np.hstack([way, rigid_phi]),
        np.hstack([rate, np.zeros((len(rate), still))]),
        _distinct([*(f"pole at {hz:.4g} Hz" for hz in natural_hz(model)), *_rigid_names(model)]),
        direct=model.direct if np.any(model.direct) else None,
    )


def _rank_factors(residue: np.ndarray | None, inputs: int, outputs: int) -> tuple[np.ndarray, np.ndarray]:
    """psi and phi with phi psi = residue, as many as its rank."""
    if residue is None:
        return np.zeros((0, inputs)), np.zeros((outputs, 0))
    left, size, right = np.linalg.svd(residue)
    rank = int(np.sum(size > RANK * size[0]))
    root = np.sqrt(size[:rank])
    return root[:, None] * right[:rank], left[:, :rank] * root


def rational_statespace(model: MeasurementModel) -> StateSpace | SampledStateSpace:
    """All of the model but its delays, with 1/s^2 as two states for each direction of L."""
    if model.sample_hz is not None:
        A, B, C = _modal_blocks(model, np.exp(model.poles / model.sample_hz))
        return SampledStateSpace(A, B, C, model.direct, 1.0 / model.sample_hz)
    modes = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    double = double_pole(model)
    modes = _beside(modes, double, DOUBLE) if np.any(double) else modes
    return modes if model.integral is None else _beside(modes, model.integral, SINGLE)


def state_names(model: MeasurementModel) -> tuple[str, ...]:
    """One for each state of `modal_statespace`, so that a design can say which pole it cannot hold."""
    pairs = zip(natural_hz(model), model.is_pair, strict=True)
    poles = tuple(f"pole at {hz:.4g} Hz" for hz, pair in pairs for _ in range(1 + pair))
    rigid = tuple(name for name in _rigid_names(model) for _ in range(2))
    return (*poles, *rigid, *(f"integrator {1 + k}" for k in range(rank_of(model.integral))))


def _rigid_names(model: MeasurementModel) -> list[str]:
    return [f"rigid-body mode {1 + k}" for k in range(rank_of(model.rigid))]


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Modes of one name numbered, so that one of them can be shifted."""
    return tuple(
        name if names.count(name) == 1 else f"{name} #{1 + names[:k].count(name)}"
        for k, name in enumerate(names)
    )


def _beside(modes: StateSpace, residue: np.ndarray, drift: np.ndarray) -> StateSpace:
    """With a residue at zero in parallel, as many chains ``drift`` of integrators as it has rank.

    q'' = psi u and y = phi q, or q' = psi u.
    """
    psi, phi = _rank_factors(residue, modes.B.shape[1], len(modes.C))
    each, rank = len(drift), len(psi)
    into, out = np.zeros((each * rank, psi.shape[1])), np.zeros((len(phi), each * rank))
    into[each - 1 :: each], out[:, ::each] = psi, phi
    A = block([modes.A, np.kron(np.eye(rank), drift)])
    return StateSpace(A, np.vstack([modes.B, into]), np.hstack([modes.C, out]), modes.D)


def block(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Block-diagonal matrix."""
    return np.asarray(scipy.linalg.block_diag(*blocks))


def _modal_blocks(model: MeasurementModel, pole: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C in real 2x2 and 1x1 blocks, of x' = pole x + b u and y = 2 Re(c x), or c x."""
    A: list[np.ndarray] = []
    B: list[np.ndarray] = []
    C: list[np.ndarray] = []
    for m, pair in enumerate(model.is_pair):
        a, b, c = _pair(model, m, pole[m]) if pair else _single(model, m, pole[m])
        # Inputs and outputs of like size keep the blocks balanced.
        ratio = np.sqrt(np.linalg.norm(c) / np.linalg.norm(b)) if np.any(c) and np.any(b) else 1.0
        A.append(a)
        B.append(b * ratio)
        C.append(c / ratio)
    rows, columns = model.direct.shape
    empty_B, empty_C = np.zeros((0, columns)), np.zeros((rows, 0))
    return block(A), np.vstack([*B, empty_B]), np.hstack([*C, empty_C])


def _pair(model: MeasurementModel, m: int, p: complex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States Re x and Im x / k. A pair near critical damping has a small Im p and, with real constants, an
    Im c that is as large: k = Im p / |p| takes the one from the other."""
    c, b = model.shapes[:, m], model.participation[m]
    k = abs(p.imag / p) if abs(p.imag) < CRITICAL * abs(p) else 1.0
    a = np.array([[p.real, -p.imag * k], [p.imag / k, p.real]])
    into = np.stack([np.real(b), np.imag(b) / k])
    return a, into, 2.0 * np.stack([np.real(c), -np.imag(c) * k], axis=1)


def _single(model: MeasurementModel, m: int, p: complex) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.array([[p.real]]), np.real(model.participation[[m]]), np.real(model.shapes[:, [m]])

"""From a measurement model to a plant: balanced real 2x2 blocks of its pairs, delays exact."""

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.identification.model.measurement_model import (
    RANK,
    MeasurementModel,
    double_pole,
    natural_hz,
    path_delay,
    rank_of,
    single_pole,
)
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

# A pair whose pole is closer to the real axis than this share of its size is near critical damping.
CRITICAL = 0.5
# Integrators in a row: 1/s^2 and 1/s.
DOUBLE, SINGLE = np.array([[0.0, 1.0], [0.0, 0.0]]), np.zeros((1, 1))


def modal_statespace(model: MeasurementModel) -> StateSpace:
    """Real block-modal form of a continuous model without its delays, of ``model.states`` states.

    Rigid-body modes come last but for integrators, each with the states q and q'.
    """
    modes = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    modes = modes if model.rigid is None else _beside(modes, model.rigid, DOUBLE)
    return modes if model.integral is None else _beside(modes, model.integral, SINGLE)


def rational_statespace(model: MeasurementModel) -> StateSpace | SampledStateSpace:
    """The model without its delays, with the fewest states at s = 0 that 1/s^2 and 1/s need."""
    if model.sample_hz is not None:
        A, B, C = _modal_blocks(model, np.exp(model.poles / model.sample_hz))
        return SampledStateSpace(A, B, C, model.direct, period_s=1.0 / model.sample_hz)
    modes = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    return _at_rest(modes, double_pole(model), single_pole(model))


def state_names(model: MeasurementModel) -> tuple[str, ...]:
    """Names of the states of `modal_statespace`, so that a design can name an uncontrollable pole."""
    pairs = zip(natural_hz(model), model.is_pair, strict=True)
    poles = tuple(f"pole at {hz:.4g} Hz" for hz, pair in pairs for _ in range(1 + pair))
    rigid = tuple(f"rigid-body mode {1 + k}" for k in range(rank_of(model.rigid)) for _ in range(2))
    return (*poles, *rigid, *(f"integrator {1 + k}" for k in range(rank_of(model.integral))))


def _at_rest(modes: StateSpace, double: np.ndarray, single: np.ndarray) -> StateSpace:
    """The system with double / s^2 + single / s in parallel, of degree rank [single, double; double, 0].

    q1' = q2 + into u, q2' = psi u and y = phi q1 + out q2 give phi psi / s^2 + (phi into + out psi) / s: of
    ``single`` all but its part beside both phi and psi needs no state of its own.
    """
    if not np.any(double):
        return _beside(modes, single, SINGLE) if np.any(single) else modes
    first = len(modes.A)
    whole = _beside(modes, double, DOUBLE)
    phi, psi = whole.C[:, first::2], whole.B[first + 1 :: 2]
    into = np.linalg.pinv(phi) @ single
    out = (single - phi @ into) @ np.linalg.pinv(psi)
    B, C = whole.B.copy(), whole.C.copy()
    B[first::2], C[:, first + 1 :: 2] = into, out
    rest = single - phi @ into - out @ psi
    whole = StateSpace(whole.A, B, C, whole.D)
    alone = np.abs(rest).max() > RANK * np.abs(single).max()
    return _beside(whole, rest, SINGLE) if alone else whole


def _beside(modes: StateSpace, residue: np.ndarray, drift: np.ndarray) -> StateSpace:
    """The system with a residue at zero in parallel: the integrator chain ``drift``, once for each rank.

    q'' = psi u and y = phi q, or q' = psi u.
    """
    left, size, right = np.linalg.svd(residue)
    rank = int(np.sum(size > RANK * size[0]))
    root = np.sqrt(size[:rank])
    psi, phi = root[:, None] * right[:rank], left[:, :rank] * root
    each = len(drift)
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


@named_kinds
def measured_plant(
    model: MeasurementModel,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant of a continuous model, its delays as they are.

    Verdicts take it so. A design of finite order takes ``approximate_delays(plant, 3)``, whose states are few
    where a path is delayed by its input plus its output: `merge_delays` makes the delays of a fit one that it
    does not tell apart, ``fit_response(..., delay="common")`` fits one. A computer sees
    ``sample_plant(plant, period_s)``, whose hold comes on top of the delays. Where ``model.hold_s`` is None
    and its data had held inputs, half a period of that hold is in the delays: sampled, it would count twice.

    States are block-modal; rigid-body modes have q and q'. The term L / s^2 of modes below the band is left
    out: it is no part of the plant, only of its neighbourhood.

    Raises `ConfigError` for a sampled model or an unknown port.
    """
    if model.sample_hz is not None:
        raise ConfigError(
            "a sampled model has no continuous plant",
            hint="fit it without sample_hz, or take identification.rational_statespace",
        )
    return Plant(
        dynamics=modal_statespace(model),
        inputs=model.inputs,
        outputs=model.outputs,
        w=tuple(w),
        u=tuple(u),
        z=tuple(z),
        y=tuple(y),
        state_names=state_names(model),
        delay_s=path_delay(model),
    )

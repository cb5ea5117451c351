"""The model a fit returns: poles, modal vectors, a direct term and exact delays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.systems.delay import pade
from middeck.systems.plant import Plant
from middeck.systems.ports import Port
from middeck.systems.statespace import SampledStateSpace, StateSpace, series
from middeck.values import record


@record
class MeasurementModel:
    """A transfer matrix by its poles and rank-one residues, with a delay for each output.

    H_o = exp(-s tau_o) [ sum_m c_om b_m / (q - lambda_m) + the conjugate of each pair + L_o / s^2 + D_o ],
    with q = s and lambda = pole in continuous time, q = exp(s T) and lambda = exp(pole T) if sampled.

    Parameters
    ----------
    poles:
        One of each conjugate pair (positive imaginary part), or a real pole [rad/s], also of a sampled
        model; a sampled pole on the negative real axis has the imaginary part pi / T and is single.
    shapes:
        Output vectors c; the residue of ``poles[m]`` is ``shapes[:, m]`` times ``participation[m]``.
    participation:
        Input vectors b.
    direct:
        Constant term D: also what modes above the band leave in it.
    lower:
        L, what modes below the band leave in it; zero unless asked for.
    delay_s:
        Delay of each output [s], exact in responses, a Pade approximation only in `measured_plant`.
    sample_hz:
        None for a continuous model; otherwise the rate at which its inputs are held and outputs sampled.
    """

    poles: Complex[np.ndarray, " mode"]
    shapes: Complex[np.ndarray, "output mode"]
    participation: Complex[np.ndarray, "mode input"]
    direct: Float[np.ndarray, "output input"]
    lower: Float[np.ndarray, "output input"]
    delay_s: Float[np.ndarray, " output"]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    sample_hz: float | None = None

    @property
    def is_pair(self) -> np.ndarray:
        """True for each mode that stands for a conjugate pair."""
        imag = np.imag(self.poles)
        single = imag == 0.0
        if self.sample_hz is not None:
            single |= imag >= np.pi * self.sample_hz * (1.0 - 1e-9)
        return ~single

    @property
    def states(self) -> int:
        """Order without the delays: two for each pair, one for each real pole."""
        return int(np.sum(np.where(self.is_pair, 2, 1)))


def model_response(
    model: MeasurementModel, frequency_hz: Float[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """Response at ``frequency_hz`` with the exact delay."""
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    T = None if model.sample_hz is None else 1.0 / model.sample_hz
    q, pole = (s, model.poles) if T is None else (np.exp(s * T), np.exp(model.poles * T))
    c, b = model.shapes, model.participation
    sum_of_terms = (c / (q[:, None, None] - pole)) @ b
    pairs = np.flatnonzero(model.is_pair)
    sum_of_terms += (c[:, pairs].conj() / (q[:, None, None] - pole[pairs].conj())) @ b[
        pairs
    ].conj() + model.direct
    if np.any(model.lower):
        sum_of_terms += model.lower / s[:, None, None] ** 2
    return sum_of_terms * np.exp(-s[:, None] * model.delay_s)[:, :, None]


def natural_hz(model: MeasurementModel) -> Float[np.ndarray, " mode"]:
    """Undamped natural frequency |pole| / 2 pi of each mode [Hz]."""
    return np.abs(model.poles) / (2.0 * np.pi)


def damping_ratio(model: MeasurementModel) -> Float[np.ndarray, " mode"]:
    """-Re pole / |pole| of each mode."""
    return -np.real(model.poles) / np.abs(model.poles)


def sampled_statespace(model: MeasurementModel) -> SampledStateSpace:
    """Real block-modal form of a sampled model, of ``model.states`` states."""
    if model.sample_hz is None or np.any(model.delay_s):
        raise ConfigError("only a sampled model without a delay has this state space", hint="measured_plant")
    T = 1.0 / model.sample_hz
    A, B, C = _modal_blocks(model, np.exp(model.poles * T))
    return SampledStateSpace(A, B, C, model.direct, T)


def measured_plant(
    model: MeasurementModel,
    *,
    pade_order: int = 3,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant of a continuous model: block-modal states, then the states of the delays.

    One delay common to all outputs is put on the side with fewer channels, so that a model with one input
    needs ``pade_order`` states for it in all; outputs that differ need as many each. The term 1/s^2 of modes
    below the band is left out: it is no part of the plant, only of its neighbourhood.

    Raises
    ------
    ConfigError
        For a sampled model, a Pade order below one or an unknown port.
    """
    if model.sample_hz is not None:
        raise ConfigError(
            "a sampled model has no continuous plant",
            hint="fit without sample_hz, or take sampled_statespace",
        )
    system = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    system, names = _with_delays(system, _pole_names(model), model.delay_s, pade_order)
    return Plant(system, model.inputs, model.outputs, tuple(w), tuple(u), tuple(z), tuple(y), names)


def _pole_names(model: MeasurementModel) -> tuple[str, ...]:
    """One for each state, so that a design can say which pole it cannot hold."""
    pairs = zip(natural_hz(model), model.is_pair, strict=True)
    return tuple(f"pole at {hz:.4g} Hz" for hz, pair in pairs for _ in range(1 + pair))


def _with_delays(
    system: StateSpace, names: tuple[str, ...], delay_s: np.ndarray, order: int
) -> tuple[StateSpace, tuple[str, ...]]:
    outputs, inputs = system.D.shape
    at_input = bool(np.all(delay_s == delay_s[0])) and inputs < outputs
    delays = _parallel([pade(tau, order) for tau in (delay_s[:1].repeat(inputs) if at_input else delay_s)])
    labels = ("delay",) * len(delays.A)
    if at_input:
        return series(delays, system), (*labels, *names)
    return series(system, delays), (*names, *labels)


def _parallel(systems: Sequence[StateSpace]) -> StateSpace:
    blocks = (_block_diagonal([getattr(s, name) for s in systems]) for name in "ABCD")
    return StateSpace(*blocks)


def _block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    return np.asarray(scipy.linalg.block_diag(*blocks))


def _modal_blocks(model: MeasurementModel, pole: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C in real 2x2 and 1x1 blocks: states Re x and Im x of x' = pole x + b u, y = 2 Re(c x)."""
    A: list[np.ndarray] = []
    B: list[np.ndarray] = []
    C: list[np.ndarray] = []
    for m, pair in enumerate(model.is_pair):
        c, b, p = model.shapes[:, m], model.participation[m], pole[m]
        # Inputs and outputs of like size keep the blocks balanced.
        ratio = np.sqrt(np.linalg.norm(c) / np.linalg.norm(b)) if np.any(c) and np.any(b) else 1.0
        c, b = c / ratio, b * ratio
        if pair:
            A.append(np.array([[p.real, -p.imag], [p.imag, p.real]]))
            B.append(np.stack([b.real, b.imag]))
            C.append(2.0 * np.stack([c.real, -c.imag], axis=1))
        else:
            A.append(np.array([[p.real]]))
            B.append(b.real[None])
            C.append(c.real[:, None])
    rows, columns = model.direct.shape
    empty_B, empty_C = np.zeros((0, columns)), np.zeros((rows, 0))
    return _block_diagonal(A), np.vstack([*B, empty_B]), np.hstack([*C, empty_C])

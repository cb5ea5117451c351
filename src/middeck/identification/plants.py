"""From a measurement model to a plant: modal blocks, delays by Pade or exactly sampled, ports by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.linalg
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.identification.measurement_model import (
    RANK,
    MeasurementModel,
    double_pole,
    natural_hz,
    path_delay,
)
from middeck.systems.delay import pade
from middeck.systems.delayed_sampling import is_sum, sample_delayed, split_delays
from middeck.systems.plant import Plant
from middeck.systems.ports import Port, port_indices
from middeck.systems.statespace import SampledStateSpace, StateSpace, series
from middeck.values import record

# A mode is on none of the chosen paths if less than this share of it is: rounding.
UNREACHED = 1e-12
# A pair whose pole is closer to the real axis than this share of its size is near critical damping.
CRITICAL = 0.5
# Delays that differ by less [s] are one: far below what any record can tell.
SAME_DELAY_S = 1e-12

Named = tuple[StateSpace, tuple[str, ...]]


@record
class Selection:
    """A model of some channels, and the names of the modes that are on no path between them."""

    model: MeasurementModel
    dropped: tuple[str, ...]


@record
class SampledPlant:
    """A plant as a computer sees it: inputs held, outputs sampled, delays exact.

    Parameters
    ----------
    system:
        From held inputs to sampled outputs; states as in `sample_delayed`.
    inputs, outputs, w, u, z, y, state_names:
        As in `Plant`.
    """

    system: SampledStateSpace
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    w: tuple[str, ...]
    u: tuple[str, ...]
    z: tuple[str, ...]
    y: tuple[str, ...]
    state_names: tuple[str, ...]


def measured_plant(
    model: MeasurementModel,
    *,
    pade_order: int = 3,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """The plant of a continuous model: block-modal states and the states of its delays.

    A delay common to all paths is put on the side with fewer channels, so that a model with one input needs
    ``pade_order`` states for it in all; what an input or an output is late beyond that needs as many each.
    Delays that are no sum of one for the input and one for the output give each channel of the smaller side
    modes of its own. Rigid-body modes have the states q and q'. The term L / s^2 of modes below the band is
    left out: it is no part of the plant, only of its neighbourhood.

    Raises
    ------
    ConfigError
        For a sampled model, a Pade order below one or an unknown port.
    """
    _check_continuous(model)
    system, names = _with_delays(model, pade_order)
    return Plant(system, model.inputs, model.outputs, tuple(w), tuple(u), tuple(z), tuple(y), names)


def sampled_plant(
    model: MeasurementModel,
    period_s: float,
    *,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> SampledPlant:
    """What a computer of the period ``period_s`` sees of a continuous model: exact, delays included.

    Inputs are held from one instant to the next, outputs are sampled at the instants, so that the hold's own
    half period comes on top of the model's delays.

    Raises
    ------
    ConfigError
        For a sampled model, a period that is not positive or an unknown port.
    """
    _check_continuous(model)
    for ports, names, side in ((model.inputs, (*w, *u), "input"), (model.outputs, (*z, *y), "output")):
        port_indices(ports, names, side)
    delay_s = path_delay(model)
    system = sample_delayed(modal_statespace(model), period_s, delay_s)
    modes = state_names(model) * (1 if is_sum(delay_s / period_s) else len(model.inputs))
    names = (*modes, *("delay",) * (len(system.A) - len(modes)))
    return SampledPlant(system, model.inputs, model.outputs, tuple(w), tuple(u), tuple(z), tuple(y), names)


def sampled_statespace(model: MeasurementModel) -> SampledStateSpace:
    """Real block-modal form of a sampled model, of ``model.states`` states."""
    if model.sample_hz is None or np.any(path_delay(model)):
        raise ConfigError("only a sampled model without a delay has this state space", hint="sampled_plant")
    A, B, C = _modal_blocks(model, np.exp(model.poles / model.sample_hz))
    return SampledStateSpace(A, B, C, model.direct, 1.0 / model.sample_hz)


def modal_statespace(model: MeasurementModel) -> StateSpace:
    """Real block-modal form of a continuous model without its delays, of ``model.states`` states.

    Rigid-body modes come last, each with the states q and q'.
    """
    modes = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    return modes if model.rigid is None else _beside(modes, model.rigid)


def rational_statespace(model: MeasurementModel) -> StateSpace | SampledStateSpace:
    """All of the model but its delays, with 1/s^2 as two states for each direction of L."""
    if model.sample_hz is not None:
        A, B, C = _modal_blocks(model, np.exp(model.poles / model.sample_hz))
        return SampledStateSpace(A, B, C, model.direct, 1.0 / model.sample_hz)
    modes = StateSpace(*_modal_blocks(model, model.poles), model.direct)
    double = double_pole(model)
    return _beside(modes, double) if np.any(double) else modes


def _beside(modes: StateSpace, double: np.ndarray) -> StateSpace:
    """With double / s^2 in parallel: for each of its rank two states, q'' = psi u and y = phi q."""
    left, size, right = np.linalg.svd(double)
    rank = int(np.sum(size > RANK * size[0]))
    root = np.sqrt(size[:rank])
    psi, phi = root[:, None] * right[:rank], left[:, :rank] * root
    drift = np.kron(np.eye(rank), np.array([[0.0, 1.0], [0.0, 0.0]]))
    into, out = np.zeros((2 * rank, psi.shape[1])), np.zeros((len(phi), 2 * rank))
    into[1::2], out[:, ::2] = psi, phi
    return StateSpace(
        _block([modes.A, drift]), np.vstack([modes.B, into]), np.hstack([modes.C, out]), modes.D
    )


def state_names(model: MeasurementModel) -> tuple[str, ...]:
    """One for each state of `modal_statespace`, so that a design can say which pole it cannot hold."""
    pairs = zip(natural_hz(model), model.is_pair, strict=True)
    poles = tuple(f"pole at {hz:.4g} Hz" for hz, pair in pairs for _ in range(1 + pair))
    return (*poles, *(f"rigid-body mode {1 + k // 2}" for k in range(model.states - len(poles))))


def select_channels(
    model: MeasurementModel, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> Selection:
    """The model between some of its inputs and outputs, in the order given; None for all.

    Modes that no chosen input moves or no chosen output sees, but for rounding, are left out and named. The
    pole of a residue of higher rank stays as often as the rank of the chosen channels asks.

    Raises
    ------
    ConfigError
        For an unknown name, naming those there are.
    """
    columns, rows = (
        list(range(len(ports))) if names is None else port_indices(ports, names, side)
        for ports, names, side in ((model.inputs, inputs, "input"), (model.outputs, outputs, "output"))
    )
    keep = (_share(model.shapes.T, rows) > UNREACHED) & (_share(model.participation, columns) > UNREACHED)
    poles, c, b = _least(
        model.poles[keep], model.shapes[rows][:, keep], model.participation[keep][:, columns]
    )
    entries = np.ix_(rows, columns)
    chosen = dataclasses.replace(
        model,
        poles=poles,
        shapes=c,
        participation=b,
        direct=model.direct[entries],
        lower=model.lower[entries],
        delay_s=model.delay_s[rows],
        path_delay_s=None if model.path_delay_s is None else model.path_delay_s[entries],
        rigid=None if model.rigid is None or not np.any(model.rigid[entries]) else model.rigid[entries],
        inputs=tuple(model.inputs[i] for i in columns),
        outputs=tuple(model.outputs[o] for o in rows),
    )
    return Selection(chosen, tuple(f"pole at {hz:.4g} Hz" for hz in natural_hz(model)[~keep]))


def _least(poles: np.ndarray, c: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same residues with each pole as often as its residue's rank."""
    each, first, count = np.unique(poles, return_index=True, return_counts=True)
    if np.all(count == 1):
        return poles, c, b
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for k in np.argsort(first):
        at = poles == each[k]
        R = c[:, at] @ b[at]
        # Real modal constants, hence imaginary residues, stay so to the last digit.
        matrix, unit = (R, 1.0) if np.any(np.real(R)) else (np.imag(R), 1j)
        left, size, right = np.linalg.svd(matrix, full_matrices=False)
        rank = int(np.sum(size > RANK * size[0]))
        parts.append((poles[at][:rank], unit * left[:, :rank] * size[:rank], right[:rank]))
    return (
        np.concatenate([p for p, _, _ in parts]),
        np.hstack([left for _, left, _ in parts]),
        np.vstack([right for _, _, right in parts]),
    )


def _share(vectors: np.ndarray, chosen: list[int]) -> Float[np.ndarray, " mode"]:
    """How much of each mode's vector lies in the chosen channels, each in its own measure."""
    size = np.abs(vectors)
    size = size / np.maximum(size.max(axis=0, initial=0.0), np.finfo(float).tiny)
    whole = np.linalg.norm(size, axis=1)
    return np.linalg.norm(size[:, chosen], axis=1) / np.where(whole > 0.0, whole, 1.0)


def scale_channels(model: MeasurementModel, scale: Mapping[str, tuple[float, str]]) -> MeasurementModel:
    """The model with some channels in other units: name to (new units per old unit, new unit).

    A name that stands for an input and an output scales both.

    >>> from middeck.identification.measurement_model import MeasurementModel
    >>> port = (Port("angle", "rad"),)
    >>> one = np.ones((1, 1))
    >>> static = MeasurementModel(np.zeros(0), np.zeros((1, 0)), np.zeros((0, 1)), one, 0.0 * one, [0.0],
    ...                           (Port("torque", "N m"),), port)
    >>> scale_channels(static, {"angle": (1e3, "mrad")}).direct.tolist()
    [[1000.0]]
    """
    known = {p.name for p in (*model.inputs, *model.outputs)}
    port_indices([*model.inputs, *model.outputs], [n for n in scale if n not in known], "channel")
    if any(not (np.isfinite(factor) and factor != 0.0) for factor, _ in scale.values()):
        raise ConfigError(f"scales {scale} are not all finite and other than zero")
    of_input, of_output = (
        np.array([scale.get(p.name, (1.0, ""))[0] for p in side]) for side in (model.inputs, model.outputs)
    )
    inputs, outputs = (
        tuple(dataclasses.replace(p, unit=scale[p.name][1]) if p.name in scale else p for p in side)
        for side in (model.inputs, model.outputs)
    )
    entries = of_output[:, None] / of_input
    return dataclasses.replace(
        model,
        shapes=model.shapes * of_output[:, None],
        participation=model.participation / of_input,
        direct=model.direct * entries,
        lower=model.lower * entries,
        rigid=None if model.rigid is None else model.rigid * entries,
        inputs=inputs,
        outputs=outputs,
    )


def _check_continuous(model: MeasurementModel) -> None:
    if model.sample_hz is not None:
        raise ConfigError(
            "a sampled model has no continuous plant",
            hint="fit without sample_hz, or take sampled_statespace",
        )


def _with_delays(model: MeasurementModel, order: int) -> Named:
    delay_s = path_delay(model)
    if is_sum(delay_s, SAME_DELAY_S):
        return _late_channels(model, delay_s, order)
    # One channel of the smaller side at a time: its paths are late by one side's delays alone.
    by_input = len(model.inputs) <= len(model.outputs)
    ports = model.inputs if by_input else model.outputs
    parts: list[Named] = []
    for k, port in enumerate(ports):
        one = (port.name,)
        alone = select_channels(model, inputs=one) if by_input else select_channels(model, outputs=one)
        late = delay_s[:, [k]] if by_input else delay_s[[k]]
        parts.append(_late_channels(alone.model, late, order))
    names = tuple(name for _, names in parts for name in names)
    return _join([system for system, _ in parts], by_input=by_input), names


def _join(systems: Sequence[StateSpace], *, by_input: bool) -> StateSpace:
    """Systems of one input each, their outputs added, or of one output each, driven by the same inputs."""
    side_by_side, stacked = (_block, np.hstack) if by_input else (np.vstack, _block)
    return StateSpace(
        _block([s.A for s in systems]),
        side_by_side([s.B for s in systems]),
        stacked([s.C for s in systems]),
        (np.hstack if by_input else np.vstack)([s.D for s in systems]),
    )


def _late_channels(model: MeasurementModel, delay_s: np.ndarray, order: int) -> Named:
    """Delays that are sums: inputs' delays in front, outputs' delays behind, the common one on one side."""
    split = split_delays(delay_s)
    of_input, of_output = split.input_s, split.output_s
    if len(of_input) < len(of_output):
        common = of_output.min()
        of_input, of_output = of_input + common, of_output - common
    before, after = (_late(side, order) for side in (of_input, of_output))
    system = series(series(before, modal_statespace(model)), after)
    names = (*("delay",) * len(before.A), *state_names(model), *("delay",) * len(after.A))
    return system, names


def _late(delay_s: Float[np.ndarray, " channel"], order: int) -> StateSpace:
    """A Pade approximation for each channel, none for those that are on time."""
    each = [pade(tau if tau > SAME_DELAY_S else 0.0, order) for tau in delay_s]
    return StateSpace(*(_block([getattr(s, name) for s in each]) for name in "ABCD"))


def _block(blocks: Sequence[np.ndarray]) -> np.ndarray:
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
    return _block(A), np.vstack([*B, empty_B]), np.hstack([*C, empty_C])


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

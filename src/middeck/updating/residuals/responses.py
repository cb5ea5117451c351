"""Measured responses and anti-resonances beside those of the model, at the poles that the survey measured.

Frequencies and damping of a survey have rows of their own. The poles of paired modes are therefore the
measured ones, so that a response counts only for what they leave open: modal constants, the curve between the
peaks, delay and gains.

A row is the real part (log magnitude) or imaginary part (phase) of the logarithm of measured over modelled
response, or the logarithm of an anti-resonance's frequency. Errors of the poles and stated errors of modal
constants are common to the rows; noise, a stated error of each mode's part on each line, and nonlinearity are
each row's own. Rows are divided by a root of that covariance, so that they are independent with deviation
one, and further by the factor by which they still miss more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import ConfigError
from middeck.structure.modes.solve import Modes
from middeck.updating.residuals.measured_response import (
    NOISY,
    AntiResonance,
    MeasuredPath,
    MeasuredResponse,
    measured_paths,
)
from middeck.updating.residuals.modal_transfer import (
    ModalTransfer,
    TransferSlopes,
    transfer_of,
    transfer_slopes,
)
from middeck.updating.unknowns.unknowns import Bound, LoopSlopes, loop_slopes
from middeck.values import record

# Standard deviations of ln zeta of a mode whose damping the survey does not state, and where it states no
# deviation; and of ln omega of a mode that it did not measure.
UNKNOWN_DAMPING, DAMPING_STD, UNSEEN = 0.3, 0.1, 0.01
# Modes kept: below so many times the top of the band, and no fewer than this.
BEYOND, LEAST = 5.0, 26
# Steps of Newton, the last of which is smaller than this part of the frequency, and how far (in logarithms)
# the model's anti-resonance may lie from the measured one.
STEPS, SETTLED, APART = 30, 1e-9, 0.15


@record(kw_only=True)
class ComparedResponse:
    """Responses of one survey beside the model, in independent rows.

    Attributes:
        residual, slope: Divided by a root of the covariance that noise and stated errors give, and turned
            into few rows that say the same.
        std: One, or ``miss`` where that is more.
        lines: Number of lines of the response that count.
        magnitude_db, phase_deg: Rms of the errors of the response over these lines and all paths.
        miss: Rms of all rows, in the deviations that noise and stated errors give them.
        lost: Anti-resonances that the model does not have.
    """

    survey: str
    residual: Float[np.ndarray, " row"]
    std: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row unknown"]
    lines: int
    magnitude_db: float
    phase_deg: float
    miss: float
    lost: tuple[AntiResonance, ...]


@record(kw_only=True)
class Poles:
    """Measured frequencies and damping ratios where there are any, and deviations of their logarithms."""

    held: tuple[int, ...]
    omega: Float[np.ndarray, " mode"]
    zeta: Float[np.ndarray, " mode"]
    omega_std: Float[np.ndarray, " mode"]
    zeta_std: Float[np.ndarray, " mode"]


@record(kw_only=True)
class _Rows:
    """Residuals, their own deviations, slopes, and what they share of common errors of deviation one."""

    residual: Float[np.ndarray, " row"]
    std: Float[np.ndarray, " row"]
    slope: Float[np.ndarray, "row unknown"]
    shared: Float[np.ndarray, "row common"]


@record(kw_only=True)
class _Beside:
    """The model of a response: its transfer at the measured poles, slopes, loop, and common errors."""

    test: MeasuredResponse
    poles: Poles
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    model: ModalTransfer
    slopes: TransferSlopes
    loop: LoopSlopes
    delay: float
    gain: Float[np.ndarray, "output input"]

    def paths(self) -> list[tuple[int, int]]:
        """(output, input) of every path, which have modal constants of their own."""
        return [(o, i) for o in range(len(self.outputs)) for i in range(len(self.inputs))]

    def by_common(
        self, s: Complex[np.ndarray, " line"], path: tuple[int, int]
    ) -> Complex[np.ndarray, "line common"]:
        """dG of a path by each common error: poles of all modes, then modal constants of every path."""
        parts = self.model.parts(s, *path)
        omega, zeta = self.model.pole_slopes(s, parts)
        constants = np.zeros((len(s), len(self.paths()), parts.shape[1]), complex)
        constants[:, self.paths().index(path)] = self.test.modal_error * parts
        poles = (omega * self.poles.omega_std, zeta * self.poles.zeta_std)
        return np.hstack([*poles, constants.reshape(len(s), -1)])


def _beside(
    test: MeasuredResponse, modes: Modes, bound: Sequence[Bound], x: np.ndarray, poles: Poles
) -> _Beside:
    (inputs, outputs), count = test.ports, len(poles.omega)
    loop = loop_slopes([b.unknown.parameters for b in bound], inputs, outputs)
    return _Beside(
        test=test,
        poles=poles,
        inputs=inputs,
        outputs=outputs,
        model=with_poles(transfer_of(modes, inputs, outputs, count), poles),
        slopes=transfer_slopes(modes, bound, inputs, outputs, poles.held, count),
        loop=loop,
        delay=test.delay_s + float(loop.delay @ x),
        gain=np.exp(loop.output @ x)[:, None] * np.exp(loop.input @ x),
    )


def with_poles(transfer: ModalTransfer, poles: Poles) -> ModalTransfer:
    """``transfer`` at other poles."""
    return dataclasses.replace(transfer, omega=poles.omega, zeta=poles.zeta)


def compare_response(
    survey: str,
    test: MeasuredResponse,
    modes: Modes,
    poles: Poles,
    bound: Sequence[Bound],
    x: Float[np.ndarray, " unknown"],
    open_x: Float[np.ndarray, "unknown drawn"],
) -> ComparedResponse:
    """The rows; ``open_x`` is a root of the covariance of the remaining uncertainty of ``x``.

    Raises `ConfigError` for ports that the article does not have, and where no line counts.
    """
    beside = _beside(test, modes, bound, x, poles)
    found, lost, errors = [], [], [np.zeros(0, complex)]
    paths = measured_paths(test)
    wide = paths[0].common.shape[1] if paths else 0
    for path in paths:
        rows, error = _of_path(beside, path, open_x)
        found.append(rows)
        errors.append(error)
    if paths and not sum(len(error) for error in errors):
        raise ConfigError(
            "no line of the response counts",
            where=survey,
            hint=f"a band with lines in it that are known to {100.0 * NOISY:g} %",
        )
    for zero in test.anti_resonances:
        row = _of_zero(beside, zero, wide, open_x)
        found += [] if row is None else [row]
        lost += [zero] if row is None else []
    lines = max((len(path.hz) for path in paths), default=0)
    return _independent(survey, found, lines, np.concatenate(errors), tuple(lost), len(bound))


def _independent(
    survey: str,
    found: Sequence[_Rows],
    lines: int,
    errors: np.ndarray,
    lost: tuple[AntiResonance, ...],
    unknowns: int,
) -> ComparedResponse:
    """Independent rows that say all that the measured ones do, no more than there are unknowns and one.

    Common errors n are unknowns of deviation one beside x. Of the triangular factor of both, divided by the
    rows' own deviations, the part below n is what remains for x (Bjorck 1996, 2.7), and its last column
    the residual, whose square is that of all rows under their covariance.
    """
    whole, common, count = np.zeros((0, unknowns + 1)), 0, 0
    if found:
        std = np.concatenate([r.std for r in found])[:, None]
        shared = np.vstack([r.shared for r in found])
        count, common = shared.shape
        right = np.column_stack(
            [np.vstack([r.slope for r in found]), np.concatenate([r.residual for r in found])]
        )
        below = np.hstack([np.eye(common), np.zeros((common, unknowns + 1))])
        upper = np.asarray(np.linalg.qr(np.vstack([np.hstack([shared, right]) / std, below]), mode="r"))
        whole = upper[common:, common:]
    residual, slope = whole[:, -1], whole[:, :-1]
    miss = float(np.linalg.norm(residual) / np.sqrt(count)) if count else 0.0
    return ComparedResponse(
        survey=survey,
        residual=residual,
        std=np.full(len(residual), max(miss, 1.0)),
        slope=slope,
        lines=lines,
        magnitude_db=float(_rms(np.real(errors)) * 20.0 / np.log(10.0)),
        phase_deg=float(np.degrees(_rms(np.imag(errors)))),
        miss=miss,
        lost=lost,
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _of_path(
    beside: _Beside, measured: MeasuredPath, open_x: np.ndarray
) -> tuple[_Rows, Complex[np.ndarray, " line"]]:
    """Log magnitude and phase; and the complex errors.

    ln(1 + d) is d to first order, wrong by half its square: where a pole that no survey measured, or a sum
    that nearly cancels, may move a line by d of itself, that is an error of the line's own. Gains and delay
    are linear in the logarithm whatever their size.
    """
    path = beside.outputs.index(measured.output), beside.inputs.index(measured.input)
    s, H = 2j * np.pi * measured.hz, measured.H
    parts = beside.model.parts(s, *path)
    G = parts.sum(axis=1)
    if np.any(G == 0.0):
        raise ConfigError(
            f"the model has no response from {measured.input} to {measured.output}",
            where="response of a survey",
            hint="leave that path out",
        )
    error = np.log(H / (beside.gain[path] * G * np.exp(-s * beside.delay)))
    loop = beside.loop.output[path[0]] + beside.loop.input[path[1]] - s[:, None] * beside.loop.delay
    slope = beside.slopes.of(beside.model, s, path) / G[:, None] + loop
    shared = np.hstack([beside.by_common(s, path) / G[:, None], measured.common / H[:, None]])
    own = beside.test.line_error * np.linalg.norm(parts, axis=1) / np.abs(G)
    moved = np.linalg.norm(np.hstack([shared, (slope - loop) @ open_x]), axis=1)
    std = np.linalg.norm([measured.noise / (np.sqrt(2.0) * np.abs(H)), own, moved**2 / 2.0], axis=0)
    rows = _Rows(
        residual=np.concatenate([error.real, error.imag]),
        std=np.concatenate([std, std]),
        slope=np.vstack([slope.real, slope.imag]),
        shared=np.vstack([shared.real, shared.imag]),
    )
    return rows, error


def _of_zero(beside: _Beside, zero: AntiResonance, wide: int, open_x: np.ndarray) -> _Rows | None:
    """d ln |s| = Re(ds / s) with ds = -dG / G'; None where the model has no such zero near."""
    path = beside.outputs.index(zero.output), beside.inputs.index(zero.input)
    s = _find_zero(beside.model, path, 2.0 * np.pi * zero.frequency_hz)
    if s is None:
        return None
    at = np.array([s])
    turn = -1.0 / (beside.model.slope(at, path)[:, None] * s)
    parts = np.linalg.norm(beside.model.parts(at, *path), axis=1)
    slope = np.real(turn * beside.slopes.of(beside.model, at, path))
    shared = np.real(turn * beside.by_common(at, path))
    moved = float(np.linalg.norm(np.hstack([shared, slope @ open_x])))
    own = np.hypot(beside.test.line_error * float(parts[0] * np.abs(turn[0, 0])), moved**2 / 2.0)
    return _Rows(
        residual=np.array([np.log(2.0 * np.pi * zero.frequency_hz / abs(s))]),
        std=np.array([np.hypot(zero.std_hz / zero.frequency_hz, own)]),
        slope=slope,
        shared=np.hstack([shared, np.zeros((1, wide))]),
    )


def _find_zero(model: ModalTransfer, path: tuple[int, int], omega: float) -> complex | None:
    """Zero of one path without its delay, by Newton's method from the measured frequency on the axis."""
    s = 1j * omega
    for _ in range(STEPS):
        at = np.array([s])
        rise = complex(model.slope(at, path)[0])
        step = complex(model.parts(at, *path).sum()) / rise if rise else 0.0
        s -= step
        if abs(step) < SETTLED * omega:
            near = s.imag > 0.0 and abs(np.log(abs(s) / omega)) < APART
            return s if near else None
    return None


def poles_of(
    modes: Modes,
    pairs: np.ndarray,
    measured_omega: np.ndarray,
    log_std: np.ndarray,
    damping: np.ndarray,
    damping_std: np.ndarray | None,
    zeta: np.ndarray,
) -> Poles:
    """Poles of the lowest modes, as many as ``zeta`` has, with measured ratios where there are any."""
    count = len(zeta)
    omega, ratio = modes.omega[:count].copy(), zeta.copy()
    omega_std, zeta_std = np.full(count, UNSEEN), np.full(count, UNKNOWN_DAMPING)
    held = [(int(i), int(j)) for i, j in pairs if i < count]
    for i, j in held:
        omega[i], omega_std[i] = measured_omega[j], log_std[j]
        if damping[j] > 0.0:
            ratio[i] = damping[j]
            stated = None if damping_std is None else damping_std[j]
            zeta_std[i] = DAMPING_STD if stated is None or not stated > 0.0 else stated / damping[j]
    return Poles(
        held=tuple(i for i, _ in held), omega=omega, zeta=ratio, omega_std=omega_std, zeta_std=zeta_std
    )


def kept_modes(modes: Modes, pairs: np.ndarray, top_hz: float) -> int:
    """Number of modes that a response needs: those of the survey, and some beyond its band."""
    below = int(np.count_nonzero(modes.frequency_hz < BEYOND * top_hz))
    return min(max(below, LEAST, int(pairs[:, 0].max(initial=-1)) + 1), len(modes.omega))

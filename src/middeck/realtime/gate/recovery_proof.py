"""A proof that a law recovers from limits of size and slew that act at any time, also both at once.

A limited output is u = w - n - m: the law asks for w; n is what the limit of size holds back, m that of slew.
In a sample in which both act, n is all of it, so that n m = 0. Where n is not zero, u is +-L with the sign of
n; where m is not zero, u - u_before is +-s with the sign of m; no sample of either is larger. Hence, with any
kernel h, causal or not, whose magnitudes add up to one at most, no term of these sums over time is negative:

    n (u - h * u) >= 0,   m ((u - u_before) - h * (u - u_before)) >= 0

(multipliers of Zames and Falb 1968, SIAM J. Control 6; sampled: Willems and Brockett 1968, IEEE TAC 13).
While the sensors stay within their ranges |w| has a bound, and so n (k w - n) >= 0 and
m (k' (w - u_before) - m) >= 0 with k, k' < 1.

Let the loop without limits be stable, and let some sum of these, as a quadratic form of (n, m), be below
-e |(n, m)|^2 at all frequencies. Cut off n and m after some sample. The sum over time is then above a
constant (a kernel that looks ahead meets outputs that are not limited any more, but the motion is bounded
and the kernel's first moment finite), and below c |(n, m)| - e |(n, m)|^2, with c of the state at the start.
So the sums of squares of n and m are bounded, whichever the sample, and the motion dies out.
"""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
import scipy.optimize as so
from jaxtyping import Complex, Float

from middeck.control.law.compensator import locate_ports
from middeck.control.qualification import align_plant
from middeck.errors import ConfigError, NumericalError
from middeck.realtime.gate.linear_law import linear_law
from middeck.realtime.package.l1_norms import bound_peaks
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.rounding_errors import unfold_law
from middeck.systems.plants.plant import Plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.state_space.balancing import balance

DELAYS = (1, 2, 4, 8, 16, 32)
DECAYS = np.exp(-1.0 / np.geomspace(2.0, 5000.0, 9))
"""Kernels, of either sign and both ways in time: delays of so many samples, and geometric series."""
MOST_LIMITS, MOST_STATES = 4, 60
"""Beyond them no proof is tried: it would cost tens of seconds."""
ROUNDS, PIVOTS, PIECES = 10, 3000, 1 << 16
EPSILON = np.finfo(float).eps
ROUNDING = 1e-11
"""Of the products in the sum, relative to their factors; a thousand times what they may err by."""
NOISES = np.geomspace(1e-6, 1e6, 7)
"""Of sensors, as shares of their ranges, where outputs take any value within their limits: powers."""
MOST_CONDITION, MOST_ERROR, SETTLINGS = 1e8, 1e-3, 30
SPARE = 1e-6
"""Added to the bound of what the law asks for: the error of that bound, and motions before they settle."""


NOT_FOUND = "no multipliers are found; smaller ranges of the sensors or larger limits may do"


class Limit(NamedTuple):
    """A limit that is reached: its output, whether it is one of slew, and the k of its sector."""

    output: int
    slew: bool
    sector: float


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


def why_unproved(package: ControllerPackage, plant: Plant) -> str:
    """Why it is not proved that motions within the sensors' ranges die out, whichever limits act when.

    Empty where it is proved: of the law at full authority, with what it learns of its outputs, and of no
    other limits than its own. A reason says nothing of the loop. No proof is tried for more than
    `MOST_LIMITS` limits or `MOST_STATES` states, limits that differ by sign, single precision, or a plant
    with a direct term.
    """
    try:
        with np.errstate(all="ignore"):  # what is no number proves nothing
            return _reason(package, plant)
    except (NumericalError, ConfigError) as error:
        return error.what
    except ValueError:  # of NumPy and SciPy
        return "numbers overflow"


def _reason(package: ControllerPackage, plant: Plant) -> str:
    if np.any(package.lower != -package.upper):
        return "limits differ by sign"
    if package.single:
        return "in single precision a motion dies out to the bound of its rounding only"
    parts = split_loop(package, plant)
    if np.any(parts.direct):
        return "a sensor answers an output in the same sample"
    states = len(parts.A) + len(parts.F)
    if states > MOST_STATES:
        return f"the loop has {states} states, the proof takes {MOST_STATES}"
    limits = reached_limits(package, bound_commands(package, parts))
    if len(limits) > MOST_LIMITS:
        return f"motions within ranges may reach {len(limits)} limits, the proof takes {MOST_LIMITS}"
    loop = close_loop(parts)
    if loop is None:
        return "the loop is too close to instability, or its modes to each other, for the digits computed"
    return "" if not limits or dies_out(loop, limits) else NOT_FOUND


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


def bound_commands(package: ControllerPackage, parts: Parts) -> Float[np.ndarray, " output"]:
    """Most that the law asks of each output once it has settled, with inputs and outputs within ranges.

    From sensors that may jump, as the law alone sees them; and from what an observer of the plant makes of
    inputs and outputs, which is what the sensors read once it has settled: the smoother, the less can jump.
    Each bound holds, and the least is taken. No output comes to exceed what is asked of it, which bounds it
    anew. Raises `NumericalError` without a bound.
    """
    law, m, n = parts.F - parts.E @ parts.K, len(parts.C), len(parts.A)
    by_y, none = parts.G - parts.E @ parts.D, np.zeros((len(law), m))
    direct = np.hstack([parts.D, np.zeros((len(parts.K), len(parts.K)))])
    peaks = [_peaks(law, np.hstack([by_y, parts.E]), parts.K, direct)]
    for gain in _observers(parts, package.input_range, package.upper):
        F = np.block([[parts.A - gain @ parts.C, np.zeros((n, len(law)))], [by_y @ parts.C, law]])
        G = np.block([[gain, parts.B], [none, parts.E]])
        peaks.append(_peaks(F, G, np.hstack([parts.D @ parts.C, parts.K]), 0.0 * direct))
    most = package.upper
    with np.errstate(invalid="ignore"):
        for _ in range(SETTLINGS):
            asked = np.min(peaks @ np.concatenate([package.input_range, most]), axis=0)
            most = np.clip(asked, np.finfo(float).tiny, most)
    if not np.isfinite(asked).all():
        raise NumericalError("what the law asks for has no bound", hint="ranges of inputs, limits")
    return np.asarray(asked)


def _observers(
    parts: Parts, reads: Float[np.ndarray, " input"], drives: Float[np.ndarray, " output"]
) -> list[Float[np.ndarray, "state input"]]:
    """Gains of Kalman predictors, sensors more and less believed; none where there is no such gain."""
    if not len(parts.A):
        return []
    moves, gains = parts.B * drives, []
    for noise in NOISES:
        R = noise * np.diag(reads**2)
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):
            S = sla.solve_discrete_are(parts.A.T, parts.C.T, moves @ moves.T, R)
            gains.append(np.linalg.solve(parts.C @ S @ parts.C.T + R, parts.C @ S @ parts.A.T).T)
    return gains


def _peaks(F: np.ndarray, G: np.ndarray, H: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Largest outputs for inputs of one, with what rounding may add; inf where no bound is found."""
    if not len(F):
        return np.asarray(np.abs(J) * (1.0 + SPARE))
    F, scale = balance(F)
    poles, vectors = np.linalg.eig(F)
    condition, radius = float(np.linalg.cond(vectors)), float(np.abs(poles).max())
    if not (radius < 1.0 and condition < MOST_CONDITION):
        return np.full_like(J, np.inf)
    error = len(F) * EPSILON * (1.0 + np.linalg.norm(F)) * condition * (condition + 8.0 / (1.0 - radius))
    if not error < MOST_ERROR:
        return np.full_like(J, np.inf)
    return np.asarray((1.0 + SPARE + error) * bound_peaks(F, G / scale[:, None], H * scale, J))


def reached_limits(package: ControllerPackage, asked: np.ndarray) -> list[Limit]:
    """Limits that commands of at most ``asked`` reach, and the sectors that these leave them."""
    found = [
        Limit(i, False, 1.0 - L / w)
        for i, (L, w) in enumerate(zip(package.upper, asked, strict=True))
        if w > L
    ]
    steps = asked + np.minimum(asked, package.upper)
    return found + [
        Limit(i, True, 1.0 - s / e) for i, (s, e) in enumerate(zip(package.slew, steps, strict=True)) if e > s
    ]


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


class _Form(NamedTuple):
    """The sum at some frequencies, a row for each force: what its terms multiply that force with."""

    kernels: Complex[np.ndarray, "kernel line"]
    moved: Complex[np.ndarray, "line force force"]
    sectors: Complex[np.ndarray, "line force force"]
    partners: Float[np.ndarray, "force force"]

    def sum(self, x: np.ndarray) -> np.ndarray:
        """Twice its Hermitian part for weights of each force: kernels, sector, partner with either sign."""
        count = len(self.kernels)
        own = np.conj(x[:, :count] @ self.kernels).T
        rows = own[:, :, None] * self.moved + x[:, count, None] * self.sectors
        rows = rows + (x[:, count + 1] - x[:, count + 2])[:, None] * self.partners
        return rows + np.conj(np.swapaxes(rows, 1, 2))

    def cut(self, line: int, v: np.ndarray) -> np.ndarray:
        """What each weight adds at a frequency in the direction ``v``."""
        moved = np.conj(v) * (self.moved[line] @ v)
        kernels = np.real(np.conj(self.kernels[:, line]) * moved[:, None])
        others = [np.real(np.conj(v) * (M @ v)) for M in (self.sectors[line], self.partners, -self.partners)]
        found = np.hstack([kernels, np.array(others).T]).ravel()
        return np.asarray(found / np.abs(found).max())


def form_sum(loop: Loop, limits: list[Limit], omega: np.ndarray) -> _Form:
    """The inequalities at frequencies ``omega`` [rad a sample], as forms of what is held back."""
    z = np.exp(1j * omega)
    on, slews = [limit.output for limit in limits], np.array([[limit.slew] for limit in limits], dtype=float)
    W = np.einsum("zk,kij->zij", 1.0 / (z[:, None] - loop.poles), loop.residues)
    asked, own = W[:, on][:, :, on], np.equal.outer(on, on).astype(float)
    before = (asked - own) / z[:, None, None]
    sector = np.array([[limit.sector] for limit in limits])
    eye = np.eye(len(limits))
    series = [(1.0 - a) / (z - a) for a in DECAYS]
    kernels = np.array([*(z**-n for n in DELAYS), *series])
    both = np.concatenate([kernels, np.conj(kernels)])
    return _Form(
        np.concatenate([np.ones((1, len(z))), 1.0 - both, 1.0 + both]),
        asked - own - slews * before, sector * (asked - slews * before) - eye, own - eye,
    )  # fmt: skip


def dies_out(loop: Loop, limits: list[Limit]) -> bool:
    """Weights by a linear programme; a direction in which their sum is not negative is one more row of it."""
    omega = _lines(loop)
    form = form_sum(loop, limits, omega)
    size = 1.0 / (1.0 + np.abs(form.moved).max(axis=(1, 2)) ** 2)
    sparse = range(0, len(omega), max(1, len(omega) // 150))
    rows = [form.cut(k, v) for k in sparse for v in np.eye(len(limits))]
    for _ in range(ROUNDS):
        found = _weigh(rows)
        if found is None:
            return False
        x = np.maximum(found[:-1], 0.0).reshape(len(limits), -1)  # a solver may stray below zero
        values, vectors = np.linalg.eigh(size[:, None, None] * form.sum(x))
        top = values[:, -1]
        if top.max() < 0.0:
            return _holds_between(loop, limits, x, omega)
        peaks = np.flatnonzero((top >= np.append(-np.inf, top[:-1])) & (top >= np.append(top[1:], -np.inf)))
        for k in peaks[np.argsort(-top[peaks])][:40]:
            rows += [form.cut(k, v) for v in vectors[k].T[values[k] > -size[k] * found[-1]]]
    return False


def _weigh(rows: list[np.ndarray]) -> np.ndarray | None:
    """Weights of sum one, and by how much their sum is negative in all ``rows``; None where it is not."""
    count = len(rows[0])
    least, one = np.append(np.zeros(count), -1.0), np.append(np.ones(count), 0.0)
    found = so.linprog(
        least, np.hstack([rows, np.ones((len(rows), 1))]), np.zeros(len(rows)), one[None], [1.0],
        bounds=[(0.0, None)] * count + [(None, 1.0)], method="highs", options={"maxiter": PIVOTS},
    )  # fmt: skip
    return np.asarray(found.x) if found.status == 0 and found.x[-1] > 1e-9 else None


def _lines(loop: Loop) -> np.ndarray:
    """Frequencies [rad a sample] from 0 to pi, dense about the poles."""
    poles = loop.poles[np.abs(loop.poles) > 0.3]
    away = np.geomspace(0.02, 300.0, 60)
    steps = np.concatenate([-away, [0.0], away])
    near = np.abs(np.angle(poles))[:, None] + (1.0 - np.abs(poles))[:, None] * steps
    found = np.concatenate([np.geomspace(1e-6, np.pi, 600), np.linspace(0.0, np.pi, 200), near.ravel()])
    return np.unique(found[(found >= 0.0) & (found <= np.pi)])


def _holds_between(loop: Loop, limits: list[Limit], x: np.ndarray, omega: np.ndarray) -> bool:
    """Whether the sum is negative at all frequencies.

    Between two of them it lies no more than h^2 / 8 of its curvature above the line that joins its values.
    """
    low, high, seen = omega[:-1], omega[1:], 0
    while len(low):
        seen += len(low)
        if seen > PIECES or np.any(high - low < 1e-14):
            return False
        ends = [form_sum(loop, limits, w).sum(x) for w in (low, high)]
        top = np.max([np.linalg.eigvalsh(P)[:, -1] for P in ends], axis=0)
        if not np.all(top < 0.0):
            return False
        rounding, curvature = bound_sum(loop, limits, x, low, high)
        left = ~(top + curvature * (high - low) ** 2 / 8.0 + rounding < 0.0)  # what is no number is left too
        middle = 0.5 * (low + high)[left]
        low, high = np.append(low[left], middle), np.append(middle, high[left])
    return True


def bound_sum(
    loop: Loop, limits: list[Limit], x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """In each piece, by its distance from poles: the sum's error of rounding, and its second derivative."""
    z, half = np.exp(0.5j * (low + high)), 0.5 * (high - low)
    ones, count, n = np.ones_like(half), len(DELAYS), np.array(DELAYS, dtype=float)
    twice = np.sqrt(2.0)  # an output has two forces at most
    W = twice * _bounds(z, half, loop.poles, np.linalg.norm(loop.residues, axis=(1, 2)))
    sides = [_bounds(z, half, loop.poles, size)[0] for size in (loop.out, loop.into)]
    moves = twice * loop.blur * sides[0] * sides[1]
    u = W + twice * np.array([ones, 0.0 * ones, 0.0 * ones])
    change = np.array([np.minimum(2.0, high), ones, ones])
    rounding, curvature = np.zeros_like(half), np.zeros_like(half)
    for limit, weights in zip(limits, x, strict=True):
        signed = weights[1:-3].reshape(4, -1).sum(axis=0)
        kernel = _bounds(z, half, DECAYS, signed[count:] * (1.0 - DECAYS))
        kernel += np.outer(
            [weights[:-3].sum() + signed[:count].sum(), signed[:count] @ n, signed[:count] @ n**2], ones
        )
        by_kernel = _product(kernel, _product(change, u) if limit.slew else u)
        sector = W + limit.slew * _product(np.array([ones, ones, ones]), u)
        # Products round by what they multiply before they cancel, 1 - 1 / z by that of ones.
        size = kernel[0] * u[0] * 2.0 + weights[-3] * (1.0 + sector[0]) + weights[-2:].sum()
        rounding += ROUNDING * size + (kernel[0] + weights[-3]) * (1.0 + limit.slew) * moves
        curvature += by_kernel[2] + weights[-3] * sector[2]
    return 2.0 * rounding, 2.0 * curvature


def _bounds(z: np.ndarray, half: np.ndarray, poles: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Of sum sizes / (z - poles) on the circle, of its first and of its second derivative, in each piece."""
    with np.errstate(divide="ignore", invalid="ignore"):
        near = 1.0 / np.maximum(np.abs(z[:, None] - poles) - half[:, None], 0.0)
        return np.array([near @ sizes, near**2 @ sizes, (near**2 + 2.0 * near**3) @ sizes])


def _product(f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Bounds of a product and its derivatives from those of its factors."""
    return np.array([f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2]])

"""C (p I - A)^-1 B + D at many points p: by solving, by substitution in Schur form, or by poles.

For many lines A is reduced once to a form in which a line costs n^2 (Schur: backward stable for every A) or n
(poles: well-conditioned eigenvectors only). Laub 1981 (IEEE TAC 26, "Efficient multivariable frequency
response computations") uses the Hessenberg form instead.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Complex, Float

from middeck.errors import NumericalError
from middeck.systems.poles.refined_poles import PoleForm, refine_poles
from middeck.systems.poles.state_units import balance_states
from middeck.systems.poles.strong_components import component_schur
from middeck.systems.state_space.second_order import sum_second_order
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

FEW_LINES = 32
"""Number of lines up to which solving costs no more than a reduction."""
CHUNK_BYTES = 2**20
"""Numbers processed at once: about the cache of a core."""
ROWS = 24
"""Rows of the Schur form taken by substitution before the next matrix product."""


System = StateSpace | SampledStateSpace
Resolvent = Callable[[np.ndarray], np.ndarray]


def evaluate_transfer(
    system: System, points: Complex[np.ndarray, " line"]
) -> Complex[np.ndarray, "line output input"]:
    """C (p I - A)^-1 B + D at ``points``, by the cheapest way as accurate as solving."""
    if not len(system.A):
        return np.broadcast_to(system.D.astype(complex), (len(points), *system.D.shape)).copy()
    if len(points) <= FEW_LINES:
        return by_solving(system)(points)
    balanced = balance_states(system)
    form = refine_poles(balanced.A, balanced.B, balanced.C)
    if form is None:
        return by_schur_form(balanced)(points)
    if system.period_s is not None:
        return by_poles(form)(points) + system.D
    return on_axis(form, np.imag(points)) + system.D


def by_solving(system: System) -> Resolvent:
    """A factorisation for each line."""

    def evaluate(points: np.ndarray) -> np.ndarray:
        pencil = points[:, None, None] * np.eye(len(system.A)) - system.A
        try:
            states = np.linalg.solve(pencil, np.broadcast_to(system.B, (len(points), *system.B.shape)))
        except np.linalg.LinAlgError as error:
            raise NumericalError(
                "a response cannot be computed: to rounding, one of its frequencies is a pole",
                hint="other frequencies, or states of like sizes, as modal ones",
            ) from error
        return np.asarray(system.C @ states + system.D)

    return evaluate


def entry_sensitivity(
    system: StateSpace, omega: Float[np.ndarray, " line"]
) -> Float[np.ndarray, "line output input"]:
    """|C R| |A| |R B| with R = (jw I - A)^-1: sensitivity of C R B to relative changes of the entries of
    A."""
    n, m = system.B.shape
    both = StateSpace(system.A, np.hstack([system.B, np.eye(n)]), np.eye(n), np.zeros((n, m + n)))
    R = by_solving(both)(1j * omega)
    return np.abs(system.C @ R[:, :, m:]) @ np.abs(system.A) @ np.abs(R[:, :, :m])


def by_poles(form: PoleForm) -> Resolvent:
    """The sum over poles without the direct term: a reciprocal a pole and line, one product."""
    residues, shape = _residues(form), (len(form.C), form.B.shape[1])

    def evaluate(points: np.ndarray) -> np.ndarray:
        H = np.empty((len(points), residues.shape[1]), dtype=complex)
        for some in _chunks(len(points), len(residues)):
            np.matmul(1.0 / (points[some, None] - form.values), residues, out=H[some])
        return H.reshape(len(points), *shape)

    return evaluate


def on_axis(form: PoleForm, omega: Float[np.ndarray, " line"]) -> Complex[np.ndarray, "line output input"]:
    """`by_poles` at j ``omega``, each conjugate pair by its upper pole, in real arithmetic."""
    residues = _residues(form)
    value, residue = form.values[form.upper], residues[form.upper]
    # r / (s - p) + its conjugate = (2 Re(r) s - 2 Re(r conj(p))) / (s^2 - 2 Re(p) s + |p|^2).
    constant, slope = -2.0 * np.real(residue * np.conj(value)[:, None]), 2.0 * np.real(residue)
    pairs = sum_second_order(omega, -2.0 * np.real(value), np.abs(value) ** 2, (constant, slope))
    if form.single.any():
        pairs += (1.0 / (1j * omega[:, None] - form.values[form.single])) @ residues[form.single]
    return pairs.reshape(len(omega), len(form.C), form.B.shape[1])


def _residues(form: PoleForm) -> Complex[np.ndarray, "pole port"]:
    return (form.B[:, None, :] * form.C.T[:, :, None]).reshape(len(form.values), -1)


def by_schur_form(system: System) -> Resolvent:
    """Back substitution in complex Schur form, many lines at once: n^2 a line, and stable.

    Each strongly connected component of A keeps a form of its own, so that equal poles
    in cascade stay equal.
    From the side of the fewer ports: the transposed system, its states in reverse, is upper triangular too.
    """
    form, Q = component_schur(system.A)
    into, out = Q.conj().T @ system.B, system.C @ Q
    turned = into.shape[1] > len(out)
    if turned:
        form, into, out = np.ascontiguousarray(form[::-1, ::-1].T), out[:, ::-1].T, into[::-1].T

    def evaluate(points: np.ndarray) -> np.ndarray:
        H = np.empty((len(points), len(out), into.shape[1]), dtype=complex)
        for some in _chunks(len(points), into.size):
            ports = out @ _substitute(form, into, points[some])
            H[some] = np.moveaxis(ports.reshape(len(out), into.shape[1], -1), 2, 0)
        return (H.transpose(0, 2, 1) if turned else H) + system.D

    return evaluate


def _substitute(T: np.ndarray, B: np.ndarray, points: np.ndarray) -> Complex[np.ndarray, "state column"]:
    """(p I - T)^-1 B for upper triangular T, a block of rows at a time; columns: inputs, then points."""
    n, inputs = B.shape
    x = np.repeat(B, len(points), axis=1)
    resolved = np.tile(1.0 / (points - np.diag(T)[:, None]), inputs)
    for end in range(n, 0, -ROWS):
        start = max(end - ROWS, 0)
        x[start:end] += T[start:end, end:] @ x[end:]
        for i in reversed(range(start, end)):
            x[i] += T[i, i + 1 : end] @ x[i + 1 : end]
            x[i] *= resolved[i]
    return x


def _chunks(lines: int, numbers: int) -> list[slice]:
    """Lines in parts whose complex intermediate, ``numbers`` a line, stays near the processor."""
    step = max(CHUNK_BYTES // (16 * max(numbers, 1)), 1)
    return [slice(k, k + step) for k in range(0, lines, step)]

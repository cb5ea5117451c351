"""A model at given unknowns: columns of the linear ones, slopes by theta, residual and Jacobian."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.layout import Layout, Point, unpack
from middeck.identification.problem.terms import Fractions, columns, fractions, slopes
from middeck.identification.problem.transient import transient_columns, transient_slopes


class Terms:
    """What all outputs share at one theta: partial fractions, and ``B`` of the transients (or no columns)."""

    def __init__(self, layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> None:
        self._layout, self._data = layout, data
        self.point: Point = unpack(layout, theta)
        self.parts: Fractions = fractions(layout, self.point.poles, data.s)
        self.B: Complex[np.ndarray, "column line"] = (
            np.zeros((0, len(data.s)), dtype=complex)
            if data.transient is None
            else transient_columns(layout, self.point, data.transient, data.s)
        )

    @functools.cached_property
    def X(self) -> Complex[np.ndarray, "column line experiment"]:
        """Columns of the model's linear unknowns, without delay; not all evaluations need them."""
        return columns(self._layout, self.point, self.parts, self._data.s, self._data.drive)

    @property
    def finite(self) -> bool:
        """False where a trial step has gone too far."""
        numbers = (self.parts.upper, self.parts.lower, self.point.b, self.point.delay_s, self.B)
        return all(bool(np.isfinite(x).all()) for x in numbers)


def build_terms(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Terms | None:
    """The terms at ``theta``; None where they are not finite, as a trial step may have it."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        terms = Terms(layout, data, theta)
    return terms if terms.finite else None


def late_columns(
    layout: Layout, data: Data, terms: Terms, output: int
) -> Complex[np.ndarray, "column line experiment"]:
    """Columns of the response of one output, its delays included."""
    late = late_of(data, terms, output)
    if data.drive is None or late.shape[1] == 1:
        return terms.X * late
    return columns(layout, terms.point, terms.parts, data.s, data.drive * late[:, :, None])


def late_slopes(
    layout: Layout, data: Data, terms: Terms, linear: Float[np.ndarray, " column"], output: int
) -> Complex[np.ndarray, "unknown line experiment"]:
    """Slopes of one output by theta, those of its delays and of its transients included."""
    x, t = split_linear(layout, data, linear)
    G = np.zeros((layout.size, *data.H.shape[1:]), dtype=complex)
    late = late_of(data, terms, output)
    if data.drive is None or late.shape[1] == 1:
        by_terms = slopes(layout, terms.point, terms.parts, x, data.s, data.drive) * late
    else:
        by_terms = slopes(layout, terms.point, terms.parts, x, data.s, data.drive * late[:, :, None])
    G[: len(by_terms)] = by_terms
    if layout.options.delay_of:
        first = len(by_terms) + (0 if layout.options.delay_of == "common" else output * late.shape[1])
        G[first : first + late.shape[1]] = _delay_slopes(layout, data, terms, x, late)
    if data.transient is not None:
        by_poles = transient_slopes(layout, terms.point, data.transient, data.s, t)
        G[: len(by_poles)] += by_poles
    return G


def late_of(data: Data, terms: Terms, output: int) -> Complex[np.ndarray, "line path"]:
    """exp(-s tau) of one output: for all its paths, or for each."""
    return np.exp(-data.s[:, None] * terms.point.delay_s[output])


def _delay_slopes(
    layout: Layout, data: Data, terms: Terms, x: np.ndarray, late: np.ndarray
) -> Complex[np.ndarray, "delay line experiment"]:
    """By the delays of one output: the response of each path, or of all of them together."""
    rate = -data.s[:, None]
    if late.shape[1] == 1:
        return (rate * late * np.tensordot(x, terms.X, axes=1))[None]
    each = columns(layout, terms.point, terms.parts, data.s) if data.drive is not None else terms.X
    path = rate * late * np.tensordot(x, each, axes=1)
    drive = np.eye(layout.inputs)[None] if data.drive is None else data.drive
    return np.moveaxis(path[:, :, None] * drive, 1, 0)


def split_linear(
    layout: Layout, data: Data, linear: Float[np.ndarray, " column"]
) -> tuple[Float[np.ndarray, " column"], Float[np.ndarray, "experiment column"]]:
    """The linear unknowns of one output: those of the model, and those of each column's transient."""
    experiments = data.H.shape[2]
    return linear[: layout.columns], linear[layout.columns :].reshape(experiments, -1)


def residual_of(
    layout: Layout,
    data: Data,
    theta: Float[np.ndarray, " unknown"],
    linear: Float[np.ndarray, "output column"],
) -> Complex[np.ndarray, "output line column"]:
    """H - E, unweighted."""
    terms = build_terms(layout, data, theta)
    if terms is None:
        return np.full(data.H.shape, np.inf, dtype=complex)
    return np.stack(
        [data.H[o] - model_of_output(layout, data, terms, linear[o], o) for o in range(layout.outputs)]
    )


def model_of_output(
    layout: Layout, data: Data, terms: Terms, linear: Float[np.ndarray, " column"], output: int
) -> Complex[np.ndarray, "line column"]:
    """E of one output: its response or spectra, transients included."""
    x, t = split_linear(layout, data, linear)
    return np.tensordot(x, late_columns(layout, data, terms, output), axes=1) + (t @ terms.B).T

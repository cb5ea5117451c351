"""A model at given unknowns: columns of the linear ones, slopes by theta, residual and Jacobian."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.fit_data import Data
from middeck.identification.terms import Fractions, Layout, Point, columns, fractions, slopes, unpack
from middeck.identification.transient import transient_columns, transient_slopes


class Terms(NamedTuple):
    """What all outputs share at one theta: ``X`` without delay, ``B`` of the transients (or no columns)."""

    point: Point
    parts: Fractions
    X: Complex[np.ndarray, "column line experiment"]
    B: Complex[np.ndarray, "column line"]


def build_terms(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Terms | None:
    """The terms at ``theta``; None where they are not finite, as a trial step may have it."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        point = unpack(layout, theta)
        parts = fractions(layout, point.poles, data.s)
        X = columns(layout, point, parts, data.s, data.drive)
        B = (
            np.zeros((0, len(data.s)), dtype=complex)
            if data.transient is None
            else transient_columns(layout, point, data.transient, data.s)
        )
    return Terms(point, parts, X, B) if np.isfinite(X).all() and np.isfinite(B).all() else None


def late_columns(data: Data, terms: Terms, output: int) -> Complex[np.ndarray, "column line experiment"]:
    """Columns of the response of one output, its delay included."""
    return terms.X * _late(data, terms, output)


def late_slopes(
    layout: Layout, data: Data, terms: Terms, linear: Float[np.ndarray, " column"], output: int
) -> Complex[np.ndarray, "unknown line experiment"]:
    """Slopes of one output by theta, those of its delay and of its transients included."""
    late = _late(data, terms, output)
    x, t = split_linear(layout, data, linear)
    G = np.zeros((count_theta(layout), *data.H.shape[1:]), dtype=complex)
    shared = len(G) - layout.outputs * layout.with_delay
    G[:shared] = slopes(layout, terms.point, terms.parts, x, data.drive) * late
    if layout.with_delay:
        G[shared + output] = -data.s[:, None] * late * np.tensordot(x, terms.X, axes=1)
    if data.transient is not None:
        by_poles = transient_slopes(layout, terms.point, data.transient, data.s, t)
        G[: len(by_poles)] += by_poles
    return G


def _late(data: Data, terms: Terms, output: int) -> Complex[np.ndarray, "line 1"]:
    return np.exp(-data.s * terms.point.delay_s[output])[:, None]


def count_theta(layout: Layout) -> int:
    """Unknowns that are not linear."""
    return layout.unknowns - layout.outputs * layout.columns


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
    return np.tensordot(x, terms.X, axes=1) * _late(data, terms, output) + (t @ terms.B).T


def jacobian(
    layout: Layout,
    data: Data,
    theta: Float[np.ndarray, " unknown"],
    linear: Float[np.ndarray, "output column"],
) -> Complex[np.ndarray, "unknown output line column"]:
    """Derivative of E by all unknowns: theta, then the linear ones of each output, transients' last."""
    terms = build_terms(layout, data, theta)
    shared, each = len(theta), linear.shape[1]
    J = np.zeros((shared + linear.size, *data.H.shape), dtype=complex)
    if terms is None:
        return np.full(J.shape, np.inf)
    transients = _all_transients(terms.B, data.H.shape[2])
    for o in range(layout.outputs):
        own = slice(shared + o * each, shared + (o + 1) * each)
        J[:shared, o] = late_slopes(layout, data, terms, linear[o], o)
        J[own, o] = np.concatenate([late_columns(data, terms, o), transients])
    return J


def _all_transients(B: np.ndarray, experiments: int) -> Complex[np.ndarray, "column line experiment"]:
    """The transients' columns, each of one experiment only, experiment by experiment."""
    return np.einsum("ql,ek->eqlk", B, np.eye(experiments)).reshape(-1, B.shape[1], experiments)

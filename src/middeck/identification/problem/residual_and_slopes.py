"""A model at given unknowns: columns of the linear ones, slopes by theta, residual and Jacobian."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Complex, Float

from middeck.identification.problem.data import Data
from middeck.identification.problem.terms import Driven, Fractions, columns, drive_terms, fractions, slopes
from middeck.identification.problem.transient import (
    FreeMotion,
    free_motion,
    transient_columns,
    transient_slopes,
)
from middeck.identification.problem.unknowns_layout import Layout, Point, unpack

# A round of reweighting ends where a search did, and the next begins there: so many thetas are kept, unless
# each has so many numbers.
LATEST, LARGE = 3, 1e6


class _OfTheta:
    """What depends on theta and on no weight."""

    def __init__(self, layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> None:
        self.layout = layout
        self.point: Point = unpack(layout, theta)
        self.parts: Fractions = fractions(layout, self.point.poles, data.s)
        self.motion: FreeMotion | None = (
            None if data.transient is None else free_motion(self.point.poles, data)
        )
        self.B: Complex[np.ndarray, "column line"] = (
            np.zeros((0, len(data.s)), dtype=complex)
            if self.motion is None
            else transient_columns(layout, self.motion, data)
        )
        self.delay_factors: dict[int, np.ndarray] = {}
        self.X: Complex[np.ndarray, "column line experiment"] | None = None
        self.driven: Driven | None = None

    @functools.cached_property
    def finite(self) -> bool:
        """False where a trial step has gone too far."""
        numbers = (self.parts.upper, self.parts.lower, self.point.b, self.point.delay_s, self.B)
        return all(bool(np.isfinite(x).all()) for x in numbers)


class Terms:
    """A model at one theta: partial fractions, and ``B`` of the transients (or no columns)."""

    def __init__(
        self, layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"], known: _OfTheta | None = None
    ) -> None:
        self.layout, self.data = layout, data
        self._known = _OfTheta(layout, data, theta) if known is None else known
        self.point, self.parts = self._known.point, self._known.parts
        self.motion, self.B = self._known.motion, self._known.B

    @property
    def X(self) -> Complex[np.ndarray, "column line experiment"]:
        """Columns of the model's linear unknowns, without delay; not all evaluations need them."""
        if self._known.X is None:
            self._known.X = columns(
                self.layout, self.point, self.parts, self.data.s, self.data.drive, self.driven
            )
        return self._known.X

    @property
    def driven(self) -> Driven:
        """Drive of the terms of every output, without delay."""
        if self._known.driven is None:
            self._known.driven = drive_terms(self.point, self.data.drive)
        return self._known.driven

    def delay_factors(self, output: int) -> Complex[np.ndarray, "line path"]:
        """exp(-s tau) of one output: for all its paths, or for each."""
        found = self._known.delay_factors
        if output not in found:
            found[output] = np.exp(-self.data.s[:, None] * self.point.delay_s[output])
        return found[output]

    def split(
        self, linear: Float[np.ndarray, " column"]
    ) -> tuple[Float[np.ndarray, " column"], Float[np.ndarray, "experiment column"]]:
        """The linear unknowns of one output: those of the model, and those of each column's transient."""
        own = self.layout.columns
        return linear[:own], linear[own:].reshape(self.data.H.shape[2], -1)

    def columns(self, output: int) -> Complex[np.ndarray, "column line experiment"]:
        """Columns of the response of one output, its delays included."""
        factors, drive = self.delay_factors(output), self.data.drive
        if drive is None or factors.shape[1] == 1:
            return self.X * factors
        return columns(self.layout, self.point, self.parts, self.data.s, drive * factors[:, :, None])

    def response(
        self, linear: Float[np.ndarray, " column"], output: int
    ) -> Complex[np.ndarray, "line column"]:
        """E of one output: its response or spectra, transients included."""
        x, t = self.split(linear)
        return combined(x, self.columns(output)) + (t @ self.B).T

    def slopes(
        self, linear: Float[np.ndarray, " column"], output: int
    ) -> Complex[np.ndarray, "unknown line experiment"]:
        """Slopes of one output by theta, those of its delays and of its transients included."""
        layout, data, (x, t) = self.layout, self.data, self.split(linear)
        factors = self.delay_factors(output)
        if data.drive is None or factors.shape[1] == 1:
            by_terms = slopes(layout, self.point, self.parts, x, data.s, data.drive, self.driven)
            by_terms *= factors
        else:
            by_terms = slopes(layout, self.point, self.parts, x, data.s, data.drive * factors[:, :, None])
        G = by_terms
        if delay_of := layout.options.delay_of:
            G = np.zeros((layout.size, *data.H.shape[1:]), dtype=complex)
            G[: len(by_terms)] = by_terms
            first = len(by_terms) + (0 if delay_of == "common" else output * factors.shape[1])
            G[first : first + factors.shape[1]] = self._delay_slopes(x, factors)
        if self.motion is not None:
            by_poles = transient_slopes(layout, self.point, self.motion, t)
            G[: len(by_poles)] += by_poles
        return G

    def _delay_slopes(
        self, x: np.ndarray, factors: np.ndarray
    ) -> Complex[np.ndarray, "delay line experiment"]:
        """Derivatives by the delays of one output: the response of each path, or of all together."""
        s, drive = self.data.s, self.data.drive
        rate = -s[:, None]
        if factors.shape[1] == 1:
            return (rate * factors * combined(x, self.X))[None]
        each = self.X if drive is None else columns(self.layout, self.point, self.parts, s)
        path = rate * factors * combined(x, each)
        drive = np.eye(self.layout.inputs)[None] if drive is None else drive
        return (path[:, :, None] * drive).swapaxes(0, 1)


def combined(
    x: Float[np.ndarray, " column"], columns: Complex[np.ndarray, "column line experiment"]
) -> Complex[np.ndarray, "line experiment"]:
    """The sum of columns, each by its own real number."""
    # `np.tensordot` itself, less its preparations, which take as long.
    return np.dot(x[None], columns.reshape(len(x), -1)).reshape(columns.shape[1:])


def build_terms(layout: Layout, data: Data, theta: Float[np.ndarray, " unknown"]) -> Terms | None:
    """The terms at ``theta``; None where they are not finite, as a trial step may have it."""
    latest, key = data.at_latest_thetas, theta.tobytes()
    known = latest.get(key)
    if known is None or known.layout is not layout:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            latest[key] = known = _OfTheta(layout, data, theta)
        most = LATEST if layout.columns * data.H[0].size < LARGE else 0
        while len(latest) > most:
            del latest[next(iter(latest))]
    return Terms(layout, data, theta, known) if known.finite else None


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
    return np.stack([data.H[o] - terms.response(linear[o], o) for o in range(layout.outputs)])

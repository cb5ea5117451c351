"""The law of a package sample by sample, in the order of rounding that every computer of it keeps.

Columns are added one after another, so that no sum is associated anew; products are rounded before they are
added. Inputs come first and the states' own terms, the largest, last: they meet the fewest roundings. C,
engine and small processors do the same and give the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import SMALLEST, Section
from middeck.realtime.package.package import ControllerPackage, largest

Array = np.ndarray
Part = TypeVar("Part", float, np.floating)


def fade_at(part: Part) -> Part:
    """3 s^2 - 2 s^3 of a part of a ramp, 0 to 1: no corner at either end, and no library to compute it."""
    return part * part * (3.0 - 2.0 * part)


class ReferenceLaw:
    """The law from reset on: `compute`, then `commit` with what was really applied; `step` is both.

    With ``fast`` the states move by one stacked product, whose sums are associated as the library likes: the
    same to some 1e-12, several times as fast, and in double precision whatever the package's.

    Attributes:
        engaged, level: Whether the ramp rises, and where it stands.
    """

    def __init__(self, package: ControllerPackage, *, fast: bool = False) -> None:
        self.package = package
        self.real = np.float32 if package.single and not fast else np.float64
        real, core = self.real, package.core
        self.x: Array = np.zeros(len(core.A), real)
        self.next, self.wanted = self.x, np.zeros(len(package.outputs), real)
        self.last = np.zeros(len(package.outputs), real)
        self.held = np.zeros(len(package.inputs), real)
        self.filters = [SectionState(place.section, real) for place in package.filters]
        self.paths = [SectionState(path.section, real) for path in package.paths]
        most = largest(package.single)
        self.range, self.lower, self.upper, self.slew = (
            np.clip(limit, -most, most).astype(real)
            for limit in (package.input_range, package.lower, package.upper, package.slew)
        )
        self.engaged, self.level = True, 0
        self.advance = _stacked(core) if fast else _advance_of(core, real)

    def step(self, y: Float[np.ndarray, " input"]) -> Float[np.ndarray, " output"]:
        """The outputs for ``y``, taken as applied."""
        u = self.compute(y)
        self.commit(u)
        return u

    def compute(self, y: Float[np.ndarray, " input"]) -> Float[np.ndarray, " output"]:
        """The outputs for ``y`` after fade, slew and limits."""
        with np.errstate(all="ignore"):  # as in C: what grows beyond the numbers is limited
            self.held = self._within_range(np.asarray(y).astype(self.real))
            c, self.next = self.advance(self.x, self._filtered(self.held))
            p = self._inner_loop(self.held)
            self.wanted = p + c
            return self._limited(p + self.fade() * c, p)

    def commit(self, applied: Float[np.ndarray, " output"]) -> None:
        """End the sample: what was ``applied`` moves the states."""
        with np.errstate(all="ignore"):
            applied = np.asarray(applied).astype(self.real)
            x, core = self.next, self.package.core
            columns = (
                core.E.T.astype(self.real) if core.drives else ()
            )  # as in C: else none is zero times inf
            for column, missing in zip(columns, applied - self.wanted, strict=core.drives):
                if missing != 0.0:
                    x = x + column * missing
            self.x, self.last = np.where(np.abs(x) < SMALLEST[self.real], self.real(0.0), x), applied
        if self.engaged:
            self.level = min(self.level + 1, self.package.ramp)
        else:
            self.level = max(self.level - 1, 0)

    def fade(self) -> np.floating:
        """The fade at this place of the ramp, in the package's precision."""
        if self.package.ramp == 0:
            return self.real(1.0 if self.engaged else 0.0)
        return fade_at(self.real(self.level) / self.real(self.package.ramp))

    def _within_range(self, y: Array) -> Array:
        """An input that is no number keeps its last value; one beyond its range is taken as its end."""
        y = np.where(np.isfinite(y), y, self.held)
        return np.where(y > self.range, self.range, np.where(y < -self.range, -self.range, y))

    def _filtered(self, y: Array) -> Array:
        filtered = y.copy()
        for place, section in zip(self.package.filters, self.filters, strict=True):
            filtered[place.input] = section.step(filtered[place.input])
        return filtered

    def _inner_loop(self, y: Array) -> Array:
        p = np.zeros(len(self.package.outputs), self.real)
        for path, section in zip(self.package.paths, self.paths, strict=True):
            p[path.output] += section.step(y[path.input])
        return p

    def _limited(self, t: Array, p: Array) -> Array:
        """Slew, then size; where the command is no number the inner loop stands alone, or zero."""
        t = np.where(np.isnan(t), np.where(np.isnan(p), self.real(0.0), p), t)
        low, high = self.last - self.slew, self.last + self.slew
        t = np.where(t < low, low, np.where(t > high, high, t))
        return np.where(t < self.lower, self.lower, np.where(t > self.upper, self.upper, t))


class SectionState:
    """A section and what it remembers."""

    def __init__(self, section: Section, real: type[np.floating] = np.float64) -> None:
        self.b, self.a = section.b.astype(real), section.a.astype(real)
        self.s1 = self.s2 = self.zero = real(0.0)
        self.smallest = real(SMALLEST[real])

    def step(self, value: np.floating) -> np.floating:
        """Its output for the next value."""
        out = self.b[0] * value + self.s1
        self.s1 = self._kept((self.b[1] * value - self.a[0] * out) + self.s2)
        self.s2 = self._kept(self.b[2] * value - self.a[1] * out)
        return out

    def _kept(self, value: np.floating) -> np.floating:
        return self.zero if abs(value) < self.smallest else value


def _advance_of(core: Core, real: type[np.floating]) -> Callable[[Array, Array], tuple[Array, Array]]:
    """(x, y) to (c, next x)."""
    A, B, C, D = (matrix.astype(real) for matrix in (core.A, core.B, core.C, core.D))
    n = len(A)

    p = core.pairs or 0
    upper, lower, diagonal = np.diag(A, p)[:p], np.diag(A, -p)[:p], np.diag(A)

    def add_states(moved: Array, x: Array) -> Array:
        if core.pairs is None:
            return _add(moved, A, x)
        moved[:p] += upper * x[p : 2 * p]
        moved[p : 2 * p] += lower * x[:p]
        return moved + diagonal * x

    def advance(x: Array, y: Array) -> tuple[Array, Array]:
        c = _add(_add(np.zeros(len(C), real), D, y), C, x)
        return c, add_states(_add(np.zeros(n, real), B, y), x)

    return advance


def _stacked(core: Core) -> Callable[[Array, Array], tuple[Array, Array]]:
    stacked, outputs = np.block([[core.C, core.D], [core.A, core.B]]), len(core.C)

    def advance(x: Array, y: Array) -> tuple[Array, Array]:
        both = stacked @ np.concatenate([x, y])
        return both[:outputs], both[outputs:]

    return advance


def _add(total: Array, columns: Array, values: Array) -> Array:
    """One term after the other, as in C."""
    return np.add.accumulate(np.vstack([total, columns.T * values[:, None]]), axis=0)[-1]

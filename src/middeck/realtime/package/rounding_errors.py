"""What rounding can do to a law in single precision: every operation as a source of a bounded error.

Each sum that the law computes is followed term by term. A product errs by u |term|, an addition by u times
the partial sum, a coefficient by half a unit in its last place, the most that single precision cuts from it
(Higham 2002, chapters 3 and 4): the bound follows from the rounded numbers alone. The errors travel through
the law as its signals do; the l1 norm of that path bounds what comes out.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from middeck.realtime.package.filter_sections import SMALLEST, Section
from middeck.realtime.package.package import ControllerPackage
from middeck.values import record

UNIT = 2.0**-24
"""Half a unit in the last place of one."""
LEAST = SMALLEST[np.float32]
"""What a sum may err by where it is taken as zero; a product below the normal numbers errs by far less."""

Array = np.ndarray


@record(kw_only=True)
class Sum:
    """One rounded sum: coefficients, the signals they multiply, and the most that was cut from each."""

    coefficients: Float[np.ndarray, " term"]
    signals: Int[np.ndarray, " term"]
    cut: Float[np.ndarray, " term"]


@record(kw_only=True)
class LinearLaw:
    """A law between its limits as x+ = F x + G v, s = H x + J v, with every partial result a signal of s.

    The inputs v are y, then e (the command applied less the one wanted), then an error added to each sum.

    Attributes:
        sums: Each sum, in order; its result is the signal ``first + k``.
        first: The signals before: states, y, e.
        wanted, law, loop: The signals p + c, c and p of each output.
    """

    F: Float[np.ndarray, "state state"]
    G: Float[np.ndarray, "state v"]
    H: Float[np.ndarray, "signal state"]
    J: Float[np.ndarray, "signal v"]
    sums: tuple[Sum, ...]
    first: int
    wanted: tuple[int, ...]
    law: tuple[int, ...]
    loop: tuple[int, ...]


@functools.lru_cache(maxsize=4)  # a gate asks at every step for that of one package or two
def unfold_law(package: ControllerPackage, *, single: bool = True) -> LinearLaw:
    """The sums of ``package`` in their order, with coefficients in single precision or as they are."""
    return _Unfolding(package, single).done()


def rounding_of(sums: Sequence[Sum], peaks: Float[np.ndarray, " signal"]) -> Float[np.ndarray, " sum"]:
    """The largest error of each sum, where each signal stays within ``peaks``."""
    errors = np.empty(len(sums))
    for k, one in enumerate(sums):
        reach = peaks[one.signals]
        terms = np.abs(one.coefficients) * reach
        inexact = np.abs(one.coefficients) != 1.0  # a product with one is exact
        added = np.cumsum(terms)[1:].sum()
        errors[k] = UNIT * (terms[inexact].sum() + added) + one.cut @ reach + LEAST * len(terms)
    # (1 + u)^n of n terms, of which no law has more than 2000.
    return errors * (1.0 + 1e-3)


def reach_of(sums: Sequence[Sum], peaks: Float[np.ndarray, " signal"]) -> float:
    """The largest that a product or partial sum can become: terms that cancel count in full."""
    return max((float(np.abs(one.coefficients) @ peaks[one.signals]) for one in sums), default=0.0)


class _Unfolding:
    """Runs the law once on rows: each signal as a row over states, inputs and errors."""

    def __init__(self, package: ControllerPackage, single: bool) -> None:
        self.package, core = package, package.core
        self.kept = np.float32 if single else np.float64
        n, m, p = len(core.A), len(package.inputs), len(package.outputs)
        self.sections = [place.section for place in (*package.filters, *package.paths)]
        self.states = n + 2 * len(self.sections)
        self.first = self.states + m + p
        most = 3 * len(self.sections) + n + 4 * p + len(package.paths) + m
        self.rows = np.eye(self.first + most) * (np.arange(self.first + most) < self.first)
        self.sums: list[Sum] = []

    def done(self) -> LinearLaw:
        package, core = self.package, self.package.core
        n, m, p = len(core.A), len(package.inputs), len(package.outputs)
        y = [self.states + j for j in range(m)]
        e = [self.states + m + i for i in range(p)]
        taken = [self.add([], [], [j], rounded=True) for j in y]  # an input becomes a number of 24 bits
        filtered, nexts, loop = list(taken), [], [[] for _ in range(p)]
        for k, place in enumerate(package.filters):
            filtered[place.input] = self.section(place.section, filtered[place.input], n + 2 * k, nexts)
        for k, path in enumerate(package.paths, len(package.filters)):
            out = self.section(path.section, taken[path.input], n + 2 * k, nexts)
            loop[path.output].append(out)
        inner = [self.add([], [], outs) for outs in loop]
        x = list(range(n))
        c = [self.add([*core.D[i], *core.C[i]], [*filtered, *x]) for i in range(p)]
        wanted = [self.add([], [], [inner[i], c[i]]) for i in range(p)]
        missing = [self.add([], [], [i], rounded=True) for i in e]
        moved = [self.state(i, filtered, missing) for i in range(n)]
        used = self.first + len(self.sums)
        rows = self.rows[:used, :used]
        update = rows[[*moved, *nexts]]
        return LinearLaw(
            F=update[:, : self.states], G=update[:, self.states :],
            H=rows[:, : self.states], J=rows[:, self.states :],
            sums=tuple(self.sums), first=self.first, wanted=tuple(wanted), law=tuple(c), loop=tuple(inner),
        )  # fmt: skip

    def state(self, i: int, filtered: list[int], missing: list[int]) -> int:
        """Next state ``i``: inputs, then states in the order of the law, then the applied command."""
        core = self.package.core
        order = list(range(len(core.A)))
        if core.pairs is not None:  # its partner in the block, then itself
            p = core.pairs
            order = [i + p, i] if i < p else [i - p, i] if i < 2 * p else [i]
        applied = (core.E[i], missing) if core.drives else ([], [])
        return self.add([*core.B[i], *core.A[i, order], *applied[0]], [*filtered, *order, *applied[1]])

    def section(self, section: Section, into: int, state: int, nexts: list[int]) -> int:
        b0, b1, b2, a1, a2 = (*section.b, *section.a)
        out = self.add([b0], [into], [state])
        nexts.append(self.add([b1, -a1], [into, out], [state + 1]))
        nexts.append(self.add([b2, -a2], [into, out]))
        return out

    def add(
        self,
        coefficients: Sequence[float],
        signals: Sequence[int],
        plus: Sequence[int] = (),
        rounded: bool = False,
    ) -> int:
        """A new signal, the sum in this order, ``plus`` last, with an error of its own."""
        kept = np.array(coefficients, dtype=self.kept)
        cut = [*0.5 * np.spacing(np.abs(kept)).astype(float), *[UNIT if rounded else 0.0] * len(plus)]
        all_of = [*kept.astype(float).tolist(), *[1.0] * len(plus)]
        terms = np.array([*signals, *plus], dtype=int)
        new = self.first + len(self.sums)
        # One term after the other, as `rounding_of` counts them.
        parts = np.array(all_of)[:, None] * self.rows[terms, :new]
        np.add.reduce(parts, axis=0, initial=0.0, out=self.rows[new, :new])
        self.rows[new, new] = 1.0
        self.sums.append(
            Sum(
                coefficients=np.array(all_of),
                signals=terms,
                cut=np.array(cut, dtype=float),
            )
        )
        return new

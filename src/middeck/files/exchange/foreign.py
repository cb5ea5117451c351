"""Systems of other programs, checked on their way in: time base, real numbers, proper ratios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from middeck.errors import ConfigError
from middeck.systems.statespace import SampledStateSpace, StateSpace, gain_system, series


def build_foreign(
    matrices: Mapping[str, Any], period_s: float | None, what: str
) -> StateSpace | SampledStateSpace:
    """A system of real A, B, C and D; raises `ConfigError` by name where they are not."""
    real = {name: real_matrix(value, f"{what}, {name}") for name, value in matrices.items()}
    try:
        if period_s is None:
            return StateSpace(**real)
        return SampledStateSpace(**real, period_s=period_s)
    except ValueError as error:
        raise ConfigError(f"the matrices do not fit: {error}", where=what) from None


def real_matrix(value: Any, where: str) -> np.ndarray:
    """``value`` as real finite numbers; raises `ConfigError` naming ``where``."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiubc":
        raise ConfigError(f"{array.dtype} is no array of numbers", where=where)
    if array.dtype.kind == "c" and np.any(np.imag(array)):
        raise ConfigError(
            "complex numbers", where=where, hint="a real form of the same system: 2x2 blocks for pairs"
        )
    if not np.isfinite(array).all():
        raise ConfigError("a number is not finite", where=where)
    return np.real(array).astype(float)


def settle_period(dt: Any, told_s: float | None, what: str) -> float | None:
    """The sampling period of another program's time base, None for a continuous one.

    ``dt`` is None or True where a program has left it open; then ``told_s`` settles it (0: continuous).

    >>> settle_period(True, 0.01, "a filter"), settle_period(0, None, "a filter")
    (0.01, None)
    """
    if dt is None or dt is True:
        if told_s is None:
            raise ConfigError(
                f"its time base is {'sampled, of no period' if dt else 'open'} (dt = {dt})",
                where=what,
                hint="period_s=, in seconds; 0 for a continuous system",
            )
        period = float(told_s)
    else:
        period = float(dt)
        if told_s is not None and told_s != period:
            raise ConfigError(
                f"period_s is {told_s:g}, its own dt {period:g}", where=what, hint="leave it out"
            )
    if not (np.isfinite(period) and period >= 0.0):
        raise ConfigError(f"a sampling period of {period:g} s", where=what, hint="> 0 s, or 0")
    return period or None


def realise_ratio(num: Any, den: Any, what: str) -> StateSpace:
    """num/den, highest power first, in controllable form; as exact as the coefficients are.

    Raises `ConfigError` for an improper ratio: it has no state space.

    >>> realise_ratio([2.0], [1.0, 3.0], "a lag").A
    array([[-3.]])
    """
    n, d = (np.trim_zeros(np.atleast_1d(real_matrix(v, what)).ravel(), "f") for v in (num, den))
    if not len(d):
        raise ConfigError("the denominator is zero", where=what)
    if len(n) > len(d):
        raise improper(len(n) - 1, len(d) - 1, what)
    order = len(d) - 1
    padded = np.concatenate([np.zeros(len(d) - len(n)), n]) / d[0]
    a = d[1:] / d[0]
    A = np.eye(order, k=-1)
    A[:1] = -a
    B = np.eye(order, 1)
    return StateSpace(A, B, (padded[1:] - padded[0] * a)[None, :], padded[:1, None])


def improper(zeros: int, poles: int, what: str) -> ConfigError:
    """The error of a ratio with more zeros than poles."""
    return ConfigError(
        f"improper: {zeros} zeros over {poles} poles; it would differentiate its input",
        where=what,
        hint=f"add {zeros - poles} fast pole{'s' if zeros - poles > 1 else ''} beyond the band (roll-off)",
    )


def chain_sections(sections: np.ndarray, what: str) -> StateSpace:
    """Ratios of second order, rows (b0 b1 b2 a0 a1 a2), one behind the other: no high-order coefficients."""
    chain = gain_system(np.eye(1))
    for row in sections:
        chain = series(chain, realise_ratio(row[:3], row[3:], what))
    return chain

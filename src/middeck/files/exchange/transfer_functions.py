"""Systems of other programs, checked on their way in: time base, real numbers, proper ratios."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from middeck.errors import ConfigError
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import (
    LinearSystem,
    SampledStateSpace,
    StateSpace,
    gain_system,
    series,
)


def build_foreign(matrices: Mapping[str, Any], period_s: float | None, what: str) -> LinearSystem:
    """A system of real A, B, C and D; raises `ConfigError` by name where they are not."""
    real = {name: real_matrix(value, f"{what}, {name}") for name, value in matrices.items()}
    try:
        if period_s is None:
            return StateSpace(**real)
        return SampledStateSpace(**real, period_s=period_s)
    except ConfigError as error:
        raise ConfigError(
            f"the matrices do not fit: {error.where}: {error.what}",
            where=what,
            hint="A (n, n), B (n, inputs), C (outputs, n), D (outputs, inputs)",
        ) from None


def with_delay(plant: Plant, delay_s: Any) -> Plant:
    """``plant`` with one delay [s] for all paths, or one for each; a single row or column is refused."""
    delays = np.asarray(delay_s, dtype=float)
    if delays.ndim and delays.shape != plant.delay_s.shape:
        raise ConfigError(
            f"delays of shape {delays.shape} for {plant.delay_s.shape} outputs and inputs",
            where="delay_s",
            hint="one number, or a row for each output and a column for each input",
        )
    return delay_plant(plant, delays)


def real_matrix(value: Any, where: str) -> np.ndarray:
    """``value`` as real finite numbers; raises `ConfigError` naming ``where``."""
    array = np.asarray(value)
    if array.dtype.kind not in "fiubc":
        raise ConfigError(
            f"{array.dtype} is no array of numbers", where=where, hint="a rectangular array of real numbers"
        )
    if array.dtype.kind == "c" and np.any(np.imag(array)):
        raise ConfigError(
            "complex numbers", where=where, hint="a real form of the same system: 2x2 blocks for pairs"
        )
    if not np.isfinite(array).all():
        raise ConfigError("a number is not finite", where=where, hint="look at where it comes from")
    return np.real(array).astype(float)


def settle_period(dt: Any, given_s: float | None, what: str) -> float | None:
    """The sampling period of another program's time base, None for a continuous one.

    ``dt`` is None or True where a program has left it open; then ``given_s`` settles it (0: continuous).

    >>> settle_period(True, 0.01, "a filter"), settle_period(0, None, "a filter")
    (0.01, None)
    """
    if dt is None or dt is True:
        if given_s is None:
            raise ConfigError(
                f"its time base is {'sampled, of no period' if dt else 'open'} (dt = {dt})",
                where=what,
                hint="period_s=, in seconds; 0 for a continuous system",
            )
        period = float(given_s)
    else:
        period = float(dt)
        if given_s is not None and given_s != period:
            raise ConfigError(
                f"period_s is {given_s:g}, its own dt {period:g}", where=what, hint="leave it out"
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
        raise ConfigError(
            "the denominator is zero",
            where=what,
            hint="coefficients from the highest power down, one of them not zero",
        )
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


def realise_roots(zeros: np.ndarray, poles: np.ndarray, gain: float, what: str) -> StateSpace:
    """gain prod(s - z) / prod(s - p) as sections of second order, one behind the other.

    No coefficients of high order: those of twenty resonances hold no digit of them. Each factor of poles has
    the nearest of zeros beside it, so that no section is large where another is small.

    Raises `ConfigError` for more zeros than poles, and for complex roots without their conjugates.

    >>> realise_roots(np.array([]), np.array([-1.0]), 2.0, "a lag").A
    array([[-1.]])
    """
    if len(zeros) > len(poles):
        raise improper(len(zeros), len(poles), what)
    above, below = _factors(zeros, f"{what}, zeros"), _factors(poles, f"{what}, poles")
    chain = gain_system(np.array([[gain]]))
    for den in below:
        fits = [num for num in above if len(num) <= len(den)]
        # Longest first, so that what is left fits the factors that are left; of those the nearest.
        num = min(fits, key=lambda num: (-len(num), abs(num[-1] - den[-1])), default=np.ones(1))
        above = [other for other in above if other is not num]
        chain = series(chain, realise_ratio(num, den, what))
    return chain


def _factors(roots: np.ndarray, where: str) -> list[np.ndarray]:
    """Real polynomials of second order whose roots these are, and at most one of first order, the last."""
    roots = np.atleast_1d(roots).astype(complex)
    # Rounding of another program's conjugates.
    single = np.abs(np.imag(roots)) <= 1e-12 * np.abs(roots)
    upper, lower = roots[~single & (np.imag(roots) > 0.0)], roots[~single & (np.imag(roots) < 0.0)]
    pairs = len(upper) == len(lower) and np.allclose(
        np.sort_complex(upper), np.sort_complex(np.conj(lower)), rtol=1e-9, atol=0.0
    )
    if not pairs:
        raise ConfigError("complex without conjugates", where=where, hint="roots in conjugate pairs")
    real = np.sort(np.real(roots[single]))
    found = [np.array([1.0, -2.0 * p.real, abs(p) ** 2]) for p in upper]
    found += [np.array([1.0, -a - b, a * b]) for a, b in zip(real[:-1:2], real[1::2], strict=True)]
    return [*found, *([np.array([1.0, -real[-1]])] if len(real) % 2 else [])]

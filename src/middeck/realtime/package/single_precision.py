"""A law in single precision, with a bound of how far its outputs can be from those in double precision."""

import dataclasses
from typing import NamedTuple

import numpy as np

from middeck.errors import ConfigError, NumericalError
from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import Section
from middeck.realtime.package.l1_norms import bound_peaks
from middeck.realtime.package.modal_form import to_modal
from middeck.realtime.package.package import ControllerPackage, law_numbers
from middeck.realtime.package.rounding_errors import UNIT, LinearLaw, reach_of, rounding_of, unfold_law
from middeck.realtime.package.vectors import add_test_vectors

ROUNDS, GROWTH = 20, 1.2
"""Trials of what the signals are with their errors, and how far the next one goes beyond the last."""
ALLOWANCE = 1.01
"""For the rounding of this computation itself, in double precision."""
STATED = 1.001
"""What a package states beyond its bound: a gate on another machine adds up in another order."""
NOTHING = 2.0**-100
"""Below all that matters, and above what is lost where numbers of single precision end (2^-149)."""
ROOM = 2.0**100
"""No product or sum may exceed it: what is added to the largest number then leaves it as it is."""
DOUBLE = "double precision"

Array = np.ndarray


def to_single(package: ControllerPackage) -> ControllerPackage:
    """``package`` for a processor of single precision, with new test vectors.

    ``error_bound`` holds for all inputs, which are kept within their ranges, and whatever the limits do: the
    difference to the law of ``package`` in double precision, and to any other whose numbers are cut to the
    same ones, never exceeds it. No operation overflows there.
    Where a law estimates from what was applied, that may be anything within the limits, as the law's own
    command is; limits and fade act as gains from 0 to 1, which about one half must not amplify errors
    without end (Khalil 2002, section 7.1). Where they may, the bound is for its own commands applied in full,
    and the package says so (``error_bound_own``): no inputs within their ranges let them reach a limit, and
    no ramp fades them.

    Raises `ConfigError` for a law that is single already, unstable, without a range at an input or a limit of
    what is applied, or with a slew limit, in which roundings add up without end; and where no bound is found.
    """
    if package.single:
        raise ConfigError("the package is in single precision already", hint="leave it as it is")
    core = package.core
    modal = to_modal(core) if core.pairs is None else core
    exact = dataclasses.replace(package, core=modal or core, vectors=None)
    numbers = np.concatenate([np.ravel(part) for part in law_numbers(exact)])
    _require_room(float(np.abs(numbers[np.isfinite(numbers)]).max()), "a coefficient or limit")
    rounded = dataclasses.replace(
        exact,
        core=_round_core(exact.core),
        filters=tuple(dataclasses.replace(f, section=_round_section(f.section)) for f in exact.filters),
        paths=tuple(dataclasses.replace(p, section=_round_section(p.section)) for p in exact.paths),
        input_range=_rounded(exact.input_range),
        lower=_rounded(exact.lower),
        upper=_rounded(exact.upper),
    )
    bound = bound_error(rounded)
    single = dataclasses.replace(
        rounded, single=True, error_bound=STATED * bound.outputs, error_bound_own=bound.own
    )
    return add_test_vectors(single, len(package.vectors.y) if package.vectors else None)


class ErrorBound(NamedTuple):
    """The most by which each output in single precision differs from that in double precision.

    Attributes:
        outputs: Of each output.
        own: Whether it holds only while the law's own commands are applied in full, from a reset on: as long
            as it is engaged and nothing else limits them or adds to them. Then it has nothing to learn from
            what is applied, and its path moves no error.
    """

    outputs: Array
    own: bool


def bound_error(package: ControllerPackage) -> ErrorBound:
    """The bound whatever is applied within the limits; where none is found, that for its own commands."""
    _require_bounded(package)
    limits = np.maximum(np.abs(package.lower), np.abs(package.upper))
    if package.core.drives and not np.isfinite(limits).all():
        raise ConfigError("what is applied has no limit: its error has no bound", hint="limits of outputs")
    try:
        return ErrorBound(_find_bound(package)[0], own=False)
    except ConfigError:
        untouched = _bound_untouched(package)
        if untouched is None:
            raise
        return ErrorBound(untouched, own=True)


def _bound_untouched(package: ControllerPackage) -> Array | None:
    """The bound without the path of applied commands, if no fade or limit lets it learn anything."""
    if package.ramp or not package.core.drives:
        return None
    silent = dataclasses.replace(package.core, E=np.zeros_like(package.core.E))
    alone = dataclasses.replace(package, core=silent, error_bound_own=False, vectors=None)
    bound, wanted = _find_bound(alone)
    least = np.minimum(package.upper, -package.lower) * (1.0 - 2.0 * UNIT)
    return bound if np.all(wanted <= least) else None


def _find_bound(package: ControllerPackage) -> tuple[Array, Array]:
    """The bound whatever is applied within the limits, and the largest command before them."""
    linear = unfold_law(package)
    closed = _close_limits(package, linear)
    m, p = len(package.inputs), len(package.outputs)
    limits = np.maximum(np.abs(package.lower), np.abs(package.upper))
    try:
        gain = bound_peaks(closed.F, closed.G, closed.H, closed.J)
    except NumericalError as error:
        raise ConfigError(f"no bound of the error in single precision: {error.what}", hint=DOUBLE) from None
    by_y, by_e, by_error = gain[:, :m], gain[:, m : m + p], gain[:, m + p :]
    # Ranges are rounded too.
    peaks = _with_limits(package, linear, by_y @ (package.input_range * (1.0 + UNIT)), by_e, limits)
    errors, limited = np.zeros(len(peaks)), np.zeros(p)
    for _ in range(ROUNDS):
        # A signal with its error in it rounds a little more: until what is assumed holds what comes out.
        assumed = peaks + GROWTH * errors + NOTHING
        _require_room(reach_of(linear.sums, assumed), "a sum")
        rounded = rounding_of(linear.sums, assumed)
        limited = _rounding_at_limits(package, assumed[list(linear.law)], assumed[list(linear.loop)])
        wanted = rounded[[w - linear.first for w in linear.wanted]]
        errors = _with_limits(package, linear, by_error @ rounded, by_e, limited + 0.5 * wanted)
        if np.all(peaks + errors <= assumed):
            bound = ALLOWANCE * (errors[list(linear.law)] + errors[list(linear.loop)] + limited)
            return bound, assumed[list(linear.wanted)]
    raise ConfigError("rounding may change a signal by more than itself", hint=DOUBLE)


def _require_room(reach: float, what: str) -> None:
    if not reach <= ROOM:
        raise ConfigError(f"{what} of {reach:.1e} overflows in single precision", hint=DOUBLE)


def _rounding_at_limits(package: ControllerPackage, law: Array, loop: Array) -> Array:
    """Rounding of p + f c, of the fade f (seven operations), and of limits cut to single precision."""
    fade = 8.0 * UNIT if package.ramp else 0.0
    limits = np.where(np.isfinite(package.upper), package.upper, 0.0)
    limits = np.maximum(limits, np.where(np.isfinite(package.lower), -package.lower, 0.0))
    return ALLOWANCE * (loop * UNIT + law * (3.0 * UNIT + fade) + limits * UNIT) + NOTHING


class _Closed(NamedTuple):
    F: Array
    G: Array
    H: Array
    J: Array


def _close_limits(package: ControllerPackage, linear: LinearLaw) -> _Closed:
    """The law with e = -w/2 + e' in place of e: a limit about the middle of its gains from 0 to 1."""
    if not package.core.drives:
        return _Closed(linear.F, linear.G, linear.H, linear.J)
    m, p = len(package.inputs), len(package.outputs)
    w, e = list(linear.wanted), slice(m, m + p)
    F = linear.F - 0.5 * linear.G[:, e] @ linear.H[w]
    G = linear.G - 0.5 * linear.G[:, e] @ linear.J[w]
    H = linear.H - 0.5 * linear.J[:, e] @ linear.H[w]
    J = linear.J - 0.5 * linear.J[:, e] @ linear.J[w]
    return _Closed(F, G, H, J)


def _with_limits(
    package: ControllerPackage, linear: LinearLaw, alone: Array, by_e: Array, more: Array
) -> Array:
    """Peaks of the signals where |e'| <= (|p| + |c|)/2 + ``more`` feeds back; ``alone`` without it."""
    if not package.core.drives:
        return alone
    law, loop = list(linear.law), list(linear.loop)
    fed = 0.5 * (by_e[law] + by_e[loop])
    if np.abs(np.linalg.eigvals(fed)).max() >= 1.0:
        raise ConfigError(
            "no bound of the error in single precision: the path of the applied command may amplify it",
            hint=f"{DOUBLE}; without that path; or without a ramp and with limits that no input reaches",
        )
    e = np.linalg.solve(np.eye(len(fed)) - fed, 0.5 * (alone[law] + alone[loop]) + more)
    return alone + by_e @ e


def _require_bounded(package: ControllerPackage) -> None:
    if package.unstable or not all(place.section.stable for place in (*package.filters, *package.paths)):
        raise ConfigError("an unstable law in single precision: its error has no bound", hint=DOUBLE)
    for port, reach in zip(package.inputs, package.input_range.tolist(), strict=True):
        if not np.isfinite(reach):
            raise ConfigError(
                f"input {port.name} has no range: its error has no bound", hint="declare its range"
            )
    if np.any(np.isfinite(package.slew)):
        raise ConfigError(
            "a slew limit in single precision: its roundings add up without a bound",
            hint=f"{DOUBLE}, or limit the slew where commands are applied",
        )


def _round_core(core: Core) -> Core:
    return Core(**{name: _rounded(getattr(core, name)) for name in "ABCDE"}, pairs=core.pairs)


def _round_section(section: Section) -> Section:
    return Section(_rounded(section.b), _rounded(section.a))


def _rounded(values: Array) -> Array:
    return values.astype(np.float32).astype(float)

"""Whether an operation of a law can overflow while its inputs are within their ranges."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.errors import NumericalError
from middeck.realtime.package.filter_sections import SMALLEST
from middeck.realtime.package.l1_norms import bound_peaks
from middeck.realtime.package.package import ControllerPackage, law_numbers
from middeck.realtime.package.rounding_errors import LinearLaw, reach_of, unfold_law

ANYTHING = "whatever limits and ramp do, and whatever is applied within the limits"
OWN_COMMANDS = "as long as it is engaged and its own commands are applied in full, from a reset on"
ROOM = 2.0**960
"""What is added to the largest number then leaves it as it is (its last place is 2^971)."""
UNIT = 2.0**-52
"""Of each term of a sum, for its product and its addition (Higham 2002, chapter 3)."""
NOTHING = 2.0**-800
"""Below all that matters, and above what is lost where a state is taken as zero (2^-900)."""
ROUNDS = 20


def when_nothing_overflows(package: ControllerPackage) -> str:
    """The condition under which no operation of ``package`` overflows or gives NaN; empty if none is known.

    Inputs are within their ranges. In single precision it is the condition of the bound of the error. In
    double precision what is applied is an input of a law that estimates from it: its observer must be stable,
    not the law. Where the observer is not, the condition is that its own commands are applied.
    """
    if package.single:
        return OWN_COMMANDS if package.error_bound_own else ANYTHING
    numbers = np.abs(np.concatenate([np.ravel(part) for part in law_numbers(package)]))
    if numbers[np.isfinite(numbers)].max() > ROOM:
        return ""
    limits = np.maximum(-package.lower, package.upper)
    with np.errstate(all="ignore"):
        law, none = unfold_law(package, single=False), np.zeros_like(limits)
        if not package.core.drives:
            return ANYTHING if _has_room(law, package.input_range, none) else ""
        if _has_room(_estimating(law, len(package.inputs)), package.input_range, limits):
            return ANYTHING
        return OWN_COMMANDS if _has_room(law, package.input_range, none) else ""


def _estimating(law: LinearLaw, inputs: int) -> LinearLaw:
    """``law`` of y and of what is applied, w + e, in place of e."""
    w, e = list(law.wanted), slice(inputs, inputs + len(law.wanted))
    return dataclasses.replace(
        law,
        F=law.F - law.G[:, e] @ law.H[w],
        G=law.G - law.G[:, e] @ law.J[w],
        H=law.H - law.J[:, e] @ law.H[w],
        J=law.J - law.J[:, e] @ law.J[w],
    )


def _has_room(law: LinearLaw, y: Float[np.ndarray, " input"], e: Float[np.ndarray, " output"]) -> bool:
    """Whether no product or sum leaves `ROOM`, with what its rounding adds to the signals."""
    given = np.concatenate([y, e])
    if not all(np.isfinite(part).all() for part in (given, law.F, law.G, law.H, law.J)):
        return False
    try:
        gain = bound_peaks(law.F, law.G, law.H, law.J, most=0)
    except (NumericalError, np.linalg.LinAlgError):
        return False
    peaks, by_error = gain[:, : len(given)] @ given, gain[:, len(given) :]
    errors = np.zeros(len(peaks))
    for _ in range(ROUNDS):
        # A signal with its error in it rounds a little more: until what is assumed holds what comes out.
        assumed = peaks + 2.0 * errors + NOTHING
        if not (np.isfinite(assumed).all() and reach_of(law.sums, assumed) <= ROOM):
            return False
        terms = [len(one.coefficients) * np.abs(one.coefficients) @ assumed[one.signals] for one in law.sums]
        errors = by_error @ (UNIT * np.array(terms) + SMALLEST[np.float64])
        if np.all(peaks + errors <= assumed):
            return True
    return False

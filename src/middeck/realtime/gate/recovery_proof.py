"""A proof that a law recovers from limits of size and slew that act at any time, also both at once.

A limited output is u = w - n - m: the law asks for w; n is what the limit of size holds back, m that of slew.
In a sample in which both act, n is all of it, so that n m = 0. Where n is not zero, u is +-L with the sign of
n; where m is not zero, u - u_before is +-s with the sign of m; no sample of either is larger. Hence, with any
kernel h, causal or not, whose magnitudes add up to one at most, no term of these sums over time is negative:

    n (u - h * u) >= 0,   m ((u - u_before) - h * (u - u_before)) >= 0

(multipliers of Zames and Falb 1968, SIAM J. Control 6; sampled: Willems and Brockett 1968, IEEE TAC 13).
While the sensors stay within their ranges |w| has a bound, and so n (k w - n) >= 0 and
m (k' (w - u_before) - m) >= 0 with k, k' < 1.

Let the loop without limits be stable, and let some sum of these, as a quadratic form of (n, m), be below
-e |(n, m)|^2 at all frequencies. Cut off n and m after some sample. The sum over time is then above a
constant (a kernel that looks ahead meets outputs that are not limited any more, but the motion is bounded
and the kernel's first moment finite), and below c |(n, m)| - e |(n, m)|^2, with c of the state at the start.
So the sums of squares of n and m are bounded, whichever the sample, and the motion dies out.

Beside a hold, p, the law's own limits of size act first, v = c - n, and those of the drives on the sum,
u = p + v - m. Each is a saturation of its own: n (v - h * v) >= 0 and n (k c - n) >= 0, m (u - h * u) >= 0
and m (k' (p + v) - m) >= 0, and the same argument holds. A limit of slew of the law begins where the limit of
the sum has left it, and that of size may then overrule it: beside a hold with such limits no proof is tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError, NumericalError
from middeck.realtime.engine.interface.settings import Drive
from middeck.realtime.gate.limited_loop import Loop, Parts, close_loop, in_units_of, split_loop
from middeck.realtime.gate.multipliers import dies_out
from middeck.realtime.gate.reached_limits import Limit, bound_commands, reached_limits, reached_sizes
from middeck.realtime.package.package import ControllerPackage
from middeck.systems.plants.plant import Plant

HELP = "smaller ranges of the sensors, larger limits or less authority may do"
TOLD, REQUIRED = (4, 60), (10, 150)
"""Most limits and states for which a proof is tried: where it is only told, and where it decides."""
QUARTERS = 4
"""How often the commands that may be asked for are quartered to see where a proof begins."""


def why_unproved(
    package: ControllerPackage,
    plant: Plant,
    *,
    drives: Sequence[Drive] = (),
    required: bool = False,
) -> str:
    """Why it is not proved that motions within the sensors' ranges die out, whichever limits act when.

    Empty where it is proved: of the law at full authority, with what it learns of its outputs, and of no
    other limits than its own. Of a ``package`` beside a hold, its inner loop, these are limits of c, and
    those of the engine's ``drives``, one for each of its outputs, limit the sum. A reason says nothing of the
    loop. No proof is tried for more limits or states than `TOLD` (`REQUIRED`, where a verdict hangs on it),
    limits that differ by sign, single precision, or a plant with a direct term.
    """
    try:
        with np.errstate(all="ignore"):  # what is no number proves nothing
            return _reason(package, plant, drives, required)
    except (NumericalError, ConfigError) as error:
        return error.what
    except ValueError:  # of NumPy and SciPy
        return "numbers overflow"


def _reason(package: ControllerPackage, plant: Plant, drives: Sequence[Drive], required: bool) -> str:
    most_limits, most_states = REQUIRED if required else TOLD
    if drives and np.isfinite(package.slew).any():
        return "beside a hold limits of slew are not proved"
    if np.any(package.lower != -package.upper) or any(drive.lower != -drive.upper for drive in drives):
        return "limits differ by sign"
    if package.single:
        return "in single precision a motion dies out to the bound of its rounding only"
    parts = split_loop(package, plant)
    if np.any(parts.direct):
        return "a sensor answers an output in the same sample"
    states = len(parts.A) + len(parts.F)
    if states > most_states:
        return f"the loop has {states} states, the proof takes {most_states}"
    sums = np.array([drive.upper for drive in drives]) if drives else None
    limits = _limits(package, parts, sums)
    if len(limits) > most_limits:
        return f"motions within ranges may reach {len(limits)} limits, the proof takes {most_limits}"
    if sums is None:
        loop = close_loop(in_units_of(parts, package.upper))
    else:
        loop = close_loop(in_units_of(parts, sums), package.upper / sums)
    if loop is None:
        return "the loop is too close to instability, or its modes to each other, for the digits computed"
    if not limits or dies_out(loop, limits):
        return ""
    near = _where_it_begins(loop, limits) if required else ""
    return f"no multipliers are found{near}; {HELP}"


def _limits(
    package: ControllerPackage, parts: Parts, sums: Float[np.ndarray, " output"] | None
) -> list[Limit]:
    """Those that are reached; beside a hold the law's own, then those of the sums."""
    asked = bound_commands(package, parts, sums)
    if sums is None:
        return reached_limits(package, asked)
    return reached_sizes(np.concatenate([package.upper, sums]), asked)


def _where_it_begins(loop: Loop, limits: list[Limit]) -> str:
    """By how much the law may exceed its limits, and at how much less there is a proof."""
    asked = np.array([1.0 / (1.0 - limit.sector) for limit in limits])
    said = f" where it may ask for {asked.max():.3g} times a limit"
    for part in 0.25 ** np.arange(1, QUARTERS + 1):
        less = 1.0 + part * (asked - 1.0)
        if dies_out(loop, [m._replace(sector=1.0 - 1.0 / a) for m, a in zip(limits, less, strict=True)]):
            return f"{said} (they are at {less.max():.3g} times)"
    return f"{said} (nor at {less.max():.3g} times)"

"""How much authority a design bears on the rig before a mode goes unstable."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Complex

from middeck.control.compensator import Compensator
from middeck.realtime.hardware_rig import linearise_rig
from middeck.realtime.rig import close_sampled_loop
from middeck.study.bench import Bench, law_on
from middeck.study.measured_loop import DesignCase, predicted_db
from middeck.systems.stability import GROWTH_LIMIT, growth_rates
from middeck.values import record

LEVELS = np.arange(0.0, 4.51, 0.25)  # log10 authority

Design = Callable[[float], Compensator]


@record
class Reach:
    """How far a design goes on the rig, with the pair of modes where it was and moved to either side.

    Parameters
    ----------
    what:
        The design.
    log10_authority, predicted_db:
        Of the last level that is stable on all of them; None where the lowest is not.
    stopped_hz, stopped_percent:
        What grows fastest at the next level, and with which shift; None where no level is stopped.
    """

    what: str
    log10_authority: float | None
    predicted_db: float | None
    stopped_hz: float | None
    stopped_percent: float | None


def find_reach(what: str, design: Design, case: DesignCase, benches: Mapping[float, Bench]) -> Reach:
    """Raise the authority level by level until a loop on one of the ``benches`` is unstable."""
    linear = {percent: linearise_rig(bench.rig).sampled for percent, bench in benches.items()}
    last: tuple[float, float | None] | None = None
    for level in LEVELS:
        compensator = design(10.0 ** float(level))
        rates = {
            percent: _fastest(
                growth_rates(close_sampled_loop(linear[percent], law_on(bench.rig, compensator)))
            )
            for percent, bench in benches.items()
        }
        worst = max(rates, key=lambda percent: rates[percent].real)
        if rates[worst].real > GROWTH_LIMIT:
            stopped = abs(rates[worst].imag) / (2.0 * np.pi)
            return Reach(what, *(last or (None, None)), stopped, worst)
        last = float(level), predicted_db(case, compensator)
    return Reach(what, *(last or (None, None)), None, None)


def _fastest(rates: Complex[np.ndarray, " state"]) -> complex:
    return complex(rates[int(np.argmax(np.real(rates)))])

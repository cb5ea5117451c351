"""Comparison of sampled designs of one plant and cost at several rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.control.analysis.margins.margins import Margins, measure_margins
from middeck.control.analysis.text_table import align_columns
from middeck.control.law.compensator import Compensator, idle_compensator
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.emulation import Rule, emulate
from middeck.control.sampled.sampled_design import Form, design_sampled_lqg
from middeck.control.sampled.sampled_loop import SampledOutcome, measure_held, measure_sampled_loop
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.values import record

HEAD = ("rate Hz", "method", "dB", "control rms", "gain dB", "phase deg", "disk")
FORMS: tuple[Form, ...] = ("current", "predictor")
# Pade order of delays in designs of finite order.
PADE_ORDER = 3


@record(kw_only=True)
class SamplingRow:
    """One compensator at one rate.

    Attributes:
        method: ``"direct, current"`` and ``"direct, predictor"``; ``"hold"``, ``"tustin"`` or ``"matched"``
            for an emulated compensator, with ``", hold known"`` where the continuous design included half a
            period of delay.
        rate_hz: Sampling rate.
        law: The compensator itself.
        outcome: Stability, rms between the samples too, control and cost.
        margins: Margins at the plant's inputs without delay margins; None for an unstable loop.
    """

    method: str
    rate_hz: float
    law: Compensator
    outcome: SampledOutcome
    margins: Margins | None


@record
class SamplingComparison:
    """All compensators at all rates; ``print`` shows them as a table.

    The table has one row for each compensator and rate: metric relative to no control (negative decibels for
    an improvement), control rms, smallest margins. ``-``: the plant alone has no metric, or no gain or phase
    breaks the loop.

    Attributes:
        rows: Rate by rate, in the order of ``rates_hz``.
        open_metric: The metric without control; ``inf`` where the plant alone does not decay.
        continuous_cost: Cost of the continuous design on its own plant with approximated delays: the limit of
            fast sampling.
    """

    rows: tuple[SamplingRow, ...]
    open_metric: float
    continuous_cost: float

    def __str__(self) -> str:
        return align_columns([HEAD, *(_cells(row, self.open_metric) for row in self.rows)])


def _cells(row: SamplingRow, open_metric: float) -> tuple[str, ...]:
    if row.margins is None:
        return (f"{row.rate_hz:g}", row.method, "unstable", *("",) * 4)
    loops = row.margins.loops
    return (
        f"{row.rate_hz:g}",
        row.method,
        _finite(20.0 * float(np.log10(row.outcome.metric) - np.log10(open_metric))),
        f"{np.linalg.norm(row.outcome.control_rms):.3g}",
        _finite(min(loop.gain_db for loop in loops)),
        _finite(np.degrees(min(loop.phase_limit_rad for loop in loops))),
        f"{min(loop.disk.alpha for loop in loops):.3f}",
    )


def _finite(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "-"


def compare_sampling(
    plant: Plant,
    weights: LQGWeights,
    authority: float,
    rates_hz: Sequence[float] | Float[np.ndarray, " rate"] = (100.0, 250.0, 500.0, 1000.0),
    *,
    match_hz: float | None = None,
) -> SamplingComparison:
    """Direct sampled designs beside emulated ones, each measured with true delay, between samples too.

    Emulated compensators come from `design_lqg` with delays approximated to third order: on the plant, and on
    the plant with half a period more delay (the effect of the hold). Tustin's rule is prewarped, and the gain
    of a matched compensator met, at ``match_hz``. Matched compensators need one input and one measurement.

    Raises what `design_lqg`, `design_sampled_lqg` and `emulate` do.
    """
    continuous = design_lqg(approximate_delays(plant, PADE_ORDER), weights, authority)
    rows: list[SamplingRow] = []
    for rate in rates_hz:
        period = 1.0 / float(rate)
        delayed = approximate_delays(_later(plant, period / 2.0), PADE_ORDER)
        laws: list[Compensator] = [
            design_sampled_lqg(plant, weights, authority, period, form) for form in FORMS
        ]
        names = [law.method for law in laws]
        for design, suffix in ((continuous, ""), (design_lqg(delayed, weights, authority), ", hold known")):
            rules: tuple[Rule, ...] = ("hold", "tustin", *(("matched",) if design.system.D.size == 1 else ()))
            laws += [emulate(design, period, rule, match_hz=match_hz) for rule in rules]
            names += [rule + suffix for rule in rules]
        for name, law in zip(names, laws, strict=True):
            outcome = measure_sampled_loop(plant, law, weights, authority)
            margins = measure_margins(plant, law, delays=False) if outcome.stable else None
            rows.append(
                SamplingRow(method=name, rate_hz=float(rate), law=law, outcome=outcome, margins=margins)
            )
    idle = emulate(idle_compensator(plant), 1.0 / float(rates_hz[0]), "hold")
    open_loop = measure_held(plant, idle, weights, authority)
    return SamplingComparison(tuple(rows), open_loop.metric, continuous.cost)


def _later(plant: Plant, more_s: float) -> Plant:
    """The plant with its control inputs delayed by a further ``more_s``."""
    delay_s = np.zeros_like(plant.delay_s)
    delay_s[:, plant.input_indices(plant.u)] = more_s
    return delay_plant(plant, delay_s)

"""Continuous or sampled, late or not: what a function takes is asked before it computes with it."""

from __future__ import annotations

from middeck.control.law.compensator import Compensator
from middeck.control.law.sampled_compensator import SampledCompensator
from middeck.errors import ConfigError
from middeck.systems.delayed_plant import DelayedPlant
from middeck.systems.plant import Plant
from middeck.systems.sampled_plant import SampledPlant


def require_continuous(law: Compensator | SampledCompensator) -> None:
    """Raise `ConfigError` for a sampled law: its matrices mean something else."""
    if isinstance(law, SampledCompensator):
        raise ConfigError(
            f"a law sampled at {1.0 / law.period_s:g} Hz where a continuous one is asked for",
            hint="measure_sampled_loop and measure_sampled_margins judge it; qualify_compensator takes both",
        )


def require_sampled(law: Compensator | SampledCompensator) -> SampledCompensator:
    """The law; raises `ConfigError` for a continuous one."""
    if not isinstance(law, SampledCompensator):
        raise ConfigError("a continuous law where a sampled one is asked for", hint="emulate(law, period_s)")
    return law


def require_rational(plant: Plant | DelayedPlant | SampledPlant) -> None:
    """Raise `ConfigError` for a plant with delays beside its states, and for a sampled one."""
    if isinstance(plant, DelayedPlant):
        raise ConfigError(
            "a plant with exact delays where one without is asked for",
            hint="approximate_delays(plant, 3); verdicts (measure_margins, ...) take it as it is",
        )
    if isinstance(plant, SampledPlant):
        raise ConfigError(
            "a sampled plant where a continuous one is asked for",
            hint="the plant itself; sampled designs and verdicts sample it",
        )

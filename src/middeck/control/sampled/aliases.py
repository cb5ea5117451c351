"""Aliases of modes beyond half the sampling rate, and their effect on the sampled loop."""

from __future__ import annotations

import dataclasses

import numpy as np

from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.antialias import filter_measurements
from middeck.control.sampled.sampled_loop import SampledOutcome, measure_sampled_loop
from middeck.systems.plants.plant import Plant, require_modal
from middeck.systems.plants.response import statespace_response
from middeck.systems.state_space.modal_system import select_modes
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record(kw_only=True)
class Alias:
    """A mode beyond half the rate and its alias.

    Attributes:
        name, frequency_hz: The mode.
        alias_hz: Frequency of the alias, folded about whole multiples of half the rate.
        damping: Damping ratio of the alias: same decay rate, lower frequency.
        filter_gain: Gain of the filter at the mode; one without a filter.
        loop_gain: Size of the mode's part of the return ratio at the alias, the largest over the loops.
        stable: Whether the loop with this mode and those below half the rate is stable.
        metric: Metric of that loop.
    """

    name: str
    frequency_hz: float
    alias_hz: float
    damping: float
    filter_gain: float
    loop_gain: float
    stable: bool
    metric: float


@record
class AliasReport:
    """The loop of one law at one rate.

    Attributes:
        rate_hz: Sampling rate.
        aliases: Each mode beyond half of it, ascending in frequency.
        resolved: The loop with the modes below half the rate alone.
        together: The loop with all modes.
    """

    rate_hz: float
    aliases: tuple[Alias, ...]
    resolved: SampledOutcome
    together: SampledOutcome


def find_aliases(
    plant: Plant,
    compensator: Compensator,
    weights: LQGWeights,
    authority: float,
    *,
    antialias: StateSpace | None = None,
) -> AliasReport:
    """Aliases of the modes beyond half the rate, and their effect on the loop of ``compensator`` and
    ``plant``.

    ``antialias`` is put behind each measurement (`filter_measurements`); the law should be designed for the
    plant with it, because of its phase lag. Metrics include the modes' own motion: compare two laws, or
    filter and no filter.

    Raises `ConfigError` for a plant that is not in modal form, and what `measure_sampled_loop` does.
    """
    active = partition_modes(plant).active
    modal = require_modal(active)
    period = compensator.sampled.period_s
    beyond = np.flatnonzero(modal.omega >= np.pi / period)
    beyond = beyond[np.argsort(modal.omega[beyond], kind="stable")]
    below = np.flatnonzero(modal.omega < np.pi / period)

    def with_modes(keep: np.ndarray) -> Plant:
        part = dataclasses.replace(active, dynamics=select_modes(modal, np.sort(keep)))
        return part if antialias is None else filter_measurements(part, antialias)

    def loop_of(keep: np.ndarray) -> SampledOutcome:
        return measure_sampled_loop(with_modes(keep), compensator, weights, authority)

    found: list[Alias] = []
    for k in beyond:
        omega, decay = float(modal.omega[k]), float(modal.omega[k] * modal.zeta[k])
        turning = float(np.sqrt(max(omega**2 - decay**2, 0.0)))
        seen = abs(turning - 2.0 * np.pi / period * round(turning * period / (2.0 * np.pi)))
        alone = form_loop(with_modes(np.array([k])), compensator).plant.sampled
        ratio = [statespace_response(s, np.array([seen]))[0] for s in (compensator.sampled, alone)]
        outcome = loop_of(np.append(below, k))
        found.append(
            Alias(
                name=modal.names[k],
                frequency_hz=omega / (2.0 * np.pi),
                alias_hz=seen / (2.0 * np.pi),
                damping=decay / float(np.hypot(seen, decay)) if decay else 0.0,
                filter_gain=1.0
                if antialias is None
                else float(np.abs(statespace_response(antialias, np.array([omega]))[0, 0, 0])),
                loop_gain=float(np.abs(np.linalg.eigvals(ratio[0] @ ratio[1])).max(initial=0.0)),
                stable=outcome.stable,
                metric=outcome.metric,
            )
        )
    return AliasReport(1.0 / period, tuple(found), loop_of(below), loop_of(np.arange(len(modal.omega))))

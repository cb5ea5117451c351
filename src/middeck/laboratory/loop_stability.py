"""Stability and margins of a loop on the rig itself, by eigenvalues and return ratio.

The rig is taken without limits, steps, Coulomb friction and noise (`linearise_rig`), sampled and with its
true delay. No design uses it; it shows the effect of a drift without a run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Complex, Float

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator
from middeck.control.sampled.emulation import emulate
from middeck.laboratory.bench import Bench
from middeck.laboratory.rig.linear_view import linearise_rig
from middeck.laboratory.rig.parts.computer import place_law
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.poles.stability import growth_limits, growth_rates, none_grows
from middeck.systems.poles.verdict import warn_if_open
from middeck.systems.state_space.feedback import feedback
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record


@record
class RigView:
    """A bench, the linear part of its rig, and its response on the lines of the excitation."""

    bench: Bench
    plant: Plant
    frequency_hz: Float[np.ndarray, " line"]
    H: Complex[np.ndarray, "line output input"]


@record(kw_only=True)
class RigLoop:
    """One compensator on one bench.

    Attributes:
        percent: Shift of the pair of modes.
        stable: Stability by the eigenvalues of the sampled loop.
        growth_hz, growth_rad_s: Frequency and real part of the pole that grows fastest or decays slowest.
        improvement_db: 20 log10 of the closed-loop rms of the first output in the band over the open-loop one
            on the same bench; None for an unstable loop, as are the margins.
        gain_margin_db, phase_margin_deg: The least change of the loop's gain, up or down, and the least turn
            of its phase, either way, that bring a pole to the axis, at rest and at half the sampling rate
            too; None where none does.
        gain_margin_hz, phase_margin_hz: Frequencies of the margins.
    """

    percent: float
    stable: bool
    growth_hz: float
    growth_rad_s: float
    improvement_db: float | None = None
    gain_margin_db: float | None = None
    gain_margin_hz: float | None = None
    phase_margin_deg: float | None = None
    phase_margin_hz: float | None = None


def view_rig(bench: Bench) -> RigView:
    """Linearise the rig of ``bench`` and evaluate it once for all compensators."""
    rig = bench.rig
    plant, f = linearise_rig(rig), _lines(bench)
    return RigView(bench, plant, f, evaluate_plant(plant, f).H)


def judge_loop(view: RigView, compensator: Compensator, percent: float) -> RigLoop:
    """The compensator on the rig of ``view``; the loop is broken at its one input."""
    fastest = fastest_pole(view, compensator)
    found = RigLoop(
        percent=percent,
        stable=none_grows(np.array([fastest]), view.plant.period_s),
        growth_hz=abs(fastest.imag) / (2.0 * np.pi),
        growth_rad_s=fastest.real,
    )
    if not found.stable:
        return found
    K = statespace_response(_placed(view, compensator), 2.0 * np.pi * view.frequency_hz)
    opened = view.H[:, 0, 0]
    closed = opened / (1.0 - np.einsum("fuy,fyu->f", K, view.H))  # u = K y is added
    better = float(20.0 * np.log10(np.linalg.norm(closed) / np.linalg.norm(opened)))
    return dataclasses.replace(found, improvement_db=better, **_margins(view, compensator))


def fastest_pole(view: RigView, compensator: Compensator) -> complex:
    """Fastest growing pole of the sampled loop [rad/s], beyond rounding, or else the slowest to decay."""
    (outputs, inputs), plant = view.H.shape[1:], view.plant.sampled
    law = _placed(view, compensator)
    loop = feedback(plant, law, range(inputs), range(outputs))
    warn_if_open(loop, plant, law)
    rates = growth_rates(loop)
    return complex(rates[int(np.argmax(np.real(rates) - growth_limits(rates, view.plant.period_s)))])


def _placed(view: RigView, compensator: Compensator) -> SampledStateSpace:
    """The compensator sampled by Tustin's rule, from all outputs of the rig to all its inputs."""
    period_s = view.bench.rig.period_s
    return place_law(emulate(compensator, period_s), view.plant.inputs, view.plant.outputs, period_s)


def judge_loops(views: Mapping[float, RigView], compensator: Compensator) -> tuple[RigLoop, ...]:
    """The same compensator with the pair of modes at each shift."""
    return tuple(judge_loop(view, compensator, percent) for percent, view in views.items())


def _margins(view: RigView, compensator: Compensator) -> dict[str, float | None]:
    """The least gain and phase margin of the loop broken at the one input."""
    (loop,) = measure_margins(view.plant, emulate(compensator, view.bench.rig.period_s)).loops
    gain_db, gain_hz = _least(np.abs(20.0 * np.log10(loop.gain)), loop.gain_hz)
    phase_deg, phase_hz = _least(np.abs(np.degrees(loop.phase_rad)), loop.phase_hz)
    return {
        "gain_margin_db": gain_db,
        "gain_margin_hz": gain_hz,
        "phase_margin_deg": phase_deg,
        "phase_margin_hz": phase_hz,
    }


def _least(margin: np.ndarray, where: np.ndarray) -> tuple[float | None, float | None]:
    if not len(margin):
        return None, None
    first = int(np.argmin(margin))
    return float(margin[first]), float(where[first])


def _lines(bench: Bench) -> Float[np.ndarray, " line"]:
    """The lines of the excitation's period within the band."""
    step = bench.rig.sample_hz / len(bench.open_loop)
    low, high = bench.band_hz
    return step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)

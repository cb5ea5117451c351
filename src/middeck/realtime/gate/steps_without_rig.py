"""Steps of the gate that need no rig: each examines a package, or its loop with a model."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.stability import (
    LoopStability,
    decide_stability,
)
from middeck.control.law.compensator import Compensator, locate_ports
from middeck.control.qualification import align_plant
from middeck.errors import ConfigError, NumericalError
from middeck.realtime.gate.linear_law import faded_laws, linear_law
from middeck.realtime.package.overflow import when_nothing_overflows
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.single_precision import bound_error
from middeck.realtime.package.vectors import find_unmoved, run_vectors
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import same_period
from middeck.values import record

FADES = tuple(k / 10.0 for k in range(11))
NOT_DECIDED = (NumericalError, ConfigError, ValueError)
"""ValueError: of NumPy and SciPy, where numbers overflow."""


@record(kw_only=True)
class GateStep:
    """One step: its name, whether the package passes it, and why not, or what was found."""

    name: str
    passed: bool
    said: str


@record(kw_only=True)
class GateMargins:
    """Margins that the loop with a model must keep at every fade.

    Attributes:
        gain_db, phase_deg: Least gain and phase margin of each loop, the others closed.
    """

    gain_db: float = 6.0
    phase_deg: float = 30.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.gain_db < math.inf and 0.0 <= self.phase_deg < 180.0):
            raise ConfigError(
                f"margins of {self.gain_db} dB and {self.phase_deg} degrees", hint="from 0; a phase below 180"
            )


class Tried(NamedTuple):
    """A law at a fade: where in words, the law, and whether nothing is engaged there."""

    where: str
    law: Compensator
    off: bool = False


def check_blacklist(law: str, blacklist: Mapping[str, str]) -> GateStep:
    """No trip has put this law on the blacklist, under whatever name."""
    reason = blacklist.get(law)
    return to_step("blacklist", [] if reason is None else [f"it has tripped: {reason}"], "not on it")


def check_interface(package: ControllerPackage, models: Mapping[str, Plant]) -> GateStep:
    """Ranges and limits are finite; every model has the ports, in their units, and the rate."""
    faults = [f"input {p.name} has no range" for p, r in zip(package.inputs, package.input_range, strict=True)
              if not np.isfinite(r)]  # fmt: skip
    limits = np.maximum(package.upper, -package.lower)
    faults += [f"output {p.name} has no limit" for p, r in zip(package.outputs, limits, strict=True)
               if not np.isfinite(r)]  # fmt: skip
    law = linear_law(package)
    for name, plant in models.items():
        numbers = [value for value in vars(plant.dynamics).values() if isinstance(value, np.ndarray)]
        if not all(np.isfinite(value).all() for value in numbers):
            faults.append(f"{name} has a number that is not finite")
        try:
            locate_ports(law, plant.inputs, plant.outputs)
        except ConfigError as error:
            faults.append(f"{name}: {error.what}")
        if plant.period_s is not None and not same_period(plant.period_s, package.period_s):
            faults.append(f"{name} is sampled at {plant.period_s:g} s, the package at {package.period_s:g} s")
    ports = (
        f"inputs: {len(package.inputs)}, outputs: {len(package.outputs)}, rate: {1.0 / package.period_s:g} Hz"
    )
    return to_step("interface", faults, ports)


def check_poles(package: ControllerPackage) -> GateStep:
    """Poles lie inside the unit circle unless the package declares otherwise; those of sections always."""
    radius = package.core.radius
    places = (*package.filters, *package.paths)
    faults = [
        f"a section at input {package.inputs[s.input].name} is unstable"
        for s in places
        if not s.section.stable
    ]
    if radius >= 1.0 and not package.unstable:
        faults.append(f"a pole of magnitude {radius:.6f} that is not declared")
    if radius >= 1.0:
        observer = linear_law(package, 0.0).sampled.A
        recovery = float(np.abs(np.linalg.eigvals(observer)).max(initial=0.0))
        if recovery >= 1.0:
            faults.append(f"while it is limited its estimate grows: a pole of magnitude {recovery:.6f}")
    said = f"largest magnitude {radius:.6f}" + (", declared" if package.unstable else "")
    return to_step("poles", faults, said)


def check_vectors(package: ControllerPackage) -> GateStep:
    """Test vectors move all ports and the ramp; the reference gives them to the last bit."""
    stored = package.vectors
    if stored is None:
        return to_step("vectors", ["no test vectors"], "")
    unmoved = find_unmoved(package)
    if unmoved:
        return to_step("vectors", [f"{len(stored.y)} samples do not move {', '.join(unmoved)}"], "")
    found = run_vectors(package, stored.y, stored.engaged, stored.start_level)
    wrong = np.flatnonzero((found.u.view(np.int64) != stored.u.view(np.int64)).any(axis=1))
    faults = [f"sample {wrong[0] + 1} of {len(stored.y)} differs from the law"] if len(wrong) else []
    return to_step("vectors", faults, f"{len(stored.y)} samples agree to the last bit")


def check_error_bound(package: ControllerPackage, faded_by: str = "") -> GateStep:
    """No operation overflows; and in single precision the stated bound is that of its numbers at least.

    A bound for own commands only does not cover what ``faded_by`` names.
    """
    step = "error bound"
    holds = when_nothing_overflows(package)
    if package.error_bound is None:
        faults = [] if holds else ["that no operation overflows within the ranges is not known"]
        return to_step(step, faults, f"double precision: no operation overflows, {holds}")
    try:
        least = bound_error(package)
    except ConfigError as error:
        return to_step(step, [error.what], "")
    faults = [
        f"output {p.name} states an error bound of {stated:.3g}, but rounding may reach {needed:.3g}"
        for p, stated, needed in zip(package.outputs, package.error_bound, least.outputs, strict=True)
        if stated < needed
    ]
    if least.own and not package.error_bound_own:
        faults.append("it states a bound whatever is applied, but one is found for its own commands only")
    if package.error_bound_own and faded_by:
        faults.append(f"its bound is for its own commands applied in full, and {faded_by} fades them")
    return to_step(step, faults, f"at most {float(package.error_bound.max()):.3g}, {holds}")


def check_model(package: ControllerPackage, name: str, plant: Plant, least: GateMargins) -> GateStep:
    """The loop with ``plant`` is stable with margin at every fade; at zero nothing grows.

    A mode that the compensator neither reaches nor sees is none of its loop.
    """
    faded = faded_laws([package])
    fades = [Tried(f"at a fade of {fade:g}", faded([fade]), off=fade == 0.0) for fade in FADES]
    return check_loops(f"model {name}", plant, fades, least)


def check_loops(step: str, plant: Plant, tried: Sequence[Tried], least: GateMargins) -> GateStep:
    """The loop of ``plant`` with each law is stable with margin: a step of this name."""
    try:
        loops = [(one, align_plant(plant, one.law)) for one in tried]
        for one, aligned in loops:  # poles cost little beside margins: all of them first
            fault = why_unstable(decide_stability(aligned, one.law), one.off)
            if fault:
                return to_step(step, [f"{one.where}: {fault}"], "")
        weakest = math.inf
        for one, aligned in loops:
            margins = measure_margins(aligned, one.law, delays=False).loops
            gain = min((loop.gain_db for loop in margins), default=math.inf)
            phase = math.degrees(min((loop.phase_limit_rad for loop in margins), default=math.inf))
            weakest = min(weakest, gain)
            if gain < least.gain_db or phase < least.phase_deg:
                fault = f"{one.where}: margins of {gain:.2f} dB and {phase:.1f} degrees"
                return to_step(step, [fault], "")
    except NOT_DECIDED as error:
        return to_step(step, [f"not decided: {getattr(error, 'what', error)}"], "")
    said = f"least gain margin {weakest:.1f} dB" if math.isfinite(weakest) else "no gain makes it unstable"
    return to_step(step, [], f"stable at {len(tried)} fades, {said}")


def why_unstable(found: LoopStability, off: bool) -> str:
    """What grows, or does not decay; nothing where all decays, or all rests where the law is ``off``."""
    if found.decays or (off and found.stable):  # without control a free body rests where it is
        return ""
    if found.growing:
        return f"a root at {found.frequency_hz:.4g} Hz grows ({-found.margin:.3g} 1/s)"
    return f"a root at {found.frequency_hz:.4g} Hz does not decay: the law neither damps nor holds it"


def to_step(name: str, faults: list[str], said: str) -> GateStep:
    """Passed where there are no faults."""
    return GateStep(name=name, passed=not faults, said="; ".join(faults) or said)

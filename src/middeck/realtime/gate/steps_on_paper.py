"""Steps of the gate that need no rig: each examines a package, or its loop with a model."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from middeck.control.analysis.loop.feedback_loop import FeedbackLoop, form_loop
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.stability.stability import (
    LoopStability,
    decide_loop,
    decide_stability,
    find_roots,
)
from middeck.control.law.compensator import Compensator, locate_ports
from middeck.control.qualification import align_plant
from middeck.errors import ConfigError, NumericalError
from middeck.realtime.engine.interface.settings import Drive
from middeck.realtime.gate.linear_law import faded_laws, limited_law, linear_law
from middeck.realtime.gate.reached_slews import reached_slews
from middeck.realtime.gate.recovery_proof import why_unproved
from middeck.realtime.package.overflow import when_nothing_overflows
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.single_precision import bound_error
from middeck.realtime.package.vectors import find_unmoved, run_vectors
from middeck.systems.plants.plant import Plant
from middeck.systems.poles.stability import growth_limits
from middeck.systems.state_space.statespace import same_period
from middeck.values import record

FADES = tuple(k / 10.0 for k in range(11))
SLEWS = tuple(0.5**k for k in range(1, 15))
"""Shares of a step that a limit of slew lets through: lags with half the rate, and with a 16 000th of it."""
NOT_DECIDED = (NumericalError, ConfigError, ValueError)
"""ValueError: of NumPy and SciPy, where numbers overflow."""
FASTER = 2.0
"""How much faster than without the law what is not held may grow."""
PROVED, UNPROVED = "; proved for limits that come and go", "; not proved for limits that come and go"
AT_ONCE, NOR_AT_ONCE = ", of size and slew at once", ", nor for size and slew at once"
WITHIN = ", at full authority, while the sensors stay within their ranges"
BEHIND = " (the engine's effort trip stands behind)"
NOT_TRIED = "no proof is tried"
ALL_TOGETHER = 6
"""Most outputs of which all sets are tried."""


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
    return _step("blacklist", [] if reason is None else [f"it has tripped: {reason}"], "not on it")


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
    return _step("interface", faults, ports)


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
    return _step("poles", faults, said)


def check_vectors(package: ControllerPackage) -> GateStep:
    """Test vectors move all ports and the ramp; the reference gives them to the last bit."""
    stored = package.vectors
    if stored is None:
        return _step("vectors", ["no test vectors"], "")
    unmoved = find_unmoved(package)
    if unmoved:
        return _step("vectors", [f"{len(stored.y)} samples do not move {', '.join(unmoved)}"], "")
    found = run_vectors(package, stored.y, stored.engaged, stored.start_level)
    wrong = np.flatnonzero((found.u.view(np.int64) != stored.u.view(np.int64)).any(axis=1))
    faults = [f"sample {wrong[0] + 1} of {len(stored.y)} differs from the law"] if len(wrong) else []
    return _step("vectors", faults, f"{len(stored.y)} samples agree to the last bit")


def check_error_bound(package: ControllerPackage, faded_by: str = "") -> GateStep:
    """No operation overflows; and in single precision the stated bound is that of its numbers at least.

    A bound for own commands only does not cover what ``faded_by`` names.
    """
    step = "error bound"
    holds = when_nothing_overflows(package)
    if package.error_bound is None:
        faults = [] if holds else ["that no operation overflows within the ranges is not known"]
        return _step(step, faults, f"double precision: no operation overflows, {holds}")
    try:
        least = bound_error(package)
    except ConfigError as error:
        return _step(step, [error.what], "")
    faults = [
        f"output {p.name} states an error bound of {stated:.3g}, but rounding may reach {needed:.3g}"
        for p, stated, needed in zip(package.outputs, package.error_bound, least.outputs, strict=True)
        if stated < needed
    ]
    if least.own and not package.error_bound_own:
        faults.append("it states a bound whatever is applied, but one is found for its own commands only")
    if package.error_bound_own and faded_by:
        faults.append(f"its bound is for its own commands applied in full, and {faded_by} fades them")
    return _step(step, faults, f"at most {float(package.error_bound.max()):.3g}, {holds}")


def check_model(package: ControllerPackage, name: str, plant: Plant, least: GateMargins) -> GateStep:
    """The loop with ``plant`` is stable with margin at every fade; at zero nothing grows.

    A mode that the compensator neither reaches nor sees is none of its loop.
    """
    faded = faded_laws([package])
    fades = [Tried(f"at a fade of {fade:g}", faded([fade]), off=fade == 0.0) for fade in FADES]
    return check_loops(f"model {name}", plant, fades, least)


def check_recovery(
    package: ControllerPackage,
    name: str,
    plant: Plant,
    *,
    held: bool,
    alone: ControllerPackage | None,
    sums: Sequence[Drive] = (),
) -> GateStep:
    """Nothing grows on ``plant`` while some outputs are limited, from none of what they are asked for to 0.9.

    Limited are motors, u = g (p + c), in slew too where the package has such limits, and beside an inner
    loop or a hold the law's commands, u = p + g c.
    What grows at this limit without the law, at least half as fast, is not its doing, unless it is unstable
    by itself, or its own inner loop (p, where it is not ``held`` by the engine's) moves an article that rests
    without. An output whose limit of slew a growing motion within the sensors' ranges does not reach
    (`reached_slews`) has none, but in a law that is unstable by itself. These are loops that stay so, each
    with limits of one kind. For limits that come and go, of size and slew at once, a proof is tried
    (`why_unproved`) and told, of the law ``alone`` with all limits that act on it, beside a hold with those
    of the drives of ``sums`` besides; None where it is not tried. It decides of a law that is unstable by
    itself, which may run away where the proof ends: it passes with that proof only.
    """
    step, core = f"recovery {name}", package.core
    moved = np.asarray(np.hstack([core.C, core.D]).any(axis=1))
    whole, off = np.ones(len(moved)), np.zeros(len(moved))
    limits = [("", whole, drives, whole) for drives in _limits(np.ones_like(moved))]
    limits += [("the law's ", shares, whole, whole) for shares in _limits(moved) if package.paths]
    slews = _limits(np.isfinite(package.slew), SLEWS) if np.isfinite(package.slew).any() else ()
    limits += [("each step of ", whole, whole, shares) for shares in slews]
    unheld = 0
    try:
        limited, reached = limited_law(package), reached_slews(package)
        loop = form_loop(align_plant(plant, limited(whole, whole)), limited(whole, whole))
        for whose, commands, drives, steps in limits:
            found = _decide(loop, limited(commands, drives, steps))
            if found.growing and steps is not whole and not package.unstable:
                steps = _reached_part(loop, functools.partial(limited, whole, whole), reached, steps)
                found = _decide(loop, limited(commands, drives, steps))
            fault = _unstable(found, off=True)
            excuses = [] if not fault or package.unstable else [drives] if held else [drives, off]
            without = [_decide(loop, limited(off, g, steps)) for g in excuses]
            if without and all(w.growing and found.margin >= FASTER * w.margin for w in without):
                unheld += 1
            elif fault:
                least = commands * drives * steps
                names = [port.name for port, g in zip(package.outputs, least, strict=True) if g < 1.0]
                where = f"while {least.min():g} of {whose}{', '.join(names)} is applied"
                return _step(step, [f"{where}: {fault}"], "")
    except NOT_DECIDED as error:
        return _step(step, [f"not decided: {getattr(error, 'what', error)}"], "")
    said = f"nothing grows at any of {len(limits)} limits of outputs"
    said += f", but at {unheld} what does so without the law too" if unheld else ""
    reason = NOT_TRIED
    if alone is not None:
        reason = why_unproved(alone, plant, drives=sums, required=package.unstable)
    if reason and package.unstable:
        return _step(step, [f"{said}, but it is unstable by itself, and not proved to recover: {reason}"], "")
    if not reason:
        return _step(step, [], f"{said}{PROVED}{AT_ONCE if len(slews) else ''}{WITHIN}")
    return _step(step, [], f"{said}{UNPROVED}{NOR_AT_ONCE if len(slews) else ''}: {reason}{BEHIND}")


def _limits(places: np.ndarray, levels: Sequence[float] = FADES[:-1]) -> np.ndarray:
    """Shares of outputs: each set of ``places`` at each; of more than `ALL_TOGETHER` each, all but each, all.

    Of 654 random laws of seven motors, stable by themselves, these few find all but three of those 654 that
    all sets find to grow.
    """
    at = np.flatnonzero(places)
    few = [np.eye(len(at)), 1.0 - np.eye(len(at)), np.ones((1, len(at)))]
    every = (np.arange(1, 1 << min(len(at), ALL_TOGETHER))[:, None] >> np.arange(len(at))) % 2
    sets = np.vstack(few) if len(at) > ALL_TOGETHER else every
    shares = np.ones((len(sets) * len(levels), len(places)))
    shares[:, at] = np.vstack([1.0 - (1.0 - share) * sets for share in levels])
    return shares


def _reached_part(
    loop: FeedbackLoop,
    limited: Callable[[np.ndarray], Compensator],
    reached: Callable[[np.ndarray, np.ndarray], np.ndarray],
    shares: np.ndarray,
) -> np.ndarray:
    """Shares with which something grows that reaches them all, else ones: what is not reached is set to 1."""
    motions = _growing(loop, limited(shares))
    hit = reached(motions, shares)
    if hit.all(axis=1).any():
        return shares
    parts = [
        _reached_part(loop, limited, reached, np.where(row, shares, 1.0)) for row in np.unique(hit, axis=0)
    ]
    return next((part for part in parts if np.any(part < 1.0)), np.ones_like(shares))


def _growing(loop: FeedbackLoop, law: Compensator) -> np.ndarray:
    """The motions z^k of the sampled loop that grow."""
    sampled = law.sampled
    roots = find_roots(dataclasses.replace(loop, law=sampled))
    return np.exp(sampled.period_s * roots[np.real(roots) > growth_limits(roots, sampled.period_s)])


def _decide(loop: FeedbackLoop, law: Compensator) -> LoopStability:
    return decide_loop(dataclasses.replace(loop, law=law.sampled))


def check_loops(step: str, plant: Plant, tried: Sequence[Tried], least: GateMargins) -> GateStep:
    """The loop of ``plant`` with each law is stable with margin: a step of this name."""
    try:
        loops = [(one, align_plant(plant, one.law)) for one in tried]
        for one, aligned in loops:  # poles cost little beside margins: all of them first
            fault = _unstable(decide_stability(aligned, one.law), one.off)
            if fault:
                return _step(step, [f"{one.where}: {fault}"], "")
        weakest = math.inf
        for one, aligned in loops:
            margins = measure_margins(aligned, one.law, delays=False).loops
            gain = min((loop.gain_db for loop in margins), default=math.inf)
            phase = math.degrees(min((loop.phase_limit_rad for loop in margins), default=math.inf))
            weakest = min(weakest, gain)
            if gain < least.gain_db or phase < least.phase_deg:
                fault = f"{one.where}: margins of {gain:.2f} dB and {phase:.1f} degrees"
                return _step(step, [fault], "")
    except NOT_DECIDED as error:
        return _step(step, [f"not decided: {getattr(error, 'what', error)}"], "")
    said = f"least gain margin {weakest:.1f} dB" if math.isfinite(weakest) else "no gain makes it unstable"
    return _step(step, [], f"stable at {len(tried)} fades, {said}")


def _unstable(found: LoopStability, off: bool) -> str:
    if found.decays or (off and found.stable):  # without control a free body rests where it is
        return ""
    if found.growing:
        return f"a root at {found.frequency_hz:.4g} Hz grows ({-found.margin:.3g} 1/s)"
    return f"a root at {found.frequency_hz:.4g} Hz does not decay: the law neither damps nor holds it"


def _step(name: str, faults: list[str], said: str) -> GateStep:
    return GateStep(name=name, passed=not faults, said="; ".join(faults) or said)

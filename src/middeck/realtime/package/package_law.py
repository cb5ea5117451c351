"""A controller package of a sampled compensator."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops
from middeck.errors import ConfigError
from middeck.realtime.package.core import Core
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, static_gain
from middeck.realtime.package.modal_form import CONDITION, to_modal
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.poles.rounding import farthest_pole
from middeck.systems.poles.strong_components import component_poles

Form = Literal["auto", "dense", "modal"]
BETTER_STATED = (
    "state it so that its numbers hold its poles: by zeros and poles (scipy.signal.ZerosPolesGain) or in "
    "sections, not by the coefficients of one ratio"
)
Each = float | Sequence[float] | Float[np.ndarray, " port"]


def package_law(
    law: Compensator,
    name: str,
    *,
    input_range: Each = np.inf,
    limit: Each = np.inf,
    slew_rate: Each = np.inf,
    ramp_s: float = 0.0,
    inner: PDLoops | None = None,
    filters: Sequence[InputFilter] = (),
    form: Form = "auto",
    unstable: bool = False,
) -> ControllerPackage:
    """The sampled ``law`` as a package with test vectors.

    Args:
        law: u = K y, added at the plant's inputs. Where it has ``applied``, it estimates from the torque that
            was really applied; else it does not know of its limits.
        name: Letters, digits, ``_`` and ``-``.
        input_range, limit, slew_rate: Largest magnitude of each input, of each output, and of each output's
            rate [1/s]; one number stands for all ports.
        ramp_s: Time from zero to full authority.
        inner: PD loops that run beside the law, on outputs and inputs that it has too.
        filters: Sections in series with inputs of the law.
        form: ``"modal"`` or ``"dense"``; ``"auto"`` is modal where the poles are far enough apart.
        unstable: Declares poles on or outside the unit circle, or that rounding may take there.

    Raises `ConfigError` for a continuous law (see `emulate`), a law with such poles that are not declared,
    a modal form of poles that nearly coincide, and what `ControllerPackage` refuses.

    >>> from middeck.systems.state_space.statespace import SampledStateSpace
    >>> lag = SampledStateSpace([[0.5]], [[1.0]], [[1.0]], [[-2.0]], period_s=0.002)
    >>> made = package_law(Compensator(lag, (Port("y", "rad"),), (Port("u", "N m"),)), "lag", limit=0.25)
    >>> made.core.pairs, made.vectors.u[0].tolist() == [0.25]
    (0, False)
    """
    if form not in get_args(Form):
        raise ConfigError(f"no form {form!r}", hint=f"one of {', '.join(get_args(Form))}")
    sampled = law.sampled
    radius, reach = float(np.abs(component_poles(sampled.A)).max(initial=0.0)), farthest_pole(sampled.A)
    if reach >= 1.0 and not unstable:
        blur = reach - radius
        sure = radius - blur >= 1.0 - 1e-9
        instead = "design with less authority" if sure else BETTER_STATED
        raise ConfigError(
            f"the compensator {'is' if sure else 'may be'} unstable by itself: "
            f"a pole of magnitude {radius:.6f} +- {blur:.0e}",
            hint=f"declare it, and it must be proved on every model; or {instead}",
        )
    if not (np.isfinite(ramp_s) and ramp_s >= 0.0):
        raise ConfigError(f"a ramp of {ramp_s} s", hint=">= 0 s, 0 for none")
    inner_paths = () if inner is None else _loop_paths(law, inner)
    steady = all(place.section.stable for place in (*filters, *inner_paths))
    top = _each(limit, len(law.outputs), "limits")
    return add_test_vectors(
        ControllerPackage(
            name=name,
            period_s=sampled.period_s,
            inputs=_bare(law.inputs),
            outputs=_bare(law.outputs),
            input_range=_each(input_range, len(law.inputs), "ranges"),
            lower=-top,
            upper=top,
            slew=_each(slew_rate, len(law.outputs), "slew rates") * sampled.period_s,
            core=_core(law, form),
            filters=tuple(filters),
            paths=inner_paths,
            ramp=math.ceil(ramp_s / sampled.period_s - 1e-6),
            unstable=unstable and not (reach < 1.0 and steady),
        )
    )


def without_applied(package: ControllerPackage) -> ControllerPackage:
    """``package`` whose law does not know of limits and fade, with new test vectors.

    Raises `ConfigError` for one in single precision: its bound is that of the law with the path.
    """
    if package.single and package.core.drives:
        raise ConfigError(
            "the bound of its error holds for the law with the path of applied commands only",
            hint="the package in double precision",
        )
    core = dataclasses.replace(package.core, E=np.zeros_like(package.core.E))
    return add_test_vectors(dataclasses.replace(package, core=core, vectors=None))


def _core(law: Compensator, form: Form) -> Core:
    s = law.sampled
    E = np.zeros((len(s.A), len(law.outputs))) if law.applied is None else law.applied
    dense = Core(A=s.A, B=s.B, C=s.C, D=s.D, E=E, pairs=None)
    if form == "dense":
        return dense
    modal = to_modal(dense)
    if modal is None and form == "modal":
        raise ConfigError(
            f"poles nearly coincide: the eigenvectors have a condition above {CONDITION:g}",
            hint="form='dense'",
        )
    return modal or dense


def _each(value: Each, count: int, what: str) -> np.ndarray:
    try:
        given = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{what}: {error}", hint="numbers") from None
    if given.shape not in ((), (count,)):
        raise ConfigError(f"{given.size} {what} for {count} ports", hint="one for all, or one for each")
    return np.broadcast_to(given, count)


def _bare(ports: Sequence[Port]) -> tuple[Port, ...]:
    return tuple(dataclasses.replace(port, channel=None) for port in ports)


def _loop_paths(law: Compensator, inner: PDLoops) -> tuple[LoopPath, ...]:
    """-(kp angle + kd rate): two paths to each loop's output."""
    reads, drives = [p.name for p in law.inputs], [p.name for p in law.outputs]
    paths: list[LoopPath] = []
    for name, kp, kd in zip(inner.names, inner.kp.tolist(), inner.kd.tolist(), strict=True):
        for port, gain in ((name, kp), (f"{name}_rate", kd)):
            if port not in reads or name not in drives:
                missing = port if port not in reads else name
                raise ConfigError(
                    f"the inner loop {name} needs {missing}, which the law has not",
                    hint=f"it reads {', '.join(reads)} and drives {', '.join(drives)}; zeros may fill a port",
                )
            if gain:
                paths.append(LoopPath(reads.index(port), drives.index(name), static_gain(-gain)))
    return tuple(paths)

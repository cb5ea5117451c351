"""python-control: `StateSpace` and `TransferFunction` objects, with the names of signals and states."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.errors import ConfigError, MissingExtraError
from middeck.files.exchange.named_system import Exchangeable, exchanged, known_ports, matrices_of
from middeck.files.exchange.transfer_functions import build_foreign, realise_ratio, settle_period, with_delay
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import LinearSystem

# python-control keeps the dot for "system.signal".
DOT, INSTEAD = ".", "·"


@named_kinds
def to_control(value: Exchangeable, *, negative_feedback: bool = False, name: str | None = None) -> Any:
    """``value`` as a `control.StateSpace` with the names of its ports and states.

    A compensator's sign is that of this house: u = K y is added, so that ``control.feedback(P, K, sign=+1)``
    closes the loop. With ``negative_feedback=True`` it is -K, for ``control.feedback(P, K)``.

    A dot in the name of a port becomes "·". States of one name are numbered: "bending #1", "bending #2".
    Units and groups have no place there; `from_control` finds units again in ``like``.

    Raises `MissingExtraError` where python-control is not installed; `ConfigError` for what cannot be
    exchanged, as two ports of one name or a number that is not finite.
    """
    control = _library()
    named = exchanged(value, negative_feedback=negative_feedback)
    system = matrices_of(named)
    labels = {
        "inputs": _port_labels(named.inputs, "input"),
        "outputs": _port_labels(named.outputs, "output"),
        "states": _numbered(named.state_names) or None,
    }
    dt = system.period_s or 0
    return control.StateSpace(
        system.A, system.B, system.C, system.D, dt, **labels, name=name, remove_useless_states=False
    )


@named_kinds
def from_control(
    system: Any,
    *,
    like: Sequence[Port] = (),
    period_s: float | None = None,
    delay_s: float | Float[np.ndarray, "output input"] = 0.0,
) -> Plant:
    """A state space, or a transfer function of one input and output, of python-control, with its names.

    Args:
        system: ``control.StateSpace`` or ``control.TransferFunction``.
        like: Ports whose namesakes here get their units and transducers.
        period_s: Sampling period [s] of a system whose dt is None or True; 0 for a continuous one.
        delay_s: Delay [s] of all paths, or of each, which python-control has no place for; kept exact.

    Raises `ConfigError` for a complex or improper system, an open time base, a negative delay, the delay of a
    sampled system, a transfer function with several
    inputs or outputs, or an object that is neither.
    """
    what = f"{type(system).__name__} {getattr(system, 'name', '') or ''}".strip()
    if not hasattr(system, "dt") or not hasattr(system, "input_labels"):
        raise _refused(what)
    period = settle_period(system.dt, period_s, what)
    found = _matrices(system, period, what)
    inputs, outputs = (
        known_ports([label.replace(INSTEAD, DOT) for label in labels], like)
        for labels in (system.input_labels, system.output_labels)
    )
    # A transfer function has no states of its own to name.
    states = getattr(system, "state_labels", ()) if hasattr(system, "A") else ()
    own = tuple(f"x[{i}]" for i in range(len(found.A)))
    names = () if tuple(states) == own else _without_numbers(states)
    plant = Plant(dynamics=found, inputs=inputs, outputs=outputs, state_names=names)
    return with_delay(plant, delay_s)


def _library() -> Any:
    try:
        return import_module("control")
    except ImportError:
        raise MissingExtraError("python-control is not installed", extra="control") from None


def _refused(what: str) -> ConfigError:
    return ConfigError(
        f"{what}: neither a state space nor a transfer function",
        hint="control.ss or control.tf; a measured response is fitted first (fit_response)",
    )


def _matrices(system: Any, period: float | None, what: str) -> LinearSystem:
    if all(hasattr(system, name) for name in "ABCD"):
        return build_foreign({name: getattr(system, name) for name in "ABCD"}, period, what)
    if not (hasattr(system, "num") and hasattr(system, "den")):
        raise _refused(what)
    if len(system.input_labels) != 1 or len(system.output_labels) != 1:
        raise ConfigError(
            f"{what}: a transfer function of several inputs or outputs", hint="control.ss(system) first"
        )
    ratio = realise_ratio(system.num[0][0], system.den[0][0], what)
    return build_foreign({name: getattr(ratio, name) for name in "ABCD"}, period, what)


def _port_labels(ports: Sequence[Port], side: str) -> list[str]:
    names = [port.name for port in ports]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise ConfigError(f"two {side}s named {', '.join(twice)}", hint="a name of its own for each port")
    taken = [name for name in names if INSTEAD in name]
    if taken:
        raise ConfigError(f'{side} {taken[0]!r}: "{INSTEAD}" stands for a dot there', hint="another name")
    return [name.replace(DOT, INSTEAD) for name in names]


def _numbered(names: Sequence[str]) -> list[str]:
    """Names of states, made unique by " #1", " #2"; a name that occurs once stays."""
    count, seen = Counter(names), Counter[str]()
    labels: list[str] = []
    for name in names:
        seen[name] += 1
        labels.append(f"{name} #{seen[name]}" if count[name] > 1 else name)
    return labels


def _without_numbers(labels: Sequence[str]) -> tuple[str, ...]:
    stems = [label.rsplit(" #", 1)[0] if label.rsplit(" #", 1)[-1].isdigit() else label for label in labels]
    # Numbered by `to_control`, or the other side's own names?
    ours = _numbered(stems) == list(labels)
    return tuple(stems if ours else labels)

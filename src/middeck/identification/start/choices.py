"""What kind of model is to be fitted; refused where the options of a fit exclude each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal

from middeck.errors import ConfigError
from middeck.identification.start.start import Options
from middeck.signals.ports import Port
from middeck.systems.response import FrequencyResponse
from middeck.values import record

Constants = Literal["real", "complex"]
Delay = Literal["output", "path", "common"]


@record
class Choices:
    """The options of `fit_response` and `fit_record`, as given; None where the others decide."""

    sample_hz: float | None = None
    constants: Constants | None = None
    delay: bool | Delay | None = None
    direct: bool | None = None
    residuals: bool = False
    full_rank: bool = False
    rigid: int = 0
    relative_degree: Literal[0, 1, 2] | None = None
    integrators: int = 0


def at_zero(choices: Choices) -> int:
    """States of the poles at zero.

    >>> at_zero(Choices(rigid=2))
    4
    """
    return 2 * choices.rigid + choices.integrators


def options_of(measured: FrequencyResponse, states: int | None, choices: Choices) -> Options:
    """The options of the search, for the least order where none is given.

    Raises `ConfigError` for a combination that has no meaning.
    """
    real = (choices.constants or usual_constants(measured.outputs, choices.sample_hz)) == "real"
    outputs, inputs = measured.H.shape[1:]
    _check_sampled(measured, choices, real=real)
    _check_rigid(choices, min(outputs, inputs))
    still = at_zero(choices)
    least = still + 1
    states = still + 2 if states is None else states
    if states < least:
        raise ConfigError(f"a model of {states} states cannot be fitted", hint=f"{least} states or more")
    if real and (states - still) % 2:
        raise ConfigError(
            f"{states} states, {still} of them at zero, are no whole number of modes",
            hint="one more, for an even number beside those at zero, or constants='complex'",
        )
    with_delay = real if choices.delay is None else bool(choices.delay)
    return Options(
        states - still,
        real,
        with_delay,
        choices.residuals,
        _with_direct(choices, real=real),
        0.0 if choices.sample_hz is None else 1.0 / choices.sample_hz,
        choices.full_rank and inputs > 1,
        choices.rigid,
        choices.delay if isinstance(choices.delay, str) else "output",
        choices.relative_degree == 2 and not real,
        choices.integrators,
    )


def usual_constants(outputs: Sequence[Port], sample_hz: float | None) -> Constants:
    """Real ones of relative degree two, but for a sampled model and for rates and accelerations.

    >>> usual_constants([Port("tip", "m")], None), usual_constants([Port("tip", "m/s^2")], None)
    ('real', 'complex')
    """
    return "complex" if sample_hz is not None or any(is_rate(p) for p in outputs) else "real"


def is_rate(port: Port) -> bool:
    """Whether the unit is that of a velocity or an acceleration: no modal constant of degree two fits it."""
    return port.unit.strip() in ("g", "gn", "g0") or bool(re.search(r"/\s*s(\^?2|²)?$", port.unit.strip()))


def _check_sampled(measured: FrequencyResponse, choices: Choices, *, real: bool) -> None:
    if choices.sample_hz is None:
        return
    if real or choices.delay or choices.residuals or at_zero(choices) or choices.relative_degree == 2:
        raise ConfigError(
            "a sampled model has complex constants, no separate delay, no residual terms, no rigid modes or "
            "integrators and no relative degree two",
            hint="leave these out, or fit a continuous model",
        )
    if measured.frequency_hz[-1] >= 0.5 * choices.sample_hz:
        raise ConfigError(
            f"the response reaches {measured.frequency_hz[-1]:.6g} Hz, beyond half of "
            f"{choices.sample_hz:.6g} Hz"
        )


def _check_rigid(choices: Choices, most: int) -> None:
    for count, name in ((choices.rigid, "rigid modes"), (choices.integrators, "integrators")):
        if not 0 <= count <= most:
            raise ConfigError(
                f"{count} {name} cannot be told apart",
                hint=f"no more than inputs and outputs: {most} here",
            )
    if choices.integrators and choices.rigid:
        raise ConfigError(
            "rigid modes and integrators are both free motion: their states would be one, told twice",
            hint="fit outputs that are angles or ways apart from those that are rates",
        )
    if choices.integrators and choices.relative_degree == 2:
        raise ConfigError("an integrator has relative degree one", hint="leave out one of them")
    if choices.rigid and choices.residuals:
        raise ConfigError(
            "rigid modes and the residual of modes below the band are both 1/s^2",
            hint="rigid, or residuals; direct=True stands for the modes above",
        )


def _with_direct(choices: Choices, *, real: bool) -> bool:
    if choices.relative_degree is None:
        return choices.residuals or (not real if choices.direct is None else choices.direct)
    if choices.relative_degree and (choices.residuals or choices.direct):
        raise ConfigError(
            f"a constant term has relative degree zero, not {choices.relative_degree}",
            hint="leave out direct and residuals, or relative_degree",
        )
    return choices.relative_degree == 0

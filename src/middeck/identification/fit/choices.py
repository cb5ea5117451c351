"""What kind of model is to be fitted; refused where the options of `fit_response` exclude each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal

from middeck.errors import ConfigError
from middeck.identification.fit.start import Options
from middeck.systems.ports import Port
from middeck.systems.response import FrequencyResponse
from middeck.values import record

Constants = Literal["real", "complex"]
Delay = Literal["output", "path", "common"]


@record
class Choices:
    """The options of `fit_response`, as given; None where the default depends on the others."""

    sample_hz: float | None = None
    constants: Constants | None = None
    delay: bool | Delay | None = None
    direct: bool | None = None
    residuals: bool = False
    full_rank: bool = False
    rigid: int = 0
    relative_degree: Literal[0, 1, 2] | None = None


def options_of(measured: FrequencyResponse, states: int, choices: Choices) -> Options:
    """The options of the search; raises `ConfigError` for a combination that has no meaning."""
    real = (choices.constants or usual_constants(measured.outputs, choices.sample_hz)) == "real"
    outputs, inputs = measured.H.shape[1:]
    _check_sampled(measured, choices, real=real)
    _check_rigid(choices, min(outputs, inputs))
    least = 2 * choices.rigid + 1
    if states < least:
        raise ConfigError(f"a model of {states} states cannot be fitted", hint=f"{least} states or more")
    if real and states % 2:
        raise ConfigError(
            f"{states} states are no whole number of modes", hint="an even number, or constants='complex'"
        )
    with_delay = real if choices.delay is None else bool(choices.delay)
    return Options(
        states - 2 * choices.rigid,
        real,
        with_delay,
        choices.residuals,
        _with_direct(choices, real=real),
        0.0 if choices.sample_hz is None else 1.0 / choices.sample_hz,
        choices.full_rank and inputs > 1,
        choices.rigid,
        choices.delay if isinstance(choices.delay, str) else "output",
        choices.relative_degree == 2 and not real,
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
    if real or choices.delay or choices.residuals or choices.rigid or choices.relative_degree == 2:
        raise ConfigError(
            "a sampled model has complex constants, no separate delay, no residual or rigid terms and no "
            "relative degree two",
            hint="leave these out, or sample_hz",
        )
    if measured.frequency_hz[-1] >= 0.5 * choices.sample_hz:
        raise ConfigError(
            f"the response reaches {measured.frequency_hz[-1]:.6g} Hz, beyond half of "
            f"{choices.sample_hz:.6g} Hz"
        )


def _check_rigid(choices: Choices, most: int) -> None:
    if not 0 <= choices.rigid <= most:
        raise ConfigError(
            f"{choices.rigid} rigid modes cannot be told apart",
            hint=f"no more than inputs and outputs: {most} here",
        )
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

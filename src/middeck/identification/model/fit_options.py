"""Options of a fit: one set, as asked for and as decided."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from typing import Literal, get_args

from middeck.errors import ConfigError
from middeck.identification.model.refused_data import check_word
from middeck.signals.ports import Port
from middeck.systems.plants.response import FrequencyResponse
from middeck.values import record

Constants = Literal["real", "complex"]
Delay = Literal["output", "path", "common"]


@record(kw_only=True)
class FitOptions:
    """The kind of model; see `fit_response`.

    None is left to the data (`decided`). Once decided, ``residuals`` is the term 1/s^2 alone, ``direct`` the
    constant term.
    """

    states: int | None = None
    sample_hz: float | None = None
    constants: Constants | None = None
    delay: bool | Delay | None = None
    direct: bool | None = None
    residuals: bool = False
    full_rank: bool = False
    rigid: int = 0
    integrators: int = 0
    relative_degree: Literal[0, 1, 2] | None = None

    @property
    def at_zero(self) -> int:
        """States of the poles at zero.

        >>> FitOptions(rigid=2).at_zero
        4
        """
        return 2 * self.rigid + self.integrators

    @property
    def moving(self) -> int:
        """States beside those at zero."""
        return (self.states or 0) - self.at_zero

    def sized(self, moving: int) -> FitOptions:
        """The same with so many states beside those at zero."""
        return dataclasses.replace(self, states=moving + self.at_zero)

    @property
    def real_constants(self) -> bool:
        """Whether pairs have real modal constants."""
        return self.constants == "real"

    @property
    def delay_of(self) -> Delay | None:
        """Kind of the delays: one for each output, for each path, or for all; None without."""
        return self.delay if isinstance(self.delay, str) else "output" if self.delay else None

    @property
    def only_continuous(self) -> bool:
        """Whether anything is asked for that a sampled model does not have."""
        asked = self.delay or self.residuals or self.at_zero or self.relative_degree == 2
        return bool(self.real_constants or asked)

    @property
    def period_s(self) -> float:
        """Sampling period, or zero in continuous time."""
        return 0.0 if self.sample_hz is None else 1.0 / self.sample_hz

    @property
    def zero_sum(self) -> bool:
        """Whether complex residues of each path add up to zero: the response falls with 1/s^2."""
        return self.relative_degree == 2 and not self.real_constants


def decided(measured: FrequencyResponse, asked: FitOptions) -> FitOptions:
    """The options of a search: nothing left open, the least order where none is given.

    Raises `ConfigError` for a combination that has no meaning.
    """
    check_word("constants", asked.constants, get_args(Constants))
    check_word("delay", asked.delay, (True, False, *get_args(Delay)))
    check_word("relative_degree", asked.relative_degree, (0, 1, 2))
    constants = asked.constants or usual_constants(measured.outputs, asked.sample_hz)
    real = constants == "real"
    _check_sampled(measured, asked)
    _check_rigid(asked, min(measured.H.shape[1:]))
    still = asked.at_zero
    states = still + 2 if asked.states is None else asked.states
    if states <= still:
        raise ConfigError(f"a model of {states} states cannot be fitted", hint=f"{still + 1} states or more")
    if real and (states - still) % 2:
        raise ConfigError(
            f"{states} states, {still} of them at zero, are no whole number of modes",
            hint="one more, for an even number beside those at zero, or constants='complex'",
        )
    return dataclasses.replace(
        asked,
        states=states,
        constants=constants,
        delay=real if asked.delay is None else asked.delay,
        direct=_with_direct(asked, measured.outputs, real=real),
        full_rank=asked.full_rank and measured.H.shape[2] > 1,
    )


# Why a fit has a delay of each path where nothing was asked for.
OF_PATHS = "each path has a delay of its own, as one of each output describes the data in more words"


def may_be_of_paths(options: FitOptions, asked: FitOptions) -> bool:
    """Whether a delay of each path may be tried: the user stated neither delays nor an order."""
    return asked.delay is None and asked.states is None and options.delay_of == "output"


def usual_constants(outputs: Sequence[Port], sample_hz: float | None) -> Constants:
    """Default constants: real ones of relative degree two, but not for sampled models or rates.

    >>> usual_constants([Port("tip", "m")], None), usual_constants([Port("tip", "m/s^2")], None)
    ('real', 'complex')
    """
    return "complex" if sample_hz is not None or any(is_rate(p) for p in outputs) else "real"


# What moves, in lower case: a length, an angle or a strain. Forces, powers and flows over seconds are none.
LENGTH = r"([kcdmμun]|milli|micro|centi|kilo)?m(et(er|re)s?)?|in(ch(es)?)?|ft|feet|foot|mils?|yd"
ANGLE = r"([mμun]|milli|micro)?(rad(ian)?s?|deg(ree)?s?)|°|arc[ -]?(sec|min)|rev(olution)?s?|turns?|r"
MOTION = rf"({LENGTH}|{ANGLE}|(micro)?strain|μ?ε|μ?m/m|1|)[\s·*.]*"
# The end of its unit: over a time, once or twice, by a stroke or by a negative power.
TIME = r"(([mμnu]|milli|micro)?s(ec(ond)?s?)?|min(utes?)?|h(r|ours?)?)\s*"
TWICE = rf"((\^|\*\*)?\s*\{{?2\}}?|²|[/*·]\s*{TIME})"


def _over_seconds(twice: str, power: str) -> re.Pattern[str]:
    over = rf"/\s*({TIME}{twice}|\(\s*{TIME}{twice}\s*\))"
    return re.compile(rf"{MOTION}({over}|{TIME}((\^|\*\*)?[({{]?-\s*{power[0]}[)}}]*|⁻{power[1]}))")


VELOCITY, ACCELERATION = _over_seconds("", "1¹"), _over_seconds(TWICE, "2²")
# Units of rates that are known by name.
SPEEDS = ("rpm", "rps", "ips", "mph", "dps", "mdps")
BY_NAME = ("g", "gn", "g0", "g_n", "g's", "mg", "μg", "ug", "gal", "mgal")


def is_rate(port: Port) -> bool:
    """Whether the unit is that of a velocity or an acceleration: no modal constant of degree two fits it.

    In any of the ways that files of measuring systems write one:

    >>> [is_rate(Port("tip", u)) for u in ("M/S2", "m/s**2", "m/s/s", "(m s^-2)", "ms⁻²", "in/sec^2", "G")]
    [True, True, True, True, True, True, True]
    >>> [is_rate(Port("tip", u)) for u in ("m/(s^2)", "meter / second ** 2", "m/s^{2}", "m s^{-2}", "°/s")]
    [True, True, True, True, True]
    >>> [is_rate(Port("tip", u)) for u in ("m", "N", "g/N", "V", "ms", "m/s^3", "", "V/(m/s)")]
    [False, False, False, False, False, False, False, False]
    >>> [is_rate(Port("cell", u)) for u in ("N m/s", "Nm/s", "N/s", "kg m/s^2", "m^3/s", "counts/s")]
    [False, False, False, False, False, False]
    """
    return is_velocity(port) or is_acceleration(port)


def is_velocity(port: Port) -> bool:
    """Whether the unit is that of a velocity: its response has relative degree one.

    >>> [is_velocity(Port("tip", u)) for u in ("m/s", "rad s^-1", "rpm", "m/s^2", "g", "m")]
    [True, True, True, False, False, False]
    """
    unit = _plain(port.unit)
    return unit in SPEEDS or bool(VELOCITY.fullmatch(unit))


def is_acceleration(port: Port) -> bool:
    """Whether the unit is that of an acceleration: its response has relative degree zero.

    >>> [is_acceleration(Port("tip", u)) for u in ("m/s/s", "rad s^-2", "g", "m/s", "rpm")]
    [True, True, True, False, False]
    """
    unit = _plain(port.unit)
    return unit in BY_NAME or bool(ACCELERATION.fullmatch(unit))


def _plain(unit: str) -> str:
    """The unit without brackets, in lower case."""
    unit = re.sub(r"^[(\[{]([^()\[\]]*)[)\]}]$", r"\1", unit.strip()).strip()
    # Nanometres have a small n.
    return re.sub("N(?=[mM])", "N ", unit).casefold()


def _check_sampled(measured: FrequencyResponse, asked: FitOptions) -> None:
    if asked.sample_hz is None:
        return
    if asked.only_continuous:
        raise ConfigError(
            "a sampled model has complex constants, no separate delay, no residual terms, no rigid modes or "
            "integrators and no relative degree two",
            hint="leave these out, or fit a continuous model",
        )
    if measured.frequency_hz[-1] >= 0.5 * asked.sample_hz:
        raise ConfigError(
            f"the response reaches {measured.frequency_hz[-1]:.6g} Hz, beyond half of "
            f"{asked.sample_hz:.6g} Hz",
            hint="a band below half the rate, or a continuous model",
        )


def _check_rigid(asked: FitOptions, most: int) -> None:
    for count, name in ((asked.rigid, "rigid modes"), (asked.integrators, "integrators")):
        if not 0 <= count <= most:
            raise ConfigError(
                f"{count} {name} cannot be told apart", hint=f"no more than inputs and outputs: {most} here"
            )
    if asked.integrators and asked.rigid:
        raise ConfigError(
            "rigid modes and integrators together represent the same free motion twice",
            hint="fit outputs that are angles or ways apart from those that are rates",
        )
    if asked.integrators and asked.relative_degree == 2:
        raise ConfigError("an integrator has relative degree one", hint="leave out one of them")
    if asked.rigid and asked.residuals:
        raise ConfigError(
            "rigid modes and the residual of modes below the band are both 1/s^2",
            hint="rigid, or residuals; direct=True stands for the modes above",
        )


def _with_direct(asked: FitOptions, outputs: Sequence[Port], *, real: bool) -> bool:
    """Complex constants take up a delay but for their sum: the constant term that a velocity lacks."""
    if asked.relative_degree is None:
        told_by_sum = bool(asked.delay) and all(is_velocity(port) for port in outputs)
        return asked.residuals or (not (real or told_by_sum) if asked.direct is None else asked.direct)
    if asked.relative_degree and (asked.residuals or asked.direct):
        raise ConfigError(
            f"a constant term has relative degree zero, not {asked.relative_degree}",
            hint="leave out direct and residuals, or relative_degree",
        )
    return asked.relative_degree == 0

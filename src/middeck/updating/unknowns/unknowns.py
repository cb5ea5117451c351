"""Unknowns of a refinement: named parameters, alone or together, each with its prior."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

import numpy as np
from jaxtyping import Float, Int

from middeck.errors import ConfigError
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.structure.sensitivity.frequency_derivatives import differentiate_products
from middeck.structure.sensitivity.parameters import (
    ModelParameter,
    choose_parameters,
    list_parameters,
    read_parameter,
    set_parameter,
)
from middeck.values import record

ENVIRONMENT, DAMPING, FRICTION = "environment.", "damping.", "friction."


@record(kw_only=True)
class Unknown:
    """One unknown x: parameters that move together, and a normal prior of it.

    Attributes:
        parameters: Names as `find_parameters` takes them, with ``*`` and ``?``; or of the loop that a
            survey's response has beside the article, ``loop.delay_s``, which is added to, and
            ``loop.sensor_gain.NAME`` and ``loop.motor_gain.NAME``.
            ``friction.JOINT.slip_torque`` and ``.slip_angle`` are of joints whose friction a survey states.
            Damping and friction are never added to, so that they stay positive.
        spread: Standard deviation of x: of the logarithm of a factor on all of the parameters or, where x is
            ``added``, of the addition to each of them, in its unit.
        mean: Prior mean of x; zero is the article as drawn.

    Raises `ConfigError` for a spread that is not positive, for no parameter, for some of the article and some
    of the environment, and for damping or friction that is added.

    >>> Unknown(name="stiffness", parameters=("members.E",), spread=0.1).spread
    0.1
    """

    name: str
    parameters: tuple[str, ...]
    spread: float
    mean: float = 0.0
    added: bool = False

    def __post_init__(self) -> None:
        for what, hint in self._faults():
            raise ConfigError(what, where=f"unknown {self.name!r}", hint=hint)

    def _faults(self) -> Iterator[tuple[str, str]]:
        if not (0.0 < self.spread < np.inf and np.isfinite(self.mean)):
            what = f"a spread of {self.spread} and a mean of {self.mean}"
            yield what, "a positive standard deviation, e.g. 0.1 for 10 % of a factor"
        if any(name.startswith(LOOP) for name in self.parameters):
            yield from _loop_faults(self.parameters, self.added)
        if self.added and any(name.startswith((DAMPING, FRICTION)) for name in self.parameters):
            what = "an amount added to damping or friction, which could make it negative"
            yield what, "a factor: leave added out; spread = 1.0 is a factor of 2.7, one standard deviation"
        of_environment = {name.startswith(ENVIRONMENT) for name in self.parameters}
        if not self.parameters or len(of_environment) > 1:
            both = "one unknown changes parameters of both the article and the environment"
            hint = "parameters of the article alone, such as members.E, or of the environment alone"
            yield both if self.parameters else "no parameter", hint


@record
class Bound:
    """An unknown, and the parameters that it moves in one article and environment."""

    unknown: Unknown
    parameters: tuple[ModelParameter, ...]


def bind(unknowns: Sequence[Unknown], structure: Structure, environment: Environment) -> tuple[Bound, ...]:
    """Parameters that each unknown moves here; those of a suspension are not in every environment.

    Raises `ConfigError` for a name that fits none, for a parameter named twice, and for a factor on numbers
    that are zero.
    """
    every = list_parameters(structure, environment)
    return tuple(Bound(u, _fitting(u, every)) for u in unknowns)


def _fitting(unknown: Unknown, every: Sequence[ModelParameter]) -> tuple[ModelParameter, ...]:
    found: list[ModelParameter] = []
    for name in unknown.parameters:
        if name.startswith((LOOP, FRICTION)):
            continue
        some = choose_parameters(every, [name], missing=name.startswith(ENVIRONMENT))
        if some and not unknown.added and not any(p.value for p in some):
            raise ConfigError(
                f"{some[0].name} is 0: a factor on it changes nothing",
                where=f"unknown {unknown.name!r}",
                hint="a small positive number in the article's [damping], and a wide spread"
                if some[0].name.startswith(DAMPING)
                else "added = true adds the unknown instead of multiplying by it",
            )
        found += [p for p in some if unknown.added or p.value]
    names = [p.name for p in found]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigError(
            f"{twice[0]} is named twice: the unknown would move it twice",
            where=f"unknown {unknown.name!r}",
            hint="patterns that do not overlap",
        )
    return tuple(found)


def change(
    structure: Structure, environment: Environment, bound: Sequence[Bound], x: Float[np.ndarray, " unknown"]
) -> tuple[Structure, Environment]:
    """Both with the unknowns at ``x``; factors on one number multiply."""
    both = structure, environment
    for one, value in zip(bound, x.tolist(), strict=True):
        for parameter in one.parameters:
            now = read_parameter(*both, parameter).value
            both = set_parameter(*both, parameter, now + value if one.unknown.added else now * np.exp(value))
    return both


def product_slopes(
    modes: Modes,
    bound: Sequence[Bound],
    left: Int[np.ndarray, " pair"],
    right: Int[np.ndarray, " pair"],
    lam: Float[np.ndarray, " pair"],
    *,
    still: bool = False,
) -> Float[np.ndarray, "pair unknown"]:
    """phi_l'(dK - lambda dM) phi_r by each unknown, where ``modes`` are; ``still`` as
    `differentiate_products` has it."""
    rest = modes.equilibrium
    now = [[read_parameter(rest.model.structure, rest.environment, p) for p in b.parameters] for b in bound]
    found = iter(
        differentiate_products(modes, [p for own in now for p in own], left, right, lam, still=still)
    )
    out = np.zeros((len(left), len(bound)))
    for k, own in enumerate(now):
        for parameter in own:
            out[:, k] += next(found) * (1.0 if bound[k].unknown.added else parameter.value)
    return out


LOOP = "loop."
DELAY, SENSOR, MOTOR = "loop.delay_s", "loop.sensor_gain.", "loop.motor_gain."


def _loop_faults(parameters: Sequence[str], added: bool) -> Iterator[tuple[str, str]]:
    """A name that no loop has, a factor where a sum is meant, or a sum."""
    for parameter in parameters:
        if not parameter.startswith(LOOP):
            yield "parameters of the loop and of the article together", "an unknown for each"
        if parameter != DELAY and not parameter.startswith((SENSOR, MOTOR)):
            yield f"a loop has no {parameter}", f"{DELAY}, {SENSOR}NAME or {MOTOR}NAME"
        if added != (parameter == DELAY):
            what = "is added to, in seconds" if parameter == DELAY else "is a factor"
            yield f"{parameter} {what}", f"added = {str(parameter == DELAY).lower()}"


@record
class LoopSlopes:
    """Whether each unknown moves the delay, and the gain of each output and input: one or zero."""

    delay: Float[np.ndarray, " unknown"]
    output: Float[np.ndarray, "output unknown"]
    input: Float[np.ndarray, "input unknown"]

    @property
    def any(self) -> np.ndarray:
        """Whether each unknown has an effect here."""
        return (np.vstack([self.delay, self.output, self.input]) != 0.0).any(axis=0)


def loop_slopes(
    unknowns: Sequence[Sequence[str]], inputs: Sequence[str], outputs: Sequence[str]
) -> LoopSlopes:
    """Derivatives by unknowns, named by their parameters; an angle and its rate are one sensor's."""
    sensors = [f"{SENSOR}{name.removesuffix(RATE)}" for name in outputs]
    motors = [f"{MOTOR}{name}" for name in inputs]

    def moved(names: Sequence[str]) -> np.ndarray:
        rows = [[any(fnmatchcase(n, p) for p in own) for own in unknowns] for n in names]
        return np.array(rows, dtype=float).reshape(len(names), len(unknowns))

    return LoopSlopes(moved([DELAY])[0], moved(sensors), moved(motors))

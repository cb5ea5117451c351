"""What the options of several verbs have in common."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from middeck.errors import ConfigError

F = TypeVar("F", bound=Callable[..., Any])


class Numbers(click.ParamType[tuple[float, ...]]):
    """Numbers separated by commas; exactly ``count`` of them if given."""

    name = "numbers"

    def __init__(self, count: int = 0) -> None:
        self.count = count

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers of ``value``; fails on anything that is not finite."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 0.5,1,8", param, ctx)
        if not all(map(math.isfinite, numbers)):
            self.fail(f"{value!r} holds a number that is not finite", param, ctx)
        if self.count and len(numbers) != self.count:
            self.fail(f"{value!r} has {len(numbers)} numbers; must be {self.count}", param, ctx)
        return numbers


class Frequencies(Numbers):
    """Positive frequencies [Hz]."""

    name = "frequencies"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers of ``value``; fails on any that is not positive, and on a band that does not rise."""
        numbers = super().convert(value, param, ctx)
        if min(numbers) <= 0.0:
            self.fail(f"{value!r} holds a frequency that is not > 0 Hz", param, ctx)
        if self.count == 2 and not numbers[0] < numbers[1]:
            self.fail(f"{value!r} does not rise from lowest to highest", param, ctx)
        return numbers


def common(command: F) -> F:
    """``--set``, ``--json`` and ``--debug``, which every verb has."""
    for option in (
        click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error."),
        click.option("--json", "as_json", is_flag=True, help="Print one JSON document."),
        click.option(
            "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override an input value."
        ),
    ):
        command = option(command)
    return command


article = click.argument("article")
environment = click.option(
    "--environment",
    default="lab",
    show_default=True,
    metavar="NAME|PATH",
    help="orbit, lab, or an environment file.",
)
count = click.option(
    "--count", type=click.IntRange(min=1), default=26, show_default=True, help="How many of the lowest modes."
)
band = click.option("--band", "band_hz", type=Frequencies(2), metavar="LO,HI", help="Band to fit [Hz].")
periods = click.option(
    "--periods",
    type=click.IntRange(min=1),
    help="Whole steady periods in each RECORD.  [default: as its file says]",
)
states = click.option(
    "--states", type=click.IntRange(min=1), help="Order of the fit.  [default: recommended]"
)


def in_a_folder(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """``value``, the path of a file to write; refused before any work if its folder is not there."""
    if value is not None and not Path(value).parent.is_dir():
        folder = Path(value).parent
        raise ConfigError("no such folder", where=f"{param.opts[0]} {value}", hint=f"mkdir -p {folder}")
    return value


def separate_names(values: tuple[str, ...]) -> tuple[str, ...]:
    """Names given by several options, by commas or both.

    >>> separate_names(("a,b", "c"))
    ('a', 'b', 'c')
    """
    return tuple(name.strip() for value in values for name in value.split(",") if name.strip())

"""Options that describe a record file: its columns and its rate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import click

from middeck.cli.options import joined

if TYPE_CHECKING:
    from middeck.files.records import Columns

F = TypeVar("F", bound=Callable[..., Any])


def columns(command: F) -> F:
    """``--inputs``, ``--outputs``, ``--sample-hz`` and ``--variable``."""
    for option in (
        click.option("--variable", default="", metavar="NAME", help="The matrix in a MAT or HDF5 file."),
        click.option("--sample-hz", type=float, metavar="HZ", help="Sampling rate, if the file has none."),
        _named("--outputs", 'Output columns: "angle [rad]", "3=angle [rad]"; may be repeated.'),
        _named("--inputs", 'Input columns: "torque [N m]", "2=torque [N m]"; may be repeated.'),
    ):
        command = option(command)
    return command


def _named(option: str, help: str) -> Callable[[F], F]:
    return click.option(option, multiple=True, callback=joined(), metavar="COLUMNS", help=help)


def told_columns(
    inputs: str | None, outputs: str | None, sample_hz: float | None, variable: str
) -> Columns | None:
    """Columns by the options; None without any, so that a file of channels beside the record is read."""
    from middeck.errors import ConfigError
    from middeck.files.records import name_columns

    if sample_hz is not None and not sample_hz > 0.0:
        raise ConfigError(f"--sample-hz is {sample_hz:g}", hint="a rate > 0 Hz")
    return name_columns(_split(inputs), _split(outputs), sample_hz=sample_hz, variable=variable)


def _split(texts: str | None) -> Sequence[str]:
    return () if texts is None else texts.split(",")

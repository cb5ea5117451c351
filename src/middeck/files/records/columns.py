"""Descriptions of channels that a file lacks: from options, or from a TOML file beside it."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from middeck.errors import ConfigError
from middeck.files.disk.kind_of_content import CHANNELS
from middeck.files.json.channels import build_channel
from middeck.files.toml.form import Finite, Form, Positive, whole
from middeck.files.toml.source import read_form
from middeck.signals.ports import Channel
from middeck.values import record

Side = Literal["", "input", "output"]


@record(kw_only=True)
class NamedColumn:
    """One channel and its description; ``number`` counts the columns of the file from one."""

    name: str
    side: Side
    unit: str | None = None
    number: int | None = None
    channel: Channel | None = None


@record
class Columns:
    """Inputs and outputs of a file, and its rate; see `name_columns`.

    If any of ``named`` has a side, the file's channels are these and no others, in this order; otherwise they
    only describe channels that the file names itself. ``variable`` is the matrix to take from a MAT or
    HDF5 file that holds several.
    """

    named: tuple[NamedColumn, ...]
    sample_hz: float | None = None
    variable: str = ""


class ChannelForm(Form):
    """``[[channel]]`` of a file of channels."""

    name: str
    unit: str | None = None
    side: Literal["input", "output"] | None = None
    column: Annotated[int, whole(1, 100_000)] | None = None
    node: str = ""
    direction: str = ""
    role: Literal["", "sensor", "actuator"] = ""
    gain: Finite | None = None
    raw_unit: str = ""
    calibrated: str = ""


class ChannelsForm(Form):
    """A file of channels: ``run.mat.toml`` beside ``run.mat``."""

    sample_hz: Positive | None = None
    variable: str = ""
    channel: Annotated[tuple[ChannelForm, ...], Field(strict=False)] = ()


def name_columns(
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    *,
    sample_hz: float | None = None,
    variable: str = "",
) -> Columns | None:
    """Columns from texts such as ``"torque [N m]"`` or ``"3=torque [N m]"``; None if nothing is given.

    Without a number, a column is found by its name, or in a file without names by its place in the list:
    inputs first, then outputs. Raises `ConfigError` for a text that is not so.

    >>> name_columns(["u [N]"], ["4=y"]).named[1].number
    4
    """
    if not inputs and not outputs and sample_hz is None and not variable:
        return None
    if bool(inputs) != bool(outputs):
        raise ConfigError("inputs and outputs are named together or not at all", hint="name both")
    named = [_column(text, "input") for text in inputs] + [_column(text, "output") for text in outputs]
    return Columns(tuple(named), sample_hz, variable)


def _column(text: str, side: Side) -> NamedColumn:
    found = re.fullmatch(r"\s*(?:(\d+)\s*=)?\s*([^\[\]=]*[^\[\]=\s])\s*(?:\[([^\[\]]*)\])?\s*", text)
    if found is None:
        raise ConfigError(f"{text!r} names no column", hint="write NAME, NAME [UNIT] or NUMBER=NAME [UNIT]")
    number, name, unit = found.groups()
    return NamedColumn(
        name=name,
        side=side,
        unit=None if unit is None else unit.strip(),
        number=int(number) if number else None,
    )


def columns_beside(file: Path) -> Columns | None:
    """Columns from the file of channels beside ``file`` (``run.csv.toml``); None if there is none.

    Raises `ConfigError`, with file, line and key, for one that is wrong.
    """
    beside = file.with_name(f"{file.name}.toml")
    if not beside.is_file():
        return None
    form = read_form(beside, CHANNELS, ChannelsForm)
    named = tuple(_described(c, f"{beside}, channel {c.name}") for c in form.channel)
    if any(c.side for c in named) and not all(c.side for c in named):
        raise ConfigError("some channels have a side, some not", where=str(beside), hint="all or none")
    return Columns(named, form.sample_hz, form.variable)


def _described(form: ChannelForm, where: str) -> NamedColumn:
    keys = ("node", "direction", "role", "gain", "raw_unit", "calibrated")
    channel = build_channel({k: getattr(form, k) for k in keys}, where)
    return NamedColumn(
        name=form.name, side=form.side or "", unit=form.unit, number=form.column, channel=channel
    )

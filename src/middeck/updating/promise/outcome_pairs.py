"""Pairs of promised and measured modes: by shape, by name, or by number alone.

A number is a place in the promise's order of frequencies. Two modes that change places are then both judged
by the statement on the other; where this is possible, a remark says so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from middeck.errors import DataError
from middeck.structure.correlation.assurance import modal_assurance
from middeck.structure.correlation.measured_modes import STRAIGHT, MeasuredModes
from middeck.structure.correlation.placing import list_names
from middeck.structure.correlation.unit_slips import warnings_on_frequencies_of_shapes
from middeck.updating.residuals.pairing import WINDOW, pair_shapes
from middeck.values import record

By = Literal["shape", "name", "number"]
# Share of its pair's MAC: a measured shape that resembles another promised one as much may be that one.
AS_ALIKE = 0.8


@record(kw_only=True)
class PromisedModes:
    """Modes that a promise states for one environment.

    Attributes:
        name, frequency_hz, interval_hz: As it states them, in its order.
        node, direction, shape: Channels as of `MeasuredModes`; none where the promise has no shapes.
    """

    environment: str
    name: tuple[str, ...]
    frequency_hz: Float[np.ndarray, " mode"]
    interval_hz: Float[np.ndarray, "mode 2"]
    node: tuple[str, ...] = ()
    direction: tuple[str, ...] = ()
    shape: Float[np.ndarray, "channel mode"] | None = None

    def called(self, index: int) -> str:
        """Number and name, as used in remarks."""
        return f"mode {index + 1} ({self.name[index]})"


@record(kw_only=True)
class MeasuredMode:
    """A mode measured without a shape. ``number`` counts from 1 in the promise's order."""

    environment: str
    frequency_hz: float
    name: str | None = None
    number: int | None = None


@record(kw_only=True)
class PairedMode:
    """A measured mode beside a promised one.

    Attributes:
        index, name: In the promise's order, from 0, and as it calls the mode.
        mac: MAC of the two shapes, at the channels that both have; None without shapes.
        open: Why it may be another promised mode, in words; empty where it is clear.
    """

    environment: str
    index: int
    name: str
    frequency_hz: float
    by: By
    mac: float | None = None
    open: str = ""


def pair_by_words(promised: PromisedModes, came: MeasuredMode) -> PairedMode:
    """Modes paired by name, else by number.

    Raises `DataError` where the promise has no such mode, or several.
    """
    where = f"outcome, mode of {came.frequency_hz:.5g} Hz in {promised.environment}"
    if came.number is not None and came.number > len(promised.name):
        raise DataError(
            f"the promise has no mode {came.number}",
            where=where,
            hint=f"1 to {len(promised.name)}" if promised.name else "it has no modes there",
        )
    if came.name is not None:
        index = _named(promised, came.name, came.number, where)
        return _paired(promised, index, came.frequency_hz, "name")
    if came.number is None:
        raise DataError("neither name nor number", where=where, hint="its name, as the promise has it")
    index = came.number - 1
    open_as = _by_number_alone(promised, index, came.frequency_hz)
    return _paired(promised, index, came.frequency_hz, "number", open=open_as)


def pair_by_shape(
    promised: PromisedModes, measured: MeasuredModes
) -> tuple[tuple[PairedMode, ...], tuple[str, ...]]:
    """Pairs by MAC, and remarks on the whole survey: channels left out, modes without a pair.

    Raises `DataError` for a promise or a survey without shapes, or without a channel in common.
    """
    where = f"outcome, survey in {promised.environment}"
    if promised.shape is None:
        hint = "its modes by name or by number"
        raise DataError("the promise has no shapes to compare a survey with", where=where, hint=hint)
    here = list(zip(promised.node, promised.direction, strict=True))
    there = list(zip(measured.node, measured.direction, strict=True))
    common = [channel for channel in there if channel in here]
    if not common:
        what = "no channel of the survey is in the promise" if there else "the survey has no shapes"
        hint = f"channels as {list_names([' '.join(channel) for channel in here])}, or modes by name"
        raise DataError(what, where=where, hint=hint)
    shapes = promised.shape[[here.index(channel) for channel in common]]
    seen = dataclasses.replace(
        measured,
        node=tuple(node for node, _ in common),
        direction=tuple(way for _, way in common),
        shape=measured.shape[[there.index(channel) for channel in common]],
        shape_std=None,
    )
    alike = modal_assurance(shapes, seen.shape)
    apart = np.abs(np.log(promised.frequency_hz[:, None] / measured.frequency_hz))
    pairs = pair_shapes(alike, apart)
    paired = tuple(
        _paired(
            promised,
            i,
            float(measured.frequency_hz[j]),
            "shape",
            mac=float(alike[i, j]),
            open=_as_alike(promised, i, np.where(apart[:, j] < np.log(WINDOW), alike[:, j], 0.0)),
        )
        for i, j in sorted(pairs.tolist())
    )
    straight = np.array([way in STRAIGHT for way in seen.direction])
    units = warnings_on_frequencies_of_shapes(promised.frequency_hz, shapes, seen, straight)
    found = _of_the_survey(promised, measured, len(common), set(pairs[:, 1].tolist()))
    return paired, (*(f"{promised.environment}: {unit}" for unit in units), *found)


def remarks_on(promised: PromisedModes, paired: Sequence[PairedMode]) -> tuple[str, ...]:
    """A sentence for each uncertain pair."""
    return tuple(
        f"{promised.environment}: {p.frequency_hz:.5g} Hz is compared with {promised.called(p.index)} "
        f"by its {p.by}{' alone' if p.by == 'number' else ''}; {p.open}"
        for p in paired
        if p.open
    )


def _paired(
    promised: PromisedModes, index: int, hz: float, by: By, *, mac: float | None = None, open: str = ""
) -> PairedMode:
    name = promised.name[index]
    return PairedMode(
        environment=promised.environment, index=index, name=name, frequency_hz=hz, by=by, mac=mac, open=open
    )


def _named(promised: PromisedModes, name: str, number: int | None, where: str) -> int:
    alike = [k for k, known in enumerate(promised.name) if known == name]
    if not alike:
        hint = f"one of {', '.join(promised.name)}" if promised.name else "it has no modes there"
        raise DataError(f"no mode {name!r} was promised", where=where, hint=hint)
    if number is None:
        if len(alike) > 1:
            numbers = " and ".join(str(k + 1) for k in alike)
            raise DataError(
                f"modes {numbers} of the promise are called {name!r}", where=where, hint="a number"
            )
        return alike[0]
    if number - 1 not in alike:
        raise DataError(
            f"mode {number} of the promise is {promised.name[number - 1]!r}, not {name!r}",
            where=where,
            hint=f"name alone, or number = {alike[0] + 1}",
        )
    return number - 1


def _by_number_alone(promised: PromisedModes, index: int, hz: float) -> str:
    low, high = promised.interval_hz.T
    overlap = (low <= high[index]) & (low[index] <= high)
    holds = (low <= hz) & (hz <= high)
    holds = holds & ~holds[index]
    for near, words in (
        (holds, "it lies within the interval of {}"),
        (overlap, "its interval overlaps with that of {}"),
    ):
        others = [promised.called(k) for k in np.flatnonzero(near).tolist() if k != index]
        if others:
            return f"{words.format(' and of '.join(others))}: which mode it is stays open"
    return ""


def _as_alike(promised: PromisedModes, index: int, mac: np.ndarray) -> str:
    others = [k for k in np.flatnonzero(mac >= AS_ALIKE * mac[index]).tolist() if k != index]
    if not others:
        return ""
    named = " and ".join(f"{promised.called(k)}, MAC {mac[k]:.2f}" for k in others)
    return f"it resembles {named}, as much (MAC {mac[index]:.2f}): which mode it is stays open"


def _of_the_survey(
    promised: PromisedModes, measured: MeasuredModes, common: int, paired: set[int]
) -> tuple[str, ...]:
    remarks: list[str] = []
    if common < len(measured.node):
        channels = f"{common} of {len(measured.node)} channels of the survey"
        remarks.append(f"{promised.environment}: {channels} are in the promise")
    remarks += [
        f"{promised.environment}: the measured mode of {hz:.5g} Hz resembles none that was promised, and is"
        " not scored"
        for j, hz in enumerate(measured.frequency_hz.tolist())
        if j not in paired
    ]
    return tuple(remarks)

"""Compensators as JSON: the law, its ports, and how it was made."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.errors import DataError
from middeck.files.json.input import json_numbers, read_json, read_ports, require_keys
from middeck.files.json.output import write_json
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from middeck.values import record

COMPENSATOR_SCHEMA = "middeck.compensator/1"
AGAIN = "write the compensator again"


@record(kw_only=True)
class StoredCompensator(Compensator):
    """A compensator as stored in a file.

    Attributes:
        authority, cost: 1/rho, and what was minimised; None if unknown.
        inert: Modes left out of the design because no port reaches or sees them.
    """

    authority: float | None = None
    cost: float | None = None
    inert: tuple[str, ...] = ()


def write_compensator(path: str | Path, compensator: Compensator) -> None:
    """Write u = K y whole or not at all: A, B, C, D, the ports in their order, and how it was made.

    ``period_s`` is null for a continuous law; ``applied`` stands there where the law has it.
    """
    ports = {"inputs": compensator.inputs, "outputs": compensator.outputs}
    matrices = {name: getattr(compensator.dynamics, name) for name in "ABCD"}
    period = {"period_s": compensator.period_s}
    applied = {} if compensator.applied is None else {"applied": compensator.applied}
    made = {"made": how_made(compensator)}
    write_json(path, {"schema": COMPENSATOR_SCHEMA, **ports, **period, **matrices, **applied, **made})


def how_made(compensator: Compensator) -> dict[str, Any]:
    """Method, authority, cost and modes left out, as far as the compensator knows them."""
    plain = type(compensator) in (Compensator, StoredCompensator)
    method = compensator.method or ("" if plain else type(compensator).__name__)
    numbers = {name: _finite(getattr(compensator, name, None)) for name in ("authority", "cost")}
    return {"method": method, **numbers, "inert": tuple(getattr(compensator, "inert", ()))}


def _finite(value: Any) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


@named_kinds
def load_compensator(path: str | Path) -> StoredCompensator:
    """The compensator in file ``path``, with the file's account of how it was made.

    Raises `DataError`, naming file and key, if it is missing, empty, truncated, of another schema, incomplete
    or inconsistent, or if a number is not finite.
    """
    data = read_json(path, COMPENSATOR_SCHEMA, "a compensator of middeck design -o")
    require_keys(data, ("inputs", "outputs", *"ABCD"), str(path), AGAIN)
    inputs, outputs = (read_ports(data[side], f"{path}, {side}", AGAIN) for side in ("inputs", "outputs"))
    matrices = {name: json_numbers(data[name], f"{path}, {name}", AGAIN) for name in "ABCD"}
    period = _optional(data.get("period_s"), f"{path}, period_s")
    law = build_stored(matrices, period, inputs, outputs, data.get("made") or {}, str(path))
    if data.get("applied") is None:
        return law
    given = json_numbers(data["applied"], f"{path}, applied", AGAIN)
    return with_applied(law, given, str(path))


def with_applied(law: StoredCompensator, applied: np.ndarray, where: str) -> StoredCompensator:
    """``law`` with the path of the applied command; raises `DataError` where it does not fit."""
    shape = (len(law.dynamics.A), len(law.outputs))
    if applied.shape != shape and (
        applied.size or shape[0]
    ):  # an empty one may have lost its shape on the way
        raise DataError(f"applied has shape {applied.shape}, not {shape}", where=where, hint=AGAIN)
    return dataclasses.replace(law, applied=applied.reshape(shape))


def build_stored(
    matrices: Mapping[str, np.ndarray],
    period_s: float | None,
    inputs: tuple[Port, ...],
    outputs: tuple[Port, ...],
    made: Any,
    where: str,
) -> StoredCompensator:
    """A compensator of matrices, ports and a table ``made``; raises `DataError` where they do not fit."""
    if not isinstance(made, dict):
        raise DataError("not a table", where=f"{where}, made", hint=AGAIN)
    known = cast("dict[str, Any]", made)
    method, inert = str(known.get("method") or ""), tuple(map(str, known.get("inert") or ()))
    authority, cost = (_optional(known.get(name), f"{where}, made.{name}") for name in ("authority", "cost"))
    system = build_system(matrices, period_s, (len(inputs), len(outputs)), where)
    return StoredCompensator(
        dynamics=system,
        inputs=inputs,
        outputs=outputs,
        authority=authority,
        cost=cost,
        inert=inert,
        method=method,
    )


def _optional(value: Any, where: str) -> float | None:
    return None if value is None else float(json_numbers(value, where, AGAIN))


def build_system(
    matrices: Mapping[str, np.ndarray], period_s: float | None, ports: tuple[int, int], where: str
) -> StateSpace | SampledStateSpace:
    """A, B, C and D for so many inputs and outputs; empty ones may have lost their shape on the way.

    Raises `DataError` for shapes that do not fit and a period that is not positive.
    """
    inputs, outputs = ports
    n = len(matrices["A"]) if matrices["A"].size else 0
    shapes = {"A": (n, n), "B": (n, inputs), "C": (outputs, n), "D": (outputs, inputs)}
    for name, shape in shapes.items():
        found = matrices[name]
        if found.size != shape[0] * shape[1] or (found.size and found.shape != shape):
            raise DataError(
                f"{name} has shape {found.shape}; {n} states, {outputs} outputs and {inputs} inputs "
                f"need {shape}",
                where=where,
                hint=AGAIN,
            )
    A, B, C, D = (matrices[name].reshape(shape) for name, shape in shapes.items())
    if period_s is None:
        return StateSpace(A, B, C, D)
    if not (math.isfinite(period_s) and period_s > 0.0):
        raise DataError(f"a sampling period of {period_s:g} s", where=where, hint="> 0 s, or none")
    return SampledStateSpace(A, B, C, D, period_s=period_s)

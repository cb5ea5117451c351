"""Some channels of a measurement model, in units of one's own, and the modes that are then on no path."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from middeck.identification.model.measurement_model import RANK, MeasurementModel, natural_hz
from middeck.signals.ports import port_indices
from middeck.values import record

# A mode is on none of the chosen paths if less than this share of it is: rounding.
UNREACHED = 1e-12


@record
class ChannelSelection:
    """A model of some channels, and the names of the modes that are on no path between them."""

    model: MeasurementModel
    dropped: tuple[str, ...]


def select_channels(
    model: MeasurementModel, *, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
) -> ChannelSelection:
    """The model between some of its inputs and outputs, in the order given; None for all.

    Modes that no chosen input moves or no chosen output sees, but for rounding, are left out and named. The
    pole of a residue of higher rank stays as often as the rank of the chosen channels asks.

    Raises `ConfigError` for an unknown name, naming those there are.
    """
    columns, rows = (
        list(range(len(ports))) if names is None else port_indices(ports, names, side)
        for ports, names, side in ((model.inputs, inputs, "input"), (model.outputs, outputs, "output"))
    )
    keep = (_share(model.shapes.T, rows) > UNREACHED) & (_share(model.participation, columns) > UNREACHED)
    poles, c, b = _least(
        model.poles[keep], model.shapes[rows][:, keep], model.participation[keep][:, columns]
    )
    entries = np.ix_(rows, columns)
    chosen = dataclasses.replace(
        model,
        poles=poles,
        shapes=c,
        participation=b,
        direct=model.direct[entries],
        lower=model.lower[entries],
        delay_s=model.delay_s[rows],
        path_delay_s=None if model.path_delay_s is None else model.path_delay_s[entries],
        rigid=_part(model.rigid, entries),
        integral=_part(model.integral, entries),
        inputs=tuple(model.inputs[i] for i in columns),
        outputs=tuple(model.outputs[o] for o in rows),
    )
    return ChannelSelection(chosen, tuple(f"pole at {hz:.4g} Hz" for hz in natural_hz(model)[~keep]))


def _part(whole: np.ndarray | None, entries: tuple[np.ndarray, ...]) -> np.ndarray | None:
    """Some entries of R or Q; None if they are all zero."""
    return None if whole is None or not np.any(whole[entries]) else whole[entries]


def _share(vectors: np.ndarray, chosen: list[int]) -> Float[np.ndarray, " mode"]:
    """Share of each mode's vector in the chosen channels, each in its own measure."""
    size = np.abs(vectors)
    size = size / np.maximum(size.max(axis=0, initial=0.0), np.finfo(float).tiny)
    whole = np.linalg.norm(size, axis=1)
    return np.linalg.norm(size[:, chosen], axis=1) / np.where(whole > 0.0, whole, 1.0)


def _least(poles: np.ndarray, c: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same residues with each pole as often as its residue's rank."""
    each, first, count = np.unique(poles, return_index=True, return_counts=True)
    if np.all(count == 1):
        return poles, c, b
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for k in np.argsort(first):
        at = poles == each[k]
        R = c[:, at] @ b[at]
        # Real modal constants, hence imaginary residues, stay so to the last digit.
        matrix, unit = (R, 1.0) if np.any(np.real(R)) else (np.imag(R), 1j)
        left, size, right = np.linalg.svd(matrix, full_matrices=False)
        rank = int(np.sum(size > RANK * size[0]))
        parts.append((poles[at][:rank], unit * left[:, :rank] * size[:rank], right[:rank]))
    return (
        np.concatenate([p for p, _, _ in parts]),
        np.hstack([left for _, left, _ in parts]),
        np.vstack([right for _, _, right in parts]),
    )

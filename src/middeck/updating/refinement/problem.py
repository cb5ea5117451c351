"""All tests as one linear problem about the present unknowns, and the model's errors that rows share."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla

from middeck.updating.refinement.bayesian_estimate import KNOWN, Linear
from middeck.updating.refinement.mesh_and_shear import left_out
from middeck.updating.refinement.model_errors import OwnErrors, sorts_of
from middeck.updating.residuals.damping_rows import ComparedDamping
from middeck.updating.residuals.gauges import Gauge
from middeck.updating.residuals.responses import ComparedResponse
from middeck.updating.residuals.static_tests import (
    ComparedStatic,
    ErrorFields,
    OncePerState,
    StaticTest,
    gauge_key,
)
from middeck.updating.residuals.surveys import Compared

# Modes that live of gravity and suspension, and flexible ones, have errors of their own; static tests one
# that they share as far as they strain the members alike, and one of each reading; where damping is refined
# each mode has one of ln zeta, the last sort.
MODES, STATIC, DAMPED = ("suspension", "flexible"), ("static", "reading"), "damping"
MODAL = len(MODES)


def sort_names(statics: bool, damped: bool) -> tuple[str, ...]:
    """Names of the model's own errors, with or without static tests and rows of damping."""
    return (*MODES, *STATIC * statics, *(DAMPED,) * damped)


class _Errors(NamedTuple):
    """Errors of the model, in rows: what each shares of errors (`Linear.S`) and their sorts."""

    S: np.ndarray
    rest: np.ndarray
    sort: np.ndarray
    row_sort: np.ndarray


def linear_problem(
    compared: Sequence[Compared],
    statics: Sequence[ComparedStatic],
    fields: ErrorFields | None,
    from_mean: np.ndarray,
    spread: np.ndarray,
    responses: Sequence[ComparedResponse] = (),
    damped: Sequence[ComparedDamping] = (),
) -> Linear:
    """The tests as one linear problem about the present unknowns."""
    tests = (*compared, *responses, *damped, *statics)
    J = np.vstack([c.slope for c in tests])
    parts = [_of_modes(compared)] if compared else []
    parts += [_of_responses(sum(len(r.residual) for r in responses))] if responses else []
    parts += [_of_damping(compared, damped, MODAL + len(STATIC) * bool(statics))] if damped else []
    parts += [] if fields is None else [_of_statics(statics, fields)]
    return Linear(
        y=np.concatenate([c.residual for c in tests]) + J @ from_mean,
        std=np.concatenate([c.std for c in tests]),
        J=J,
        spread=spread,
        S=np.asarray(sla.block_diag(*(p.S for p in parts))),
        rest=np.concatenate([p.rest for p in parts]),
        sort=np.concatenate([p.sort for p in parts]),
        row_sort=np.concatenate([p.row_sort for p in parts]),
        sorts=len(sort_names(bool(statics), bool(damped))),
    )


def _of_modes(compared: Sequence[Compared]) -> _Errors:
    errors = OwnErrors.of(compared)
    own = [np.arange(len(c.rows)) < len(c.pairs) for c in compared]
    S = np.vstack(
        [
            np.where(mine[:, None], errors.of_survey(k)[c.rows[:, 1]], 0.0)
            for k, (c, mine) in enumerate(zip(compared, own, strict=True))
        ]
    )
    return _Errors(
        np.column_stack([np.concatenate([_of_mesh_and_shear(c) for c in compared]), S]),
        np.maximum(1.0 - np.sum(S**2, axis=1), 0.0),
        np.append(KNOWN, errors.sorts(compared)),
        np.concatenate([sorts_of(c.modes, c.rows[:, 1]) for c in compared]),
    )


def _of_mesh_and_shear(compared: Compared) -> np.ndarray:
    """Change of each row by more elements and shear."""
    own, (of, place) = compared.pairs[:, 0], compared.rows.T
    index, at = np.unique(np.append(own, place), return_inverse=True)
    k = at[: len(own)][of]
    return left_out(compared.modes, index)[at[len(own) :], k] / (2.0 * compared.modes.omega[own[of]] ** 2)


def _of_responses(rows: int) -> _Errors:
    """None: what a response errs by is stated, and in its rows."""
    return _Errors(np.zeros((rows, 0)), np.zeros(rows), np.zeros(0, dtype=int), np.zeros(rows, dtype=int))


def _of_damping(compared: Sequence[Compared], damped: Sequence[ComparedDamping], sort: int) -> _Errors:
    """One of ln zeta for each shape that has an error of its own in frequency, shared as that is."""
    errors = OwnErrors.of(compared)
    S = np.vstack([errors.shared_with(c.modes)[c.pairs[:, 0]] for c in damped])
    own = np.full(S.shape[1], sort), np.full(len(S), sort)
    return _Errors(S, np.maximum(1.0 - np.sum(S**2, axis=1), 0.0), *own)


def _of_statics(statics: Sequence[ComparedStatic], fields: ErrorFields) -> _Errors:
    moves = OncePerState()
    by_fields = np.vstack([fields.slope(c.at, c.test.gauges, moves)[0] / c.scale[:, None] for c in statics])
    zeros = zeros_of(statics)
    by_zeros = np.zeros((len(by_fields), len(zeros)))
    rows = [(c, gauge) for c in statics for gauge in c.test.gauges]
    for row, (c, gauge) in enumerate(rows):
        if c.test.since_unloaded:
            by_zeros[row, zeros.index(zero_of(c.test, gauge))] = -1.0
    static, reading = MODAL, MODAL + 1
    sort = np.repeat([static, reading], [by_fields.shape[1], len(zeros)])
    return _Errors(np.hstack([by_fields, by_zeros]), np.ones(len(rows)), sort, np.full(len(rows), reading))


def zeros_of(statics: Sequence[ComparedStatic]) -> tuple[tuple[str, ...], ...]:
    """Unloaded readings of all tests whose gauges count from one."""
    counted = [c.test for c in statics if c.test.since_unloaded]
    return tuple(dict.fromkeys(zero_of(test, gauge) for test in counted for gauge in test.gauges))


def zero_of(test: StaticTest, gauge: Gauge) -> tuple[str, ...]:
    """The unloaded reading from which a gauge counts in a test."""
    return test.series or test.name, *gauge_key(gauge)

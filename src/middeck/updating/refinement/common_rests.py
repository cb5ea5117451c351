"""Correlation of rows of a new test with rows of earlier tests, beside errors with names.

`refine` counts what a row has of errors that have no name (the mixing of two modes, the reading of a gauge)
as its own. A test made twice would then count as two independent ones, although both rows have the same
error.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from middeck.updating.refinement.bayesian_estimate import Linear
from middeck.updating.residuals.static_tests import PRESENT, ComparedStatic, Loaded, gauge_key
from middeck.updating.residuals.surveys import Compared


def common_rests(problem: Linear, links: Sequence[tuple[int, int, float]]) -> Linear:
    """The problem with rests shared between new and old rows: (old, new, part), each new row once.

    The rest of an old row becomes an error with a column of its own, last of all; the rest of a new row keeps
    the remainder.
    """
    rest, columns, sort = problem.rest.copy(), {}, list(problem.sort)
    for old, new, part in links:
        size = problem.rest[old]
        if size <= 0.0 or problem.row_sort[old] != problem.row_sort[new]:
            continue
        if old not in columns:
            columns[old] = np.where(np.arange(len(rest)) == old, np.sqrt(size), 0.0)
            sort.append(problem.row_sort[old])
            rest[old] = 0.0
        # No more than all of it.
        most = min(abs(part), np.sqrt(problem.rest[new] / size))
        columns[old][new] = np.sign(part) * most * np.sqrt(size)
        rest[new] = max(problem.rest[new] - most**2 * size, 0.0)
    return dataclasses.replace(
        problem, S=np.column_stack([problem.S, *columns.values()]), rest=rest, sort=np.array(sort, dtype=int)
    )


def same_modes(made: Sequence[Compared], new: Compared) -> list[tuple[int, int, float]]:
    """The row that each row of a new, last survey resembles most, and by how much.

    An error E of the model is phi_i'E phi_m in the row of mode i and a pair whose own mode is m: in modes of
    another set-up, each made of these, it has the product of the two parts.
    """
    if not made:
        return []
    parts = np.hstack([_parts(old, new) for old in made])
    best = np.argmax(np.abs(parts), axis=1)
    first = parts.shape[1]
    return [(int(old), first + k, float(parts[k, old])) for k, old in enumerate(best)]


def _parts(old: Compared, new: Compared) -> np.ndarray:
    mass = old.modes.mass
    size = np.sqrt(np.einsum("im,im->m", new.modes.shapes, mass @ new.modes.shapes))
    cross = (new.modes.shapes / size).T @ (mass @ old.modes.shapes)
    (mine, i), (theirs, j) = (c.rows.T for c in (new, old))
    own, others = new.pairs[mine, 0], old.pairs[theirs, 0]
    return cross[np.ix_(i, j)] * cross[np.ix_(own, others)]


def same_readings(statics: Sequence[ComparedStatic], before: int) -> list[tuple[int, int, float]]:
    """Readings of the last static test that another also made; ``before`` is the number of earlier rows."""
    at = before + np.cumsum([0, *(len(c.value) for c in statics)])
    *made, new = statics
    return [
        (int(at[t]) + g, int(at[-2]) + k, 1.0)
        for k, gauge in enumerate(new.test.gauges)
        for t, g in _first(made, new, gauge_key(gauge))
    ]


def _first(
    made: Sequence[ComparedStatic], new: ComparedStatic, key: tuple[str, str, str]
) -> Iterator[tuple[int, int]]:
    for t, old in enumerate(made):
        keys = [gauge_key(gauge) for gauge in old.test.gauges]
        if key in keys and _alike(old.at, new.at):
            yield t, keys.index(key)
            return


def _alike(old: Loaded, new: Loaded) -> bool:
    """Whether two loads strain the article alike, from alike."""
    a, b = old.strains(), new.strains()
    return a.shape == b.shape and bool(np.linalg.norm(a - b) <= PRESENT * np.linalg.norm(a))

"""When a doubtful refinement stops looking elsewhere: landscapes of known ends in place of an article."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import middeck.updating.refinement.search as search
from middeck.errors import NumericalError

SPREAD = np.array([1.0, 0.1])
PRIOR = search.Prior(np.zeros(2), SPREAD, np.array([1e-4]))
FITS = -40.0


@dataclass(kw_only=True)
class End:
    """The end of a search at ``x``, this unlikely."""

    x: np.ndarray
    level: float
    converged: bool = True
    first: Any = None

    @property
    def estimate(self) -> Any:
        return SimpleNamespace(x_std=0.1 * SPREAD)

    def doubtful(self, _: np.ndarray) -> bool:
        return self.level > FITS + 5.0

    def unlikely(self, _: np.ndarray) -> float:
        return self.level

    def if_it_fitted(self, _: np.ndarray) -> float:
        return FITS


def _near(x, level, converged=True, by=0.005):
    """An end a twentieth of a deviation away, as two searches of one minimum are."""
    return End(x=np.array(x) + by * SPREAD, level=level, converged=converged)


def _tried(monkeypatch, ends):
    """The end that is found, and how many starts were tried, where each leads to one of ``ends``."""
    tried: list[End] = []

    def next_end(*_: Any) -> End:
        tried.append(ends[len(tried)])
        if tried[-1] is None:
            raise NumericalError("none", hint="")
        return tried[-1]

    monkeypatch.setattr(search, "_as_if_right", lambda *_: None)
    monkeypatch.setattr(search, "_search", next_end)
    survey = SimpleNamespace(measured=SimpleNamespace(node=()))
    places: Any = SimpleNamespace(
        solve=lambda x, _: x, moves_damping=False, surveys=(survey,), compare=lambda *_: None
    )
    return search.find_most_probable(places, (), PRIOR), len(tried)


A, B, RIGHT = (0.5, 0.0), (-1.0, 0.05), (0.04, 0.0)


def test_two_draws_at_the_likeliest_end_are_enough(monkeypatch):
    ends = [
        _near(A, 10.1),
        _near(A, 10.0),
        _near(B, 9.0),
        _near(B, 9.0, by=-0.005),
        *[_near(RIGHT, FITS)] * 9,
    ]
    found, tried = _tried(monkeypatch, ends)
    assert found.x is ends[2].x
    assert tried == 4


@pytest.mark.parametrize(
    "wrong",
    [
        [_near(A, 10.0), _near(A, 10.0), _near(B, 9.0), _near((1.0, 0.1), 20.0), _near((1.0, 0.1), 20.0)],
        [_near(A, 9.0), _near(A, 9.0), _near(B, 12.0), _near(B, 12.0), _near(B, 12.0)],
        [_near(A, 10.0), None, _near(B, 9.0, converged=False), _near(B, 9.0, converged=False)],
        [
            _near(A, 10.0),
            _near(A, 10.0),
            _near(B, 9.0),
            _near((-1.0, 0.1), 9.0),
            None,
            _near((0.0, 0.1), 9.0),
        ],
    ],
    ids=["less likely", "only from the mean", "short of an end", "none twice"],
)
def test_other_ends_do_not_keep_the_right_one_from_being_found(wrong, monkeypatch):
    """It comes from the seventh draw."""
    ends = [*wrong, *[None] * (8 - len(wrong)), _near(RIGHT, FITS)]
    found, tried = _tried(monkeypatch, ends)
    assert found.x is ends[-1].x
    assert tried == len(ends)


def test_no_end_beyond_the_reach_is_likelier_than_the_best():
    """A perfect fit so far from the prior is as likely as the best end that there is."""
    best = _near(A, 10.0)
    reach = search._reach([_near(B, 12.0), best], PRIOR.usual)
    assert FITS + 0.5 * reach**2 == pytest.approx(best.level)
    assert search._reach([], PRIOR.usual) == np.inf

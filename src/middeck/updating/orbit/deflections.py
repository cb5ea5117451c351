"""Gauge readings under untested load cases, from a refinement on tested ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from middeck.errors import ConfigError
from middeck.structure.model.article import LoadCase
from middeck.structure.model.environment import Environment
from middeck.updating.refinement.bayesian_estimate import NORMAL_95
from middeck.updating.refinement.problem import MODAL, zero_of
from middeck.updating.refinement.refine import OF_READING, USUAL_STATIC, Refined
from middeck.updating.residuals.gauges import Gauge
from middeck.updating.residuals.static_tests import (
    ErrorFields,
    check_zero,
    full_scales,
    gauge_key,
    set_up_static,
)
from middeck.values import record

USUAL_TAU = np.array([USUAL_STATIC, OF_READING * USUAL_STATIC])


@record(kw_only=True)
class Deflection:
    """Readings as predicted under one load case, in the units of the gauges.

    Attributes:
        of_the_article: Readings on the refined article.
        value: The most probable: with the errors of the model that the static tests showed.
        std: Total standard deviation of a gauge's predicted reading.
        by_unknowns, by_unseen, by_larger, by_own, by_gauge: What it is made of: the article's numbers
            together with the errors that the tests showed; errors of strains that no test had; changes of
            those errors where strains are larger than in any test; errors of each reading by itself; and the
            gauge's own.
        seen: Part of the strain energy that has the strains of the tests.
    """

    name: str
    gauges: tuple[Gauge, ...]
    of_the_article: Float[np.ndarray, " gauge"]
    value: Float[np.ndarray, " gauge"]
    std: Float[np.ndarray, " gauge"]
    by_unknowns: Float[np.ndarray, " gauge"]
    by_unseen: Float[np.ndarray, " gauge"]
    by_larger: Float[np.ndarray, " gauge"]
    by_own: Float[np.ndarray, " gauge"]
    by_gauge: Float[np.ndarray, " gauge"]
    seen: float

    @property
    def interval(self) -> Float[np.ndarray, "gauge 2"]:
        """95 % intervals."""
        return self.value[:, None] + NORMAL_95 * self.std[:, None] * np.array([-1.0, 1.0])


def predict_deflections(
    refined: Refined,
    environment: Environment,
    load_cases: Sequence[LoadCase | str | None],
    gauges: Sequence[Gauge],
    since_unloaded: bool = True,
    series: str = "",
) -> tuple[Deflection, ...]:
    """Readings of ``gauges`` under each load case, since unloaded or since drawn.

    Readings of a ``series`` of the static tests count from its unloaded reading. Errors of a model that was
    refined on no static test are what such models are thought to have. Raises
    `ConfigError` for a gauge or a load case that cannot be, `NumericalError` where there is no rest state.
    """
    return tuple(
        _predict(refined, environment, case, tuple(gauges), since_unloaded, series) for case in load_cases
    )


def _predict(
    refined: Refined,
    environment: Environment,
    case: LoadCase | str | None,
    gauges: tuple[Gauge, ...],
    since_unloaded: bool,
    series: str,
) -> Deflection:
    name = case if isinstance(case, str) else "as it is" if case is None else case.name
    check_zero(case, since_unloaded, f"prediction of load case {name!r}")
    place = set_up_static(refined.structure, environment, (), case, since_unloaded, refined.unknowns)
    at, found = place.solve(refined.x), refined.estimate
    tau = refined.unseen[MODAL:] if refined.statics else USUAL_TAU
    fields = ErrorFields.none(at) if refined.fields is None else refined.fields
    seen, unseen = fields.slope(at, gauges)
    zeros, known = _zeros_of(refined, gauges, since_unloaded, series)
    of_modes = len(found.d) - seen.shape[1] - zeros.shape[1]
    J = np.hstack([place.slope(at, gauges), np.zeros((len(gauges), of_modes)), seen, zeros])
    by_unknowns, by_unseen = np.linalg.norm(J @ found.root, axis=1), tau[0] * np.abs(unseen)
    by_larger = tau[0] * np.linalg.norm(fields.beyond(at, gauges), axis=1)
    full = full_scales([c.at for c in refined.statics], [c.test for c in refined.statics])
    size = np.maximum(at.lengths(gauges), [full.get(gauge_key(g), 0.0) for g in gauges])
    own = tau[1] * size * np.sqrt(1.0 + (since_unloaded & ~known))
    reads = np.array([gauge.std for gauge in gauges])
    value = at.value(gauges)
    return Deflection(
        name=name,
        gauges=gauges,
        of_the_article=value,
        value=value + np.hstack([seen, zeros]) @ found.d[of_modes:],
        std=np.sqrt(by_unknowns**2 + by_unseen**2 + by_larger**2 + own**2 + reads**2),
        by_unknowns=by_unknowns,
        by_unseen=by_unseen,
        by_larger=by_larger,
        by_own=own,
        by_gauge=reads,
        seen=fields.part(at),
    )


def _zeros_of(
    refined: Refined, gauges: Sequence[Gauge], since_unloaded: bool, series: str
) -> tuple[Float[np.ndarray, "gauge zero"], Bool[np.ndarray, " gauge"]]:
    """Slopes of readings by the errors of the tests' unloaded ones, and the gauges that depend on these.

    Raises `ConfigError` for a series that no static test has.
    """
    named = {zero[0] for zero in refined.zeros}
    if series and series not in named:
        raise ConfigError(
            f"no series {series!r}",
            where="prediction under load",
            hint=f"static tests have {', '.join(sorted(named))}"
            if named
            else "no static test was refined on",
        )
    out = np.zeros((len(gauges), len(refined.zeros)))
    full = {
        zero: scale
        for c in refined.statics
        for zero, scale in zip((zero_of(c.test, g) for g in c.test.gauges), c.scale, strict=True)
    }
    for k, gauge in enumerate(gauges):
        zero = series, *gauge_key(gauge)
        if since_unloaded and zero in refined.zeros:
            out[k, refined.zeros.index(zero)] = -full[zero]
    return out, np.any(out, axis=1)

"""What gauges will read under load cases that nobody has tried, from what was refined on those that were."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from middeck.structure.model.article import LoadCase
from middeck.structure.model.environment import Environment
from middeck.updating.gauges import Gauge, lengths
from middeck.updating.orbit import NORMAL_95
from middeck.updating.refine import MODAL, OF_READING, USUAL_STATIC, Refined
from middeck.updating.statics import ErrorFields, check_zero, set_up_static
from middeck.values import record

USUAL_TAU = np.array([USUAL_STATIC, OF_READING * USUAL_STATIC])


@record(kw_only=True)
class Deflection:
    """Readings as predicted under one load case, in the units of the gauges.

    Attributes:
        of_the_article: What the refined article reads.
        value: The most probable: with the errors of the model that the static tests showed.
        std: Standard deviation of what a gauge will read, all told.
        by_unknowns, by_shared, by_own, by_gauge: What it is made of: the article's numbers together with the
            errors that the tests showed; errors of strains that no test had; those of each reading by itself;
            and the gauge's own.
        seen: Part of the strain energy that has the strains of the tests.
    """

    name: str
    gauges: tuple[Gauge, ...]
    of_the_article: Float[np.ndarray, " gauge"]
    value: Float[np.ndarray, " gauge"]
    std: Float[np.ndarray, " gauge"]
    by_unknowns: Float[np.ndarray, " gauge"]
    by_shared: Float[np.ndarray, " gauge"]
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
    settings: Sequence[tuple[str, float]] = (),
    since_unloaded: bool = True,
) -> tuple[Deflection, ...]:
    """What ``gauges`` will read under each load case, since unloaded or since drawn.

    The errors of a model that no static test was refined on are what such models are thought to have. Raises
    `ConfigError` for a gauge or a load case that cannot be, `NumericalError` where there is no rest state.
    """
    return tuple(
        _predict(refined, environment, case, tuple(gauges), settings, since_unloaded) for case in load_cases
    )


def _predict(
    refined: Refined,
    environment: Environment,
    case: LoadCase | str | None,
    gauges: tuple[Gauge, ...],
    settings: Sequence[tuple[str, float]],
    since_unloaded: bool,
) -> Deflection:
    name = case if isinstance(case, str) else "as it is" if case is None else case.name
    check_zero(case, since_unloaded, f"prediction of load case {name!r}")
    place = set_up_static(refined.structure, environment, settings, case, since_unloaded, refined.unknowns)
    at, found = place.solve(refined.x), refined.estimate
    tau = found.tau[MODAL:] if refined.statics else USUAL_TAU
    fields = ErrorFields.none(at) if refined.fields is None else refined.fields
    shared, unshared = fields.slope(at, gauges)
    of_modes = len(found.d) - shared.shape[1]
    J = np.hstack([place.slope(at, gauges), np.zeros((len(gauges), of_modes)), shared])
    by_unknowns = np.linalg.norm(J @ found.root, axis=1)
    own = tau[1] * lengths(at.rest, at.unloaded, gauges)
    reads = np.array([gauge.std for gauge in gauges])
    value = at.value(gauges)
    by_shared = tau[0] * np.abs(unshared)
    return Deflection(
        name=name,
        gauges=gauges,
        of_the_article=value,
        value=value + shared @ found.d[of_modes:],
        std=np.sqrt(by_unknowns**2 + by_shared**2 + own**2 + reads**2),
        by_unknowns=by_unknowns,
        by_shared=by_shared,
        by_own=own,
        by_gauge=reads,
        seen=fields.part(at),
    )


def describe_deflections(predicted: Sequence[Deflection]) -> list[dict[str, Any]]:
    """As documents have them: one entry a load case, one in it a gauge; numbers in SI."""
    return [
        {
            "load_case": case.name,
            "strained_as_in_the_tests": case.seen,
            "readings": [
                {
                    "gauge": gauge.name,
                    "at": gauge.at,
                    "kind": gauge.kind.value,
                    "unit": gauge.unit,
                    "value": float(case.value[k]),
                    "std": float(case.std[k]),
                    "interval_95": case.interval[k].tolist(),
                    "of_the_refined_article": float(case.of_the_article[k]),
                    "std_by": {
                        "unknowns_and_errors_seen": float(case.by_unknowns[k]),
                        "errors_not_seen": float(case.by_shared[k]),
                        "each_reading": float(case.by_own[k]),
                        "gauge": float(case.by_gauge[k]),
                    },
                }
                for k, gauge in enumerate(case.gauges)
            ],
        }
        for case in predicted
    ]

"""Comparison of designs on one set of plants: decibels, stable share, order and control effort."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from middeck.arguments import named_kinds
from middeck.control.analysis.text_table import align_columns
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import Uncertainty, parameter_names
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.verification.monte_carlo import (
    PlantOutcomes,
    stable_share,
    verify_robustness,
    worst_db,
)
from middeck.systems.plants.plant import Plant
from middeck.values import record

HEAD = (
    "design", "setting", "order", "nominal dB", "nominal rms", "control rms", "stable share", "worst dB",
    "worst rms", "median dB", "median rms",
)  # fmt: skip


@record(kw_only=True)
class ComparedDesign:
    """One design in one setting.

    Attributes:
        name, setting: The design, and ``"continuous"`` or the sampling rate.
        order: States of the compensator, fixed filters included.
        nominal_db, nominal_control_rms: On the nominal plant; ``inf`` where unstable.
        stable_share: Share of the unseen plants that are stable.
        worst_db, median_db: Over the stable ones among them; ``inf`` where there is none.
        nominal_rms, worst_rms, median_rms: As ``..._db``, in the unit of the weighted outputs; they compare
            designs where a plant drifts without control (a free body) and all decibels are minus infinity.
    """

    name: str
    setting: str
    order: int
    nominal_db: float
    nominal_control_rms: float
    stable_share: float
    worst_db: float
    median_db: float
    nominal_rms: float
    worst_rms: float
    median_rms: float


@record
class DesignComparison:
    """Every design in every setting, design by design; ``print`` shows them as a table.

    ``-``: decibels relative to a plant of infinite rms without control.
    """

    rows: tuple[ComparedDesign, ...]

    def __str__(self) -> str:
        return align_columns([HEAD, *map(_cells, self.rows)])


def _cells(row: ComparedDesign) -> tuple[str, ...]:
    return (
        row.name,
        row.setting,
        str(row.order),
        _decibels(row.nominal_db),
        f"{row.nominal_rms:.3g}",
        f"{row.nominal_control_rms:.3g}",
        f"{row.stable_share:.1%}",
        _decibels(row.worst_db),
        f"{row.worst_rms:.3g}",
        _decibels(row.median_db),
        f"{row.median_rms:.3g}",
    )


def _decibels(value: float) -> str:
    return "-" if value == -np.inf else f"{value:.2f}"


@named_kinds
def compare_designs(
    plant: Plant,
    designs: Mapping[str, Compensator],
    weights: LQGWeights,
    *,
    uncertainty: Uncertainty,
    positions: Float[np.ndarray, "plant parameter"],
    rates_hz: Sequence[float] = (),
) -> DesignComparison:
    """Every design on the nominal plant and on the plants at ``positions``, in every setting.

    The designs are compared as they are: at equal authority it is for the caller to make them so.
    """
    places = np.vstack([np.zeros((1, len(parameter_names(uncertainty)))), positions])
    rows: list[ComparedDesign] = []
    for name, design in designs.items():
        found = verify_robustness(
            plant, design, weights, uncertainty=uncertainty, positions=places, rates_hz=rates_hz
        )
        rows += [_row(name, len(design.system.A), outcomes) for outcomes in found.outcomes]
    return DesignComparison(tuple(rows))


def _row(name: str, order: int, whole: PlantOutcomes) -> ComparedDesign:
    unseen = PlantOutcomes(
        setting=whole.setting,
        stable=whole.stable[1:],
        rms=whole.rms[1:],
        db=whole.db[1:],
        control_rms=whole.control_rms[1:],
    )
    return ComparedDesign(
        name=name,
        setting=whole.setting,
        order=order,
        nominal_db=float(whole.db[0]),
        nominal_control_rms=float(whole.control_rms[0]),
        stable_share=stable_share(unseen),
        worst_db=worst_db(unseen),
        median_db=_median(unseen.db, unseen.stable),
        nominal_rms=float(whole.rms[0]),
        worst_rms=float(unseen.rms[unseen.stable].max()) if unseen.stable.any() else np.inf,
        median_rms=_median(unseen.rms, unseen.stable),
    )


def _median(values: np.ndarray, stable: np.ndarray) -> float:
    return float(np.median(values[stable])) if stable.any() else np.inf

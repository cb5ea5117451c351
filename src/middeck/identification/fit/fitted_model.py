"""The measurement model that a refined search has found."""

from __future__ import annotations

import numpy as np

from middeck.identification.model.measurement_model import RANK, MeasurementModel
from middeck.identification.problem.terms import constant_terms, shapes
from middeck.identification.problem.unknowns_layout import Layout
from middeck.identification.search.refine_and_reweigh import SearchedModel
from middeck.identification.uncertainty.model_unknowns import ModelStructure
from middeck.signals.ports import Port


def model_of(run: SearchedModel, inputs: tuple[Port, ...], outputs: tuple[Port, ...]) -> MeasurementModel:
    """The model at the end of a search, without transients; its delays may be negative."""
    layout, point = run.layout, run.start.point
    linear = run.refined.step.linear[:, : layout.columns]
    c = np.array([shapes(layout, point, x) for x in linear])
    poles, b = point.poles, point.b
    if layout.options.full_rank:
        poles, c, b = _by_rank(poles, c.reshape(len(c), -1, layout.copies))
    R, Q, L, D = constant_terms(layout, point, linear)
    each, beyond = point.delay_s[:, 0], None
    if point.delay_s.shape[1] > 1:
        each = np.min(point.delay_s, axis=1)
        # A path that leads is as prompt as can be: zero, as the output's delay is then (`causal_delay`).
        beyond = np.maximum(point.delay_s, 0.0) - np.maximum(each, 0.0)[:, None]
    return MeasurementModel(
        poles=poles,
        shapes=c,
        participation=b,
        direct=D,
        lower=L,
        delay_s=each,
        inputs=inputs,
        outputs=outputs,
        sample_hz=layout.options.sample_hz,
        path_delay_s=beyond,
        rigid=R if layout.rigid_pivot else None,
        integral=Q if layout.integral_pivot else None,
    )


def structure_of(layout: Layout) -> ModelStructure:
    """The free parts of the model."""
    return ModelStructure(
        real_constants=layout.options.real_constants,
        with_delay=bool(layout.options.delay_of),
        with_lower=layout.options.residuals,
        with_direct=bool(layout.options.direct),
        common_delay=layout.options.delay_of == "common",
        relative_degree_two=layout.options.zero_sum,
    )


def _by_rank(poles: np.ndarray, residues: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residues [output, pole, input] as terms c b, as many for each pole as its residue has rank."""
    found: list[tuple[complex, np.ndarray, np.ndarray]] = []
    for pole, residue in zip(poles, residues.swapaxes(0, 1), strict=True):
        left, size, right = np.linalg.svd(residue)
        for k in range(max(1, int(np.sum(size > RANK * size[0])))):
            found.append((pole, size[k] * left[:, k], right[k]))
    return (
        np.array([pole for pole, _, _ in found]),
        np.stack([c for _, c, _ in found], axis=1),
        np.array([b for _, _, b in found]),
    )

"""Fitted delays made common where their covariance cannot distinguish them: a plant with fewer states.

A delay of its own costs each output states of a Pade approximation, and what outputs seem late against each
other by the noise alone would be a delay of microseconds, with poles far beyond all others. The constraint
that some delays are one is put on the fit by the covariance of all its unknowns: with the delays d = J x of
covariance C = J M J' and groups G,

    d' = G (G' C^-1 G)^-1 G' C^-1 d,    x' = x - M J' C^-1 (d - d'),    T^2 = (d - d')' C^-1 (d - d'),

the weighted least squares estimate under linear constraints (Seber and Lee 2003, sec. 3.8) and its test.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from middeck.identification.model.measurement_model import MeasurementModel, path_delay
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_set import LARGEST
from middeck.identification.uncertainty.model_unknowns import model_at
from middeck.identification.uncertainty.parameter_deviations import check_level, joint_tail
from middeck.values import record

# Delays that are one and are kept apart cost fast poles, delays made one wrongly three deviations at most:
# rarer than the 5 % of a test for its own sake.
LEVEL = 0.01

Groups = list[list[int]]


@record
class MergedDelays:
    """A model whose delays are common where they may be.

    Attributes:
        model: All its unknowns moved as the covariance ties them to the delays; the fit's own if none was
            merged.
        sentences: Sentences on the delays that were merged; empty for none.
        p: Probability that delays which are one differ as much by chance; one where none was merged.
    """

    model: MeasurementModel
    sentences: tuple[str, ...]
    p: float


def merge_delays(covariance: ModelCovariance, *, level: float = LEVEL) -> MergedDelays:
    """The fitted model with one delay for all outputs, or paths, that a test cannot distinguish.

    Delays nearest to each other, in their deviations, are joined one after the other; of the partitions on
    that way the coarsest is taken whose joint test has a probability of ``level`` or more. Where the
    constraint would move a decay rate by more than a linear covariance can say, the fit is left as it is.

    Args:
        covariance: ``covariance`` of a fit, or of a model file (`load_fitted`).
        level: Probability that delays which are one are kept apart.

    Raises `ConfigError` for a level that is no probability.

    ``plant = measured_plant(merge_delays(fit.covariance).model, u=("torque",), y=("base", "tip"))``
    """
    check_level(level)
    model = covariance.model
    J = _delay_rows(covariance)
    by = J @ covariance.root
    spread = by @ by.T
    unchanged = MergedDelays(model, (), 1.0)
    if len(J) < 2 or not np.all(np.diag(spread) > 0.0):
        return unchanged
    delay_s = model.delay_s if model.path_delay_s is None else path_delay(model).ravel()
    groups, merged_s, p = _coarsest(delay_s, spread, covariance.degrees, level)
    if len(groups) == len(delay_s):
        return unchanged
    x = covariance.unknowns
    moved = x - covariance.root @ by.T @ np.linalg.solve(spread, delay_s - merged_s)
    decay = covariance.at.sigma
    if np.max(np.abs(moved - x)[decay], initial=0.0) > LARGEST:
        return unchanged
    merged = _with_delays(model_at(model, covariance.structure, moved), np.maximum(merged_s, 0.0))
    names = _names(model)
    sentences = tuple(_sentence(names, delay_s, merged_s, g, p) for g in groups if len(g) > 1)
    return MergedDelays(merged, sentences, p)


def _delay_rows(covariance: ModelCovariance) -> Float[np.ndarray, "delay unknown"]:
    """Derivatives of every delay by the unknowns; no row where there is at most one delay."""
    at = covariance.at
    if not covariance.structure.with_delay or covariance.structure.common_delay:
        return np.zeros((0, at.size))
    unit = np.eye(at.size)
    if covariance.model.path_delay_s is None:
        return unit[at.delay]
    beyond = np.where(at.path[:, :, None] >= 0, unit[at.path], 0.0)
    return (unit[at.delay][:, None] + beyond).reshape(-1, at.size)


def _with_delays(model: MeasurementModel, delay_s: np.ndarray) -> MeasurementModel:
    if model.path_delay_s is None:
        return dataclasses.replace(model, delay_s=delay_s)
    each = delay_s.reshape(model.direct.shape)
    earliest = each.min(axis=1)
    beyond = each - earliest[:, None]
    return dataclasses.replace(model, delay_s=earliest, path_delay_s=beyond if np.any(beyond) else None)


def _coarsest(
    delay_s: np.ndarray, spread: np.ndarray, degrees: float, level: float
) -> tuple[Groups, Float[np.ndarray, " delay"], float]:
    """Groups of delays that are one, the delays so, and the probability of their differences."""
    scale = np.sqrt(np.diag(spread))
    weight = np.linalg.inv(spread / scale[:, None] / scale) / scale[:, None] / scale
    groups: Groups = [[int(k)] for k in np.argsort(delay_s, kind="stable")]
    found = groups, delay_s, 1.0
    while len(groups) > 1:
        mean, covariance = _means(groups, delay_s, weight)
        variance = np.diag(covariance)[:-1] + np.diag(covariance)[1:] - 2.0 * np.diag(covariance, 1)
        k = int(np.argmin(np.abs(np.diff(mean)) / np.sqrt(variance)))
        groups = [*groups[:k], groups[k] + groups[k + 1], *groups[k + 2 :]]
        mean, _ = _means(groups, delay_s, weight)
        merged_s = _indicator(groups, len(delay_s)) @ mean
        left = delay_s - merged_s
        p = float(joint_tail(left @ weight @ left, len(delay_s) - len(groups), degrees))
        if p >= level:
            found = groups, merged_s, p
    return found


def _means(groups: Groups, delay_s: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean of each group and the covariance of the means."""
    G = _indicator(groups, len(delay_s))
    covariance = np.linalg.inv(G.T @ weight @ G)
    return covariance @ (G.T @ weight @ delay_s), covariance


def _indicator(groups: Groups, delays: int) -> Float[np.ndarray, "delay group"]:
    G = np.zeros((delays, len(groups)))
    for k, group in enumerate(groups):
        G[group, k] = 1.0
    return G


def _names(model: MeasurementModel) -> list[str]:
    if model.path_delay_s is None:
        return [p.name for p in model.outputs]
    return [f"{i.name} to {o.name}" for o in model.outputs for i in model.inputs]


def _sentence(names: list[str], delay_s: np.ndarray, merged_s: np.ndarray, group: list[int], p: float) -> str:
    members = sorted(group)
    each = ", ".join(f"{names[k]} {delay_s[k] * 1e3:.6g}" for k in members)
    return (
        f"delays not told apart by their deviations are taken as one of {merged_s[members[0]] * 1e3:.6g} ms "
        f"(p = {p:.2g}): {each} ms"
    )

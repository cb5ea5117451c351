"""Monte Carlo verification of a compensator on many plants, with exact delays, continuous and sampled."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from middeck.control.h2.closed_cost import Law, closed_matrices
from middeck.control.h2.generalized_plant import GeneralizedPlant, generalize
from middeck.control.h2.noise_rms import NoiseOutcome, integrate_band_noise, integrate_noise
from middeck.control.law.compensator import Compensator, idle_compensator, locate_ports
from middeck.control.law.delay_order import LEAST_PADE, MOST_PADE, is_within, pade_order, phase_of_modes
from middeck.control.law.rounding_of_results import is_vague_half
from middeck.control.law.uncertainty import Uncertainty, finished_plants
from middeck.control.lqg.weights import LQGWeights
from middeck.control.robust.verification.batch import same_shapes, warn_of_lost
from middeck.control.robust.verification.exact_delay import exact_growth
from middeck.control.robust.verification.exact_family import family_law, measure_in_family
from middeck.control.robust.verification.gain_above_modes import gain_above
from middeck.control.robust.verification.many_loops import measure_many
from middeck.control.robust.verification.sampled_loops import sampled_outcomes
from middeck.errors import ConfigError, NumericalError
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.norms.peak_gain import peak_gain
from middeck.systems.plants.plant import Plant, remove_delays
from middeck.systems.poles.stability import all_decay
from middeck.systems.state_space.statespace import StateSpace, poles
from middeck.values import record

UNDECIDED = NoiseOutcome(False, np.inf, np.inf)
SMALL = 0.5
"""Gain of a loop from which on its phase may decide stability: one, with a half to spare."""
KEPT = 512
"""Plants of which the approximation is remembered, a hundred kilobytes each."""


@record(kw_only=True)
class PlantOutcomes:
    """Outcomes of all plants under one form of the compensator.

    Attributes:
        setting: ``"continuous"``, or the sampling rate, as ``"500 Hz"``.
        stable: Stability by the roots. A loop of infinite rms is not stable: a root on the axis drifts.
        rms: Rms of the weighted outputs, (E[z' W^2 z])^1/2 under process and sensor noise; ``inf`` where
            unstable. That of a sampled loop is at the sampling instants.
        db: 20 log10 of it over the same plant's without control; improvement is negative. ``-inf`` where the
            plant is unstable without control and stable with it.
        control_rms: (E[u' R u])^1/2.
    """

    setting: str
    stable: Bool[np.ndarray, " plant"]
    rms: Float[np.ndarray, " plant"]
    db: Float[np.ndarray, " plant"]
    control_rms: Float[np.ndarray, " plant"]


@record
class Verification:
    """A compensator's outcomes: continuous with exact delays, then at each sampling rate."""

    positions: Float[np.ndarray, "plant parameter"]
    outcomes: tuple[PlantOutcomes, ...]


def verify_robustness(
    plant: Plant,
    compensator: Compensator,
    weights: LQGWeights,
    *,
    uncertainty: Uncertainty,
    positions: Float[np.ndarray, "plant parameter"],
    rates_hz: Sequence[float] = (),
) -> Verification:
    """Close the loop on the plants at ``positions`` of the box (`draw_positions` draws unseen ones).

    For plants of decaying modes with delays, unstable roots are counted and the rms is integrated with exact
    exp(-s tau) (`exact_family`). Other delays are approximated with an order that keeps every mode's phase to
    1e-9 (`pade_order`); the rightmost poles are then corrected for the exact delay, and the rms is that of
    the approximation. Where the order would exceed 40, the leading pole lies outside the range of the
    approximation, approximation and roots disagree, or rounding of plant or compensator moves poles
    (`is_vague`), the plant is evaluated singly and exactly (`measure_noise_rms`). At each rate of
    ``rates_hz`` the compensator is sampled by Tustin's rule and held, in addition to the plant's delay.

    A plant whose stability cannot be decided counts as unstable, and a warning gives its position.

    Raises `ConfigError` for a compensator of other ports than the plant's groups y and u.
    """
    plants = finished_plants(plant, uncertainty, np.asarray(positions, dtype=float))
    return Verification(positions, outcomes_on(plants, compensator, weights, rates_hz=rates_hz))


def outcomes_on(
    plants: Sequence[Plant], compensator: Compensator, weights: LQGWeights, *, rates_hz: Sequence[float] = ()
) -> tuple[PlantOutcomes, ...]:
    """`verify_robustness` for a list of plants."""
    _require(plants, compensator)
    reference = np.zeros(0)
    if plants:
        generalize(remove_delays(plants[0]), weights, 1.0)  # it refuses weights that do not fit
        reference = uncontrolled_rms(plants, weights)
    continuous = _outcomes("continuous", *noise_on(plants, compensator, weights), reference)
    sampled = [
        _outcomes(f"{rate:g} Hz", *sampled_outcomes(plants, compensator, weights, rate), reference)
        for rate in rates_hz
    ]
    return (continuous, *sampled)


def stable_share(outcomes: PlantOutcomes) -> float:
    """Fraction of the plants that are stable."""
    return float(np.mean(outcomes.stable))


def worst_db(outcomes: PlantOutcomes) -> float:
    """The least improvement among the stable plants; ``inf`` if there is none."""
    return float(outcomes.db[outcomes.stable].max(initial=-np.inf)) if outcomes.stable.any() else np.inf


def _require(plants: Sequence[Plant], compensator: Compensator) -> None:
    for plant in plants:
        _require_ports(plant, compensator)
    if np.any(compensator.system.D):
        raise ConfigError(
            "the compensator has a direct term: sensor noise would make its rms infinite",
            hint="add a roll-off to the compensator",
        )


def _require_ports(plant: Plant, compensator: Compensator) -> None:
    locate_ports(compensator, plant.inputs, plant.outputs)
    reads, drives = (tuple(p.name for p in side) for side in (compensator.inputs, compensator.outputs))
    if reads != plant.y or drives != plant.u:
        raise ConfigError(
            f"the compensator reads {', '.join(reads)} and drives {', '.join(drives)}; the plant's groups y "
            f"and u are {', '.join(plant.y)} and {', '.join(plant.u)}",
            hint="design the compensator on a plant with the same groups, in the same order",
        )


def _uncontrolled(plant: Plant, weights: LQGWeights) -> Plant:
    """The plant from w to z without the delays common to all paths of an output."""
    delay_s = np.zeros_like(plant.delay_s)
    kept = np.ix_(plant.output_indices(plant.z), plant.input_indices(weights.disturbed))
    delay_s[kept] = plant.delay_s[kept] - plant.delay_s[kept].min(axis=1, keepdims=True, initial=np.inf)
    return dataclasses.replace(plant, delay_s=delay_s)


def uncontrolled_rms(
    plants: Sequence[Plant], weights: LQGWeights, band_hz: tuple[float, float] | None = None
) -> Float[np.ndarray, " plant"]:
    """(E[z' W^2 z])^1/2 of each plant alone, in a band if one is given; ``inf`` where it does not decay."""
    alone = [_uncontrolled(p, weights) for p in plants]
    return noise_on(alone, idle_compensator(plants[0]), weights, band_hz)[1] if plants else np.zeros(0)


def noise_on(
    plants: Sequence[Plant],
    compensator: Compensator,
    weights: LQGWeights,
    band_hz: tuple[float, float] | None = None,
) -> tuple[Bool[np.ndarray, " plant"], Float[np.ndarray, " plant"], Float[np.ndarray, " plant"]]:
    """Stability, rms of the weighted outputs, and of the weighted inputs, continuous, delays exact.

    Over all frequencies, or of what lies in ``band_hz``.

    Raises `ConfigError` for a compensator of other ports than the plants' groups y and u, for one that is
    sampled, and for one with a direct term.
    """
    stable, rms, control = _noise_on(plants, compensator, weights, measured=band_hz is None)
    if band_hz is not None:
        for i in np.flatnonzero(np.isfinite(rms)).tolist():
            rms[i], control[i] = integrate_band_noise(plants[i], compensator, weights, band_hz)
    return stable, rms, control


def which_decay(
    plants: Sequence[Plant], compensator: Compensator, weights: LQGWeights
) -> Bool[np.ndarray, " plant"]:
    """Which loops are stable and of finite rms in `noise_on`, without computing the rms.

    Above the modes of a plant the phase of its delay is not kept where the gain of the loop is small there.
    """
    stable, rms, _ = _noise_on(plants, compensator, weights, measured=False)
    return stable & np.isfinite(rms)


def _noise_on(
    plants: Sequence[Plant], compensator: Compensator, weights: LQGWeights, *, measured: bool
) -> tuple[Bool[np.ndarray, " plant"], Float[np.ndarray, " plant"], Float[np.ndarray, " plant"]]:
    """`noise_on` over all frequencies; without ``measured`` a finite rms may be any finite number."""
    _require(plants, compensator)
    found: list[NoiseOutcome | None] = [None] * len(plants)
    modal = [p.delayed and p.modal is not None for p in plants]
    known = family_law(compensator, weights) if any(modal) else None
    if known is not None:
        both = zip(plants, modal, strict=True)
        found = [measure_in_family(p, known, measured=measured) if its else None for p, its in both]
    left = [i for i, outcome in enumerate(found) if outcome is None]
    others = _approximated([plants[i] for i in left], compensator, weights, measured=measured)
    for i, outcome in zip(left, others, strict=True):
        found[i] = outcome
    lost = [i for i, outcome in enumerate(found) if outcome is None]
    warn_of_lost(lost, len(plants))
    rows = [(f.stable, f.rms, f.control_rms) for f in (one or UNDECIDED for one in found)]
    stable, rms, control = (np.array(x) for x in zip(*rows, strict=True)) if rows else (np.zeros(0),) * 3
    return stable.astype(bool), rms, control


def _approximated(
    plants: Sequence[Plant], compensator: Compensator, weights: LQGWeights, *, measured: bool
) -> list[NoiseOutcome | None]:
    """All plants together with approximated delays, but exactly where that is needed; None if undecided."""
    of_law = is_vague_half(compensator)
    vague = [of_law or _is_mixed(p) for p in plants]
    known = [p for p, its in zip(plants, vague, strict=True) if not its]
    together = iter(_together(known, compensator, weights, measured=measured))
    found = [None if its else next(together) for its in vague]
    for i, plant in enumerate(plants):
        if found[i] is None:
            with contextlib.suppress(NumericalError):
                found[i] = integrate_noise(plant, compensator, weights, measured=measured)
    return found


def _together(
    plants: Sequence[Plant], compensator: Compensator, weights: LQGWeights, *, measured: bool
) -> list[NoiseOutcome | None]:
    """Outcomes with approximated delays; None for a plant that these, or rounding, leave undecided."""
    system = compensator.system
    law = Law(system.A, system.B, system.C)
    turning = float(np.abs(np.imag(poles(system))).max(initial=0.0))
    small = [False] * len(plants) if measured else _small_above(plants, system, turning)
    orders = [
        _order(p, 0.0 if few else turning) if p.delayed else 1 for p, few in zip(plants, small, strict=True)
    ]
    order = max((n for n in orders if n <= MOST_PADE), default=LEAST_PADE)
    models = [_model(p, order, weights) for p in plants]
    values, rms, control = _rms(models, [law] * len(models), measured=measured)
    stable = exact_growth(plants, law, values) <= 0.0
    found: list[NoiseOutcome | None] = []
    for i, plant in enumerate(plants):
        agreed = stable[i] == np.isfinite(rms[i]) and orders[i] <= order
        lost = np.isnan(rms[i]) or (plant.delayed and not (agreed and is_within(order, plant, values[i])))
        found.append(None if lost else NoiseOutcome(bool(stable[i]), float(rms[i]), float(control[i])))
    return found


# What no law changes: the compensators of a promise are tried on the same plants one after the other.
_once = functools.lru_cache(maxsize=KEPT)
_is_mixed = _once(is_vague_half)


@_once
def _phase(plant: Plant) -> float:
    return phase_of_modes(plant)


@_once
def _gain_above(plant: Plant) -> float:
    return gain_above(plant, _top(plant))


def _top(plant: Plant) -> float:
    """The fastest turning of a mode [rad/s]."""
    return _phase(plant) / float(plant.delay_s.max())


@_once
def _model(plant: Plant, order: int, weights: LQGWeights) -> GeneralizedPlant:
    return generalize(approximate_delays(plant, order), weights, 1.0)


def _small_above(plants: Sequence[Plant], law: StateSpace, turning: float) -> list[bool]:
    """Loops whose gain above their plant's modes is so small that no phase there decides stability."""
    delayed = [p for p in plants if p.delayed]
    low = min((_top(p) for p in delayed), default=turning)
    if turning <= low:
        return [False] * len(plants)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its uncertainty is far below the half left
        try:
            most = peak_gain(law, (low, np.inf)).gain
        except NumericalError:
            most = np.inf
    return [p.delayed and most * _gain_above(p) < SMALL for p in plants]


def _order(plant: Plant, turning: float) -> int:
    """Order of the delays' approximation under a compensator with poles of up to ``turning`` [rad/s]."""
    return pade_order(max(_phase(plant), turning * float(plant.delay_s.max(initial=0.0))))


def _outcomes(
    setting: str, stable: np.ndarray, rms: np.ndarray, control: np.ndarray, reference: np.ndarray
) -> PlantOutcomes:
    stable = stable & np.isfinite(rms)
    rms, control = np.where(stable, rms, np.inf), np.where(stable, control, np.inf)
    db = np.where(np.isfinite(rms), np.where(np.isfinite(reference), 0.0, -np.inf), np.inf)
    both = np.isfinite(rms) & np.isfinite(reference) & (rms > 0.0) & (reference > 0.0)
    db[both] = 20.0 * np.log10(rms[both] / reference[both])
    return PlantOutcomes(setting=setting, stable=stable, rms=rms, db=db, control_rms=control)


def _rms(
    models: Sequence[GeneralizedPlant], laws: Sequence[Law], *, measured: bool
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Poles, rms of the weighted outputs, and of the weighted input, plant by plant; ``nan`` where rounding
    leaves stability open.
    """
    found: list[np.ndarray] = [np.zeros(0)] * len(models)
    rms, control = np.full(len(models), np.inf), np.full(len(models), np.inf)
    closed = [closed_matrices(m, law) for m, law in zip(models, laws, strict=True)]
    for group in same_shapes([c[0].shape for c in closed]):
        A, B, C = (np.array([closed[i][k] for i in group]) for k in range(3))
        values = np.linalg.eigvals(A).astype(complex)
        each = _measured(A, B, C) if measured else _bounded(A, C, values)
        inputs = models[group[0]].B2.shape[1]
        outputs = each.shape[1] - inputs
        for j, i in enumerate(group):
            found[i] = values[j]
            rms[i] = np.linalg.norm(each[j, :outputs])
            control[i] = np.linalg.norm(each[j, outputs:])
    return found, rms, control


def _measured(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> Float[np.ndarray, "loop output"]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what it leaves open is decided exactly
        found = measure_many(A, B, C)
    return np.where(np.isinf(found.residual)[:, None], np.nan, found.rms)


def _bounded(A: np.ndarray, C: np.ndarray, values: np.ndarray) -> Float[np.ndarray, "loop output"]:
    """Zero for each loop whose poles decay, ``values`` or what these are without rounding; as `_measured`."""
    decay = np.array([all_decay(own) for own in values], bool)
    found = np.zeros((len(A), C.shape[1]))
    nothing = np.zeros((len(A), A.shape[1], 0))
    found[~decay] = _measured(A[~decay], nothing[~decay], C[~decay])
    return found

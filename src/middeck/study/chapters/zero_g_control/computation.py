"""Figure 7: controllers designed on the 0-g model, impinged on the 0-g and the 1-g model."""

import dataclasses
from collections.abc import Mapping
from functools import partial

import numpy as np

from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.loop.authority import (
    AuthoritySweep,
    FirstInstability,
    find_first_instability,
    sweep_authority,
)
from middeck.control.loop.closed_loop import ClosedLoop, close_loop, leave_open
from middeck.control.loop.performance import Performance, loop_metric
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.estimator import design_filter
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import ConfigError, NumericalError
from middeck.files.studies.documents import Study
from middeck.structure.gravity.compare_modes import ModeComparison
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import damped_kinds
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.plants.sensors_and_actuators import RATE
from middeck.systems.norms.band_rms import band_rms_by_quadrature
from middeck.systems.plants.plant import Plant, require_modal
from middeck.systems.poles.stability import GROWTH_LIMIT
from middeck.systems.state_space.modal_system import select_modes
from middeck.values import record

SUB_MODELS = ("all", "rigid", "flexible")
SEARCH_LAST = 7.0  # log10 authority: beyond the plotted range


@record(kw_only=True)
class SubModelSweep:
    """One sub-model over authority.

    Attributes:
        reference_db_lab_pd: The lab metric under PD alone, over the orbit one.
        first_instability: First instability in the lab, searched beyond the plotted range; None for none.
        mode_frequency_hz, mode_kind: Those of the leading mode in the lab without any control.
        unstable_pairs, unstable_real: Numbers of complex pairs and of real poles, which diverge, past the
            stability limit there.
        quadrature_error: Largest relative difference of the closed-form metric from adaptive quadrature, over
            the stable loops of the first and the last level.
    """

    sweep: AuthoritySweep
    reference_db_lab_pd: float
    first_instability: FirstInstability | None
    mode_frequency_hz: float | None
    mode_kind: str
    unstable_pairs: int
    unstable_real: int
    quadrature_error: float


@record
class ZeroGControl:
    """Figure 7 in numbers.

    ``disturbance_psd`` is the two-sided intensity S_w [(N m)^2/Hz] that makes three sigma of the metric the
    stated angle for the full 0-g model under PD alone; ``metric_pd`` that metric [rad] by environment.
    """

    log10_authority: np.ndarray
    disturbance_psd: float
    metric_pd: tuple[tuple[str, float], ...]
    sweeps: tuple[tuple[str, SubModelSweep], ...]


def control_plant(modes: Modes, study: Study) -> Plant:
    """The paper's plant: control and disturbance torques in, angles and rates out, metric angles as z.

    The two secondary gimbal angles and rates are outputs for their PD loops alone; LQG never sees them.
    """
    control = study.control
    measured = [*control.angles, *(f"{a}{RATE}" for a in control.angles)]
    inner = [n for loop in control.pd_loops for n in (loop, f"{loop}{RATE}") if n not in measured]
    inputs = list(dict.fromkeys([*control.disturbances, *control.inputs]))
    return build_plant(
        modes,
        inputs=inputs,
        outputs=[*measured, *inner],
        count=control.modes_kept,
        w=control.disturbances,
        u=control.inputs,
        z=control.metric,
        y=measured,
    )


def sub_model(plant: Plant, kinds: tuple[str, ...], which: str) -> Plant:
    """``plant`` with all its modes, the flexible ones, or those that are not flexible."""
    flexible = np.array([k == "flexible" for k in kinds])
    keep = {"all": np.ones(len(flexible), dtype=bool), "flexible": flexible, "rigid": ~flexible}[which]
    return dataclasses.replace(plant, dynamics=select_modes(require_modal(plant), keep), state_names=())


def compute(study: Study, rng: np.random.Generator, comparison: ModeComparison) -> ZeroGControl:
    """The sweep on the modes that Figures 4 and 5 compare; nothing is drawn from ``rng``."""
    return study_zero_g_control({"orbit": comparison.orbit, "lab": comparison.lab}, study)


def study_zero_g_control(modes: Mapping[str, Modes], study: Study) -> ZeroGControl:
    """Design on the PD-controlled 0-g plant at every authority, judge on ``modes`` "orbit" and "lab"."""
    control = study.control
    _require_flexible(modes, control.modes_kept)
    pd = PDLoops(control.pd_loops, np.array(control.pd_kp_nm_per_rad), np.array(control.pd_kd_nms_per_rad))
    whole = {env: control_plant(m, study) for env, m in modes.items()}
    kinds = {env: damped_kinds(m)[: control.modes_kept] for env, m in modes.items()}
    held = any(set(k) == {"flexible"} for k in kinds.values())  # clamped, it has no rigid sub-model
    plants = {
        which: {env: close_inner_loop(sub_model(p, kinds[env], which), pd) for env, p in whole.items()}
        for which in SUB_MODELS
        if not (held and which == "rigid")
    }
    psd = disturbance_psd(plants["all"]["orbit"], study)
    performance = performance_under(study, psd)
    metric_pd = tuple((env, loop_metric(leave_open(p), performance)) for env, p in plants["all"].items())
    if dict(metric_pd)["lab"] == 0.0:
        raise NumericalError(
            "in the laboratory the disturbances do not move the metric: there is no decibel of it",
            where="control.disturbances",
            hint="a motor of a node that is not clamped there, or another laboratory",
        )
    levels = np.linspace(control.log10_authority_first, control.log10_authority_last, control.levels)
    sweeps = tuple(
        (which, _sweep(pair, design_weights(study, psd), performance, levels, modes["lab"]))
        for which, pair in plants.items()
    )
    return ZeroGControl(levels, psd, metric_pd, sweeps)


def _require_flexible(modes: Mapping[str, Modes], kept: int) -> None:
    """The flexible sub-model needs a mode on both sides, and below it no rigid mode may be cut off."""
    kinds = [damped_kinds(m) for m in modes.values()]
    needed = max(k.index("flexible") + 1 if "flexible" in k else len(k) for k in kinds)
    if kept < needed:
        raise ConfigError(
            f"{kept} modes hold no flexible one in orbit and in the laboratory",
            where="control.modes_kept",
            hint=f"at least {needed} for this article",
        )


def _sweep(
    pair: Mapping[str, Plant],
    weights: LQGWeights,
    performance: Performance,
    levels: np.ndarray,
    lab: Modes,
) -> SubModelSweep:
    design = partial(design_lqg, pair["orbit"], weights, kalman=design_filter(pair["orbit"], weights))
    reference = loop_metric(leave_open(pair["orbit"]), performance)
    sweep = sweep_authority(design, 10.0**levels, on=pair, performance=performance, reference=reference)
    lab_pd = loop_metric(leave_open(pair["lab"]), performance)
    over_orbit = float(20.0 * np.log10(lab_pd / reference))
    ends = [close_loop(plant, design(10.0**level)) for level in levels[[0, -1]] for plant in pair.values()]
    error = max((_quadrature_error(loop, performance) for loop in ends if loop.stable), default=0.0)
    first = find_first_instability(design, pair["lab"], first=float(levels[0]), last=SEARCH_LAST)
    mode, growing = None, np.zeros(0)
    if first is not None:
        mode = lab.name.index(first.mode_name)
        loop = close_loop(pair["lab"], design(10.0**first.log10_authority))
        growing = np.imag(loop.poles)[np.real(loop.poles) > GROWTH_LIMIT]
    return SubModelSweep(
        sweep=sweep,
        reference_db_lab_pd=over_orbit,
        first_instability=first,
        mode_frequency_hz=None if mode is None else float(lab.frequency_hz[mode]),
        mode_kind="" if mode is None else lab.kind[mode],
        unstable_pairs=int(np.count_nonzero(growing > 0.0)),
        unstable_real=int(np.count_nonzero(growing == 0.0)),
        quadrature_error=error,
    )


def _quadrature_error(loop: ClosedLoop, performance: Performance) -> float:
    rms = band_rms_by_quadrature(loop.system, performance.intensity, performance.band_hz)
    return abs(loop_metric(loop, performance) / float(np.linalg.norm(performance.weights * rms)) - 1.0)


def performance_under(study: Study, psd: float) -> Performance:
    """The metric in the stated band, under white torques of this intensity."""
    control = study.control
    intensity = psd * np.eye(len(control.disturbances))
    return Performance(np.array(control.metric_weights), intensity, control.band_hz)


def disturbance_psd(plant: Plant, study: Study) -> float:
    """S_w from 3 sigma = the stated angle; the metric is proportional to its root."""
    unit = loop_metric(leave_open(plant), performance_under(study, 1.0))
    if not 0.0 < unit < np.inf:
        raise NumericalError(
            f"under PD alone the metric in 0-g is {unit:g} for a unit disturbance, which no intensity scales",
            where="control",
            hint="a disturbance that the metric sees, and pd_kd_nms_per_rad that damp every reachable mode",
        )
    return float((np.radians(study.control.three_sigma_deg) / 3.0 / unit) ** 2)


def design_weights(study: Study, psd: float) -> LQGWeights:
    """The sheet's weights and noise: disturbance and a small torque noise on every input, white sensors."""
    control = study.control
    n_w, n_u, n_y = len(control.disturbances), len(control.inputs), len(control.angles)
    process = np.diag([psd] * n_w + [control.actuator_noise_ratio * psd] * n_u)
    sensor = [control.angle_noise_rad_per_rthz**2] * n_y + [control.rate_noise_rad_per_s_per_rthz**2] * n_y
    return LQGWeights(
        output=np.array(control.metric_weights),
        input=np.array(control.input_weight),
        disturbed=(*control.disturbances, *control.inputs),
        process=process,
        sensor=np.array(sensor),
    )

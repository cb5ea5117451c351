"""The paper's articles as rigs that an engine steps itself, what holds them, and compensators for them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.signal
from numpy.typing import ArrayLike

from middeck.control.law.compensator import Compensator
from middeck.control.law.partition import partition_modes
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.loop.closed_loop import leave_open
from middeck.control.loop.performance import Performance, loop_metric
from middeck.control.riccati.discrete import solve_discrete_riccati
from middeck.files.studies.documents import load_study
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.rigs.linear_article import LinearArticle, linear_article
from middeck.realtime.engine.trials.standard_trips import find_reach, guard
from middeck.realtime.package.filter_sections import LoopPath, Section, static_gain
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import package_law
from middeck.structure.plants.modal_plant import build_plant
from middeck.study.chapters.zero_g_control.computation import control_plant
from middeck.study.shared import find_modes
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant, delay_plant, select_ports
from middeck.systems.state_space.statespace import SampledStateSpace
from middeck.values import record
from ungated import Supervisor

PERIOD_S = 0.002
ROLL_OFF_HZ = 2.0
IN_ORBIT = 0.02
"""Share of the disturbance in orbit, where only the hold resists below 0.1 Hz."""
TORQUE_RMS = 0.3
"""Of the disturbance at the gimbal of the development model in the laboratory [N m], up to 60 Hz."""
ANGLE_NOISE, RATE_NOISE = 1e-5, 2e-4 * np.sqrt(500.0)
"""Rms of a sample: an encoder's step over the root of 12, and the gyro's of the study."""


PIECE_S = 30.0
"""Of a long run, between two looks of the supervisor."""


@functools.cache
def study(turned_deg: float = 0.0):
    """With the primary payload of both articles turned about its inner axis."""
    turned = (f"gimbal.0.angle_z_deg={turned_deg}",) if turned_deg else ()
    return load_study(Path(__file__).parents[1] / "studies" / "mace-1993.toml", turned)


@record(kw_only=True)
class RigCase:
    """An article between an engine's ports, held by the sheet's loops.

    Attributes:
        plant: Continuous, delayed, without the modes that no port moves.
        sensors, drives: Names of ports in the engine's order; the first ``controlled`` drives and the first
            ``measured`` sensors are a compensator's.
        hold: The sheet's gains; without a roll-off of the wheels' damping the delay makes 48 Hz grow.
        disturbed, disturbance_rms: Where white noise pushes, and its rms in a sample [N m].
    """

    plant: Plant
    sensors: tuple[str, ...]
    drives: tuple[str, ...]
    measured: int
    controlled: int
    hold: tuple[LoopPath, ...]
    disturbed: tuple[str, ...]
    disturbance_rms: float


def _rates(names):
    return [f"{name}_rate" for name in names]


@functools.cache
def rig_case(article: str = "simple", environment: str = "lab", turned_deg: float = 0.0) -> RigCase:
    """``article`` "simple" or "dm", ``environment`` "lab" or "orbit"."""
    control, modes = study().control, find_modes(*study(turned_deg).case(article, environment))
    if article == "simple":
        plant, disturbed = control_plant(modes, study()), tuple(control.disturbances)
        loops, measured = control.pd_loops, (*control.angles, *_rates(control.angles))
        rest = [name for loop in control.disturbances for name in (loop, f"{loop}_rate")]
    else:
        loops, disturbed, rest = tuple(control.inputs), ("pri_rel_z",), []
        measured = (*control.angles, *_rates(control.angles))
        plant = build_plant(modes, inputs=loops, outputs=measured, count=control.modes_kept)
    active = partition_modes(plant).active
    sensors, drives = (*measured, *rest), (*control.inputs, *(n for n in loops if n not in control.inputs))
    hold: list[LoopPath] = []
    for name, kp, kd in zip(
        control.pd_loops, control.pd_kp_nm_per_rad, control.pd_kd_nms_per_rad, strict=True
    ):
        if name in drives:
            at, rate = sensors.index(name), sensors.index(f"{name}_rate")
            damping = _rolled_off(-kd) if name.startswith("bus") else static_gain(-kd)
            hold += [
                LoopPath(at, drives.index(name), static_gain(-kp)),
                LoopPath(rate, drives.index(name), damping),
            ]
    delay = study().rig.delay_s - PERIOD_S / 2  # half a sample of hold is in the rig's
    return RigCase(
        plant=delay_plant(active, delay),
        sensors=sensors,
        drives=drives,
        measured=len(measured),
        controlled=len(control.inputs),
        hold=tuple(hold),
        disturbed=disturbed,
        disturbance_rms=_disturbance(article, environment),
    )


def _rolled_off(gain: float) -> Section:
    b, a = scipy.signal.butter(2, 2.0 * ROLL_OFF_HZ * PERIOD_S)
    return Section(gain * b, a[1:])


def _disturbance(article: str, environment: str) -> float:
    """As the study has it: three sigma of the metric, or the torque at the gimbal."""
    if article == "dm":
        share = 1.0 if environment == "lab" else IN_ORBIT
        return share * TORQUE_RMS / np.sqrt(2.0 * 60.0 * PERIOD_S)
    control = study().control
    plant = control_plant(find_modes(*study().case("simple", "orbit")), study())
    pd = PDLoops(control.pd_loops, np.array(control.pd_kp_nm_per_rad), np.array(control.pd_kd_nms_per_rad))
    unit = Performance(np.array(control.metric_weights), np.eye(len(control.disturbances)), control.band_hz)
    metric = loop_metric(leave_open(close_inner_loop(plant, pd)), unit)
    share = 1.0 if environment == "lab" else IN_ORBIT
    return share * float(np.radians(control.three_sigma_deg) / 3.0 / metric / np.sqrt(PERIOD_S))


def article_of(case: RigCase, plant: Plant | None = None, **changes) -> LinearArticle:
    """What an engine steps: ``plant`` instead of the case's own where one is given."""
    noise = [RATE_NOISE if name.endswith("_rate") else ANGLE_NOISE for name in case.sensors]
    given = {"disturbance_rms": case.disturbance_rms, "sensor_noise": noise, "seed": 1}
    return linear_article(
        plant or case.plant,
        PERIOD_S,
        case.drives,
        case.sensors,
        disturbed=case.disturbed,
        **(given | changes),
    )


@functools.cache
def nominal_article(article: str = "simple", environment: str = "lab") -> LinearArticle:
    return article_of(rig_case(article, environment))


def shifted(case: RigCase, factors: dict[str, float]) -> Plant:
    """The case's plant with frequencies of modes multiplied."""
    return shift_modes(case.plant, factors)


@record(kw_only=True)
class Held:
    """x+ = A x + B u + G w, y = C x with the hold closed, its filters' states behind the article's."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    G: np.ndarray


def held(article: LinearArticle, case: RigCase) -> Held:
    n, k = len(article.A), 2 * len(case.hold)
    A = np.zeros((n + k, n + k))
    A[:n, :n] = article.A
    for i, path in enumerate(case.hold):
        b, (a1, a2) = path.section.b, path.section.a
        y, u, at = article.C[path.input], article.B[:, path.output], n + 2 * i
        A[:n, :n] += b[0] * np.outer(u, y)
        A[:n, at] += u
        A[at : at + 2, at : at + 2] = [[-a1, 1.0], [-a2, 0.0]]
        A[at, :n] += (b[1] - a1 * b[0]) * y
        A[at + 1, :n] += (b[2] - a2 * b[0]) * y
    B, G = (np.vstack([m, np.zeros((k, m.shape[1]))]) for m in (article.B, article.G))
    return Held(A=A, B=B, C=np.hstack([article.C, np.zeros((len(article.C), k))]), G=G)


def lqg(case: RigCase, article: LinearArticle, authority: float) -> Compensator:
    """Discrete LQG on the held article: angles weighted alike, torques with 1 / ``authority``."""
    ports = case.drives[: case.controlled], case.sensors[: case.measured]
    return weighted_lqg(case, article, ports, (1.0, 1.0 / authority), (1.0, 1e-6, 1.0))


def weighted_lqg(
    case: RigCase,
    article: LinearArticle,
    ports: tuple[tuple[str, ...], tuple[str, ...]],
    weights: tuple[ArrayLike, ArrayLike],
    intensities: tuple[float, float, ArrayLike],
) -> Compensator:
    """Discrete LQG from ``ports``, drives and sensors, of the held article.

    Args:
        weights: Of each angle read, and of each drive.
        intensities: Of the disturbance, of as much at each drive, and of each sensor's noise, over those of
            the article.
    """
    whole, drives, sensors = held(article, case), *_places(case, *ports)
    A, B, C, G = whole.A, whole.B[:, drives], whole.C[sensors], whole.G
    at = C[[i for i, name in enumerate(ports[1]) if not name.endswith("_rate")]]
    disturbed, driven, noisy = intensities
    process = disturbed * G @ G.T + driven * case.disturbance_rms**2 * B @ B.T
    L = _gain(A.T, C.T, process, np.diag(noisy * article.sensor_noise[sensors] ** 2)).T
    K = _gain(A, B, (at.T * weights[0]) @ at, np.diag(np.broadcast_to(weights[1], len(drives))))
    law = SampledStateSpace(
        A - B @ K - L @ C, L, -K, np.zeros((len(drives), len(sensors))), period_s=PERIOD_S
    )
    chosen = select_ports(case.plant, *ports)
    return Compensator(law, chosen.outputs, chosen.inputs, applied=B)


def _places(case: RigCase, drives: Iterable[str], sensors: Iterable[str]) -> tuple[list[int], list[int]]:
    return [case.drives.index(name) for name in drives], [case.sensors.index(name) for name in sensors]


def _gain(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    names = tuple(f"state {i}" for i in range(len(A)))
    return solve_discrete_riccati(A, B, Q, R, np.zeros_like(B), names=names, complaint="unheld").gain


def closed_states(case: RigCase, article: LinearArticle, law: Compensator) -> np.ndarray:
    """The states' matrix of the held article with the compensator at full authority."""
    s, whole = law.sampled, held(article, case)
    drives, sensors = _places(case, *([port.name for port in side] for side in (law.outputs, law.inputs)))
    B, C = whole.B[:, drives], whole.C[sensors]
    top = np.hstack([whole.A + B @ s.D @ C, B @ s.C])
    return np.vstack([top, np.hstack([s.B @ C, s.A])])


def growth(states: np.ndarray) -> float:
    """Largest rate of growth [1/s]."""
    return float(np.log(np.abs(np.linalg.eigvals(states)).max()) / PERIOD_S)


def pack(law: Compensator, **changes) -> ControllerPackage:
    return package_law(law, "law", **({"ramp_s": 0.3, "unstable": True} | changes))


def scaled_rows(law: Compensator, gains: np.ndarray) -> Compensator:
    """Another gain at each output, of which the estimator knows nothing."""
    s = law.sampled
    rows = gains[:, None]
    system = SampledStateSpace(s.A, s.B, rows * s.C, rows * s.D, period_s=s.period_s)
    return Compensator(system, law.inputs, law.outputs, applied=law.applied)


ENVELOPE = {("simple", "lab"): 2.0, ("simple", "orbit"): 4.0, ("dm", "lab"): 15.0, ("dm", "orbit"): 15.0}
"""Largest angle of normal operation with a margin [deg]."""
SHARE = 0.75
"""Of the torque that the safe state can catch (`find_reach`), as the limit of each output."""
AUTHORITY = 2.0
"""Decades of authority of the compensator of normal operation."""
SETTLE_S, NOMINAL_S = 10.0, 40.0


@functools.cache
def bare_settings(article: str = "simple", environment: str = "lab") -> EngineSettings:
    """Ports, hold and limits, without a monitor."""
    case, most = rig_case(article, environment), np.radians(ENVELOPE[article, environment])
    y = [case.plant.outputs[i] for i in case.plant.output_indices(case.sensors)]
    u = [case.plant.inputs[i] for i in case.plant.input_indices(case.drives)]
    rig = study().rig
    sheet = [(rig.wheel if p.name.startswith("bus") else rig.gimbal).torque_limit for p in u]
    settings = EngineSettings(
        period_s=PERIOD_S,
        sensors=tuple(
            SensorTest(port=port, range=20.0, stuck_s=0.05)
            if port.name.endswith("_rate")
            else SensorTest(port=port, range=1.5, envelope=most, stuck_s=0.05)
            for port in y
        ),
        drives=tuple(Drive(port=p, lower=-m, upper=m) for p, m in zip(u, sheet, strict=True)),
        hold=case.hold,
        heartbeat_s=0.0,
    )
    reach = SHARE * find_reach(settings, nominal_article(article, environment)).limit
    drives = [
        dataclasses.replace(d, lower=-m, upper=m)
        for d, m in zip(settings.drives, np.minimum(sheet, reach), strict=True)
    ]
    return dataclasses.replace(settings, drives=tuple(drives))


@functools.cache
def design(article: str, environment: str, log10_authority: float) -> Compensator:
    return lqg(rig_case(article, environment), nominal_article(article, environment), 10.0**log10_authority)


@functools.cache
def nominal_package(article: str = "simple", environment: str = "lab") -> ControllerPackage:
    return pack(design(article, environment, AUTHORITY))


def wait_for_hold(engine: Supervisor) -> int:
    """Run until the hold is verified, without which no law engages; the sample."""
    while not engine.file.status["hold_verified"]:
        assert engine.sample < engine.settings.samples(120.0)
        engine.run(50, keep=False)
    return engine.sample


def engaging_step(seed: int, *rig: str) -> float:
    """The most that the fade of a law, in and out, adds to a step of a command, over its limit.

    Beside the larger step of the same sample without it: of the hold alone, or with the whole law.
    """
    settings = settings_of(*rig)
    limits = np.array([drive.upper for drive in settings.drives])
    ramp = settings.samples(settings.ramp_s)
    with Supervisor(settings, dataclasses.replace(nominal_article(*rig), seed=seed)) as engine:
        engine.load(nominal_package(*rig))
        engine.reset()
        engine.run(2 * ramp, keep=False)
        wait_for_hold(engine)
        parts = [engine.run(1)]
        for word, state in (("engage", "control"), ("disengage", "ready")):
            assert engine.command(word, values=[1.0]).done
            parts.append(engine.run(ramp + 1))
            assert engine.state == state
    taken = np.concatenate(parts)
    faded, alone, whole = (
        np.abs(np.diff(u, axis=0)) for u in (taken["u"], taken["hold"], taken["hold"] + taken["wanted_0"])
    )
    return float(((faded - np.maximum(alone, whole)) / limits).max())


def end_of_normal_operation(seed: int, article: str, seconds: float) -> tuple[str, list]:
    """State and events of an engine after so long under control, disturbance and noise."""
    settings = settings_of(article)
    with Supervisor(settings, dataclasses.replace(nominal_article(article), seed=1000 + seed)) as engine:
        engine.load(nominal_package(article))
        engine.run(5000, keep=False)
        engine.reset()
        engine.run(5000, keep=False)
        wait_for_hold(engine)
        engine.command("engage", values=[1.0])
        for _ in range(round(seconds / PIECE_S)):
            engine.run(settings.samples(PIECE_S), keep=False)
        return engine.state, engine.events()


@functools.cache
def settings_of(article: str = "simple", environment: str = "lab") -> EngineSettings:
    """With the standard trips, from a record of the held article and of one under control."""
    settings, rig = bare_settings(article, environment), nominal_article(article, environment)
    settle, count = settings.samples(SETTLE_S), settings.samples(NOMINAL_S)
    with Supervisor(settings, rig) as engine:
        engine.load(nominal_package(article, environment))
        engine.run(settle, keep=False)
        engine.reset()
        records = [engine.run(count)]
        wait_for_hold(engine)
        assert engine.command("engage", values=[1.0]).done
        records.append(engine.run(count))
        assert engine.state == "control"
    whole = np.concatenate(records)
    return guard(settings, rig, whole["y"], whole["u"])


@functools.cache
def siso_case() -> RigCase:
    """Figure 9: the gimbal's torque to the payload's angle in the laboratory, wheels off, nothing held."""
    case, modes = rig_case("dm", "lab"), find_modes(*study().case("dm", "lab"))
    plant = build_plant(modes, inputs=("pri_rel_z",), outputs=("pri_in_z",), count=study().control.modes_kept)
    return dataclasses.replace(
        case,
        plant=delay_plant(partition_modes(plant).active, study().rig.delay_s - PERIOD_S / 2),
        sensors=("pri_in_z",),
        drives=("pri_rel_z",),
        measured=1,
        controlled=1,
        hold=(),
    )

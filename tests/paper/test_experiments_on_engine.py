"""The paper's three ground experiments, SISO and two sensors under one and two penalties, on the engine.

Each compensator of Figures 9, 11 and 12 becomes a package, meets every step of the gate, on the fits that it
was designed on and on the simulated rig, and runs there in an engine that loads what has passed and nothing
else. The decibels are the study's.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.lqg.design import design_lqg
from middeck.control.sampled.emulation import emulate
from middeck.errors import ConfigError, DataError
from middeck.identification.plants.measured_plant import measured_plant
from middeck.identification.spectra.estimate import estimate_response
from middeck.laboratory.article_rig import build_rig_article
from middeck.laboratory.bench import build_bench
from middeck.laboratory.rig.linear_view import linearise_rig
from middeck.laboratory.rig.runs import remove_ramps
from middeck.laboratory.rig.ticks.stepped import SteppedRig
from middeck.realtime.engine.interface.settings import Drive, EngineSettings, SensorTest
from middeck.realtime.engine.process.supervisor import Supervisor
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.engine.trials.served_rig import ServedRig
from middeck.realtime.gate.gate import examine_package
from middeck.realtime.gate.recovery_proof import why_unproved
from middeck.realtime.gate.steps_on_rig import GateRig, GateTrials
from middeck.realtime.gate.steps_without_rig import GateMargins, check_poles
from middeck.realtime.package.package_bytes import decode_package, encode_package
from middeck.realtime.package.package_law import package_law
from middeck.signals.record import Record
from middeck.study.chapters.measured_control.numbers_and_claims import GAIN_DB, PHASE_DEG
from middeck.study.chapters.zero_g_control.computation import control_plant, design_weights
from middeck.study.measured_loop.computation import decibel, measured_rms_of
from middeck.systems.plants.plant import delay_plant
from middeck.systems.plants.response import evaluate_plant
from repeats import LONG, repeats

PERIOD_S = 0.002
TORQUE_NM = 5.0  # of the gimbal's motor
LOOPS = ("robust", "payload", "both", "low", "high")  # CL3, Figures 11 and 12, CL1, CL2


@pytest.fixture(scope="module")
def loops(paper_outcomes):
    """Each loop by name, with the open loop that was measured beside it and the fits of its records."""
    nine, two = paper_outcomes["figure 9"], paper_outcomes["figures 10 to 12"]
    siso = {loop.name: (loop, nine.open_loop, (nine.fit, nine.drifted_fit)) for loop in nine.loops}
    sito = {loop.name: (loop, two.sensors.measured, (two.sensors.fit,)) for loop in (two.payload, two.both)}
    return siso | sito


@pytest.fixture(scope="module")
def bench(paper_study):
    """The rig of the study and its excitation, by a seed of its own."""
    siso, sito = paper_study.siso, paper_study.sito
    article = build_rig_article(*paper_study.case(siso.article, siso.environment), paper_study.rig)
    rng = np.random.default_rng(15)
    return build_bench(article, paper_study.rig, paper_study.loop_test, (siso.sensor, *sito.sensors), rng)


def package_of(loop):
    law = emulate(loop.compensator, PERIOD_S)
    return package_law(law, loop.name, input_range=2.0, limit=TORQUE_NM, ramp_s=0.5)


def settings(plant, **changes) -> EngineSettings:
    sensor = {"range": 2.0, "envelope": 1.0, **changes}
    return EngineSettings(
        period_s=PERIOD_S,
        sensors=tuple(SensorTest(port=port, **sensor) for port in plant.outputs),
        drives=tuple(Drive(port=port, lower=-TORQUE_NM, upper=TORQUE_NM) for port in plant.inputs),
    )


def run_under_excitation(engine, package, samples: int, settle: int, periods: int = 1) -> np.ndarray:
    """Engaged, then excited for ``settle`` unread periods and ``periods`` that are read."""
    assert engine.load(package).done
    assert engine.reset().done
    assert engine.command("engage", values=[1.0]).done
    engine.run(500, keep=False)
    assert engine.command("excite", values=[0.0]).done
    engine.run(settle * samples, keep=False)
    read = [engine.run(samples)["y"] for _ in range(periods)]
    assert engine.state == "control", engine.events()
    return np.stack(read)


MARGINS = dict.fromkeys(("robust", "low"), (GAIN_DB, PHASE_DEG))
MARGINS |= {"payload": (3.0, 15.0), "both": (3.0, 15.0), "high": (0.0, 0.0)}
"""Gain and phase margins [dB, deg] that are asked for. CL1 and CL3 keep what the study asks of CL3, on both
records; the two-sensor loops of Figures 11 and 12 keep 4.2 and 3.8 dB."""


@pytest.fixture(scope="module")
def judge(paper_study, loops, bench):
    """The verdict on a loop by name, and margins; each is found once."""
    siso, verdicts = paper_study.siso, {}

    def judged(name, margins=None):
        margins = margins or MARGINS[name]
        if (name, margins) in verdicts:
            return verdicts[name, margins]
        loop, _, fits = loops[name]
        u, y = (siso.actuator,), tuple(port.name for port in loop.compensator.inputs)
        models = {}
        for which, fit in zip(("first record", "second record"), fits, strict=False):
            # The fitted delay has half a period of hold in it, which sampling adds once more.
            plant = measured_plant(fit.model, w=u, u=u, z=y, y=y)
            models[which] = delay_plant(plant, -0.5 * PERIOD_S)
        verdicts[name, margins] = examine_package(
            package_of(loop),
            models,
            GateMargins(gain_db=margins[0], phase_deg=margins[1]),
            trials=GateTrials(disturbance=0.1, noise=1e-5),
            rig=GateRig(stepped(bench), settings(bench.rig)),
        )
        return verdicts[name, margins]

    return judged


def stepped(bench) -> SteppedRig:
    return SteppedRig(bench.rig, np.random.default_rng(9), rest_s=bench.rest_s)


# CL2 is unstable on the second record, taken when the pair near 9 Hz had moved: what the paper met later.
@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize(
    ("name", "margins", "word"),
    repeats(
        [
            ("high", None, "grows"),
            ("payload", (6.0, 30.0), "margins of"),
            ("both", (6.0, 30.0), "margins of"),
        ],
        2,
    ),
)
def test_what_the_gate_refuses_is_not_loaded(loops, judge, bench, name, margins, word):
    """By an engine that admits what has passed."""
    package = package_of(loops[name][0])
    verdict, good = judge(name, margins), judge("robust")
    refused = [(step.name, step.said) for step in verdict.steps if not step.passed]
    assert [which for which, _ in refused] == [
        "model second record" if name == "high" else "model first record"
    ]
    assert word in refused[0][1]
    passed = {one.sha256: one.hold for one in (verdict, good) if one.passed}
    plant = linearise_rig(bench.rig)
    with Supervisor(settings(plant), article_of(plant), admitted=passed) as engine:
        assert engine.load(package).word == "not admitted"
        assert engine.load(package_of(loops["robust"][0])).done
        assert [event.kind for event in engine.events()] == ["loaded"]


SHEET = np.array([1.5] * 7 + [20.0] * 7), np.array([0.5] * 3 + [5.0] * 2)
"""Ranges of seven angles [rad] and rates [rad/s]; torques of wheels and gimbals [N m]."""


@pytest.fixture(scope="module")
def sheet(paper_study, paper_outcomes):
    """Figure 7: weights, the article in orbit and in the laboratory under PD, decibels by authority."""
    control, found = paper_study.control, paper_outcomes["figure 7"]
    modes, sweep = paper_outcomes["figures 4 and 5"], dict(found.sweeps)["all"].sweep
    pd = PDLoops(control.pd_loops, np.array(control.pd_kp_nm_per_rad), np.array(control.pd_kd_nms_per_rad))
    plants = {
        name: close_inner_loop(control_plant(of, paper_study), pd)
        for name, of in (("orbit", modes.orbit), ("lab", modes.lab))
    }
    decibels = dict(zip(found.log10_authority.round(2), -sweep.db[0], strict=True))
    return design_weights(paper_study, found.disturbance_psd), plants, decibels


def own_poles(weights, plant, authority):
    """Of the LQG law by Riccati equations of another program, each mapped by Tustin's rule."""
    P, q = plant.system, weights
    at = {side: list(find(names)) for side, find, names in (
        ("w", plant.input_indices, q.disturbed), ("u", plant.input_indices, plant.u),
        ("z", plant.output_indices, plant.z), ("y", plant.output_indices, plant.y))}  # fmt: skip
    B, C, z = P.B[:, at["u"]], P.C[at["y"]], P.C[at["z"]] * q.output[:, None]
    R, V = np.diag(q.input) / authority, np.diag(q.sensor)
    K = np.linalg.solve(R, B.T @ sla.solve_continuous_are(P.A, B, z.T @ z, R))
    S = sla.solve_continuous_are(P.A.T, C.T, P.B[:, at["w"]] @ q.process @ P.B[:, at["w"]].T, V)
    s = np.linalg.eigvals(P.A - B @ K - S @ C.T @ np.linalg.solve(V, C))
    return (1.0 + 0.5 * PERIOD_S * s) / (1.0 - 0.5 * PERIOD_S * s)


def sheet_law(sheet, log10_authority, **told):
    weights, plants, _ = sheet
    law = emulate(design_lqg(plants["orbit"], weights, 10.0**log10_authority), PERIOD_S)
    return package_law(law, "sheet", input_range=SHEET[0], limit=SHEET[1], ramp_s=0.5, **told)


@pytest.mark.parametrize("log10_authority", repeats([2.5, 3.5, 4.5]))
def test_a_law_of_figure_7_beyond_23_db_is_refused_undeclared_and_judged_when_it_is_declared(
    sheet, log10_authority
):
    weights, plants, decibels = sheet
    assert decibels[log10_authority] > 23.0
    largest = np.abs(own_poles(weights, plants["orbit"], 10.0**log10_authority)).max()
    assert largest > 1.0003
    with pytest.raises(ConfigError, match="unstable by itself"):
        sheet_law(sheet, log10_authority)
    declared = sheet_law(sheet, log10_authority, unstable=True)
    assert declared.core.radius == pytest.approx(largest, abs=1e-7)
    undeclared = copy.copy(declared)
    object.__setattr__(undeclared, "unstable", False)  # as a file that says so, which no reader takes
    with pytest.raises(DataError, match="undeclared pole"):
        decode_package(encode_package(undeclared))
    refused = check_poles(undeclared)
    assert not refused.passed
    assert "not declared" in refused.said
    # It is judged on the models: in the laboratory it grows, as the paper feared of what is designed in 0-g.
    (refused,) = [s for s in examine_package(declared, {"lab": plants["lab"]}, ANY).steps if not s.passed]
    assert refused.name == "model lab"
    assert "grows" in refused.said


ANY = GateMargins(gain_db=0.0, phase_deg=0.0)


@pytest.mark.parametrize(
    ("log10_authority", "proved"),
    repeats([(2.5, True), (2.0, True), (3.0, True), (3.5, False), (4.5, False)]),
)
def test_a_law_of_figure_7_beyond_23_db_passes_in_orbit_with_a_proof_of_recovery(
    sheet, log10_authority, proved
):
    """And not without: five motors, 92 states. `make test-all` takes every step; some last seconds.

    The one next below is stable by itself: it passes without the proof, which there is of it too.
    """
    _, plants, decibels = sheet
    package = sheet_law(sheet, log10_authority, unstable=True)
    assert package.unstable == (decibels[log10_authority] > 23.0)
    assert (why_unproved(package, plants["orbit"], required=True) == "") == proved
    if LONG:
        verdict = examine_package(package, {"orbit": plants["orbit"]}, ANY)
        assert verdict.passed == (proved or not package.unstable)
        assert verdict.steps[-1].name == "recovery orbit"
        word = "not proved to recover: no multipliers" if package.unstable else "; not proved for limits"
        if proved and package.unstable:
            word = "; proved for limits that come and go"
        assert word in verdict.steps[-1].said


def article_of(plant):
    drives, reads = ([port.name for port in side] for side in (plant.inputs, plant.outputs))
    return linear_article(plant, PERIOD_S, drives, reads)


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("name", repeats(LOOPS, 2))
def test_the_engine_on_the_linear_rig_has_the_decibels_of_its_return_ratio(paper_study, loops, bench, name):
    """The article stepped in C, 320 s of it in about a second, against return ratio line by line."""
    loop, _, _ = loops[name]
    plant = linearise_rig(bench.rig)
    wave, wide = bench.closed_loop, settings(plant, range=100.0, envelope=50.0)
    # CL2 too, which no gate passes.
    with Supervisor(wide, article_of(plant), waveform=wave, admitted="ungated") as engine:
        y = run_under_excitation(engine, package_of(loop), len(wave), 3)
    f = np.fft.rfftfreq(len(wave), PERIOD_S)
    lines = (f > bench.band_hz[0] - 1e-9) & (f < bench.band_hz[1] + 1e-9)
    closed = np.fft.rfft(y[0, :, 0])[lines] / np.fft.rfft(wave[:, 0])[lines]
    opened = evaluate_plant(plant, f[lines]).H[:, 0, 0]
    found = 20.0 * np.log10(np.linalg.norm(closed) / np.linalg.norm(opened))
    # What is left of the start after three periods is below 1e-6.
    assert abs(found - loop.on_rig[0].improvement_db) < 1e-5


# The gimbal's angle walks by its friction; the payload's is judged.
@pytest.mark.filterwarnings("ignore:pri_rel_z drifts")
@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("name", repeats(LOOPS))
def test_each_experiment_goes_through_gate_and_engine_to_the_decibels_of_the_study(
    paper_study, loops, bench, judge, name
):
    """One chain, on the rig in a process of its own, with friction, steps, noise and drift of its gyros.

    CL2 ends at the gate; what it does on the rig is shown on a bench.
    """
    loop, open_loop, fits = loops[name]
    verdict = judge(name)
    assert verdict.passed == (name != "high"), [s.said for s in verdict.steps if not s.passed]
    if verdict.passed:
        each = [f"{kind} {which}" for kind in ("model", "recovery", "dry run") for which in verdict.models]
        once = ["blacklist", "interface", "poles", "vectors", "error bound"]
        assert [step.name for step in verdict.steps] == [*once, *each, "shadow run", "engagement"]
        assert not verdict.left_out
        assert len(verdict.models) == len(fits)
    admitted = {verdict.sha256: verdict.hold} if verdict.passed else "ungated"
    wave, rig, (settle, periods) = bench.closed_loop, bench.rig, (2, 3) if LONG else (1, 1)
    with (
        ServedRig(stepped(bench)) as served,
        Supervisor(settings(rig), served, waveform=wave, admitted=admitted) as engine,
    ):
        y = run_under_excitation(engine, package_of(loop), len(wave), settle, periods)
    record = Record(
        sample_hz=rig.sample_hz, u=np.broadcast_to(wave, (1, periods, *wave.shape)),
        y=remove_ramps(y, rig.readout.gyro)[None],
        inputs=rig.inputs, outputs=rig.outputs, periodic=True, held=True,
    )  # fmt: skip
    closed = estimate_response(record, band_hz=bench.band_hz)
    torque = paper_study.siso.excitation_nm
    found = decibel(measured_rms_of(closed, torque), measured_rms_of(open_loop, torque))
    # As long as the study's run: other noise and phases. Shorter, the noise is averaged less: simulated so,
    # the loop of Figure 12 has 0.10 dB more as well.
    assert abs(found - loop.measured_db) < (0.05 if LONG else 0.15)

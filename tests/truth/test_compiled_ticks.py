"""Ticks in C are the ticks in Python, bit for bit: joints beside joints, limits, steps, delays, drift."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from middeck.joints.attachment import JointElements
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.rig.parts.motors import Motor, Rotor
from middeck.laboratory.rig.parts.sensors import Encoder, Gyro, Sampler
from middeck.laboratory.rig.plant.drifting_modes import Drift
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.ticks import compiled, simulate_rig
from middeck.laboratory.rig.ticks.compiled import TickRows, compile_ticks, run_compiled
from middeck.laboratory.rig.ticks.simulate_rig import switch_on
from middeck.laboratory.rig.ticks.stepped import SteppedRig
from middeck.laboratory.rig.ticks.tick import column_sums
from middeck.realtime.generate import compiler
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace
from packaged_laws import STRICT
from rig_checks import on_rig, run_through

SAMPLES = 3000
FRICTION = (Friction(0.02, 20.0, 0.01), Friction(0.05, 8.0))
LAW = SampledStateSpace(
    [[0.8, 0.1], [0.0, 0.7]], [[0.2, 0.1, 0.0], [0.0, 0.3, 1e-3]], [[-2.0, 0.5], [0.1, -1.0]],
    [[-0.5, 0.0, 1e-3], [0.0, -0.8, 0.0]], period_s=0.002,
)  # fmt: skip


def two_joints() -> Plant:
    """Three modes, torques and angles at two joints, and an accelerometer that feels both."""
    omega = 2.0 * np.pi * np.array([1.5, 9.0, 31.0])
    beside = np.array([[1.0, 0.3], [0.6, -0.8], [0.2, 0.4]])
    modes = ModalSystem(
        omega=omega, zeta=np.array([0.02, 0.01, 0.01]), psi=beside, phi=np.vstack([beside.T, 0.0 * omega]),
        phi_rate=np.zeros((3, 3)), phi_acceleration=np.vstack([np.zeros((2, 3)), [0.5, 0.4, -0.7]]),
        names=("slow", "middle", "fast"),
    )  # fmt: skip
    torques = tuple(Port(name, "N m") for name in ("a", "b"))
    return Plant(
        dynamics=modes, inputs=torques, outputs=(*(Port(n, "rad") for n in "AB"), Port("acc", "m/s^2"))
    )


def write(target, data):
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)


def rig_with(**changes):
    given = {
        "motors": {"a": Motor(torque_limit=0.6, slew_limit=150.0, resolution=1e-3),
                   "b": Motor(torque_limit=0.9, holding=0.2, rotor=Rotor(0.001, 60.0))},
        "sensors": {"A": Gyro(bandwidth_hz=100.0, noise=1e-4, bias=1e-3, bias_walk=1e-5, range=0.02,
                              resolution=1e-5, anti_alias_hz=200.0),
                    "B": Encoder(1e-6), "acc": Sampler(1e-3)},
        "joints": [JointElements("a", "A", FRICTION[:1]), JointElements("b", "B", FRICTION[1:])],
        "sample_hz": 500.0, "delay_s": 0.0083,
    }  # fmt: skip
    return build_rig(two_joints(), **{**given, **changes})


RIGS = {
    "all": rig_with,
    "substeps": lambda: rig_with(substeps=3),
    "drifting": lambda: rig_with(drifts=(Drift(("middle",), 2.0, 5.0),)),
    "one joint": lambda: rig_with(joints=[JointElements("a", "A", (FRICTION[0],))]),
    "no joints": lambda: rig_with(joints=()),
    "a tick of delay": lambda: rig_with(delay_s=0.0068),
}


def ran(rig, law):
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-1.0, 1.0, (SAMPLES // 5, 2)), 5, axis=0)
    start = switch_on(rig, on_rig(rig, law), 0.2, rng)
    return run_through(rig, law, u, rng, start=start)


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("law", [None, LAW], ids=["open", "closed"])
@pytest.mark.parametrize("name", RIGS)
def test_every_number_of_a_run_is_that_of_the_ticks_in_python(name, law, monkeypatch):
    rig, used = RIGS[name](), []

    def seen(*asked):
        used.append(run_compiled(*asked))
        return used[-1]

    monkeypatch.setattr(simulate_rig, "run_compiled", seen)
    in_c = ran(rig, law)
    assert used
    assert all(done is not None for done in used)
    monkeypatch.setattr(simulate_rig, "run_compiled", lambda *asked: None)
    python = ran(rig, law)
    if name == "all":  # its limits are met
        assert np.abs(python["torque"][:, 0]).max() == 0.6
        assert np.abs(python["readings"][:, 0]).max() == pytest.approx(0.02)
    states = [vars(run.pop("state")) for run in (in_c, python)]
    for one, other in ((in_c, python), states):
        for key, value in other.items():
            assert np.asarray(one[key]).tobytes() == np.asarray(value).tobytes(), key


@pytest.mark.parametrize(("rows", "columns"), [(1, 40), (2, 40), (7, 9), (67, 130)])
def test_products_sum_column_by_column(rows, columns):
    rng = np.random.default_rng(rows)
    matrix = rng.standard_normal((rows, columns)) * 10.0 ** rng.integers(-8, 8, (rows, columns))
    vector, start, out = rng.standard_normal(columns), rng.standard_normal(rows), np.empty(rows)
    column_sums(matrix)(start, vector, out)
    for row, first, found in zip(matrix.tolist(), start.tolist(), out.tolist(), strict=True):
        total = first
        for a, b in zip(row, vector.tolist(), strict=True):
            total += a * b
        assert found == total


def stepped(rig):
    """Commands that the readings move, as an engine's do."""
    made, rng = SteppedRig(rig, np.random.default_rng(3), rest_s=0.2), np.random.default_rng(4)
    found = []
    for push in rng.uniform(-0.5, 0.5, (SAMPLES, 2)):
        y = made.read()
        made.write(push - 2.0 * y[:2])
        found.append(y)
    return np.array(found)


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("name", RIGS)
def test_a_rig_that_an_engine_drives_reads_the_same_bits(name, monkeypatch):
    used = []

    def seen(*asked):
        used.append(compile_ticks(*asked))
        return used[-1]

    rig = RIGS[name]()
    monkeypatch.setattr("middeck.laboratory.rig.ticks.stepped.compile_ticks", seen)
    in_c = stepped(rig)
    assert len(used) > 1
    assert all(ticks is not None for ticks in used)
    monkeypatch.setattr("middeck.laboratory.rig.ticks.stepped.compile_ticks", lambda *asked: None)
    assert stepped(rig).tobytes() == in_c.tobytes()
    assert np.ptp(in_c[:, 0]) > 0.0


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("fault", ["other machine", "no home", "does not compile"])
def test_code_that_cannot_be_had_is_said_once(fault, tmp_path, monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if fault == "no home":
        monkeypatch.setattr(compiler, "cache_folder", homeless)
    if fault == "does not compile":
        monkeypatch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-Drun_ticks=!"))
    else:
        monkeypatch.setattr(compiler, "_compile", lambda _, sources, flags, target: write(target, b"\x7fELF"))
    compiled._library.cache_clear()
    with pytest.warns(UserWarning, match=r"ticks of rigs run in Python, about ten times slower"):
        assert compiled._library() is None
    assert compiled._library() is None
    compiled._library.cache_clear()


def test_without_a_compiler_nothing_is_said(monkeypatch):
    monkeypatch.setattr(compiler.shutil, "which", lambda *_: None)
    compiled._library.cache_clear()
    assert compiled._library() is None
    compiled._library.cache_clear()


def test_a_joint_with_a_gap_is_left_to_python():
    rig = rig_with(joints=[JointElements("a", "A", (Deadband(1e-3, 20.0),))])
    names = ("compute", "shift", "excitation", "offset", "noise", "digital", "rows", "issued")
    ticks = TickRows(kept=0, **dict.fromkeys(names, np.zeros((0, 0))))
    assert run_compiled(rig, rig.plant, ticks, switch_on(rig, None, 0.0, np.random.default_rng(1))) is None


def test_two_compilers_have_nothing_to_say(compiler, clang, tmp_path):
    source = Path(compiled.__file__).parent / "source" / "ticks.c"
    for one in (compiler, clang):
        subprocess.run([one, *STRICT, "-O3", "-c", source, "-o", tmp_path / "ticks.o"], check=True)

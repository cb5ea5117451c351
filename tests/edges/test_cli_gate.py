"""``middeck gate`` with a computer: dry runs, a rig, and the blacklist that outlasts the verdict."""

from __future__ import annotations

import dataclasses
import json
import resource
import shutil
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cli_runner import margins_once, middeck
from fuzzed_packages import sealed
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError, DataError
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.laws.blacklists import load_blacklist, write_blacklist
from middeck.files.laws.gate_logs import GateLog, load_gate_log
from middeck.files.laws.packages import load_package, write_package
from middeck.files.laws.verdicts import load_verdicts
from middeck.files.measured.models import write_model
from middeck.identification.model.plant_model import model_of_plant
from middeck.realtime.engine.rigs.linear_article import linear_article
from middeck.realtime.engine.rigs.stepped_article import SteppedArticle
from middeck.realtime.engine.trials.served_rig import ServedRig
from middeck.realtime.gate.steps_without_rig import GateStep
from middeck.realtime.package.package_bytes import encode_package, hash_package
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace
from repeats import repeats

PERIOD_S = 0.008
"""Runs of tens of seconds take few samples of it; the swing is one of 1 Hz."""
WAY, PUSH = Port("way", "m"), Port("push", "N")


def swing(sign: float = 1.0) -> Plant:
    w = 2.0 * np.pi
    system = StateSpace([[0.0, w], [-w, -0.02 * w]], [[0.0], [sign]], [[1.0, 0.0]], [[0.0]])
    return Plant(dynamics=system, inputs=(PUSH,), outputs=(WAY,))


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A package and a model of the swing, whose margins are measured once."""
    monkeypatch.setattr("middeck.realtime.gate.steps_without_rig.measure_margins", margins_once)
    monkeypatch.chdir(tmp_path)
    lag = SampledStateSpace([[0.66]], [[1.0]], [[17.0]], [[-50.0]], period_s=PERIOD_S)
    law = Compensator(lag, (WAY,), (PUSH,))
    write_package("law.mdk", package_law(law, "law", input_range=0.1, limit=1.0, ramp_s=0.3))
    write_model("model.json", model_of_plant(swing()))
    return "law.mdk", "model.json", "--gain-db", "3", "--phase-deg", "10"


def served(sign: float) -> ServedRig:
    noise = {"disturbed": ["push"], "disturbance_rms": 0.05, "sensor_noise": 1e-6}
    return ServedRig(SteppedArticle(linear_article(swing(sign), PERIOD_S, ["push"], ["way"], **noise)))


@pytest.mark.usefixtures("compiler")
def test_a_package_that_trips_on_the_rig_is_refused_for_good(files, capfd):
    """Stable on the model; the rig's motor pushes the other way. The next gate reads why, from the file."""
    with served(-1.0) as rig:
        asked = (*files, "--rig-port", rig.port, "--blacklist", "black.json", "-o", "verdict.json")
        first = middeck(capfd, "gate", *asked)
        assert first.code == 1
        document = json.loads(Path("verdict.json").read_text())
        assert [s["name"] for s in document["steps"] if not s["passed"]] == ["engagement"]
        assert document["tripped"].startswith("envelope way")
        assert load_blacklist("black.json") == {document["law"]: document["tripped"]}
        (logged,) = load_gate_log("verdict.jsonl")
        assert (logged.passed, logged.tripped) == (False, document["tripped"])
    again = middeck(capfd, "gate", *files, "--blacklist", "black.json", "--json")
    assert again.code == 1
    (step,) = json.loads(again.out)["steps"]
    assert "it has tripped" in step["said"]


def test_without_a_compiler_the_gate_runs_by_the_reference_law(files, capfd, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda *_: None)
    ended = middeck(capfd, "gate", *files, "--json")
    document = json.loads(ended.out)
    assert ended.code == 0, document
    assert document["steps"][-1]["said"].endswith("(reference law in Python)")
    assert document["left_out"] == ["shadow run", "engagement"]
    Path("driver.c").write_text("int nothing;\n")
    refused = middeck(capfd, "gate", *files, "--driver", "driver.c")
    assert refused.code == 3
    assert "no C compiler" in refused.err


@pytest.mark.parametrize(("late_s", "hold_s", "tried"), [
    (0.012, None, ["model", "model, if held"]), (0.002, None, ["model"]), (0.012, PERIOD_S, ["model"]),
])  # fmt: skip
def test_a_model_that_does_not_say_whether_it_was_held_is_tried_both_ways(
    files, capfd, late_s, hold_s, tried
):
    """The hold of the loop may be among its delays already; one of less than half a period has none."""
    model = model_of_plant(delay_plant(swing(), late_s))
    write_model("model.json", dataclasses.replace(model, hold_s=hold_s))
    ended = middeck(capfd, "gate", *files[:2], "--paper", "--json", "--delay-ms", "1")
    assert json.loads(ended.out)["models"] == tried


def test_what_does_not_go_together_is_refused(files, capfd):
    for options in (("--paper", "--rig-port", "9"), ("--rig-port", "9", "--driver", "law.mdk")):
        ended = middeck(capfd, "gate", *files, *options)
        assert ended.code == 2
    on_paper = middeck(capfd, "gate", *files, "--paper", "--json")
    assert json.loads(on_paper.out)["left_out"] == ["dry run", "shadow run", "engagement"]


def test_a_blacklist_that_was_changed_is_refused(tmp_path):
    path = tmp_path / "black.json"
    assert load_blacklist(path) == {}
    reasons = {"ab" * 32: "envelope way at 1 s", "01" * 32: "effort push"}
    write_blacklist(path, reasons)
    assert load_blacklist(path) == reasons
    path.write_text(path.read_text().replace("effort", "no"))
    with pytest.raises(DataError, match="not what was sealed"):
        load_blacklist(path)
    write_blacklist(path, {"xyz": "no hash"})
    with pytest.raises(DataError, match="no table of reasons"):
        load_blacklist(path)
    path.write_text("{}")
    with pytest.raises(DataError):
        load_blacklist(path)


ADDING = """
import sys
from middeck.files.laws.blacklists import add_to_blacklist
path, who = sys.argv[1:]
print("ready", flush=True)
sys.stdin.readline()
for k in range(25):
    add_to_blacklist(path, {f"{who}{k:063d}": "effort push"})
"""


def test_processes_that_add_to_one_blacklist_lose_no_entry(tmp_path):
    path = tmp_path / "new" / "black.json"
    started = [
        subprocess.Popen(
            [sys.executable, "-c", ADDING, str(path), who], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        for who in "abc"
    ]
    for process in started:
        assert process.stdout.readline() == b"ready\n"
    for process in started:
        process.stdin.write(b"go\n")
        process.stdin.flush()
    for process in started:
        process.communicate()
        assert process.returncode == 0
    assert set(load_blacklist(path)) == {f"{who}{k:063d}" for who in "abc" for k in range(25)}


def test_the_package_that_is_relieved_and_the_hold_have_ports_of_their_own(files, capfd):
    """A damper of the rate, and one that grows: as the old one is whole the loop is that of it alone."""
    rate = dataclasses.replace(WAY, name="rate", unit="m/s")
    seen = StateSpace(swing().dynamics.A, [[0.0], [1.0]], np.eye(2), np.zeros((2, 1)))
    write_model("two.json", model_of_plant(Plant(dynamics=seen, inputs=(PUSH,), outputs=(WAY, rate))))
    none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    for name, gain in (("sound", -0.1), ("grows", 0.5)):
        law = Compensator(SampledStateSpace(*none, [[gain]], period_s=PERIOD_S), (rate,), (PUSH,))
        package = package_law(law, name, input_range=1.0, limit=1.0)
        write_package("old.mdk", package)
        asked = (files[0], "two.json", *files[2:], "--engaged", "old.mdk", "--hold", "rate", "push", "-0.05")
        ended = middeck(capfd, "gate", *asked, "--paper", "--json")
        document = json.loads(ended.out)
        assert document["engaged"] == hash_package(package)
        last = document["steps"][-1]
        assert last["name"].startswith(f"cross-fade from {name} on ")
        assert last["passed"] == (ended.code == 0) == (name == "sound"), last["said"]
    assert last["said"].startswith("grows at 1, law at 0: a root at ")
    assert "grows (0.162" in last["said"]  # 0.225 - 0.02 pi


@pytest.mark.usefixtures("compiler")
def test_a_hold_is_closed_beside_the_package(files, capfd):
    """One that turns the spring over is refused where nothing else acts; one of no port is told."""
    held = middeck(capfd, "gate", *files, "--hold", "way", "push", "-0.05", "-o", "verdict.json")
    assert held.code == 0, held.out
    plain = middeck(capfd, "gate", *files, "--paper", "--json")
    assert json.loads(Path("verdict.json").read_text())["hold"] != json.loads(plain.out)["hold"]
    outward = middeck(capfd, "gate", *files, "--paper", "--json", "--hold", "way", "push", "40")
    (step,) = [step for step in json.loads(outward.out)["steps"] if not step["passed"]]
    assert step["said"].startswith("at a fade of 0: a root at 0 Hz grows")  # its spring is turned over
    wrong = middeck(capfd, "gate", *files, "--hold", "nose", "push", "1")
    assert wrong.code == 2
    assert "no sensor 'nose'" in wrong.err


@pytest.mark.usefixtures("compiler")
def test_only_a_verdict_that_holds_every_step_admits(files, capfd):
    """On paper, without a rig, refused, changed, beside two holds: each is said, none admits in silence."""
    law, model, *_ = files
    paper, dry, whole = (f"{name}.json" for name in ("paper", "dry", "whole"))
    assert middeck(capfd, "gate", *files, "--paper", "-o", paper).code == 0
    assert middeck(capfd, "gate", *files, "-o", dry).code == 0
    with served(1.0) as rig:
        assert middeck(capfd, "gate", *files, "--rig-port", rig.port, "-o", whole).code == 0
    document = json.loads(Path(whole).read_text())
    admitted = {document["package"]: document["hold"]}
    assert load_verdicts([whole]) == load_verdicts([]) | admitted
    rigless = ("shadow run", "engagement")
    assert (
        load_verdicts([dry], without=rigless)
        == load_verdicts([paper], without=("dry run", *rigless))
        == admitted
    )
    for path, without, said in (
        (paper, (), "without dry run, engagement, shadow run"),
        (paper, rigless, "without dry run"),
        (dry, (), "without engagement, shadow run"),
        (dry, ("dry run",), "without engagement, shadow run"),
    ):
        with pytest.raises(DataError, match=said):
            load_verdicts([whole, path], without=without)
    assert middeck(capfd, "gate", law, model, "--gain-db", "80", "--paper", "-o", paper).code == 1
    with pytest.raises(DataError, match="law did not pass"):
        load_verdicts([paper], without=("dry run", *rigless))
    assert middeck(capfd, "gate", *files, "--hold", "way", "push", "-0.01", "--paper", "-o", paper).code == 0
    with pytest.raises(DataError, match="beside another hold"):
        load_verdicts([whole, paper], without=("dry run", *rigless))
    Path(dry).write_text(Path(dry).read_text().replace('"shadow run", ', "").replace('"shadow run",', ""))
    for broken in (dry, law, "nowhere.json"):
        with pytest.raises(DataError):
            load_verdicts([broken], without=rigless)
    for kind in ("recovery", "model", "dry run", "vectors", "engagement"):  # as an older gate would leave out
        steps = [step for step in document["steps"] if not step["name"].startswith(kind)]
        body = {key: value for key, value in document.items() if key != SEAL} | {"steps": steps}
        Path(paper).write_text(json.dumps(seal(body)))
        with pytest.raises(DataError, match=f"was tried without {kind}"):
            load_verdicts([paper])


@pytest.mark.parametrize("step", ["blacklist", "interface", "poles", "vectors", "error bound"])
def test_some_steps_cannot_be_left_out(step):
    """A package that was not tried on a rig may be taken, not one of another rate or with other numbers."""
    with pytest.raises(ConfigError, match=f"a verdict without {step}"):
        load_verdicts([], without=("dry run", step))


KILLED_AFTER = """
import os, signal, sys
from middeck.cli.main import run
from middeck.files.laws.gate_logs import GateLog
left, logged = int(sys.argv.pop(1)), GateLog.__call__
def kill_after(log, step):
    global left
    logged(log, step)
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
GateLog.__call__ = kill_after
run()
"""


def test_a_gate_that_is_killed_leaves_the_steps_that_ended(files, capfd):
    """A real kill as a step ends: the log has what a whole run has so far, and no verdict."""
    asked = [*files, "-o", "verdict.json"]
    assert middeck(capfd, "gate", *asked).code == 0
    (whole,) = load_gate_log("verdict.jsonl")
    document = json.loads(Path("verdict.json").read_text())
    assert (whole.package, whole.law, whole.passed) == (document["package"], document["law"], True)
    assert whole.tripped == ""
    assert list(whole.models) == document["models"]
    assert [dataclasses.asdict(step) for step in whole.steps] == document["steps"]
    for last in repeats(range(len(whole.steps) - 1, 0, -1), 1):
        dies = [sys.executable, "-c", KILLED_AFTER, str(last), "gate", *files, "-o", "none.json"]
        assert subprocess.run(dies, capture_output=True, timeout=60).returncode == -signal.SIGKILL
        assert not Path("none.json").exists()
        cut = load_gate_log("none.jsonl")[-1]
        assert (cut.package, cut.passed, cut.steps) == (whole.package, None, whole.steps[:last])


def test_a_log_of_the_gate_goes_on_after_a_torn_line_and_tells_of_a_changed_one(files, capfd):
    def gate():
        return middeck(capfd, "gate", *files, "--paper", "--log", "gate.jsonl")

    assert gate().code == 0
    log = Path("gate.jsonl")
    whole = log.read_bytes()
    log.write_bytes(whole[:-40])
    (cut,) = load_gate_log(log)
    assert cut.passed is None
    assert gate().code == 0
    assert [one.passed for one in load_gate_log(log)] == [None, True]
    assert len({one.steps for one in load_gate_log(log)}) == 1
    lines = whole.splitlines(keepends=True)
    for spoilt in (
        whole.replace(b"not on it", b"not on  it"),
        b"".join(lines[1:]),
        b"".join(lines[:2] + lines[3:]),
        lines[0] + lines[1][:-9] + b"\n" + lines[2],
        whole + lines[0],
    ):
        log.write_bytes(spoilt)
        with pytest.raises(DataError, match="not a line as the gate wrote it"):
            load_gate_log(log)
    log.write_text("notes of mine\n")
    refused = gate()
    assert refused.code == 4
    assert "is no log of the gate" in refused.err
    assert log.read_text() == "notes of mine\n"


def broken_packages() -> dict[str, tuple[bytes, str]]:
    """A builder each, and what the user must read in one way or another."""
    whole = load_package("law.mdk")
    data = encode_package(whole)

    def patched(at: int, form: str, value: float) -> bytes:
        body = bytearray(data[:-32])
        struct.pack_into(form, body, at, value)
        return sealed(bytes(body))

    first = next(k for k in range(64, len(data), 8) if struct.unpack_from("<d", data, k)[0] == 0.1)
    outward = dataclasses.replace(whole.core, A=np.array([[1.01]]))
    flags = struct.unpack_from("<I", data, 12)[0]
    declared = encode_package(
        add_test_vectors(dataclasses.replace(whole, core=outward, unstable=True, vectors=None))
    )
    port = dataclasses.replace(WAY, name="weg")
    unit = dataclasses.replace(WAY, unit="mm")
    other = add_test_vectors(
        dataclasses.replace(whole, core=dataclasses.replace(whole.core, D=[[-40.0]]), vectors=None)
    )
    return {
        "wrong size": (patched(16, "<I", 40), "wrong size"),
        "another rate": (
            encode_package(dataclasses.replace(whole, period_s=0.004)),
            "125 Hz: the engine's 250 Hz",
        ),
        "another name": (encode_package(dataclasses.replace(whole, inputs=(port,))), "reads weg"),
        "another unit": (encode_package(dataclasses.replace(whole, inputs=(unit,))), "mm"),
        "truncated": (data[:-9], "cut short"),
        "replayed vectors": (
            encode_package(dataclasses.replace(whole, vectors=other.vectors)),
            "differs from the law",
        ),
        "corrupted": (data[:-200] + bytes([data[-200] ^ 1]) + data[-199:], "was changed"),
        "a NaN coefficient": (patched(first + 8 * 4, "<d", np.nan), "not finite"),
        "an undeclared pole": (
            sealed(declared[:12] + struct.pack("<I", flags & ~4) + declared[16:-32]),
            "undeclared",
        ),
        "wrong endianness": (patched(8, ">I", 1), "big-endian"),
        "empty": (b"", "empty"),
    }


def test_each_way_to_break_a_package_reaches_the_user_by_a_reason_of_its_own(files, capfd):
    """By `generate`, which reads them, and by the gate: the words of no other stand there.

    Models in files are continuous: a rate is wrong beside that of the package that runs now.
    """
    builders = broken_packages()
    Path("now.mdk").write_bytes(Path("law.mdk").read_bytes())
    for name, (data, words) in builders.items():
        Path("law.mdk").write_bytes(data)
        gated = middeck(capfd, "gate", *files, "--paper", "--engaged", "now.mdk", "--json")
        said = gated.err + (
            " ".join(step["said"] for step in json.loads(gated.out)["steps"] if not step["passed"])
            if gated.out
            else ""
        )
        assert gated.code in (1, 2, 4)
        assert [one for one, (_, told) in builders.items() if told in said] == [name], (name, said)
        Path("other.mdk").unlink(missing_ok=True)
        generated = middeck(capfd, "generate", "law.mdk", "-o", "other.mdk")
        fits_others = name in ("another rate", "another name", "another unit")
        assert generated.code == (0 if fits_others else 4), (name, generated)
        assert fits_others == Path("other.mdk").exists() == (words not in generated.err)


def test_a_gate_that_dies_within_a_line_spoils_no_line_of_another_on_its_log(files):
    """Two at once; also where the one that died had just begun the file."""
    package, steps = load_package(files[0]), [GateStep(name=name, passed=True, said="") for name in "abc"]
    with GateLog("two.jsonl", package, ["swing"]) as dying, GateLog("two.jsonl", package, ["swing"]) as log:
        dying(steps[0])
        log(steps[0])
        with open("two.jsonl", "ab") as file:
            file.write(Path("two.jsonl").read_bytes()[:100])
        log(steps[1])
        log(steps[2])
    assert [one.steps for one in load_gate_log("two.jsonl")] == [tuple(steps[:1]), tuple(steps)]
    for length in (1, 20, 100):
        Path("one.jsonl").write_bytes(Path("two.jsonl").read_bytes()[:length])
        with GateLog("one.jsonl", package, ["swing"]) as log:
            log(steps[0])
        assert [one.steps for one in load_gate_log("one.jsonl")] == [tuple(steps[:1])]


def test_a_log_that_takes_half_a_line_stops_the_gate(files):
    """As a full disk does; what was whole stays, and the next gate goes on behind it."""
    package, step = load_package(files[0]), GateStep(name="a", passed=True, said="")
    before, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with GateLog("full.jsonl", package, ["swing"]) as log:
        log(step)
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (Path("full.jsonl").stat().st_size + 50, before[1]))
            for _ in range(2):
                with pytest.raises(DataError, match="cannot be written"):
                    log(step)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
            signal.signal(signal.SIGXFSZ, ignored)
    with GateLog("full.jsonl", package, ["swing"]) as log:
        log(step)
    assert [(one.steps, one.passed) for one in load_gate_log("full.jsonl")] == [((step,), None)] * 2

"""``middeck qualify`` and what is under it: plants, shifts, rates, verdicts, and compensator files."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import ROOT, margins_once, middeck
from coarse_articles import coarse
from middeck.control import qualification
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.design import LQGCompensator, design_lqg
from middeck.control.qualification import qualify_compensator
from middeck.control.robust.verification.monte_carlo import outcomes_on
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.errors import ConfigError, DataError, NumericalError
from middeck.files.laws.compensators import (
    StoredCompensator,
    load_compensator,
    write_compensator,
)
from middeck.files.measured.models import write_model
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.plants.measured_plant import measured_plant
from middeck.signals.ports import Channel, Port
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays
from middeck.systems.state_space.statespace import gain_system
from plant_builders import sum_of_modes, unit_weights
from repeats import repeats

Capture = pytest.CaptureFixture[str]
TORQUE, ANGLE = Port("torque", "N m"), Port("angle", "rad", Channel(node="7"))
GROUPS = {"w": ("torque",), "u": ("torque",), "z": ("angle",), "y": ("angle",)}
WEIGHTS = unit_weights(("torque",), 4e-10, process=1e-4)
DEFAULTS = ("--angle-noise", 2e-5, "--disturbance", 1e-2)


def measured(late_s: float = 0.004) -> MeasurementModel:
    """Modes at 2, 5 and 9 Hz of 1 %."""
    omega = 2.0 * np.pi * np.array([2.0, 5.0, 9.0])
    zero = np.zeros((1, 1))
    shapes = np.array([[1.0, -0.6, 0.8]]) / (2j * omega)
    poles = omega * (-0.01 + 1j)
    return MeasurementModel(
        poles=poles,
        shapes=shapes,
        participation=np.array([[1.0], [0.7], [1.2]]),
        direct=zero,
        lower=zero,
        delay_s=np.array([late_s]),
        inputs=(TORQUE,),
        outputs=(ANGLE,),
    )


def plant(late_s: float = 0.004) -> Plant:
    w, u, z, y = GROUPS.values()
    return measured_plant(measured(late_s), w=w, u=u, z=z, y=y)


def law(authority: float = 1e4) -> LQGCompensator:
    return design_lqg(remove_delays(plant()), WEIGHTS, authority)


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Margins of one loop are measured once."""
    monkeypatch.setattr(qualification, "measure_margins", margins_once)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A law and the model that it is for, late by 4 ms."""
    write_model(tmp_path / "model.json", measured())
    write_compensator(tmp_path / "law.json", law())
    return tmp_path


def qualify(capfd: Capture, files: Path, *arguments: object, code: int = 0) -> dict[str, Any]:
    ended = middeck(capfd, "qualify", files / "law.json", files / "model.json", *arguments, "--json")
    assert ended.code == code, ended.err
    return json.loads(ended.out)


# compensator files


def test_a_compensator_comes_back_with_ports_and_how_it_was_made(tmp_path: Path) -> None:
    made = law()
    write_compensator(tmp_path / "law.json", made)
    back = load_compensator(tmp_path / "law.json")
    assert back == StoredCompensator(
        dynamics=made.system,
        inputs=made.inputs,
        outputs=made.outputs,
        applied=made.applied,
        authority=made.authority,
        cost=made.cost,
        inert=made.inert,
        method="LQGCompensator",
    )
    write_compensator(tmp_path / "again.json", back)
    assert load_compensator(tmp_path / "again.json") == back


def test_a_sampled_compensator_too(tmp_path: Path) -> None:
    made = design_sampled_lqg(plant(), WEIGHTS, 1e4, 0.004)
    write_compensator(tmp_path / "law.json", made)
    back = load_compensator(tmp_path / "law.json")
    assert isinstance(back, StoredCompensator)
    assert (back.sampled, back.inputs, back.outputs) == (made.sampled, made.inputs, made.outputs)
    assert (back.method, back.authority) == (made.method, made.authority)
    assert made.applied is not None
    assert np.array_equal(back.applied, made.applied)


def test_a_law_without_states_and_one_of_an_earlier_version(tmp_path: Path) -> None:
    file = tmp_path / "law.json"
    gain = Compensator(gain_system([[-2.0]]), (ANGLE,), (TORQUE,))
    write_compensator(file, gain)
    assert load_compensator(file).system == gain.system
    document = json.loads(file.read_text())
    del document["made"], document["period_s"]
    file.write_text(json.dumps(document))
    assert load_compensator(file) == StoredCompensator(
        dynamics=gain.system, inputs=gain.inputs, outputs=gain.outputs
    )


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"schema": "middeck.model/1"}, "schema is 'middeck.model/1'"),
        ({"A": None}, "not finite"),
        ({"A": [[1.0]]}, "B has shape"),
        ({"inputs": []}, "no ports"),
        ({"inputs": [{"name": "angle"}]}, "keys missing: unit"),
        ({"period_s": 0.0}, "a sampling period of 0 s"),
        ({"made": [1]}, "made: not a table"),
        ({"made": {"authority": "high"}}, "made.authority: not an array of numbers"),
    ],
)
def test_a_file_that_is_no_compensator(
    changes: dict[str, Any], says: str, files: Path, capfd: Capture
) -> None:
    file = files / "law.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    with pytest.raises(DataError, match=says) as refused:
        load_compensator(file)
    assert str(file) in str(refused.value)
    ended = middeck(capfd, "qualify", file, files / "model.json")
    assert ended.code == 4


# numbers


def test_a_row_is_what_each_analysis_says_by_itself() -> None:
    made, delayed = law(), plant()
    continuous, sampled = qualify_compensator(made, {"p": delayed}, WEIGHTS, rates_hz=[200.0])
    outcome = outcomes_on([delayed], made, WEIGHTS)[0]
    # By quadrature with exp(-s tau), and by a Lyapunov equation of the approximation: 1e-9 in phase.
    assert continuous.rms == pytest.approx(outcome.rms[0], rel=1e-9)
    assert continuous.db == pytest.approx(float(outcome.db[0]), abs=1e-7)
    assert continuous.control_rms == pytest.approx(outcome.control_rms[0], rel=1e-9)
    assert continuous.loops == measure_margins(delayed, made).loops
    assert sampled.setting == "200 Hz"
    assert sampled.loops[0].channel == "torque"
    # Tustin's rule and the hold cost phase: half a period at crossover, and no more than a period.
    lost = continuous.loops[0].delay_limit_s - sampled.loops[0].delay_limit_s
    assert 0.0 < lost < 0.005


def test_a_sampled_compensator_runs_at_its_own_rate() -> None:
    made = design_sampled_lqg(plant(), WEIGHTS, 1e4, 0.004)
    (row,) = qualify_compensator(made, {"p": plant()}, WEIGHTS)
    outcome = measure_sampled_loop(plant(), made, WEIGHTS, 1.0)
    assert (row.setting, row.rms) == ("250 Hz", outcome.metric)
    with pytest.raises(ConfigError, match="sampled, at 250 Hz; it has no form at another rate"):
        qualify_compensator(made, {"p": plant()}, WEIGHTS, rates_hz=[500.0])


def test_a_delay_beyond_the_margin_is_unstable_and_one_within_is_not() -> None:
    """The margin, the stability and the delay are exact: 0.1 % to both sides tells them apart."""
    limit = qualify_compensator(law(), {"p": plant()}, WEIGHTS)[0].loops[0].delay_limit_s
    around = {f"{share}": plant(0.004 + share * limit) for share in (0.999, 1.001)}
    within, beyond = qualify_compensator(law(), around, WEIGHTS)
    assert (within.stable, beyond.stable) == (True, False)
    assert beyond.db == np.inf
    assert beyond.loops == ()


def free(seen: float) -> Plant:
    """A rigid mode that nothing drives, seen or not, beside two that bend."""
    omega = 2.0 * np.pi * np.array([0.0, 2.0, 5.0])
    modal = sum_of_modes(
        omega, [0.0, 0.01, 0.01], [[0.0], [1.0], [0.7]], [[seen, 1.0, -0.6]], names=("rotation z", "a", "b")
    )
    return Plant(dynamics=modal, inputs=(TORQUE,), outputs=(ANGLE,), **GROUPS)


def test_what_nothing_holds_is_named_and_not_stable_at_any_rate() -> None:
    """A double pole at the origin: rounding puts it left or right of the axis as it likes."""
    made = design_lqg(free(0.0), WEIGHTS, 1e3)
    plants = {"unseen": delay_plant(free(0.0), 1e-3), "seen": delay_plant(free(0.5), 1e-3)}
    rows = qualify_compensator(made, plants, WEIGHTS, rates_hz=[100.0, 250.0, 500.0])
    for row in rows:
        # In no transfer function it is left out; in one it drifts.
        assert row.stable == (row.plant == "unseen"), row.setting
        assert row.unheld == (() if row.stable else ("rotation z",))


def test_what_cannot_be_decided_is_reported_in_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(plant: Any, law: Any) -> Any:
        if plant.delay_s[0, 0] == 0.5:
            raise NumericalError("a root lies on the axis")
        return measure_margins(plant, law)

    monkeypatch.setattr(qualification, "measure_margins", measure)
    delayed, fine = qualify_compensator(law(), {"late": plant(0.5), "fine": plant()}, WEIGHTS)
    assert (delayed.stable, delayed.undecided, delayed.db) == (False, "a root lies on the axis", np.inf)
    assert (fine.stable, fine.undecided) == (True, "")


def test_white_sensor_noise_through_a_direct_term_has_no_rms() -> None:
    gain = Compensator(gain_system([[-0.1]]), (ANGLE,), (TORQUE,))
    continuous, sampled = qualify_compensator(gain, {"p": plant(0.0)}, WEIGHTS, rates_hz=[500.0])
    assert not np.isfinite(continuous.control_rms)
    # The plant rolls off: what it does with white commands is finite.
    assert np.isfinite(continuous.rms) == continuous.stable
    assert np.isfinite(sampled.control_rms) == sampled.stable


# the verb


def test_the_table_of_a_model(files: Path, capfd: Capture) -> None:
    found = qualify(capfd, files, "--rate", "100,500", *DEFAULTS)
    assert found["schema"] == "middeck.qualify/1"
    assert found["law"]["method"] == "LQGCompensator"
    assert found["law"]["authority"] == 1e4
    assert [row["setting"] for row in found["rows"]] == ["continuous", "100 Hz", "500 Hz"]
    wanted = qualify_compensator(law(), {"model": plant()}, WEIGHTS, rates_hz=[100.0, 500.0])
    for row, q in zip(found["rows"], wanted, strict=True):
        assert row["db"] == pytest.approx(q.db, abs=1e-9)
        assert row["gain_db"] == pytest.approx(q.loops[0].gain_db, rel=1e-9)
        assert row["delay_ms"] == pytest.approx(1e3 * q.loops[0].delay_limit_s, rel=1e-9)
    shown = middeck(capfd, "qualify", files / "law.json", files / "model.json", *DEFAULTS).out
    assert "model  continuous  yes" in shown


def test_modes_are_moved_by_name_and_by_band(files: Path, capfd: Capture) -> None:
    by_name = qualify(capfd, files, "--shift", "pole at 9 Hz", 30)["rows"]
    by_band = qualify(capfd, files, "--shift", "8:10", 30)["rows"]
    assert [row["plant"] for row in by_band] == ["model", "model, 8:10 -30 %", "model, 8:10 +30 %"]
    assert [row["db"] for row in by_name] == [row["db"] for row in by_band]
    delayed = plant()
    moved = shift_modes(delayed, {"pole at 9 Hz": 0.7})
    assert by_band[1]["db"] == pytest.approx(
        qualify_compensator(law(), {"m": moved}, WEIGHTS)[0].db, abs=1e-9
    )


def test_a_further_delay_is_added_to_the_models_own(files: Path, capfd: Capture) -> None:
    own, later = (qualify(capfd, files, "--delay-ms", ms)["rows"][0]["delay_ms"] for ms in (0, 3))
    assert own - later == pytest.approx(3.0, rel=1e-9)


def test_the_limits_are_where_the_loop_turns_unstable(files: Path, capfd: Capture) -> None:
    write_compensator(files / "law.json", law(1e7))
    found = qualify(capfd, files, "--limits")
    limited = [
        (shift["mode"], shift[end])
        for shift in found["allowed_shift"]
        for end in ("down_percent", "up_percent")
        if shift[end] is not None
    ]
    assert limited
    for mode, percent in repeats(limited, 2):
        # The shift found is the unstable end of a bracket of 1e-6 %.
        rows = [qualify(capfd, files, "--shift", mode, abs(percent) * share) for share in (0.99, 1.01)]
        side = 1 if percent < 0.0 else 2
        assert [r["rows"][side]["stable"] for r in rows] == [True, False]


@pytest.mark.parametrize(
    ("limits", "code"),
    [
        (["stable"], 0),
        (["stable", "gain_db=6", "phase_deg=30", "delay_ms=10", "disk=0.5", "db=-6", "control_rms=1"], 0),
        (["gain_db=60"], 1),
        (["db=-60"], 1),
        (["control_rms=1e-6"], 1),
        (["damping=0.5"], 1),
    ],
)
def test_a_verdict(limits: list[str], code: int, files: Path, capfd: Capture) -> None:
    asked = [part for limit in limits for part in ("--require", limit)]
    found = qualify(capfd, files, *asked, code=code)
    assert found["passed"] is (code == 0)
    assert len(found["requirements"]) == len(limits)
    shown = middeck(capfd, "qualify", files / "law.json", files / "model.json", *asked).out
    assert ("FAILED" in shown) is (code == 1)


def test_an_unstable_row_meets_nothing_and_is_no_error_by_itself(files: Path, capfd: Capture) -> None:
    found = qualify(capfd, files, "--delay-ms", 200)
    row = found["rows"][0]
    assert row["stable"] is False
    assert row["decay_per_s"] < 0.0
    assert [row[key] for key in ("gain_db", "phase_deg", "disk", "db", "control_rms")] == [None] * 5
    assert qualify(capfd, files, "--delay-ms", 200, "--require", "control_rms=1e9", code=1)["passed"] is False


def test_an_article_in_several_environments(tmp_path: Path, capfd: Capture) -> None:
    article, file = coarse("mace-dm"), tmp_path / "law.json"
    asked = ("--count", 12, "--environment", "lab")
    made = ("--control", "pri_rel_z", "--measure", "pri_in_z", "--log10-authority", 2, "-o", file)
    assert middeck(capfd, "design", article, *asked, *made).code == 0
    ended = middeck(capfd, "qualify", file, article, *asked, "--environment", "orbit", "--json")
    assert ended.code == 0
    rows = json.loads(ended.out)["rows"]
    assert [row["plant"] for row in rows] == ["mace-dm in lab", "mace-dm in orbit"]
    assert [row["stable"] for row in rows] == [True, False]
    # Free in space a torque between two bodies turns them against each other and never both together.
    assert rows[1]["unheld"]
    others = [tmp_path / folder / "orbit.toml" for folder in ("a", "b")]
    for other in others:
        other.parent.mkdir()
        shutil.copy(ROOT / "environments" / "orbit.toml", other)
    several = [x for other in ("orbit", *others) for x in ("--environment", other)]
    ended = middeck(capfd, "qualify", file, article, "--count", 12, *several, "--json")
    assert [row["plant"] for row in json.loads(ended.out)["rows"]] == [
        "mace-dm in orbit", *(f"{article} in {other}" for other in others)
    ]  # fmt: skip
    delays = ("--count", 12, "--environment", "orbit", "--delay-ms", 7)
    text = middeck(capfd, "qualify", file, article, *delays).err
    assert "nothing at these ports holds" in text


# what is refused


@pytest.mark.parametrize(
    ("arguments", "code", "says", "advice"),
    [
        (["--require", "gain"], 2, "--require gain: stable, or one of gain_db", "--help"),
        (["--require", "gain_db=much"], 2, "--require gain_db=much", "--help"),
        (["--shift", "nothing", 2], 2, "no mode named 'nothing'", "one of pole at 2 Hz"),
        (["--shift", "20:30", 2], 2, "no mode between 20 and 30 Hz", "pole at 9 Hz 9 Hz"),
        (["--shift", "8:10", 100], 2, "100", "--help"),
        (["--rate", "0"], 2, "not > 0 Hz", "--help"),
        (["--set", "mesh.size=1"], 2, "--set is for articles", "name an article"),
    ],
)
def test_options_that_cannot_be(
    arguments: list[Any], code: int, says: str, advice: str, files: Path, capfd: Capture
) -> None:
    ended = middeck(capfd, "qualify", files / "law.json", files / "model.json", *arguments)
    assert ended.code == code
    assert says in ended.err
    assert advice in ended.err


def test_ports_that_a_plant_does_not_have(files: Path, capfd: Capture) -> None:
    ended = middeck(capfd, "qualify", files / "law.json", coarse("mace-dm"), "--count", 12)
    assert ended.code == 2
    assert "the compensator drives torque; the article has no such actuator" in ended.err
    assert "try: a plant with it; this one has" in ended.err
    other = dataclasses.replace(measured(), outputs=(Port("position", "m"),))
    write_model(files / "model.json", other)
    ended = middeck(capfd, "qualify", files / "law.json", files / "model.json")
    assert ended.code == 2
    assert "the compensator reads angle; the model has no such output" in ended.err


def test_ports_of_another_unit() -> None:
    inside = dataclasses.replace(remove_delays(plant()), outputs=(Port("angle", "deg"),))
    with pytest.raises(ConfigError, match="reads angle in rad, the plant has it in deg") as refused:
        qualify_compensator(law(), {"p": inside}, WEIGHTS)
    assert refused.value.where == "p"


def test_a_sampled_law_has_no_limits_and_no_other_rate(files: Path, capfd: Capture) -> None:
    made = design_sampled_lqg(plant(), WEIGHTS, 1e4, 0.004)
    assert isinstance(made, Compensator)
    write_compensator(files / "law.json", made)
    assert [row["setting"] for row in qualify(capfd, files)["rows"]] == ["250 Hz"]
    for arguments, says in ((["--limits"], "--limits is for a continuous"), (["--rate", 500], "at 250 Hz")):
        ended = middeck(capfd, "qualify", files / "law.json", files / "model.json", *arguments)
        assert ended.code == 2
        assert says in ended.err


def sampled_return_ratio(law: Compensator, omega: np.ndarray, period_s: float) -> np.ndarray:
    """u = K y broken at u: `measured` behind sample and hold, its delay exact, K by Tustin's rule."""
    model, z = measured(), np.exp(1j * omega * period_s)
    late_s = float(model.delay_s[0])
    whole = int(np.ceil(late_s / period_s))
    rest_s, path = whole * period_s - late_s, np.zeros(len(omega), dtype=complex)
    terms = model.shapes[0] * model.participation[:, 0]
    both = (np.concatenate([x, x.conj()]) for x in (model.poles, terms))
    for pole, term in zip(*both, strict=True):
        step = np.exp(pole * period_s)
        path += term / pole * (np.exp(pole * rest_s) * (step - 1.0) / (z - step) + np.expm1(pole * rest_s))
    A, B, C, D = (np.asarray(x) for x in (law.system.A, law.system.B, law.system.C, law.system.D))
    s = 2.0 / period_s * (z - 1.0) / (z + 1.0)
    gain = [(C @ np.linalg.solve(x * np.eye(len(A)) - A, B) + D)[0, 0] for x in s]
    return np.asarray(gain) * z**-whole * path


@pytest.mark.parametrize("hold_s", [0.004, 0.01, 0.0])
def test_the_hold_that_a_model_excludes_is_added_once(capfd: Capture, files: Path, hold_s: float) -> None:
    """Whatever hold was taken out of a model's data, a rate adds that of the loop."""
    write_model(files / "model.json", dataclasses.replace(measured(), hold_s=hold_s))
    found = qualify(capfd, files, "--rate", 250)
    row = next(r for r in found["rows"] if r["setting"] == "250 Hz")
    near = [2.0 * np.pi * f * (1.0 + np.linspace(-0.3, 0.3, 4000)) for f in (2.0, 5.0, 9.0)]
    omega = np.unique(np.concatenate([*near, np.linspace(0.1, 0.99 * np.pi / 0.004, 4000)]))
    ratio = sampled_return_ratio(load_compensator(files / "law.json"), omega, 0.004)
    # u = K y is added: the critical point is +1, and the disk margin 1 / max |S - 1/2|.
    assert row["disk"] == pytest.approx(1.0 / np.abs(1.0 / (1.0 - ratio) - 0.5).max(), rel=1e-3)
    edge = ratio[np.nonzero(np.diff(np.abs(ratio) > 1.0))[0]]
    assert row["phase_deg"] == pytest.approx(np.abs(np.degrees(np.angle(edge))).min(), abs=0.5)
    assert not any("held" in warning for warning in found["warnings"])

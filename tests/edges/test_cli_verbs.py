"""What the verbs print is what the rooms compute; stdout is one document or plain text."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, detect_faults_once, middeck, mirror_records
from coarse_articles import coarse
from middeck.signals.ports import Port
from middeck.signals.record import Record
from middeck.structure.rest.equilibrium import node_rotations
from plant_builders import unit_weights
from repeats import LONG

SIMPLE = coarse("mace-simple")
DM = coarse("mace-dm")
LAB = ROOT / "environments/lab.toml"
MIRROR = ROOT / "data/cubespec-fsm" if LONG else mirror_records()
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Faults of one record are looked for once."""
    monkeypatch.setattr("middeck.cli.work.fit_records.detect_faults", detect_faults_once)


def document(capfd: Capture, *arguments: object) -> dict[str, Any]:
    """The JSON that the verb prints, and nothing else; the schema names the verb."""
    ended = middeck(capfd, *arguments, "--json")
    assert (ended.code, ended.err) == (0, "")
    found = json.loads(ended.out, parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))
    assert found["schema"] == f"middeck.{arguments[0]}/1"
    return found


def text(capfd: Capture, *arguments: object) -> str:
    ended = middeck(capfd, *arguments)
    assert (ended.code, ended.err) == (0, "")
    assert "\x1b" not in ended.out
    return ended.out


@pytest.fixture(scope="module")
def lab() -> Any:
    return md.solve_modes(md.solve_equilibrium(*md.load_setup(SIMPLE, LAB)))


def test_modes_in_the_laboratory(capfd: Capture, lab: Any) -> None:
    found = document(capfd, "modes", SIMPLE, "--environment", "lab")
    rest = lab.equilibrium
    # Exact: JSON carries all digits, and the same computation in the same process rounds alike.
    assert found["frequency_hz"] == lab.frequency_hz[:26].tolist()
    assert found["kind"] == list(lab.kind[:26])
    assert found["name"] == list(lab.name[:26])
    assert found["residual"] == lab.residual[:26].max()
    strained = [most is not None for most in found["most_strained"]]
    assert strained == (lab.strain_share[:26] >= 5e-4).tolist()  # a bounce on the cables strains no part
    assert 0 < strained.count(False) < 13
    assert found["equilibrium_residual"] == rest.residual
    assert found["rigid_residual"] == lab.rigid_residual
    assert found["reactions_n"] == dict(zip(["n1", "n3", "n5"], rest.suspension.reaction, strict=True))
    assert list(found["reactions_n"]) == ["n1", "n3", "n5"]
    joints = ["pri_x", "pri_z", "sec_x", "sec_z"]
    assert found["holding_torque_nm"] == dict(zip(joints, rest.holding_torque, strict=True))
    assert list(found["node_rotation_deg"]) == ["n1", "n2", "n3", "n4", "n5"]
    drawn, hung = rest.model.rest.x, rest.config.x
    np.testing.assert_allclose(list(found["node_shift_m"].values()), (hung - drawn)[:5], atol=1e-12)
    for node, vector in node_rotations(rest).items():
        assert found["node_rotation_deg"][node] == np.degrees(vector).tolist()
    weight = 9.80665 * found["mass_kg"]
    # Statics: what the cables carry is the weight (residual 1e-10 of it).
    assert sum(found["reactions_n"].values()) == pytest.approx(weight, rel=1e-9)
    assert sum(found["tension_n"].values()) == pytest.approx(weight, rel=1e-4)  # cables lean by 0.1 degree


def test_modes_in_orbit_and_how_many(capfd: Capture) -> None:
    found = document(capfd, "modes", DM, "--environment", "orbit", "--count", 9)
    assert found["frequency_hz"][:8] == [0.0] * 8
    assert found["frequency_hz"][8] > 1.0
    assert found["kind"] == ["rigid"] * 8 + ["flexible"]
    assert found["reactions_n"] == {} == found["tension_n"]
    for key in ("kind", "name", "strain_share", "mode_residual"):
        assert len(found[key]) == 9


def test_orbit_has_no_weight_and_no_negative_zero(capfd: Capture) -> None:
    """What hangs nowhere has its residual over the weight that it has on the ground."""
    shown = text(capfd, "modes", SIMPLE, "--environment", "orbit", "--count", 8)
    assert "of the weight under 1 g" in shown
    assert "of the weight at rest" not in shown
    assert not re.search(r"-0\.0+\b", shown)
    assert "of the weight at rest" in text(capfd, "modes", SIMPLE, "--count", 8)


def test_set_changes_what_is_computed(capfd: Capture) -> None:
    ask = ("modes", DM, "--environment", LAB, "--count", 8)
    bounce = [
        dict(zip(found["name"], found["frequency_hz"], strict=True))["bounce"]
        for found in (document(capfd, *ask), document(capfd, *ask, "--set", "suspension.bounce_hz=0.2"))
    ]
    # The bounce frequency is the device's up to the bus's own flexibility (0.2 % on the sheet).
    assert bounce == pytest.approx([0.25, 0.2], rel=5e-3)


def test_modes_as_text_begins_with_the_mass(capfd: Capture, lab: Any) -> None:
    lines = text(capfd, "modes", SIMPLE).splitlines()
    mass = lab.equilibrium.model.structure.mass
    assert lines[0] == f"mass         {mass:.6g} kg"
    bounce = r" *3 +0\.2496\d +3\.000 +suspension +bounce +100\.0% +0\.0%"
    assert any(re.fullmatch(bounce, line) for line in lines)
    x, y, z = np.degrees(node_rotations(lab.equilibrium)["n1"])
    (first,) = (line.split() for line in lines if line.startswith("n1 ") and len(line.split()) == 7)
    assert first[4:] == [f"{x:.5f}", f"{y:.5f}", f"{z:.5f}"]
    article = next(i for i, line in enumerate(lines) if line.startswith("article "))  # as long as its title
    assert max(map(len, lines[:article] + lines[article + 1 :])) <= 80


def test_compare(capfd: Capture, lab: Any) -> None:
    found = document(capfd, "compare", SIMPLE)
    orbit = md.solve_modes(md.solve_equilibrium(lab.equilibrium.model.structure, md.Environment.orbit()))
    expected = md.compare_modes(orbit, lab, 26)
    assert found["matrix"] == expected.cross_orthogonality.tolist()
    assert found["mac"] == expected.mac.tolist()
    assert found["pairs"] == expected.pairs.tolist()
    assert found["ratio"] == expected.ratio.tolist()
    assert found["subspace_angle_deg"] == np.degrees(expected.subspace_angle).tolist()
    for side, modes in (("orbit", orbit), ("lab", lab)):
        assert found[side]["frequency_hz"] == modes.frequency_hz[:26].tolist()
        assert found[side]["kind"] == list(modes.kind[:26])
        assert found[side]["rigid_residual"] == modes.rigid_residual
    assert "translation x" in text(capfd, "compare", SIMPLE)


def test_response(capfd: Capture) -> None:
    ask = ("response", DM, "--environment", "lab", "--at", "0.5,1,8")
    found = document(capfd, *ask, "--input", "pri_rel_z", "--output", "pri_in_z_rate", "--output", "bus_z")
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(DM, LAB)))
    plant = md.build_plant(modes, inputs=["pri_rel_z"], outputs=["pri_in_z_rate", "bus_z"])
    H = md.evaluate_plant(plant, np.array([0.5, 1.0, 8.0])).H
    pairs = found["responses"]
    assert [(p["input"], p["output"], p["unit"]) for p in pairs] == [
        ("pri_rel_z", "pri_in_z_rate", "rad/s per N m"),
        ("pri_rel_z", "bus_z", "rad per N m"),
    ]
    for o, pair in enumerate(pairs):
        assert pair["frequency_hz"] == [0.5, 1.0, 8.0]
        assert pair["re"] == H[:, o, 0].real.tolist()
        assert pair["im"] == H[:, o, 0].imag.tolist()
    alone = document(capfd, *ask, "--input", "pri_rel_z", "--output", "bus_z")
    assert alone["unit"] == pairs[1]["unit"]
    for part in ("re", "im"):
        # Rounding: a product of other shape adds in another order.
        np.testing.assert_allclose(alone[part], pairs[1][part], rtol=1e-12)
    assert "pri_rel_z to bus_z, rad per N m" in text(capfd, *ask, "--input", "pri_rel_z", "--output", "bus_z")


def test_a_response_beyond_the_modes_kept_says_so(capfd: Capture) -> None:
    ports = ("--input", "pri_rel_z", "--output", "bus_z_rate")
    ask = ("response", SIMPLE, "--environment", "lab", *ports)
    few, all_of_them = (document(capfd, *ask, "--at", "500", "--count", n) for n in (26, 400))
    assert abs(few["im"][0]) < 0.9 * abs(all_of_them["im"][0])
    assert "beyond the 26 lowest are left out: at 500 Hz" in few["warnings"][-1]
    assert not any("left out" in text for text in all_of_them["warnings"])
    assert not any("left out" in text for text in document(capfd, *ask, "--at", "0.5,1,2")["warnings"])


def test_damping_of_a_response_can_be_set(capfd: Capture) -> None:
    ports = ("--input", "bus_z", "--output", "bus_z")
    modes = document(capfd, "modes", DM, "--environment", "orbit")
    hz = modes["frequency_hz"][modes["name"].index("first bending x-y")]
    ask = ("response", DM, "--environment", "orbit", "--at", repr(hz), "--count", 9, *ports)
    im = [document(capfd, *ask, "--set", f"damping.flexible={zeta}")["im"][0] for zeta in (0.01, 0.02)]
    # At resonance the one flexible mode is psi phi / (2 j zeta omega^2): inversely as zeta.
    assert im[0] == pytest.approx(2.0 * im[1], rel=1e-9)


FIT = (MIRROR / "mirror-300mV-train.npz", "--states", 6, "--band", "300,1000")


def test_identify_then_design(tmp_path: Path, capfd: Capture) -> None:
    held_out = MIRROR / "mirror-300mV-test.npz"
    model, law = tmp_path / "model.json", tmp_path / "law.json"
    found = document(capfd, "identify", *FIT, "--continuous", "--validate", held_out, "-o", model)
    measured = md.estimate_response(md.load_record(FIT[0]), band_hz=(300.0, 1000.0))
    fit = md.fit_response(measured, states=6)
    assert md.files.load_model(model) == fit.model
    assert found["states"] == 6
    assert found["sampled"] is False
    assert found["frequency_hz"] == (np.abs(fit.model.poles) / (2.0 * np.pi)).tolist()
    outputs = ["position_1", "position_2", "position_3"]
    assert found["delay_s"] == dict(zip(outputs, fit.model.delay_s, strict=True))
    assert found["error"] == dict(zip(outputs, fit.error, strict=True))
    error = md.identification.nrmse(fit.model, md.load_record(held_out))
    assert found["held_out_nrmse"] == dict(zip(outputs, error, strict=True))

    ports = ("--control", "piezo_1", "--measure", "position_1")
    noise = ("--angle-noise", 1e-7, "--disturbance", 0.1, "--log10-authority", 12)
    designed = document(capfd, "design", model, *ports, *noise, "-o", law)
    path = md.identification.select_channels(fit.model, inputs=["piezo_1"], outputs=["position_1"]).model
    plant = md.approximate_delays(
        md.measured_plant(path, w=["piezo_1"], u=["piezo_1"], z=["position_1"], y=["position_1"]), 3
    )
    weights = unit_weights(("piezo_1",), 1e-14, process=0.01)
    written = json.loads(law.read_text())
    assert written["schema"] == "middeck.compensator/1"
    assert (written["inputs"], written["outputs"]) == (
        [{"name": "position_1", "unit": "m"}],
        [{"name": "piezo_1", "unit": "V"}],
    )
    system = md.design_lqg(plant, weights, 1e12).system
    for name in "ABCD":
        # rtol: 10.0**12.0 and 1e12 may differ in the last digit; the Riccati condition magnifies it.
        np.testing.assert_allclose(
            written[name], getattr(system, name), rtol=1e-6, atol=1e-12 * np.abs(system.A).max()
        )
    assert designed["stable"] is True
    assert designed["compensator_stable"] is True
    assert designed["order"] == len(system.A) == designed["plant_order"]
    assert designed["db"]["position_1"] < -5.0  # the disturbance of the example is heard, the loop helps
    same = document(capfd, "design", model, *ports, *noise[:4], "--set", "log10_authority=12")
    assert same == designed


def test_the_sort_of_model_follows_from_the_band(capfd: Capture) -> None:
    # 1000 Hz of 6400 Hz is past the eighth at which a held input needs a sampled model; 799 Hz is not.
    ask = ("identify", FIT[0], "--states", 2)
    assert document(capfd, *ask, "--band", "700,1000")["sampled"] is True
    assert document(capfd, *ask, "--band", "700,799")["sampled"] is False
    assert document(capfd, *ask, "--band", "700,799", "--set", "sampled=true")["sampled"] is True


def test_without_states_the_recommended_order_is_taken(tmp_path: Path, capfd: Capture) -> None:
    f = np.arange(129)[:, None]  # one mode at 20 Hz, 5 % damped, 1 Hz lines, a little noise
    u = np.tile(np.random.default_rng(1).standard_normal((1, 1, 256, 1)), (1, 3, 1, 1))
    y = np.fft.irfft(np.fft.rfft(u, axis=2) / (1.0 - (f / 20.0) ** 2 + 0.1j * f / 20.0), axis=2)
    y = y + 1e-3 * np.random.default_rng(2).standard_normal(y.shape)
    ports = (Port("torque", "N m"),), (Port("angle", "rad"),)
    md.write(
        tmp_path / "one.npz",
        Record(sample_hz=256.0, u=u, y=y, inputs=ports[0], outputs=ports[1], periodic=True),
    )
    ended = middeck(capfd, "identify", tmp_path / "one.npz", "--band", "5,60", "--continuous", "--json")
    assert (ended.code, ended.err) == (0, "")
    found = json.loads(ended.out)
    measured = md.estimate_response(md.load_record(tmp_path / "one.npz"), band_hz=(5.0, 60.0))
    fit = md.fit_response(measured)
    assert found["states"] == fit.model.states
    assert found["order_reason"] == fit.order_reason
    assert found["frequency_hz"] == (np.abs(fit.model.poles) / (2.0 * np.pi)).tolist()


def test_design_straight_from_a_record(capfd: Capture) -> None:
    ports = ("--control", "piezo_1", "--measure", "position_1", "--log10-authority", 12)
    noise = ("--angle-noise", 1e-7, "--disturbance", 0.1)
    found = document(capfd, "design", FIT[0], "--states", 6, "--fit-band", "300,1000", *ports, *noise)
    assert found["stable"] is True
    assert found["db"]["position_1"] < -5.0


def test_design_for_an_article(capfd: Capture) -> None:
    ask = (
        "design",
        DM,
        "--environment",
        "lab",
        "--count",
        12,
        "--control",
        "pri_rel_z",
        "--measure",
        "pri_in_z",
    )
    low, high = (document(capfd, *ask, "--log10-authority", level) for level in (0, 2))
    assert low["stable"] is True is high["stable"]
    assert high["db"]["pri_in_z"] < low["db"]["pri_in_z"] < 0.0
    rms = high["rms_closed"]["pri_in_z"] / high["rms_open"]["pri_in_z"]
    assert high["db"]["pri_in_z"] == pytest.approx(20.0 * np.log10(rms), rel=1e-12)  # rounding
    assert "loop         stable" in text(capfd, *ask)


@pytest.mark.parametrize("verb", ["modes", "compare", "budget", "path"])
def test_units_are_doubted_by_every_verb_on_modes(capfd: Capture, verb: str) -> None:
    coarse = ("--count", 10, "--set", "mesh.elements_per_strut=1")
    coarse += ("--through", "earth,9") if verb == "path" else ()
    found = document(capfd, verb, DM, *coarse, "--set", "material.lexan.rho=1.6")
    assert sum("1.6 kg/m^3" in text for text in found["warnings"]) == 1


def test_a_slipped_unit_is_the_first_thing_to_try(capfd: Capture) -> None:
    ended = middeck(capfd, "compare", DM, "--count", 10, "--set", "material.lexan.E=2.3")
    assert (ended.code, ended.out) == (5, "")
    assert "is E in Pa" in ended.err.partition("try:")[2]


def test_damping_and_shares_are_in_the_document(capfd: Capture) -> None:
    found = document(capfd, "modes", DM, "--count", 10, "--set", "damping.rule=shares")
    mean = [0.01 * s + 0.03 * (1.0 - s) for s in found["strain_share"]]
    assert found["damping"] == pytest.approx(mean)
    assert found["rigid_share"][0] == pytest.approx(1.0, abs=1e-3)
    assert max(found["mesh_error"]) < 1e-4


@pytest.mark.parametrize("ending", ["unv", "json"])
def test_shapes_written_by_modes_are_its_own_survey(capfd: Capture, tmp_path: Path, ending: str) -> None:
    survey = tmp_path / f"shapes.{ending}"
    ask = (SIMPLE, "--environment", "orbit", "--set", "mesh.elements_per_strut=1")
    found = document(capfd, "modes", *ask, "--count", 16, "-o", survey)
    flexible = [f for f, k in zip(found["frequency_hz"], found["kind"], strict=True) if k != "rigid"]
    measured = md.load_measured_modes(survey)
    np.testing.assert_allclose(measured.frequency_hz, flexible, rtol=1e-5)  # six digits in a universal file
    setup = md.load_setup(SIMPLE, "orbit", ["mesh.elements_per_strut=1"])
    modes = md.solve_modes(md.solve_equilibrium(*setup), 16)
    nodes = [f"n{n}" if ending == "unv" else n for n in measured.node]  # the format knows numbers
    channels = list(zip(nodes, measured.direction, strict=True))
    computed = md.structure.measure_modes(modes, channels, chosen=range(10, 16))
    np.testing.assert_allclose(measured.shape, computed.shape, rtol=2e-5, atol=1e-12)

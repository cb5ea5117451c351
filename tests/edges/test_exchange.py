"""Exchange with python-control, scipy.signal and MATLAB: nothing is lost, and what cannot be is refused.

Where python-control is not installed a stand-in with its rules for names takes its place; the last tests
close loops with python-control itself and run where it is.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.signal
import scipy.sparse as sp

from cli_runner import middeck
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.design import design_lqg
from middeck.errors import ConfigError, DataError, MissingExtraError
from middeck.files.exchange.matlab_systems import load_mat, write_mat
from middeck.files.exchange.named_system import as_compensator, exchanged
from middeck.files.exchange.python_control import from_control, to_control
from middeck.files.exchange.scipy_signal import from_scipy, to_scipy
from middeck.files.laws.compensators import StoredCompensator
from middeck.signals.ports import Channel, Port
from middeck.systems.plants.plant import Plant, delay_plant, group_ports, name_states
from middeck.systems.plants.response import evaluate_plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.sampling.sampling import tustin
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace, gain_system
from plant_builders import grouped_plant, unit_weights

TORQUE, FORCE = Port("motor.z", "N m"), Port("shaker", "N", Channel(node="7", direction="+z", gain=2.0))
ANGLE, RATE = Port("payload angle", "rad"), Port("payload_rate", "rad/s")


def plant() -> Plant:
    """Two modes, two inputs, two outputs, a dot and a space in names, a transducer behind one port."""
    modal = ModalSystem(
        omega=[3.0, 20.0],
        zeta=[0.01, 0.02],
        psi=[[1.0, 0.3], [0.7, -1.0]],
        phi=[[1.0, 0.4], [0.0, 0.0]],
        phi_rate=[[0.0, 0.0], [1.0, 0.4]],
        names=("bending 1", "bending 2"),
    )
    return grouped_plant(
        modal, (TORQUE, FORCE), (ANGLE, RATE), w=("shaker",), u=("motor.z",), z=("payload angle",)
    )


def law() -> Compensator:
    weights = unit_weights(("shaker",), [1e-4, 1e-4])
    return design_lqg(plant(), weights, 10.0)


def sampled_law() -> Compensator:
    made = law()
    return Compensator(tustin(made.system, 0.004), made.inputs, made.outputs, method="Tustin")


class StandIn:
    """`control.StateSpace` of python-control 0.10: labels of repeated names are lost, dots are refused."""

    def __init__(self, A: Any, B: Any, C: Any, D: Any, dt: Any = 0, **names: Any) -> None:
        self.A, self.B, self.C, self.D, self.dt = A, B, C, D, dt
        self.name = names.get("name") or "sys[0]"
        for side in ("inputs", "outputs"):
            if any("." in name for name in names[side]):
                raise ValueError("invalid signal name ('.' not allowed)")
        self.input_labels = list(dict.fromkeys(names["inputs"]))
        self.output_labels = list(dict.fromkeys(names["outputs"]))
        states = names.get("states") or [f"x[{i}]" for i in range(len(A))]
        self.state_labels = list(dict.fromkeys(states))


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Any:
    """python-control, or its stand-in."""
    try:
        import control
    except ImportError:
        control = types.ModuleType("control")
        control.StateSpace = StandIn
        monkeypatch.setitem(sys.modules, "control", control)
    return control


def same(found: Any, wanted: Any) -> None:
    """To the last bit: matrices are handed over, not computed."""
    assert type(found) is type(wanted)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), strict=True)
    assert getattr(found, "period_s", None) == getattr(wanted, "period_s", None)


# python-control


def test_a_plant_comes_back_from_python_control_with_all_names(library: Any) -> None:
    there = to_control(plant())
    assert there.input_labels == ["motor·z", "shaker"]
    assert there.state_labels == ["bending 1 #1", "bending 1 #2", "bending 2 #1", "bending 2 #2"]
    back = from_control(there, like=(TORQUE, FORCE, ANGLE, RATE))
    same(back.system, plant().system)
    assert (back.inputs, back.outputs) == (plant().inputs, plant().outputs)
    assert back.state_names == name_states(plant())
    groups = {group: getattr(plant(), group) for group in "wuzy"}
    again = group_ports(back, **groups)
    assert again == dataclasses.replace(plant(), dynamics=plant().system, state_names=name_states(plant()))


def test_without_like_units_are_empty(library: Any) -> None:
    assert from_control(to_control(plant())).inputs == (Port("motor.z", ""), Port("shaker", ""))


def test_a_compensator_keeps_its_sign_or_is_turned(library: Any) -> None:
    made = law()
    ports = (*made.inputs, *made.outputs)
    same(as_compensator(from_control(to_control(made), like=ports)).system, made.system)
    turned = to_control(made, negative_feedback=True)
    np.testing.assert_array_equal(turned.C, -made.system.C)
    back = as_compensator(from_control(turned, like=ports), negative_feedback=True)
    same(back.system, made.system)
    assert (back.inputs, back.outputs) == (made.inputs, made.outputs)


def test_sampled_systems_keep_their_period(library: Any) -> None:
    made = sampled_law()
    there = to_control(made)
    assert there.dt == 0.004
    back = as_compensator(from_control(there, like=(*made.inputs, *made.outputs)))
    assert back == dataclasses.replace(made, method="")
    sampled = sample_plant(delay_plant(plant(), 0.003), 0.002)
    again = group_ports(
        from_control(to_control(sampled), like=(TORQUE, FORCE, ANGLE, RATE)),
        w=sampled.w, u=sampled.u, z=sampled.z, y=sampled.y,
    )  # fmt: skip
    assert again == sampled


def test_names_that_another_program_numbered_are_its_own(library: Any) -> None:
    bare = StateSpace(np.diag([-1.0, -2.0]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    named = Plant(dynamics=bare, inputs=(FORCE,), outputs=(ANGLE,), state_names=("tank #2", "tank #3"))
    assert from_control(to_control(named)).state_names == ("tank #2", "tank #3")
    assert from_control(to_control(bare)).state_names == ()


def test_ports_that_python_control_would_mix_up(library: Any) -> None:
    gain = gain_system(np.eye(2))
    with pytest.raises(ConfigError, match="two inputs named shaker"):
        to_control(Plant(dynamics=gain, inputs=(FORCE, FORCE), outputs=(ANGLE, RATE)))
    with pytest.raises(ConfigError, match="stands for a dot"):
        to_control(Plant(dynamics=gain, inputs=(Port("a·b", ""), FORCE), outputs=(ANGLE, RATE)))


def ratio(num: list[float], den: list[float], **changes: Any) -> Any:
    """What a transfer function of python-control shows."""
    shown = {"num": [[np.array(num)]], "den": [[np.array(den)]], "dt": 0, "name": "F"}
    return types.SimpleNamespace(**(shown | {"input_labels": ["u[0]"], "output_labels": ["y[0]"]} | changes))


def test_a_transfer_function_becomes_a_state_space() -> None:
    system = from_control(ratio([2.0, 1.0, 5.0], [1.0, 0.4, 9.0])).system
    s = 2.5j
    H = system.C @ np.linalg.solve(s * np.eye(2) - system.A, system.B) + system.D
    # Rounding of a handful of operations.
    np.testing.assert_allclose(H, (2 * s**2 + s + 5) / (s**2 + 0.4 * s + 9), rtol=1e-14)


@pytest.mark.parametrize(
    ("system", "says", "advice"),
    [
        (ratio([1.0, 0.0, 0.0], [1.0, 1.0]), "improper: 2 zeros over 1 poles", "add 1 fast pole"),
        (ratio([1.0], [0.0]), "denominator is zero", ""),
        (ratio([1j, 1.0], [1.0, 1.0]), "complex", "real form"),
        (ratio([1.0], [1.0, 1.0], dt=None), "time base is open", "period_s="),
        (ratio([1.0], [1.0, 1.0], dt=True), "sampled, of no period", "period_s="),
        (ratio([1.0], [1.0, 1.0], input_labels=["a", "b"]), "several inputs", "control.ss"),
        (types.SimpleNamespace(dt=0, input_labels=[], output_labels=[]), "neither a state space", "control"),
        (3.0, "float: neither a state space", "control.ss"),
    ],
)
def test_what_python_control_has_and_this_house_has_not(system: Any, says: str, advice: str) -> None:
    with pytest.raises(ConfigError, match=says) as refused:
        from_control(system)
    assert advice in refused.value.hint


def test_an_open_time_base_is_settled_by_the_caller() -> None:
    assert from_control(ratio([1.0], [1.0, 0.5], dt=True), period_s=0.01).period_s == 0.01
    assert isinstance(from_control(ratio([1.0], [1.0, 0.5], dt=None), period_s=0.0).dynamics, StateSpace)
    with pytest.raises(ConfigError, match="its own dt 0"):
        from_control(ratio([1.0], [1.0, 0.5]), period_s=0.01)


def test_without_python_control_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingExtraError) as refused:
        to_control(plant())
    assert refused.value.exit_code == 3
    assert "middeck[control]" in str(refused.value)


def test_nothing_of_theirs_is_imported_until_asked_for() -> None:
    code = (
        "import sys, middeck.files.exchange\n"
        "print([m for m in ('control', 'scipy.signal', 'scipy.io', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# scipy.signal


def test_matrices_come_back_from_scipy() -> None:
    there = to_scipy(plant())
    assert isinstance(there, scipy.signal.lti)
    back = from_scipy(there, inputs=plant().inputs, outputs=plant().outputs, state_names=name_states(plant()))
    assert back == group_ports(exchanged(plant()))
    made = sampled_law()
    there = to_scipy(made, negative_feedback=True)
    assert isinstance(there, scipy.signal.dlti)
    again = as_compensator(
        from_scipy(there, inputs=made.inputs, outputs=made.outputs), negative_feedback=True
    )
    assert again == dataclasses.replace(made, method="")
    assert [p.name for p in from_scipy(to_scipy(plant())).outputs] == ["y1", "y2"]


def test_poles_and_zeros_do_not_pass_through_coefficients_of_high_order() -> None:
    """A comb of 20 pairs from 1 to 1000 rad/s and a real pole: as a polynomial it would lose every digit."""
    w = np.geomspace(1.0, 1000.0, 20)
    poles = np.concatenate([w * (-0.01 + 1j), w * (-0.01 - 1j), [-5.0]])
    zeros = np.concatenate([1.1 * w * (-0.01 + 1j), 1.1 * w * (-0.01 - 1j)])
    found = from_scipy(scipy.signal.ZerosPolesGain(zeros, poles, 3.0)).system
    s = 1j * np.array([0.5, 3.0, 77.0, 2000.0])
    exact = [3.0 * np.prod(x - zeros) / np.prod(x - poles) for x in s]
    H = [(found.C @ np.linalg.solve(x * np.eye(41) - found.A, found.B) + found.D).item() for x in s]
    # Conditioning of 41 factors, each near a resonance of 1 %.
    np.testing.assert_allclose(H, exact, rtol=1e-10)


@pytest.mark.parametrize(
    ("zeros", "poles"),
    [
        ([], [-1.0, -2.0, -3.0]),
        ([-4.0], [-1.0 + 2j, -1.0 - 2j]),
        ([-4.0], [-1.0 + 2j, -1.0 - 2j, -0.5]),
        ([-4.0, 3.0, -1j, 1j], [-1.0 + 2j, -1.0 - 2j, -0.5, -0.1]),
        ([-4.0, 3.0, 0.5], [-1.0, -0.5, -0.1]),
    ],
)
def test_any_mixture_of_real_and_complex_roots(zeros: list[complex], poles: list[complex]) -> None:
    found = from_scipy(scipy.signal.ZerosPolesGain(zeros, poles, -2.0)).system
    assert len(found.A) == len(poles)
    for s in (0.3j, 2.0 + 1.0j):
        H = (found.C @ np.linalg.solve(s * np.eye(len(poles)) - found.A, found.B) + found.D).item()
        exact = -2.0 * np.prod(s - np.array(zeros)) / np.prod(s - np.array(poles))
        assert abs(H - exact) < 1e-13 * abs(exact)  # rounding of a few factors


@pytest.mark.parametrize(
    ("system", "says"),
    [
        (scipy.signal.ZerosPolesGain([-1.0, -2.0], [-3.0], 1.0), "improper: 2 zeros over 1 poles"),
        (scipy.signal.ZerosPolesGain([], [-1.0 + 2.0j], 1.0), "complex without conjugates"),
        (scipy.signal.TransferFunction([1.0, 0.0], [1.0]), "improper"),
        (scipy.signal.StateSpace([[1j]], [[1.0]], [[1.0]], [[0.0]]), "StateSpace, A: complex numbers"),
        (scipy.signal.StateSpace([[np.nan]], [[1.0]], [[1.0]], [[0.0]]), "StateSpace, A: a number is not"),
        (scipy.signal.dlti([[0.5]], [[1.0]], [[1.0]], [[0.0]]), "sampled, of no period"),
        ("a text", "no system of scipy"),
    ],
)
def test_what_scipy_has_and_this_house_has_not(system: Any, says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        from_scipy(system)
    assert says in str(refused.value)
    assert refused.value.hint


# MATLAB


@pytest.mark.parametrize("negative", [False, True])
def test_a_compensator_comes_back_from_a_mat_file(negative: bool, tmp_path: Path) -> None:
    made = law()
    write_mat(tmp_path / "law.mat", made, negative_feedback=negative)
    back = load_mat(tmp_path / "law.mat")
    assert back == StoredCompensator(
        dynamics=made.system,
        inputs=made.inputs,
        outputs=made.outputs,
        authority=made.authority,
        cost=made.cost,
        inert=made.inert,
        method="LQGCompensator",
        applied=made.applied,
    )
    contents = scipy.io.loadmat(tmp_path / "law.mat")
    np.testing.assert_array_equal(contents["C"], -made.system.C if negative else made.system.C)
    assert contents["Ts"].item() == 0.0
    assert [cell.item() for cell in contents["InputName"].ravel()] == ["payload angle", "payload_rate"]
    assert contents["Feedback"].item() == ("negative" if negative else "positive")


def test_a_sampled_compensator_too(tmp_path: Path) -> None:
    made = sampled_law()
    write_mat(tmp_path / "law.mat", made)
    assert load_mat(tmp_path / "law.mat") == StoredCompensator(
        dynamics=made.sampled,
        inputs=made.inputs,
        outputs=made.outputs,
        authority=None,
        cost=None,
        inert=(),
        method="Tustin",
    )


def test_plants_and_systems_come_back_with_groups_units_and_transducers(tmp_path: Path) -> None:
    file = tmp_path / "plant.mat"
    write_mat(file, plant())
    assert load_mat(file) == dataclasses.replace(
        plant(), dynamics=plant().system, state_names=name_states(plant())
    )
    sampled = sample_plant(plant(), 0.01)
    write_mat(file, sampled)
    assert load_mat(file) == sampled
    for bare in (plant().system, gain_system(np.ones((2, 1))), tustin(plant().system, 0.01)):
        write_mat(file, bare)
        same(load_mat(file).dynamics, bare)


def test_matrices_of_any_origin(tmp_path: Path) -> None:
    """As MATLAB writes them, by themselves or in a structure, with or without names."""
    A, B, C, D = np.array([[-1.0]]), np.array([[1.0, 2.0]]), np.array([[3.0]]), np.zeros((1, 2))
    plain = {"E": np.eye(1), "InputDelay": np.zeros(2), "TimeUnit": "seconds"}
    scipy.io.savemat(tmp_path / "a.mat", {"G": {"A": A, "B": B, "C": C, "D": D, "Ts": 0.1, **plain}})
    found = load_mat(tmp_path / "a.mat", variable="G")
    assert isinstance(found, Plant)
    assert [p.name for p in found.inputs] == ["u1", "u2"]
    same(found.sampled, SampledStateSpace(A, B, C, D, period_s=0.1))
    scipy.io.savemat(tmp_path / "b.mat", {"A": A, "B": B, "C": C, "D": D, "InputName": "torque"})
    with pytest.raises(DataError, match="1 names and 1 units for 2 inputs"):
        load_mat(tmp_path / "b.mat", period_s=0.0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"A": None}, "no A; there is B, C, D, Ts"),
        ({"A": np.array([[1j]])}, "A: complex numbers"),
        ({"A": np.array([[np.inf]])}, "A: a number is not finite"),
        ({"B": np.ones((2, 1))}, "B has shape (2, 1)"),
        ({"Ts": None}, "Ts: its time base is open"),
        ({"Ts": -1.0}, "Ts: its time base is sampled, of no period"),
        ({"Ts": -2.0}, "a sampling period of -2 s"),
        ({"E": np.array([[2.0]])}, "E: a descriptor matrix"),
        ({"InputDelay": np.array([0.01, 0.02])}, "InputDelay: delays of shape (1, 2)"),
        ({"OutputDelay": 2.0, "Ts": 0.1}, "OutputDelay: a delay of a sampled system"),
        ({"IODelay": 0.01, "Kind": "compensator"}, "IODelay: a delay of a compensator"),
        ({"InternalDelay": np.array([0.0, 0.01])}, "InternalDelay: a delay"),
        ({"TimeUnit": "minutes"}, "TimeUnit: time in minutes"),
        ({"Kind": "law"}, "Kind: 'law' is no kind"),
        ({"Kind": "compensator", "Feedback": "Negative"}, "Feedback: a feedback of 'Negative'"),
        ({"Feedback": "negative"}, "Feedback: a feedback of 'negative' for a system"),
        ({"Kind": "plant", "u": np.array(["motor"], dtype=object)}, "no input named 'motor'"),
    ],
)
def test_a_mat_file_that_is_no_system(changes: dict[str, Any], says: str, tmp_path: Path) -> None:
    good: dict[str, Any] = dict(zip("ABCD", np.ones((4, 1, 1)), strict=True)) | {"Ts": 0.0}
    file = tmp_path / "x.mat"
    scipy.io.savemat(file, {k: v for k, v in (good | changes).items() if v is not None})
    with pytest.raises(DataError) as refused:
        load_mat(file)
    assert says in str(refused.value)
    assert str(file) in str(refused.value)


def test_a_mat_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        load_mat(tmp_path / "missing.mat")
    (tmp_path / "text.mat").write_text("no MAT file")
    with pytest.raises(DataError, match="not a MAT file"):
        load_mat(tmp_path / "text.mat")


@pytest.mark.parametrize("begin", [b"# Created by Octave 9.2.0\n", b"Octave-1-L\0", b"\x89HDF\r\n\x1a\n"])
def test_what_octave_writes_unless_told_otherwise(tmp_path: Path, begin: bytes) -> None:
    (tmp_path / "law.mat").write_bytes(begin + bytes(200))
    with pytest.raises(DataError, match="not a MAT file") as refused:
        load_mat(tmp_path / "law.mat")
    assert "-v7" in refused.value.hint


def test_a_mat_file_without_a_system_gets_the_hint_what_to_save(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    scipy.io.savemat(tmp_path / "law.mat", {"K": np.eye(2)})
    ended = middeck(capfd, "qualify", tmp_path / "law.mat", "articles/mace-simple.toml")
    assert ended.code == 4
    assert "D = K.D" in ended.err


# what is asked of all three


@pytest.mark.parametrize("convert", [to_scipy, exchanged])
def test_what_cannot_be_exchanged(convert: Any) -> None:
    with pytest.raises(ConfigError, match="a plant with exact delays") as refused:
        convert(delay_plant(plant(), 0.01))
    assert "approximate_delays" in refused.value.hint
    with pytest.raises(ConfigError, match="turns the sign of a compensator"):
        convert(plant(), negative_feedback=True)
    with pytest.raises(ConfigError, match="D has a number that is not finite"):
        convert(gain_system(np.array([[np.nan]])))


def test_groups_are_checked_of_sampled_plants_too() -> None:
    with pytest.raises(ConfigError, match="no output named 'nowhere'"):
        group_ports(exchanged(tustin(plant().system, 0.01)), y=["nowhere"])


# python-control itself


def test_its_feedback_is_ours() -> None:
    """feedback(P, K, +1) with K = to_control(law), feedback(P, K) with the sign turned."""
    control = pytest.importorskip("control")
    from middeck.control.loop.closed_loop import close_loop

    made = law()
    whole = dataclasses.replace(plant(), w=("motor.z",), z=("payload angle", "payload_rate"))
    ours = np.sort_complex(close_loop(whole, made).poles)
    P = to_control(plant())[["payload angle", "payload_rate"], "motor·z"]
    for K, sign in ((to_control(made), 1), (to_control(made, negative_feedback=True), -1)):
        theirs = np.sort_complex(control.feedback(P, K, sign=sign).poles())
        # Two joins of the same matrices: rounding of eigenvalues of size 20.
        np.testing.assert_allclose(theirs, ours, atol=1e-9)


def test_its_transfer_functions_come_over() -> None:
    control = pytest.importorskip("control")
    system = from_control(control.tf([1.0, 3.0], [1.0, 0.2, 4.0], inputs="torque", outputs="angle"))
    assert [p.name for p in (*system.inputs, *system.outputs)] == ["torque", "angle"]
    np.testing.assert_allclose(
        np.linalg.eigvals(system.system.A), [-0.1 + 1.99750j, -0.1 - 1.99750j], rtol=1e-5
    )
    with pytest.raises(ConfigError, match="improper"):
        from_control(control.tf([1.0, 0.0, 0.0], [1.0, 1.0]))
    with pytest.raises(ConfigError, match="time base is open"):
        from_control(control.ss(-1.0, 1.0, 1.0, 0.0, None))


def test_a_delay_beside_a_plant_of_theirs_is_exact() -> None:
    matrices = [[-1.0, 2.0], [-2.0, -1.0]], np.eye(2), np.eye(2), np.zeros((2, 2))
    delay_s = np.array([[0.1, 0.2], [0.3, 0.0]])
    theirs = scipy.signal.StateSpace(*matrices)
    omega = 2.0 * np.pi * np.array([0.2, 3.0])
    G = np.array([np.linalg.inv(1j * w * np.eye(2) - theirs.A) * np.exp(-1j * w * delay_s) for w in omega])
    found = evaluate_plant(from_scipy(theirs, delay_s=delay_s), omega / (2.0 * np.pi)).H
    np.testing.assert_allclose(found, G, rtol=1e-12)
    for wrong in (-0.1, np.nan, np.zeros((1, 2))):
        with pytest.raises(ConfigError, match="delay"):
            from_scipy(theirs, delay_s=wrong)
    with pytest.raises(ConfigError, match="sampled"):
        from_scipy(scipy.signal.StateSpace(*matrices, dt=0.1), delay_s=0.2)


@pytest.mark.parametrize("version", [5, 7])
def test_sparse_matrices_of_a_mat_file(tmp_path: Path, version: int) -> None:
    """Another descriptor matrix than I is refused where it is sparse too, as it was not."""
    A, E = np.array([[0.0, 1.0], [-4.0, 0.0]]), np.diag([1.0, 2.0])
    others = {"B": np.array([[0.0], [1.0]]), "C": np.array([[1.0, 0.0]]), "D": np.zeros((1, 1))}
    path = tmp_path / "s.mat"

    def write(**sparse: np.ndarray) -> None:
        found = {name: sp.csc_array(matrix) for name, matrix in sparse.items()}
        if version == 5:
            return scipy.io.savemat(path, {**others, **found, "Ts": 0.0})
        with h5py.File(path, "w", userblock_size=512) as archive:
            for name, matrix in {**others, "Ts": np.zeros((1, 1))}.items():
                archive.create_dataset(name, data=matrix.T).attrs["MATLAB_class"] = np.bytes_("double")
            for name, matrix in found.items():
                group = archive.create_group(name)
                group.attrs["MATLAB_sparse"] = np.uint64(matrix.shape[0])
                for key, value in (("data", matrix.data), ("ir", matrix.indices), ("jc", matrix.indptr)):
                    group[key] = value
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")

    write(A=A)
    np.testing.assert_array_equal(load_mat(path).dynamics.A, A)
    write(A=A, E=E)
    with pytest.raises(DataError, match="a descriptor matrix E"):
        load_mat(path)
    if version == 5:
        scipy.io.savemat(path, {"sys": {**others, "A": sp.csc_array(A), "Ts": 0.0}})
        with pytest.raises(DataError) as error:
            load_mat(path)
        assert error.value.hint == "variable='sys'"
        np.testing.assert_array_equal(load_mat(path, variable="sys").dynamics.A, A)

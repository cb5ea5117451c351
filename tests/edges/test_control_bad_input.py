"""What is wrong with the input of a design or an analysis is named, with what to try."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import ROOT, middeck
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.h2.law_form import LawForm
from middeck.control.law.compensator import Compensator
from middeck.control.law.pd_loops import PDLoops, close_inner_loop
from middeck.control.law.uncertainty import ModeShift, Uncertainty
from middeck.control.loop.authority import sweep_authority
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.qualification import qualify_compensator
from middeck.control.reduction.modal import reduce_modes
from middeck.control.reduction.reduced_compensators import reduce_compensator
from middeck.control.robust.designs.multimodel import design_multimodel
from middeck.control.robust.designs.popov import design_popov
from middeck.control.robust.designs.sensitivity_weighted import design_sensitivity_weighted
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError, MiddeckError, NotStabilisableError
from middeck.files.exchange.scipy_signal import from_scipy
from middeck.files.measured.models import write_model
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.laboratory.rig.rig import build_rig
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant, delay_plant
from middeck.systems.plants.plant_from_matrices import make_plant
from middeck.systems.sampling.sampled_plant import sample_plant
from middeck.systems.sampling.sampling import sample_dynamics
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import gain_system
from plant_builders import grouped_plant, sum_of_modes

TORQUE, ANGLE = Port("torque", "N m"), Port("angle", "rad")
GOOD: dict[str, Any] = {
    "output": [1.0],
    "input": [1.0],
    "disturbed": ("torque",),
    "process": [[1e-4]],
    "sensor": [4e-10],
}
APART = Uncertainty(shifts=(ModeShift(("c",), 0.02),))
DESIGNS: dict[str, Callable[[Any, LQGWeights, float], Any]] = {
    "LQG": design_lqg,
    "sampled": lambda plant, weights, authority: design_sampled_lqg(plant, weights, authority, 0.004),
    "multi-model": lambda *given: design_multimodel(*given, uncertainty=APART),
    "sensitivity": lambda *given: design_sensitivity_weighted(*given, uncertainty=APART),
    "Popov": lambda *given: design_popov(*given, uncertainty=APART),
}
ROBUST = ("multi-model", "sensitivity", "Popov")
each_design = pytest.mark.parametrize("method", DESIGNS)


def plant(
    hz: tuple[float, ...] = (2.0, 5.0, 9.0),
    psi: tuple[float, ...] = (1.0, 0.7, 1.2),
    phi: tuple[float, ...] = (1.0, -0.6, 0.8),
    zeta: tuple[float, ...] = (0.01, 0.01, 0.01),
) -> Plant:
    """Three modes, "a", "b" and "c", from a torque to an angle."""
    modal = sum_of_modes(
        2.0 * np.pi * np.array(hz),
        np.where(np.array(hz) > 0.0, zeta, 0.0),
        np.array(psi)[:, None],
        np.array([phi]),
    )
    return grouped_plant(modal, (TORQUE,), (ANGLE,))


def refused(run: Callable[[], Any], kind: type[MiddeckError], says: str) -> MiddeckError:
    """The error of ``run``, which must say what to try."""
    with pytest.raises(kind, match=says) as error:
        run()
    assert error.value.hint, f"nothing to try: {error.value}"
    return error.value


# a plant that no controller can stabilise


@each_design
@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ({"hz": (0.0, 5.0, 9.0), "psi": (0.0, 0.7, 1.2)}, "no control input in u reaches it"),
        ({"hz": (0.0, 5.0, 9.0), "phi": (0.0, -0.6, 0.8)}, "no measurement in y sees it|cost .* misses it"),
        ({"zeta": (-0.01, 0.01, 0.01), "psi": (0.0, 0.7, 1.2)}, "no control input in u reaches it"),
        ({"zeta": (-0.01, 0.01, 0.01), "phi": (0.0, -0.6, 0.8)}, "no measurement in y sees it|misses it"),
    ],
)
def test_the_mode_that_cannot_be_held_is_named(method: str, kind: dict[str, Any], says: str) -> None:
    error = refused(
        lambda: DESIGNS[method](plant(**kind), LQGWeights(**GOOD), 1e3), NotStabilisableError, says
    )
    assert "does not decay: a" in error.what
    assert error.data["modes"] == ("a",)


def test_the_command_line_names_it_too(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Free in space, driven by the torque between two bodies: all of it turns together, unheld."""
    ended = middeck(
        capfd, "design", ROOT / "articles" / "mace-dm.toml", "--environment", "orbit", "--count", 12,
        "--control", "pri_rel_z", "--measure", "pri_in_z",
    )  # fmt: skip
    assert ended.code == 5
    assert "does not decay: rotation z" in ended.err
    assert "  try: " in ended.err


# weights


@each_design
@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"output": [1.0, 1.0]}, r"2 output weights for 1 ports \(angle\)"),
        ({"input": [1.0, 1.0]}, r"2 input weights for 1 ports \(torque\)"),
        ({"sensor": [1.0, 1.0]}, r"2 sensor intensities for 1 ports \(angle\)"),
        ({"disturbed": ("wind",)}, "no input named 'wind'"),
    ],
)
def test_weights_that_do_not_fit_the_plant(method: str, changes: dict[str, Any], says: str) -> None:
    refused(lambda: DESIGNS[method](plant(), LQGWeights(**(GOOD | changes)), 1e3), ConfigError, says)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"process": np.eye(2)}, "1 disturbed inputs for 2 intensities"),
        ({"input": [-1.0]}, "input weight is not positive"),
        ({"input": [0.0]}, "input weight is not positive"),
        ({"process": [[-1.0]]}, "not symmetric and positive semidefinite"),
        (
            {"process": [[1.0, 2.0], [2.0, 1.0]], "disturbed": ("torque", "torque")},
            "not symmetric and positive semidefinite",
        ),
        (
            {"process": [[1.0, 0.5], [0.0, 1.0]], "disturbed": ("torque", "torque")},
            "not symmetric and positive semidefinite",
        ),
        ({"sensor": [0.0]}, "sensor noise intensity is not positive"),
        ({"sensor": [-1.0]}, "sensor noise intensity is not positive"),
        ({"output": [np.nan]}, "not a finite number"),
        ({"process": [[np.inf]]}, "not a finite number"),
    ],
)
def test_weights_that_are_none(changes: dict[str, Any], says: str) -> None:
    refused(lambda: LQGWeights(**(GOOD | changes)), ConfigError, says)


@pytest.mark.parametrize("method", ROBUST)
@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"process": [[0.0]]}, "nothing disturbs the plant"),
        ({"output": [0.0]}, "the cost has no output"),
    ],
)
def test_a_robust_design_with_no_cost(method: str, changes: dict[str, Any], says: str) -> None:
    refused(lambda: DESIGNS[method](plant(), LQGWeights(**(GOOD | changes)), 1e3), ConfigError, says)


@each_design
@pytest.mark.parametrize("authority", [0.0, -1.0, np.nan, np.inf])
def test_an_authority_that_is_none(method: str, authority: float) -> None:
    refused(
        lambda: DESIGNS[method](plant(), LQGWeights(**GOOD), authority),
        ConfigError,
        f"authority is {authority}",
    )


# delays and sampling


@pytest.mark.parametrize("period_s", [0.0, -0.01, np.nan, np.inf])
def test_a_period_that_is_none(period_s: float) -> None:
    weights = LQGWeights(**GOOD)
    refused(lambda: design_sampled_lqg(plant(), weights, 1e3, period_s), ConfigError, "sampling period of")
    refused(lambda: sample_plant(plant(), period_s), ConfigError, "sampling period of")
    if not period_s > 0.0:
        refused(lambda: sample_dynamics(plant().dynamics, period_s), ConfigError, "a period of")


def test_a_delay_against_a_sample_period() -> None:
    """Seconds taken for milliseconds would be 2500 states; a total delay is no less than the hold's own."""
    weights = LQGWeights(**GOOD)
    delayed = delay_plant(plant(), 10.0)
    refused(
        lambda: design_sampled_lqg(delayed, weights, 1e3, 0.004),
        ConfigError,
        "10 s is 2500 periods of 0.004 s",
    )
    refused(lambda: delay_plant(plant(), -0.1), ConfigError, "or one is negative")
    refused(
        lambda: build_rig(plant(), sample_hz=100.0, delay_s=1e-3),
        ConfigError,
        "less than hold and filters take, 0.005 s",
    )


# ports and compensators


def test_ports_that_do_not_exist() -> None:
    weights = LQGWeights(**GOOD)
    made = design_lqg(plant(), weights, 1e3)
    other = dataclasses.replace(plant(), inputs=(Port("motor", "N m"),), w=(), u=("motor",))
    for run in (
        lambda: close_loop(other, made),
        lambda: measure_margins(other, made),
        lambda: qualify_compensator(made, {"other": other}, weights),
    ):
        error = refused(run, ConfigError, "torque")
        assert "motor" in error.hint
    refused(lambda: dataclasses.replace(plant(), y=("nose",)), ConfigError, "no output named 'nose'")
    refused(lambda: close_inner_loop(plant(), PDLoops(("neck",), [1.0], [1.0])), ConfigError, "'neck'")
    shifted = Uncertainty(shifts=(ModeShift(("q",), 0.02),))
    refused(
        lambda: design_multimodel(plant(), weights, 1e3, uncertainty=shifted),
        ConfigError,
        "no mode named 'q'",
    )


def test_an_improper_compensator_and_a_loop_without_a_solution() -> None:
    scipy_signal = pytest.importorskip("scipy.signal")
    refused(
        lambda: from_scipy(scipy_signal.ZerosPolesGain([-1.0, -2.0], [-3.0], 1.0)), ConfigError, "improper"
    )
    modal = plant().dynamics
    assert isinstance(modal, ModalSystem)
    direct = dataclasses.replace(plant(), dynamics=dataclasses.replace(modal, direct=[[1.0]]))
    gain = Compensator(gain_system([[1.0]]), (ANGLE,), (TORQUE,))
    refused(lambda: close_loop(direct, gain), ConfigError, "through the direct terms has no solution")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--control", "nowhere"], "nowhere"),
        (["--log10-authority", "nan"], "--log10-authority = nan"),
        (["--angle-noise", "0"], "angle_noise"),
        (["--disturbance", "-1"], "disturbance"),
        (["--pade-order", "0"], "--pade-order = 0"),
    ],
)
def test_the_options_of_design(
    arguments: list[str], says: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    zero = np.zeros((1, 1))
    omega = 2.0 * np.pi * np.array([2.0])
    model = MeasurementModel(
        poles=omega * (-0.01 + 1j),
        shapes=np.array([[1.0]]) / (2j * omega),
        participation=np.ones((1, 1)),
        direct=zero,
        lower=zero,
        delay_s=np.zeros(1),
        inputs=(TORQUE,),
        outputs=(ANGLE,),
    )
    write_model(tmp_path / "model.json", model)
    ended = middeck(capfd, "design", tmp_path / "model.json", *arguments)
    assert ended.code == 2
    assert says in ended.err


# one name where several are asked for


@pytest.mark.parametrize(
    "use",
    [
        lambda: ModeShift("9 Hz", 0.02),
        lambda: LQGWeights(**(GOOD | {"disturbed": "torque"})),
        lambda: dataclasses.replace(plant(), z="angle"),
        lambda: plant().input_indices("torque"),
    ],
)
def test_a_text_is_no_tuple_of_names(use: Callable[[], Any]) -> None:
    refused(use, ConfigError, "is one name, not a tuple of names")


def test_a_plant_without_groups_is_advised_to_name_them() -> None:
    bare = dataclasses.replace(plant(), w=(), u=(), z=(), y=())
    refused(
        lambda: design_lqg(bare, LQGWeights(**GOOD), 1e3), ConfigError, "that group of the plant is empty"
    )


def test_a_sweep_needs_something_to_compare_with() -> None:
    band = Performance(np.ones(1), np.eye(1), (0.0, 5.0))
    sweep = partial(sweep_authority, lambda a: design_lqg(plant(), LQGWeights(**GOOD), a), np.ones(1))
    refused(lambda: sweep(on={"p": plant()}, performance=band, reference=0.0), ConfigError, "reference = 0")


def static_plant() -> Plant:
    """A gain of two on the measurement; what is disturbed is not felt."""
    ports = {"inputs": ["w", "u"], "outputs": ["z", "y"], "w": ["w"], "u": ["u"], "z": ["z"], "y": ["y"]}
    return make_plant(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((2, 0)), [[0, 1], [0, 2]], **ports)


@pytest.mark.parametrize(
    "design",
    [
        lambda p, w: design_lqg(p, w, 1.0),
        lambda p, w: design_sampled_lqg(p, w, 1.0, 0.1),
        lambda p, w: design_multimodel(p, w, 1.0, uncertainty=Uncertainty(shifts=()), form=LawForm(order=1)),
    ],
)
def test_a_plant_without_states_has_nothing_to_design_for(design: Callable[..., Any]) -> None:
    weights = LQGWeights(**(GOOD | {"disturbed": ("w",)}))
    refused(lambda: design(static_plant(), weights), ConfigError, "nothing to design for")


def test_what_has_no_states_is_not_told_to_keep_some() -> None:
    gain = Compensator(gain_system(np.eye(1)), static_plant().outputs[1:], static_plant().inputs[1:])
    refused(lambda: reduce_compensator(gain, static_plant(), 1), ConfigError, "it needs no reduction")
    refused(lambda: reduce_modes(static_plant(), 1, band_hz=(0.0, 1.0)), ConfigError, "it needs no reduction")

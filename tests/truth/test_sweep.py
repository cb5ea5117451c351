"""The default robustness sweep: its cases, and loops closed by hand in each of them."""

import json
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import middeck
from middeck.control.law.compensator import Compensator
from middeck.control.lqg.design import design_lqg
from middeck.control.lqg.weights import LQGWeights
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.errors import ConfigError
from middeck.files.laws.compensators import write_compensator
from middeck.files.measured.models import write_model
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.plants.measured_plant import measured_plant
from middeck.signals.ports import Channel, Port
from middeck.structure.modes.results.dispersed_modes import dispersed_modes
from middeck.systems.plants.dispersed_frequencies import DispersedModes, Dispersion, dispersed_factors
from repeats import repeats

HZ = np.array([1.7, 7.0, 9.0])
GAIN = np.array([1.0, -0.42, 0.96])
ZETA = 0.01
NAMES = ("pole at 1.7 Hz", "pole at 7 Hz", "pole at 9 Hz")
TORQUE, ANGLE = Port("torque", "N m"), Port("angle", "rad", Channel(node="7"))
GROUPS = {"w": ("torque",), "u": ("torque",), "z": ("angle",), "y": ("angle",)}
WEIGHTS = LQGWeights(output=[1.0], input=[1.0], disturbed=("torque",), process=[[1e-4]], sensor=[4e-10])


def model() -> MeasurementModel:
    """Sum of GAIN / (s^2 + 2 zeta omega s + omega^2)."""
    damped = 2.0 * np.pi * HZ * np.sqrt(1.0 - ZETA**2)
    zero = np.zeros((1, 1))
    return MeasurementModel(
        poles=2.0 * np.pi * HZ * (-ZETA + 1j * np.sqrt(1.0 - ZETA**2)),
        shapes=(GAIN / (2j * damped))[None],
        participation=np.ones((3, 1)),
        direct=zero,
        lower=zero,
        delay_s=np.zeros(1),
        inputs=(TORQUE,),
        outputs=(ANGLE,),
    )


def grows(law: Compensator, factors: np.ndarray) -> bool:
    """The loop of the law and the three oscillators, frequencies times ``factors``, written out."""
    omega = 2.0 * np.pi * HZ * factors
    plant = np.zeros((6, 6))
    plant[:3, 3:] = np.eye(3)
    plant[3:, :3], plant[3:, 3:] = np.diag(-(omega**2)), np.diag(-2.0 * ZETA * omega)
    push, read = np.concatenate([np.zeros(3), np.ones(3)])[:, None], np.concatenate([GAIN, np.zeros(3)])[None]
    system = law.system
    whole = np.block([[plant, push @ system.C], [system.B @ read, system.A]])
    return bool(np.linalg.eigvals(whole).real.max() > 0.0)


def test_cases_are_each_mode_alone_and_the_four_together():
    found = dispersed_factors(DispersedModes(first_bending=("a", "b"), others=("c",)))
    alone = {"a": (0.9, 1.1), "b": (0.9, 1.1), "c": (0.8, 1.2)}
    assert [f for f in found.values() if len(f) == 1] == [{n: x} for n, both in alone.items() for x in both]
    together = [(f["a"], f["b"], f["c"]) for f in found.values() if len(f) == 3]
    assert together == [(0.9, 0.9, 0.8), (0.9, 0.9, 1.2), (1.1, 1.1, 0.8), (1.1, 1.1, 1.2)]
    assert len(found) == 10


@pytest.mark.parametrize(
    ("first", "others", "sweep", "count"),
    [
        (("a",), (), Dispersion(), 2),
        (("a", "b"), (), Dispersion(), 6),
        ((), ("a", "b", "c"), Dispersion(), 8),
        (("a",), ("b", "c"), Dispersion(first_bending=0.0), 6),
        (("a",), ("b",), Dispersion(first_bending=0.0, others=0.0), 0),
        ((), (), Dispersion(), 0),
    ],
)
def test_what_is_not_shifted_is_in_no_case(
    first: tuple[str, ...], others: tuple[str, ...], sweep: Dispersion, count: int
):
    found = dispersed_factors(DispersedModes(first_bending=first, others=others), sweep)
    assert len(found) == count
    assert all(x != 1.0 for factors in found.values() for x in factors.values())


@pytest.mark.parametrize("share", [1.0, -0.1, float("nan")])
def test_a_sweep_beyond_its_range_is_refused(share: float):
    with pytest.raises(ConfigError, match="from 0 to below 100"):
        Dispersion(others=share)


@pytest.mark.parametrize("place", ["lab", "orbit"])
def test_first_bending_of_an_article_is_that_of_both_planes(place: str):
    article, lab = md.load_setup("articles/mace-dm.toml", "environments/lab.toml")
    environment = lab if place == "lab" else md.Environment.orbit()
    modes = md.solve_modes(md.solve_equilibrium(article, environment))
    found = dispersed_modes(modes, 14)
    assert set(found.first_bending) == {"first bending x-y", "first bending x-z"}
    flexible = {modes.name[i] for i in range(14) if modes.kind[i] == "flexible"}
    assert {*found.first_bending, *found.others} == flexible
    assert not set(found.first_bending) & set(found.others)


@pytest.mark.parametrize("authority", repeats([1e8, 1e6, 1e4]))
def test_stability_in_every_case_is_that_of_loops_closed_by_hand(
    authority: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    law = design_lqg(measured_plant(model(), **GROUPS), WEIGHTS, authority)
    write_compensator(tmp_path / "law.json", law)
    write_model(tmp_path / "model.json", model())
    command = ("qualify", tmp_path / "law.json", tmp_path / "model.json", "--sweep")
    refused = middeck(capfd, *command)
    assert refused.code == 2
    assert "does not say which of its modes is the first bending" in refused.err
    rows = json.loads(middeck(capfd, *command, "--first-bending", "1:2", "--json").out)["rows"]
    by_hand = [np.ones(3)]
    for k, by in enumerate((0.1, 0.2, 0.2)):
        by_hand += [np.where(np.arange(3) == k, 1.0 + sign * by, 1.0) for sign in (-1.0, 1.0)]
    for a in (0.9, 1.1):
        by_hand += [np.array([a, b, b]) for b in (0.8, 1.2)]
    assert [row["stable"] for row in rows] == [not grows(law, factors) for factors in by_hand]
    assert rows[1]["plant"] == f"model, {NAMES[0]} -10 %"
    assert rows[-1]["plant"] == "model, first bending +10 %, others +20 %"


def test_the_gate_closes_the_loop_in_every_case(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    law = design_sampled_lqg(measured_plant(model(), **GROUPS), WEIGHTS, 1e4, 0.004)
    write_compensator(tmp_path / "law.json", law)
    write_model(tmp_path / "model.json", model())
    made = middeck(capfd, "generate", tmp_path / "law.json", "--without-applied", "-o", tmp_path / "law.mdk")
    assert made.code == 0, made.err
    command = ("gate", tmp_path / "law.mdk", tmp_path / "model.json", "--gain-db", "0", "--phase-deg", "0")
    alone = json.loads(middeck(capfd, *command, "--json").out)
    swept = json.loads(middeck(capfd, *command, "--sweep", "--first-bending", "1:2", "--json").out)
    assert len(swept["models"]) == 11 * len(alone["models"])

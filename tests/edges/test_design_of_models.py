"""``middeck design`` for a fitted model: the states of its path alone, delays, and what is refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli_runner import middeck
from middeck.files.measured.models import write_model
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.identification.uncertainty.covariance import ModelCovariance
from middeck.identification.uncertainty.model_unknowns import ModelStructure, places_of
from middeck.signals.ports import Port

Capture = pytest.CaptureFixture[str]
INPUTS, OUTPUTS = tuple(Port(f"u{i}", "N") for i in range(2)), tuple(Port(f"y{o}", "m") for o in range(3))
PATH = ("--control", "u0", "--measure", "y0", "--log10-authority", 2)
ALL = ("--control", "u0,u1", "--measure", "y0,y1,y2", "--log10-authority", 2)


def fit(*, late_s: float = 1e-6, **changes: Any) -> ModelCovariance:
    """Two modes on all paths at 2 and 5 Hz, one at 9 Hz that only u1 moves; delays known to 5 us."""
    omega = 2.0 * np.pi * np.array([2.0, 5.0, 9.0])
    poles = omega * (-0.01 + 1j)
    zero = np.zeros((3, 2))
    model = MeasurementModel(
        poles=poles,
        shapes=np.array([[1.0, 0.8, 0.5], [-0.6, 1.0, 0.9], [0.4, -0.7, 1.0]]) / (2j * omega),
        participation=np.array([[1.0, 0.5], [0.7, -1.0], [0.0, 1.0]]),
        direct=zero,
        lower=zero,
        delay_s=8e-3 + late_s * np.arange(3),
        inputs=INPUTS,
        outputs=OUTPUTS,
    )
    model = dataclasses.replace(model, **changes)
    structure = ModelStructure(real_constants=True, with_delay=True, with_lower=False, with_direct=False)
    at = places_of(model, structure)
    variance = np.full(at.size, 1e-6)
    variance[at.delay] = 2.5e-11
    return ModelCovariance(
        model=model,
        structure=structure,
        root=np.diag(np.sqrt(variance)),
        inflation=np.ones(at.size),
        degrees=np.inf,
        robust=False,
    )


def saved(tmp_path: Path, of: ModelCovariance, *, known: bool = True) -> Path:
    write_model(tmp_path / "model.json", of.model, of if known else None)
    return tmp_path / "model.json"


def design(capfd: Capture, *arguments: Any) -> dict[str, Any]:
    ended = middeck(capfd, "design", *arguments, "--json")
    assert ended.code == 0, ended.err
    return json.loads(ended.out)


def test_a_path_needs_its_own_states_alone(tmp_path: Path, capfd: Capture) -> None:
    found = design(capfd, saved(tmp_path, fit()), *PATH)
    # Two of the three modes and one delay of order three.
    assert found["plant_order"] == 4 + 3
    assert found["stable"] is True
    assert found["warnings"] == ["left out of the plant, as it is on no path from u0 to y0: pole at 9 Hz"]


def test_a_constant_term_is_refused_with_the_fit_that_has_none(tmp_path: Path, capfd: Capture) -> None:
    ended = middeck(capfd, "design", saved(tmp_path, fit(direct=np.ones((3, 2))), known=False), *PATH)
    assert ended.code == 2
    assert "constant term from u0 to y0" in ended.err
    assert "--states N" in ended.err


def test_delays_that_are_not_distinguished_cost_one_approximation(tmp_path: Path, capfd: Capture) -> None:
    model = saved(tmp_path, fit())
    found = design(capfd, model, *ALL)
    # Two inputs, three outputs: the delay goes to the inputs.
    assert found["plant_order"] == 6 + 2 * 3
    assert len(found["warnings"]) == 1
    assert found["warnings"][0].startswith(
        "delays not told apart by their deviations are taken as one of 8.001"
    )
    assert "delays not told apart" in middeck(capfd, "design", model, *ALL).err


def test_several_delays_get_the_hint_what_would_save_their_states(tmp_path: Path, capfd: Capture) -> None:
    for of, known in ((fit(), False), (fit(late_s=2e-3), True)):
        found = design(capfd, saved(tmp_path, of, known=known), *ALL)
        # A common one at the two inputs, one more at each of two outputs.
        assert found["plant_order"] == 6 + 4 * 3
        assert found["warnings"] == [
            "3 different delays, each approximated by 3 states; "
            "if there is only one, fit one: identify --delay common"
        ]


def test_a_design_that_fails_beside_fast_poles_says_so(tmp_path: Path, capfd: Capture) -> None:
    """Delays 1 ps apart without a covariance: poles beyond 1e12 Hz at order six."""
    model = saved(tmp_path, fit(late_s=1e-12), known=False)
    ended = middeck(capfd, "design", model, *ALL, "--pade-order", 6)
    assert ended.code == 5
    assert str(model) in ended.err
    assert "the fastest of them of approximated delays" in ended.err
    assert "try: --pade-order 3, or a common delay (identify --delay common)" in ended.err


def test_a_sampled_model_is_refused_by_the_verb_that_makes_another(tmp_path: Path, capfd: Capture) -> None:
    sampled = fit(sample_hz=100.0, delay_s=np.zeros(3))
    ended = middeck(capfd, "design", saved(tmp_path, sampled, known=False), *PATH)
    assert ended.code == 2
    assert "the model is sampled, at 100 Hz" in ended.err
    assert "try: middeck identify RECORD... --continuous -o MODEL.json" in ended.err


@pytest.mark.parametrize("kind", ["pole", "rigid"])
def test_what_does_not_decay_is_never_left_out(kind: str, tmp_path: Path, capfd: Capture) -> None:
    of = fit(late_s=0.0)
    poles = of.model.poles.copy()
    poles[2] = 0.2 + 56j
    rigid = np.array([[0.0, 1.0], [0.0, 0.5], [0.0, 1.0]])
    model = dataclasses.replace(of.model, **({"poles": poles} if kind == "pole" else {"rigid": rigid}))
    file = tmp_path / "model.json"
    write_model(file, model)
    ended = middeck(capfd, "design", file, *PATH)
    assert ended.code == 5
    assert "does not decay" in ended.err
    assert ("pole at 8.9" if kind == "pole" else "rigid-body mode 1") in ended.err

"""A sampled law is no continuous one, and a late plant none without delays: asked before computing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import middeck as md
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.modal import ModalSystem
from middeck.systems.plant import Plant

MODES = ModalSystem([3.0, 9.0], [0.01, 0.01], [[1.0], [0.5]], [[1.0, 0.5]], [[0.0, 0.0]], ("a", "b"))
GROUPS = ("u",), ("u",), ("y",), ("y",)
PLANT = Plant(MODES, (Port("u", "N"),), (Port("y", "m"),), *GROUPS)
LATE = md.delay_inputs(PLANT, 0.02)
WEIGHTS = md.LQGWeights(np.ones(1), np.ones(1), ("u",), np.eye(1), np.array([1e-4]))
LAW = md.design_lqg(PLANT, WEIGHTS, 10.0)
SAMPLED = md.emulate(LAW, 0.05)
BAND = md.Performance(np.ones(1), np.eye(1), (0.0, 5.0))
BOX = md.Uncertainty((md.ModeShift(("a",), 0.02),))
HERE = np.zeros((1, 1))


@pytest.mark.parametrize("plant", [PLANT, LATE])
@pytest.mark.parametrize(
    "judge",
    [
        md.measure_margins,
        md.decide_stability,
        md.measure_disk_margin,
        md.trace_return_ratio,
        md.find_allowed_shifts,
        md.find_inversion,
        lambda p, law: md.measure_delayed_rms(p, law, BAND),
        lambda p, law: md.verify_robustness(p, law, WEIGHTS, uncertainty=BOX, positions=HERE),
        lambda p, law: md.find_worst_case(p, law, BOX),
        lambda p, law: md.reduce_compensator(law, p, 2),
    ],
)
def test_a_sampled_law_is_not_judged_as_a_continuous_one(judge: Callable[..., Any], plant: Any) -> None:
    with pytest.raises(ConfigError, match="a law sampled at 20 Hz"):
        judge(plant, SAMPLED)


@pytest.mark.parametrize(
    "use",
    [
        lambda: md.close_loop(PLANT, SAMPLED),
        lambda: md.measure_control_rms(PLANT, SAMPLED, BAND),
        lambda: md.shape_compensator(SAMPLED, md.roll_off(1.0)),
        lambda: md.emulate(SAMPLED, 0.05),
    ],
)
def test_nor_used_as_one(use: Callable[[], Any]) -> None:
    with pytest.raises(ConfigError, match="a law sampled at 20 Hz"):
        use()


@pytest.mark.parametrize(
    "use",
    [
        lambda: md.measure_sampled_margins(PLANT, LAW),
        lambda: md.measure_sampled_loop(PLANT, LAW, WEIGHTS, 1.0),
        lambda: md.measure_margins(md.build_sampled_plant(LATE, 0.05), LAW),
    ],
)
def test_a_continuous_law_is_not_run_by_a_computer(use: Callable[[], Any]) -> None:
    with pytest.raises(ConfigError, match="a continuous law"):
        use()


@pytest.mark.parametrize(
    "use",
    [
        lambda: md.design_lqg(LATE, WEIGHTS, 1.0),
        lambda: md.design_filter(LATE, WEIGHTS),
        lambda: md.close_loop(LATE, LAW),
        lambda: md.leave_open(LATE),
        lambda: md.measure_control_rms(LATE, LAW, BAND),
        lambda: md.close_inner_loop(LATE, md.PDLoops(("u",), np.ones(1), np.ones(1))),
        lambda: md.colour_disturbances(LATE, (("u", md.line_filter(1.0, 0.1, 1.0)),)),
        lambda: md.reduce_modes(LATE, 1, band_hz=(0.1, 1.0)),
    ],
)
def test_a_late_plant_is_not_taken_for_one_without_delays(use: Callable[[], Any]) -> None:
    with pytest.raises(ConfigError, match="a plant with exact delays"):
        use()


def test_a_sampled_plant_goes_with_a_sampled_law_by_name() -> None:
    by_name = md.measure_margins(md.build_sampled_plant(LATE, 0.05), SAMPLED)
    direct = md.measure_sampled_margins(LATE, SAMPLED)
    assert by_name.loops[0].channel == direct.loops[0].channel == "u"
    assert by_name.stable == direct.stable
    np.testing.assert_allclose(by_name.loops[0].gain, direct.loops[0].gain, rtol=1e-9)
    with pytest.raises(ConfigError, match="a sampled plant"):
        md.design_lqg(md.build_sampled_plant(PLANT, 0.05), WEIGHTS, 1.0)

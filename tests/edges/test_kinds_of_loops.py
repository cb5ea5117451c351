"""One verdict whatever the time domain and the delay; what knows only one of them refuses the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import middeck as md
from middeck.control.lqg.disturbance_spectra import colour_disturbances, line_filter
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant
from plant_builders import sum_of_modes, unit_weights

MODES = sum_of_modes([3.0, 9.0], 0.01, [[1.0], [0.5]], [[1.0, 0.5]])
GROUPS = {"w": ("u",), "u": ("u",), "z": ("y",), "y": ("y",)}
PLANT = Plant(dynamics=MODES, inputs=(Port("u", "N"),), outputs=(Port("y", "m"),), **GROUPS)
LATE = md.delay_plant(PLANT, 0.02)
WEIGHTS = unit_weights(("u",), 1e-4)
LAW = md.design_lqg(PLANT, WEIGHTS, 10.0)
SAMPLED = md.emulate(LAW, 0.05)
BAND = md.Performance(np.ones(1), np.eye(1), (0.0, 5.0))
BOX = md.Uncertainty(shifts=(md.ModeShift(("a",), 0.02),))
HERE = np.zeros((1, 1))


@pytest.mark.parametrize("plant", [PLANT, LATE])
def test_a_sampled_law_meets_the_plant_as_its_computer_does(plant: Plant) -> None:
    held = md.sample_plant(plant, 0.05)
    assert md.decide_stability(plant, SAMPLED) == md.decide_stability(held, SAMPLED)
    assert md.control.measure_disk_margin(plant, SAMPLED) == md.control.measure_disk_margin(held, SAMPLED)
    here, there = (md.measure_margins(p, SAMPLED).loops[0] for p in (plant, held))
    np.testing.assert_array_equal(here.gain, there.gain)
    assert here.delay_s is not None
    assert there.delay_s is None
    hz = np.array([0.3, 2.0])
    one, other = (md.control.trace_return_ratio(p, SAMPLED, frequency_hz=hz).L for p in (plant, held))
    np.testing.assert_array_equal(one, other)
    worst = md.control.find_worst_case(plant, SAMPLED, BOX)
    moved = shift_modes(plant, {"a": 1.0 + 0.02 * float(worst.position[0])})
    assert worst.stability == md.decide_stability(moved, SAMPLED)
    inverted = md.control.find_inversion(plant, SAMPLED, within=10.0)
    assert [i.distance for i in inverted] == [
        i.distance for i in md.control.find_inversion(held, SAMPLED, within=10.0)
    ]


def test_a_mode_shifts_before_the_plant_is_sampled() -> None:
    law = md.emulate(LAW, 0.1)
    (a, b) = md.find_allowed_shifts(PLANT, law)
    ends = [(one.mode, end) for one in (a, b) for end in (one.down, one.up) if np.isfinite(end)]
    assert ends
    for mode, end in ends:
        for factor, stable in ((0.999, True), (1.001, False)):
            moved = shift_modes(PLANT, {mode: 1.0 + factor * end})
            assert md.decide_stability(md.sample_plant(moved, 0.1), law).stable == stable


@pytest.mark.parametrize("plant", [PLANT, LATE])
@pytest.mark.parametrize(
    "judge",
    [
        lambda p, law: md.measure_rms(p, law, BAND),
        lambda p, law: md.control.verify_robustness(p, law, WEIGHTS, uncertainty=BOX, positions=HERE),
        lambda p, law: md.reduce_compensator(law, p, 2),
    ],
)
def test_a_sampled_law_is_not_judged_as_a_continuous_one(judge: Callable[..., Any], plant: Any) -> None:
    with pytest.raises(ConfigError, match="a compensator sampled at 20 Hz"):
        judge(plant, SAMPLED)


@pytest.mark.parametrize(
    "use",
    [
        lambda: md.close_loop(PLANT, SAMPLED),
        lambda: md.shape_compensator(SAMPLED, md.control.roll_off(1.0)),
        lambda: md.emulate(SAMPLED, 0.05),
    ],
)
def test_nor_used_as_one(use: Callable[[], Any]) -> None:
    with pytest.raises(ConfigError, match="a compensator sampled at 20 Hz"):
        use()


@pytest.mark.parametrize(
    "use",
    [
        lambda: measure_sampled_loop(PLANT, LAW, WEIGHTS, 1.0),
        lambda: md.measure_margins(md.sample_plant(LATE, 0.05), LAW),
    ],
)
def test_a_continuous_law_is_not_run_by_a_computer(use: Callable[[], Any]) -> None:
    with pytest.raises(ConfigError, match="a continuous compensator"):
        use()


@pytest.mark.parametrize(
    "use",
    [
        lambda: md.design_lqg(LATE, WEIGHTS, 1.0),
        lambda: md.design_filter(LATE, WEIGHTS),
        lambda: md.close_loop(LATE, LAW),
        lambda: md.leave_open(LATE),
        lambda: md.close_inner_loop(LATE, md.PDLoops(("u",), np.ones(1), np.ones(1))),
        lambda: colour_disturbances(LATE, (("u", line_filter(1.0, 0.1, 1.0)),)),
        lambda: md.reduce_modes(LATE, 1, band_hz=(0.1, 1.0)),
    ],
)
def test_a_delayed_plant_is_not_taken_for_one_without_delays(use: Callable[[], Any]) -> None:
    with pytest.raises(ConfigError, match="a plant with exact delays"):
        use()


def test_a_sampled_plant_goes_with_a_sampled_law_by_name() -> None:
    by_name = md.measure_margins(md.sample_plant(LATE, 0.05), SAMPLED)
    direct = md.measure_margins(LATE, SAMPLED)
    assert by_name.loops[0].channel == direct.loops[0].channel == "u"
    assert by_name.stable == direct.stable
    np.testing.assert_allclose(by_name.loops[0].gain, direct.loops[0].gain, rtol=1e-9)
    with pytest.raises(ConfigError, match="a plant sampled at 20 Hz"):
        md.design_lqg(md.sample_plant(PLANT, 0.05), WEIGHTS, 1.0)

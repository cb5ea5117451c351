"""Margins of rational loops beside python-control (margins/make_margins.py)."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from middeck.control.analysis.margins.disk import measure_disk_margin
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.law.compensator import Compensator
from middeck.signals.ports import Port
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace, gain_system

HERE = Path(__file__).parent / "margins"
NUMBERS = json.loads((HERE / "numbers.json").read_text())
LOOPS = runpy.run_path(str(HERE / "loops.py"))


def loop(name: str) -> tuple[Plant, Compensator]:
    system = StateSpace(*LOOPS[name]())
    count = len(system.D)
    u = tuple(Port(f"u{i}", "N") for i in range(count))
    y = tuple(Port(f"y{i}", "m/s") for i in range(count))
    return Plant(dynamics=system, inputs=u, outputs=y), Compensator(gain_system(-np.eye(count)), y, u)


def test_gain_phase_and_sensitivity() -> None:
    one, theirs = measure_margins(*loop("single")).loops[0], NUMBERS["single"]
    # Theirs at rest is the rounding of a gain of zero: 1e14.
    assert one.gain == pytest.approx([g for g in theirs["gain"] if g < 1e4], rel=1e-8)
    assert one.gain_hz[0] * 2.0 * np.pi == pytest.approx(theirs["gain_omega"][0], rel=1e-8)
    assert one.phase_hz * 2.0 * np.pi == pytest.approx(theirs["phase_omega"], rel=1e-8)
    assert np.degrees(one.phase_rad) == pytest.approx(theirs["phase_deg"], rel=1e-7)
    # Their H-infinity norm is bisected to 1e-6 (slycot's ab13dd).
    assert one.sensitivity.gain == pytest.approx(theirs["sensitivity"], rel=2e-6)


def test_disk_of_one_loop() -> None:
    disk, theirs = measure_margins(*loop("single")).loops[0].disk, NUMBERS["disk_single"]
    # Theirs is the least on a grid of 20,001 lines: it errs upwards, by the square of 3e-4 over the damping.
    assert disk.alpha == pytest.approx(theirs["alpha"], rel=1e-3)
    assert disk.alpha <= theirs["alpha"] * (1.0 + 1e-9)
    assert np.degrees(disk.phase_rad) == pytest.approx(theirs["phase_deg"], rel=1e-3)
    assert 20.0 * np.log10(disk.gain[1]) == pytest.approx(theirs["gain_db"], rel=1e-3)


def test_disk_of_two_loops_at_once() -> None:
    """Theirs breaks the loop at the outputs; slycot's scaling (ab13md) is exact for two blocks, as ours."""
    disk, theirs = measure_disk_margin(*loop("double"), at="outputs"), NUMBERS["disk_double"]
    assert disk.alpha == pytest.approx(theirs["alpha"], rel=1e-3)
    assert disk.alpha <= theirs["alpha"] * (1.0 + 1e-6)

"""What a test leaves unjudged: a verdict and its table say so, and no other mode takes its place."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import middeck as md
from cli_runner import ROOT, middeck
from coarse_articles import coarse
from middeck.structure.correlation.effective_mass import measure_effective_mass
from middeck.structure.correlation.frequencies import compare_frequencies
from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes
from middeck.structure.correlation.review_criteria import Quantity, Scope, change_limit, find_profile
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import TURNING_TUBE, body, straight_beam

ARTICLE, LAB = coarse("mace-simple"), ROOT / "environments/lab.toml"
ECSS = find_profile("ecss-e-st-32-11c")
CHANNELS = [(f"n{i}", d) for i in range(1, 6) for d in ("x", "y", "z", "rx")]
CHANNELS += [(joint, "angle") for joint in ("pri_x", "pri_z", "sec_x", "sec_z")]
FIRST = 10  # flexible mode, after ten of the suspension


@cache
def hung() -> Modes:
    return solve_modes(solve_equilibrium(*md.load_setup(ARTICLE, LAB)))


def correlated(modes: Modes, measured: MeasuredModes) -> md.structure.Correlation:
    noise = MeasurementNoise(1e-4, 1e-3)
    return md.correlate_modes(modes, measured, ECSS, rng=np.random.default_rng(0), noise=noise, runs=5)


def bare(measured: MeasuredModes) -> MeasuredModes:
    none = dict.fromkeys(("shape_std", "position_m"))
    return dataclasses.replace(measured, node=(), direction=(), shape=measured.shape[:0], **none)


@pytest.mark.parametrize(("chosen", "measured"), [([10, 11, 13], True), ([11, 13, 14], False)])
def test_the_fundamental_is_the_models_and_not_the_lowest_measured(chosen: list[int], measured: bool) -> None:
    test = measure_modes(hung(), CHANNELS, chosen=chosen)
    shapes, frequencies = correlated(hung(), test), compare_frequencies(hung(), bare(test), ECSS)
    first = [f for f in shapes.findings if f.criterion.group is Scope.FUNDAMENTAL]
    assert [f.passed for f in first] == [measured] * 2
    assert [f.items for f in first] == [(hung().name[FIRST],) if measured else ()] * 2
    # A correct model would not show it either.
    assert {f.probability.value for f in first} == {float(measured)}
    assert shapes.probability.value == float(measured)
    assert (shapes.passed, shapes.verdict) == ((True, "passes") if measured else (False, "open"))
    (only,) = [f for f in frequencies.findings if f.criterion.group is Scope.FUNDAMENTAL]
    assert only.met == measured
    assert (only.worst is None) != measured
    assert frequencies.verdict == "open"
    for found in (shapes, frequencies):
        message = " ".join(found.warnings)
        hz = hung().frequency_hz
        assert ("a flexible mode lies below all that was measured" in message) != measured
        assert (
            f"mode {FIRST} {hung().name[FIRST]!r} of {hz[FIRST]:.4g} Hz has no partner" in message
        ) != measured
        # Of a hung article; which modes those are is counted here.
        assert "of the model only suspension modes have more than 10 % of the effective mass" in message


def test_a_model_far_off_in_one_mode_fails_though_that_has_no_partner() -> None:
    """The others agree, so that 20 % is likelier a mode of something else: not a verdict that is open."""
    modes = solve_modes(
        solve_equilibrium(straight_beam(TURNING_TUBE, 2.0, 4), Environment.clamped("a", gravity=0.0))
    )
    test = bare(measure_modes(modes, [("b", "y"), ("b", "z")], chosen=[0, 2, 4, 6]))
    far = dataclasses.replace(test, frequency_hz=test.frequency_hz * np.array([1.2, 1.0, 1.0, 1.0]))
    found = compare_frequencies(modes, far, ECSS)
    assert found.unpaired == (0,)
    assert [f.worst for f in found.findings if f.criterion.group is Scope.FUNDAMENTAL] == [None]
    assert found.verdict == "does not pass"
    assert compare_frequencies(modes, test, ECSS).verdict == "open"


def test_either_mode_of_a_repeated_fundamental_is_it() -> None:
    """A round beam bends in two planes at one frequency; a test may measure either."""
    modes = solve_modes(
        solve_equilibrium(straight_beam(TURNING_TUBE, 2.0, 4), Environment.clamped("a", gravity=0.0))
    )
    np.testing.assert_allclose(modes.frequency_hz[0], modes.frequency_hz[1], rtol=1e-9)
    for one in (0, 1):
        test = bare(measure_modes(modes, [("b", "y"), ("b", "z")], chosen=[one]))
        (first,) = [f for f in compare_frequencies(modes, test, ECSS).findings if f.criterion.limit == 0.03]
        assert first.met
        assert first.worst == pytest.approx(0.0, abs=1e-6)


def test_a_mode_of_large_effective_mass_that_was_not_measured_is_named() -> None:
    modes = solve_modes(
        solve_equilibrium(straight_beam(TURNING_TUBE, 2.0, 4), Environment.clamped("a", gravity=0.0))
    )
    fraction = measure_effective_mass(modes).fraction.max(axis=1)
    others = [i for i in range(2, len(fraction)) if fraction[i] > 0.1]
    for one in (0, int(np.argmin(fraction))):  # the fundamental, which is none of these, and the smallest
        found = compare_frequencies(modes, bare(measure_modes(modes, chosen=[one])), ECSS)
        (warning,) = [w for w in found.warnings if "large effective mass" in w]
        assert (
            f"of {modes.frequency_hz[others[0]]:.4g} Hz has more than 10 % of the effective mass" in warning
        )


def test_a_changed_limit_says_which_it_replaced() -> None:
    changed = change_limit(ECSS, Quantity.FREQUENCY_ERROR, 0.05, "test plan")
    assert [c.limit for c in changed.criteria if c.quantity is Quantity.FREQUENCY_ERROR] == [0.05] * 3
    assert changed.title.endswith(
        "frequency error by test plan: 0.05 in place of 0.03 (fundamental), 0.05 (large effective mass), "
        "0.1 (other modes)"
    )


def test_modes_count_from_one_and_damping_stands_beside_the_models(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    hz = hung().frequency_hz[[FIRST, FIRST + 1]]
    spurious = 1.3 * hz[1]
    lines = ["mode;frequency [Hz];damping [%]", f"1;{hz[0]};0.7", f"2;{hz[1]};0", f"3;{spurious};0.9"]
    (tmp_path / "s.csv").write_text("\n".join(lines))
    asked = "correlate", ARTICLE, tmp_path / "s.csv", "--environment", LAB
    plain = middeck(capfd, *asked)
    assert f"measured mode 3 of {spurious:.4g} Hz has no partner" in plain.err
    table = plain.out.split("pairs by frequency alone\n")[1].splitlines()
    assert table[0].split()[:2] == ["test", "model"]
    assert "test zeta %  model zeta %" in table[0]
    zeta = estimate_damping(hung(), count=FIRST + 2).zeta
    assert table[1].split()[:2] == ["1", str(FIRST)]
    assert table[1].split()[5:7] == ["0.70", f"{100.0 * zeta[FIRST]:.2f}"]
    assert table[2].split()[5] == f"{100.0 * zeta[FIRST + 1]:.2f}"
    document = json.loads(middeck(capfd, *asked, "--json").out)
    assert document["measured_damping"] == [pytest.approx(0.007), None]
    np.testing.assert_allclose(document["damping"], zeta[[FIRST, FIRST + 1]], rtol=1e-9)


@pytest.mark.parametrize(("tip", "named"), [(1.0, False), (1e7, True)])
def test_a_mode_that_hardly_moves_the_sensors_is_named(tip: float, named: bool) -> None:
    """Sensors on a heavy tip read the beam's own modes too, but noise of the tip's hides them."""
    beam = straight_beam(TURNING_TUBE, 2.0, 4)
    ends = tuple(
        dataclasses.replace(n, body=body(tip, inertia=(tip,) * 3)) for n in beam.nodes if n.name == "b"
    )
    heavy = dataclasses.replace(beam, nodes=(*(n for n in beam.nodes if n.name != "b"), *ends))
    modes = solve_modes(solve_equilibrium(heavy, Environment.clamped("a", gravity=0.0)))
    bending = [i for i, name in enumerate(modes.name) if name.endswith("bending x-y")][:3]
    test = measure_modes(modes, [("b", "y"), ("b", "rz")], chosen=bending[1:])
    remarks = [w for w in correlated(modes, test).warnings if "moves the sensors" in w]
    assert bool(remarks) == named
    if named:
        assert f"of {modes.frequency_hz[bending[2]]:.4g} Hz moves the sensors" in remarks[0]

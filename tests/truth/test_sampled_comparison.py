"""Direct and emulated laws side by side, margins at the sampled rate, aliased modes and the filter."""

import dataclasses

import numpy as np
import pytest
import sampled_cases as cases

from middeck.control.analysis.loop.feedback_loop import form_loop
from middeck.control.analysis.margins.disk import measure_disk_margin
from middeck.control.analysis.margins.margins import measure_margins
from middeck.control.analysis.shifts.shifts import find_allowed_shifts
from middeck.control.sampled.aliases import filter_measurements, find_aliases
from middeck.control.sampled.compare_sampling import compare_sampling
from middeck.control.sampled.sampled_design import design_sampled_lqg
from middeck.control.sampled.sampled_loop import measure_sampled_loop
from middeck.control.shaping.leads_and_notches import roll_off
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant, delay_plant, name_states, remove_delays
from middeck.systems.plants.response import evaluate_plant, statespace_response
from middeck.systems.state_space.modal_system import ModalSystem, select_modes
from middeck.systems.state_space.statespace import StateSpace, poles
from plant_builders import sum_of_modes, unit_weights

# At 100 Hz it does: what that costs is compared.
pytestmark = pytest.mark.filterwarnings("default:the compensator rings:UserWarning")


@pytest.fixture(scope="module")
def comparison():
    return compare_sampling(cases.late_gimbal(), cases.gimbal_weights(), 100.0, match_hz=5.0)


def at(comparison, rate):
    return {row.method: row.outcome for row in comparison.rows if row.rate_hz == rate}


def test_no_emulation_beats_the_direct_design(comparison):
    # A theorem for the cost; the predictor only against laws that have a sample to compute in too.
    assert {row.rate_hz for row in comparison.rows} == {100.0, 250.0, 500.0, 1000.0}
    for rate in (100.0, 250.0, 500.0, 1000.0):
        rows = at(comparison, rate)
        direct = rows.pop("direct, current").cost
        assert all(other.cost > direct for other in rows.values())
        predictor = rows["direct, predictor"].cost
        assert all(rows[name].cost > predictor for name in ("hold", "hold, hold known"))


def test_at_100_hz_only_the_direct_design_is_of_use(comparison):
    rows = at(comparison, 100.0)
    reduction = {
        name: -20.0 * np.log10(o.metric / comparison.open_metric) for name, o in rows.items() if o.stable
    }
    assert reduction["direct, current"] > 30.0
    assert reduction["direct, predictor"] > 27.0
    emulated = [value for name, value in reduction.items() if not name.startswith("direct")]
    assert max(emulated) < 21.0
    assert len(emulated) == 1  # five of six are unstable


def test_at_1000_hz_it_hardly_matters(comparison):
    rows = at(comparison, 1000.0)
    assert all(o.stable for o in rows.values())
    assert rows["direct, current"].cost == pytest.approx(comparison.continuous_cost, rel=0.03)
    assert rows["tustin, hold known"].cost == pytest.approx(comparison.continuous_cost, rel=0.05)


def test_open_loop_is_that_of_the_modes(comparison):
    # White force of intensity S: each mode's variance is phi^2 psi^2 S / (4 zeta w^3); cross terms are small.
    w = 2.0 * np.pi * cases.FREQUENCY_HZ
    variance = np.sum((cases.UNIT**2 * cases.SHAPE) ** 2 / cases.UNIT / (4.0 * 0.01 * w**3))
    assert comparison.open_metric == pytest.approx(np.sqrt(variance), rel=0.01)


def test_margins_are_those_of_the_sampled_loop(comparison):
    # The law times the limit, at either end, puts a pole on the circle; a bit less does not.
    plant = cases.late_gimbal()
    for row in comparison.rows:
        if row.margins is None:
            assert not row.outcome.stable
            continue
        held, law = form_loop(plant, row.law).plant.sampled, row.law.sampled
        for limit in row.margins.loops[0].gain_limits:
            if limit in (0.0, np.inf):
                continue
            radius = [np.abs(poles(closed(held, law, k))).max() for k in (limit, 1.0 + 0.99 * (limit - 1.0))]
            assert radius[0] == pytest.approx(1.0, abs=1e-7)
            assert radius[1] < 1.0
        assert row.margins.loops[0].channel == "torque"


def test_shifts_end_where_the_sampled_loop_does(comparison):
    plant = cases.late_gimbal()
    law = next(row.law for row in comparison.rows if row.rate_hz == 500.0 and row.outcome.stable)
    (found,) = find_allowed_shifts(plant, law, modes=["8.8 Hz"], most=0.1)

    def radius(shift):
        moved = shift_modes(plant, {"8.8 Hz": 1.0 + shift})
        return np.abs(poles(closed(form_loop(moved, law).plant.sampled, law.sampled, 1.0))).max()

    # Bisected to 1e-8.
    for limit in (found.down, found.up):
        assert radius(limit) > 1.0 > radius(limit - np.sign(limit) * 2e-8)
    assert all(radius(x) < 1.0 for x in np.linspace(found.down, found.up, 23)[1:-1])


def test_the_table_says_what_was_measured(comparison):
    head, *lines = str(comparison).splitlines()
    assert head.split("  ")[0] == "rate Hz"
    assert len(lines) == len(comparison.rows)
    for line, row in zip(lines, comparison.rows, strict=True):
        cells = [cell.strip() for cell in line.split("  ") if cell.strip()]
        assert cells[:2] == [f"{row.rate_hz:g}", row.method]
        if row.margins is None:
            assert cells[2:] == ["unstable"]
        else:
            ratio = row.outcome.metric / comparison.open_metric
            assert float(cells[2]) == pytest.approx(20.0 * np.log10(ratio), abs=0.051)  # a decimal is printed
            assert float(cells[4]) == pytest.approx(row.margins.loops[0].gain_db, abs=0.051)
            assert float(cells[6]) == pytest.approx(row.margins.loops[0].disk.alpha, abs=0.00051)


def test_one_channel_has_the_same_disk_alone_and_at_once(comparison):
    plant, law = cases.late_gimbal(), comparison.rows[0].law
    alone = measure_margins(plant, law).loops[0].disk
    assert measure_disk_margin(plant, law, at="inputs").alpha == pytest.approx(alone.alpha, rel=1e-9)
    # A change at each end is one change of twice the size at most: half the radius, roughly.
    assert 0.45 * alone.alpha < measure_disk_margin(plant, law).alpha < 0.55 * alone.alpha


def closed(held, law, gain):
    A = np.block([[held.A + gain * held.B @ law.D @ held.C, gain * held.B @ law.C], [law.B @ held.C, law.A]])
    return StateSpace(A, np.zeros((len(A), 1)), np.zeros((1, len(A))), np.zeros((1, 1)))


@pytest.mark.parametrize("at", ["inputs", "outputs", "both"])
def test_channels_of_margins_have_names(at):
    plant, weights = cases.tangled(), cases.tangled_weights()
    law = design_sampled_lqg(plant, weights, 10.0, 0.1)
    names = {"inputs": ("u1", "u2"), "outputs": ("y1", "y2"), "both": ("u1", "u2", "y1", "y2")}[at]
    found = measure_margins(plant, law, at=at)
    assert tuple(m.channel for m in found.loops) == names
    assert found.stable


def test_an_open_loop_without_end_is_no_obstacle():
    # A rigid body: its metric without control is infinite, its control is not.
    modal = ModalSystem(omega=[0.0], zeta=[0.0], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]], names=("rigid",))
    ports = (Port("t", "N m"),), (Port("a", "rad"),)
    plant = Plant(dynamics=modal, inputs=ports[0], outputs=ports[1], w=("t",), u=("t",), z=("a",), y=("a",))
    weights = unit_weights(("t",), 1e-6)
    found = compare_sampling(plant, weights, 1.0, (20.0, 50.0))
    assert found.open_metric == np.inf
    assert all(row.outcome.stable for row in found.rows)
    assert str(found).splitlines()[1].split()[3] == "-"  # after "20", "direct,", "current"


def test_more_channels_have_no_matched_law():
    found = compare_sampling(cases.tangled(), cases.tangled_weights(), 10.0, (20.0,))
    assert not any(row.method.startswith("matched") for row in found.rows)
    assert found.rows[0].outcome.stable


def test_where_aliases_are():
    # By the eigenvalues of the sampled mode alone: angle is the image, size the decay.
    T, zeta = 0.01, 0.01
    hz = np.array([62.0, 95.0, 98.5, 131.0, 190.0])
    plant = cases.gimbal(more_hz=hz, more_shape=np.full(5, 1e-6))
    law = design_sampled_lqg(cases.gimbal(), cases.gimbal_weights(), 1e-4, T)
    found = find_aliases(plant, law, cases.gimbal_weights(), 1e-4)
    assert [a.name for a in found.aliases] == ["62 Hz", "95 Hz", "98.5 Hz", "131 Hz", "190 Hz"]
    for alias, f in zip(found.aliases, hz, strict=True):
        w = 2.0 * np.pi * f
        rate = np.log(np.exp(T * w * complex(-zeta, np.sqrt(1.0 - zeta**2)))) / T
        assert alias.alias_hz == pytest.approx(abs(rate.imag) / (2.0 * np.pi), rel=1e-10)
        assert alias.damping == pytest.approx(-rate.real / abs(rate), rel=1e-10)
        assert alias.alias_hz == pytest.approx(abs(f - 100.0 * round(f / 100.0)), abs=0.011)
        assert alias.filter_gain == 1.0
        assert alias.stable
    assert found.together.stable
    assert found.resolved.metric == pytest.approx(found.together.metric, rel=1e-6)


def pointing_plant(share):
    """A rigid body, to be held at some 4 Hz, and a mode that 100 Hz folds to 3 Hz; 2 ms late."""
    omega = 2.0 * np.pi * np.array([0.0, 97.0])
    modal = sum_of_modes(omega, [0.0, 0.002], [[1.0], [1.0]], [[1.0, share]], names=("rigid", "panel"))
    torque, angle = (Port("t", "N m"),), (Port("a", "rad"),)
    return delay_plant(
        Plant(dynamics=modal, inputs=torque, outputs=angle, w=("t",), u=("t",), z=("a",), y=("a",)), 0.002
    )


def test_the_filter_takes_an_alias_out_of_the_loop():
    T, authority = 0.01, 1e6
    weights = unit_weights(("t",), 1e-10, process=1e-4)
    whole = pointing_plant(400.0)
    rigid = dataclasses.replace(remove_delays(whole), dynamics=select_modes(whole.dynamics, np.array([0])))
    plain = delay_plant(rigid, whole.delay_s)
    section = roll_off(20.0, 2)
    law = design_sampled_lqg(plain, weights, authority, T, "current")
    without = find_aliases(whole, law, weights, authority)
    filtered = design_sampled_lqg(filter_measurements(plain, section), weights, authority, T, "current")
    with_it = find_aliases(whole, filtered, weights, authority, antialias=section)
    assert without.aliases[0].alias_hz == pytest.approx(3.0, abs=0.01)
    assert without.resolved.stable
    assert not without.together.stable
    assert with_it.together.stable
    assert with_it.aliases[0].filter_gain == pytest.approx(1.0 / np.hypot(1.0, (97.0 / 20.0) ** 2), rel=1e-9)
    assert with_it.aliases[0].loop_gain < 0.1 * without.aliases[0].loop_gain
    assert without.together.metric == np.inf
    # The filter costs phase, hence something of the loop without the mode.
    assert with_it.resolved.metric > without.resolved.metric


def test_a_design_that_knows_the_mode_needs_no_filter():
    # Sampled exactly, a mode beyond half the rate is one like any other.
    T, authority = 0.01, 1e6
    weights = unit_weights(("t",), 1e-10, process=1e-4)
    whole = pointing_plant(400.0)
    law = design_sampled_lqg(whole, weights, authority, T, "current")
    found = measure_sampled_loop(whole, law, weights, authority)
    assert found.stable
    assert found.cost == pytest.approx(law.cost, rel=1e-9)


def test_filtered_measurements():
    plant, section = cases.tangled(), roll_off(8.0, 3)
    filtered = filter_measurements(plant, section)
    hz = np.array([0.2, 0.9, 5.0, 40.0])
    before, after = evaluate_plant(plant, hz).H, evaluate_plant(filtered, hz).H
    F = statespace_response(section, 2.0 * np.pi * hz)[:, 0, 0]
    np.testing.assert_allclose(after[:, :2], before[:, :2], rtol=1e-11)
    np.testing.assert_allclose(after[:, 2:], F[:, None, None] * before[:, 2:], rtol=1e-9)
    assert filtered.y == ("y1", "y2")
    assert name_states(remove_delays(filtered))[4:] == ("anti-alias",) * 6


def test_performance_is_read_in_front_of_the_filter():
    plant = filter_measurements(cases.late_gimbal(), roll_off(5.0, 2))
    hz = np.array([0.2, 1.0, 9.0])
    H, before = evaluate_plant(plant, hz).H, evaluate_plant(cases.late_gimbal(), hz).H
    z = plant.output_indices(plant.z)
    np.testing.assert_allclose(H[:, z], before, rtol=1e-11)
    law = design_sampled_lqg(plant, cases.gimbal_weights(), 1.0, 0.01)
    assert measure_sampled_loop(plant, law, cases.gimbal_weights(), 1.0).cost == pytest.approx(
        law.cost, rel=1e-9
    )


def test_filtered_noise_may_reach_a_measurement_directly():
    # An accelerometer beside the motor reads the torque's noise: behind a filter it can be sampled.
    ports = (Port("t", "N m"),), (Port("a", "rad"), Port("acc", "rad/s^2"))
    modal = sum_of_modes(
        [6.0], 0.01, [[1.0]], [[1.0], [0.0]], names=("mode",), phi_acceleration=[[0.0], [1.0]]
    )
    plant = Plant(dynamics=modal, inputs=ports[0], outputs=ports[1], w=("t",), u=("t",), z=("a",), y=("acc",))
    weights = unit_weights(("t",), 1e-6, process=1e-2)
    with pytest.raises(ConfigError, match="filter_measurements"):
        design_sampled_lqg(plant, weights, 100.0, 0.01)
    filtered = filter_measurements(plant, roll_off(30.0, 2))
    law = design_sampled_lqg(filtered, weights, 100.0, 0.01)
    assert measure_sampled_loop(filtered, law, weights, 100.0).cost == pytest.approx(law.cost, rel=1e-10)


def test_what_has_no_aliases():
    with pytest.raises(ConfigError, match="one of each"):
        filter_measurements(cases.gimbal(), StateSpace(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2))))
    plant, weights = cases.tangled(), cases.tangled_weights()
    law = design_sampled_lqg(plant, weights, 10.0, 0.1)
    with pytest.raises(ConfigError, match="not in modal form"):
        find_aliases(plant, law, weights, 10.0)

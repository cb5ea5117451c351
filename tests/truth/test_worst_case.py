"""Allowed shifts, worst cases, inversion and participation against brute force and closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.optimize

from middeck.control.analysis.rms.measure_rms import measure_rms
from middeck.control.analysis.shifts.inversion import find_inversion
from middeck.control.analysis.shifts.shifts import find_allowed_shifts
from middeck.control.analysis.shifts.worst_case import find_worst_case
from middeck.control.analysis.stability.stability import decide_stability
from middeck.control.law.compensator import Compensator
from middeck.control.law.uncertainty import ModeShift, Uncertainty, finished_plants
from middeck.control.loop.authority import find_participation
from middeck.control.loop.closed_loop import close_loop
from middeck.control.loop.performance import Performance
from middeck.control.lqg.design import design_lqg
from middeck.control.sampled.emulation import emulate
from middeck.control.shaping.leads_and_notches import second_order_section
from middeck.errors import ConfigError
from middeck.signals.ports import Port
from middeck.systems.delay.delay_approximation import approximate_delays
from middeck.systems.plants.mode_blocks import part_modes
from middeck.systems.plants.mode_shift import shift_modes
from middeck.systems.plants.plant import Plant, delay_plant, remove_delays
from middeck.systems.state_space.modal_system import ModalSystem
from middeck.systems.state_space.statespace import gain_system
from plant_builders import grouped_plant, sum_of_modes, unit_weights

FORCE, WAY, SEEN = Port("force", "N"), Port("way", "m"), Port("seen", "m")
# The multi-model reference case: five modes, y 10 ms late, in units of 1/(2 pi 3 Hz).
MODES = ("1.1 Hz", "1.7 Hz", "7 Hz", "8.8 Hz", "9.4 Hz")
OMEGA = np.array([1.1, 1.7, 7.0, 8.8, 9.4]) / 3.0
PLANT = grouped_plant(
    sum_of_modes(OMEGA, 0.01, np.array([[1.0, 0.6, 0.6, 0.8, 0.7]]).T, np.ones((2, 5)), names=MODES),
    (FORCE,),
    (WAY, SEEN),
    z=("way",),
    y=("seen",),
)
LATE = delay_plant(PLANT, np.array([[0.0], [0.010 * 2.0 * np.pi * 3.0]]))
WEIGHTS = unit_weights(("force",), 1e-6)
LAW = design_lqg(approximate_delays(LATE, 3), WEIGHTS, 100.0)


def moved(mode: str, shift: float) -> Plant:
    return shift_modes(LATE, {mode: 1.0 + shift})


def test_stability_ends_at_the_allowed_shift_and_not_before() -> None:
    (found,) = find_allowed_shifts(LATE, LAW, modes=["9.4 Hz"], most=0.1)
    for limit in (found.down, found.up):
        assert not decide_stability(moved("9.4 Hz", limit), LAW).stable
        assert decide_stability(moved("9.4 Hz", limit - np.sign(limit) * 2e-8), LAW).stable
    assert all(
        decide_stability(moved("9.4 Hz", x), LAW).stable for x in np.linspace(found.down, found.up, 22)[1:-1]
    )
    at = decide_stability(moved("9.4 Hz", found.up), LAW)
    assert found.up_hz == pytest.approx(at.frequency_hz, rel=1e-9)


def test_a_light_mode_delayed_by_many_turns_is_ranked_with_its_own_phase() -> None:
    """A weak gain -k moves the root of a mode by j k exp(-j w tau) / (2 w): growth where sin(w tau) > 0.

    Late by 25 radians, all that an approximation of order 8 can turn: it sees no limit below.
    """
    omega, zeta, tau, k = 1250.0, 1e-5, 0.02, 100.0
    modal = ModalSystem(
        omega=[omega], zeta=[zeta], psi=[[1.0]], phi=[[1.0]], phi_rate=[[0.0]], names=("fast",)
    )
    delayed = delay_plant(Plant(dynamics=modal, inputs=(FORCE,), outputs=(SEEN,)), np.array([[tau]]))
    law = Compensator(gain_system(np.array([[-k]])), (SEEN,), (FORCE,))
    (found,) = find_allowed_shifts(delayed, law, most=0.2)

    def growth(shift: float) -> float:
        w = omega * (1.0 + shift)
        return float(k * np.sin(w * tau) / (2.0 * w) - zeta * w)

    # The root itself is off the mode's frequency by k / (2 w^2) = 4e-5 of it.
    for limit in (found.down, found.up):
        assert np.isfinite(limit)
        assert scipy.optimize.brentq(growth, limit - 0.01, limit + 0.01) == pytest.approx(limit, abs=1e-4)


def test_a_shift_without_limit_and_a_loop_unstable_from_the_start() -> None:
    (found,) = find_allowed_shifts(LATE, LAW, modes=["1.1 Hz"], most=0.05)
    assert (found.down, found.up, found.up_hz) == (-np.inf, np.inf, 0.0)
    (broken,) = find_allowed_shifts(moved("8.8 Hz", 0.03), LAW, modes=["1.1 Hz"], most=0.05)
    assert (broken.down, broken.up) == (0.0, 0.0)
    with pytest.raises(ConfigError, match="no mode named"):
        find_allowed_shifts(LATE, LAW, modes=["3 Hz"])


def test_modes_of_unnamed_states_have_one_name_for_all_questions() -> None:
    unnamed = dataclasses.replace(LATE, dynamics=remove_delays(LATE).system)
    named = part_modes(unnamed)
    name = named.state_names[0]
    (found,) = find_allowed_shifts(unnamed, LAW, modes=[name], most=0.01)
    assert found.mode == name
    np.testing.assert_allclose(
        np.abs(np.linalg.eigvals(shift_modes(named, {name: 1.01}).continuous.A)).min(), 1.01 * OMEGA[0]
    )
    with pytest.raises(ConfigError, match="no mode named") as caught:
        shift_modes(unnamed, {name: 1.01})
    assert "part_modes" in caught.value.hint


def test_worst_stability_over_a_box_by_brute_force() -> None:
    """Where the box is just unstable the search says so; just inside, it does not."""
    apart = (ModeShift(("8.8 Hz",), 0.02), ModeShift(("9.4 Hz",), 0.02))
    found = find_worst_case(LATE, LAW, Uncertainty(shifts=apart))
    assert not found.stability.stable
    small = Uncertainty(shifts=tuple(dataclasses.replace(s, half_width=0.002) for s in apart))
    assert find_worst_case(LATE, LAW, small).stability.stable


def test_worst_rms_over_a_box_by_brute_force() -> None:
    box = Uncertainty(shifts=(ModeShift(("7 Hz",), 0.002), ModeShift(("8.8 Hz", "9.4 Hz"), 0.005)))
    performance = Performance(np.ones(1), np.eye(1), (0.001, 2.0))
    found = find_worst_case(LATE, LAW, box, performance=performance)
    grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 4)] * 2), axis=-1).reshape(-1, 2)
    brute = max(measure_rms(p, LAW, performance)[0] for p in finished_plants(LATE, box, grid))
    # The grid is not in the search: it may only be less bad.
    assert found.metric is not None
    assert found.metric >= brute * (1.0 - 1e-9)
    nominal = measure_rms(LATE, LAW, performance)[0]
    assert found.nominal_metric == pytest.approx(nominal, rel=1e-12)
    assert found.metric > found.nominal_metric


def test_search_leaves_the_corners_where_the_worst_is_inside() -> None:
    """A box wide enough for the notch of a law to be met inside only: the mode at its worst shift."""
    quiet = ModalSystem(
        omega=[1.0], zeta=[0.01], psi=[[1.0]], phi=[[1.0], [1.0]], phi_rate=[[0.0], [0.0]], names=("one",)
    )
    plant = dataclasses.replace(PLANT, dynamics=quiet)
    # A law with a light pole at 1.1: the mode meets it amid the box, at neither end nor the middle.
    at = 1.1 / (2.0 * np.pi)
    law = Compensator(second_order_section(at, 0.02, at, 0.004), (SEEN,), (FORCE,))
    small = dataclasses.replace(law.system, C=law.system.C * -0.01, D=law.system.D * -0.01)
    law = dataclasses.replace(law, dynamics=small)
    box = Uncertainty(shifts=(ModeShift(("one",), 0.2),))
    performance = Performance(np.ones(1), np.eye(1), (0.01, 1.0))
    found = find_worst_case(plant, law, box, performance=performance)
    grid = np.linspace(-1.0, 1.0, 201)[:, None]
    brute = max(measure_rms(p, law, performance)[0] for p in finished_plants(plant, box, grid))
    assert found.metric == pytest.approx(brute, rel=1e-3)


def test_a_notch_on_a_mode_is_an_inversion() -> None:
    at = OMEGA[2] / (2.0 * np.pi)
    law = Compensator(second_order_section(1.003 * at, 0.012, at, 0.5), (SEEN,), (FORCE,))
    first = find_inversion(LATE, law)[0]
    assert (first.mode, first.reads, first.drives) == ("7 Hz", "seen", "force")
    assert -first.zero.real == pytest.approx(0.012 * abs(first.zero), rel=1e-9)
    assert -first.pole.real == pytest.approx(0.01 * abs(first.pole), rel=1e-12)
    assert first.distance == pytest.approx(np.hypot(0.003, 0.002), rel=0.01)


def test_nominal_lqg_inverts_and_the_sampled_loop_says_the_same() -> None:
    """Cheap control of a disturbance at the actuator: zeros beside the modes that the law cancels."""
    found = find_inversion(LATE, LAW, within=0.3)
    assert found
    period = 0.005
    sampled = find_inversion(PLANT, emulate(LAW, period), within=0.3)
    # Tustin's rule moves a frequency by (w T)^2 / 12, 2e-5 at most here.
    assert sampled[0].distance == pytest.approx(found[0].distance, abs=1e-4)
    assert sampled[0].zero == pytest.approx(found[0].zero, rel=1e-4)


@pytest.mark.parametrize("k", [0.3, 2.0, 6.0])
def test_two_coupled_modes_share_a_pole_as_their_eigenvectors_say(k: float) -> None:
    """Two modes of w1, w2 joined by a spring: (1 - s, s), tan 2a = 2 k / (w2^2 - w1^2), s = sin^2 a."""
    w = np.array([2.0, 3.0])
    modal = sum_of_modes(w, 0.0, np.ones((2, 1)), [[1.0, 1.0]], names=("slow", "fast"))
    plant = grouped_plant(modal, (FORCE,), (WAY,))
    # u = -k (q1 + q2): each mode stiffer by k, and k between them.
    loop = close_loop(plant, Compensator(gain_system(np.array([[-k]])), (WAY,), (FORCE,)))
    a = 0.5 * np.arctan2(2.0 * k, w[1] ** 2 - w[0] ** 2)
    stiff = np.linalg.eigvalsh(np.diag(w**2) + k)
    found = find_participation(loop)
    slow = np.cos(a) ** 2 if found.pole.imag < np.sqrt(stiff.mean()) else np.sin(a) ** 2
    # Left and right eigenvectors are those of the symmetric stiffness.
    assert found.shares == pytest.approx([slow, 1.0 - slow], rel=1e-10)


def test_every_mode_of_modal_form_that_has_a_frequency_has_its_shift_however_damped() -> None:
    modes = sum_of_modes(OMEGA[:3], [1.0, 1.3, 0.01], np.ones((3, 1)), np.ones((1, 3)), names=MODES[:3])
    plant = grouped_plant(modes, (FORCE,), (WAY,))
    idle = Compensator(gain_system(np.zeros((1, 1))), (WAY,), (FORCE,))
    assert [one.mode for one in find_allowed_shifts(plant, idle)] == list(MODES[:3])

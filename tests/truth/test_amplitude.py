"""Frequency and damping against amplitude: closed forms, free decay in time, sticking and slipping limits."""

import dataclasses

import numpy as np
import pytest

import middeck as md
from middeck.errors import ConfigError
from middeck.joints.attachment import JointElements
from middeck.joints.deadband import Deadband
from middeck.joints.friction import Friction
from middeck.laboratory.rig.rig import build_rig
from middeck.laboratory.rig.ticks.simulate_rig import switch_on
from middeck.signals.ports import Port
from middeck.structure.gimbals.amplitude import sweep_amplitude
from middeck.structure.gimbals.damped import follow_damped, pair_undamped
from middeck.structure.gimbals.stiffened_joint import JointSystem, solve_undamped
from middeck.structure.model.article import JointState
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.modal_system import ModalSystem
from repeats import repeats
from rig_checks import run_through
from structure_builders import body, joint, node, structure

J, KP = 0.062, 3.9  # a payload of 5 kg hanging 8 cm below its axis
UNDAMPED = md.Damping(flexible=0.0, suspension=0.0)
BEARING = Friction(slip_torque=0.002, stiffness=2.0)


@pytest.fixture(scope="module")
def pendulum():
    """A payload on a spring as its weight would be, on a base that hardly moves."""
    hinge = joint("hinge", "base", (0.0, 0.0, 1.0), body(1.0, inertia=(J, J, J)), stiffness=KP)  # fmt: skip
    base = node("base", (0.0, 0.0, 0.0), body(1e9, inertia=(1e9, 1e9, 1e9)))
    return md.solve_modes(md.solve_equilibrium(structure([base], joints=[hinge]), md.Environment.orbit()))


@pytest.fixture(scope="module")
def article():
    return md.load_structure("articles/mace-simple.toml")


@pytest.fixture(scope="module", params=repeats(["lab", "orbit"]))
def modes(request, article):
    return md.solve_modes(
        md.solve_equilibrium(article, md.load_environment(f"environments/{request.param}.toml"))
    )


def change_joint(structure, name, **change):
    joints = tuple(dataclasses.replace(j, **change) if j.name == name else j for j in structure.joints)
    return dataclasses.replace(structure, joints=joints)


def sprung(modes, name, stiffness):
    """The same rest state with the joint on a spring that carries what its motor held."""
    structure = modes.equilibrium.model.structure
    i = [j.name for j in structure.joints].index(name)
    angle, held = structure.joints[i].angle, modes.equilibrium.holding_torque[i]
    stiffer = change_joint(
        structure, name, state=JointState.SPRUNG, stiffness=stiffness, target=angle + held / stiffness
    )
    return md.solve_modes(md.solve_equilibrium(stiffer, modes.equilibrium.environment))


@pytest.mark.parametrize("element", [BEARING, Deadband(0.001, 1.5), Friction(0.002, 2.0, viscous=0.05)])
def test_one_degree_of_freedom_has_its_closed_form(pendulum, element):
    A = np.geomspace(1e-4, 1.0, 25)
    curves = sweep_amplitude(
        pendulum, joint="hinge", elements=[element], amplitudes=A, select=[6], damping=UNDAMPED
    )
    equal = element.describing_function(A)
    k = KP + equal.stiffness
    # The base, a billion times heavier, and rounding.
    np.testing.assert_allclose(curves.omega[:, 0], np.sqrt(k / J), rtol=1e-9)
    rate = element.viscous / (2.0 * J)
    s = -rate + 1j * np.sqrt((k + 1j * equal.loss) / J - rate**2)
    np.testing.assert_allclose(curves.zeta[:, 0], -s.real / np.abs(s), rtol=1e-8, atol=1e-13)
    np.testing.assert_allclose(curves.joint_angle[:, 0], 1.0 / np.sqrt(J), rtol=1e-9)
    # Without viscous damping of the pendulum itself the third harmonic meets |KP - 9 w^2 J| alone.
    third = np.abs(element.harmonic(A, 3)) / A / np.abs(KP - 9.0 * k)
    np.testing.assert_allclose(curves.distortion[:, 0], third, rtol=1e-8, atol=1e-15)


def decay(strength, amplitude, slip_angle):
    """Mean amplitude, angular frequency and damping ratio of the second cycle of a free decay."""
    element = Friction(strength * KP * slip_angle, strength * KP)
    w = np.sqrt(KP / J)
    one = np.array([[1.0 / np.sqrt(J)]])
    modal = ModalSystem(omega=np.array([w]), zeta=np.zeros(1), psi=one, phi=np.vstack([one, 0.0 * one]),
                        phi_rate=np.vstack([0.0 * one, one]), names=("pendulum",))  # fmt: skip
    plant = Plant(
        dynamics=modal, inputs=(Port("t", "N m"),), outputs=(Port("a", "rad"), Port("a_rate", "rad/s"))
    )
    h = 2.0 * np.pi / w / 2000
    joint = JointElements("t", "a", (element,))
    rig = build_rig(plant, joints=[joint], sample_hz=1.0 / h, delay_s=0.5 * h)
    rest = switch_on(rig, None, 0.0, np.random.default_rng(0))
    x = np.array([amplitude * np.sqrt(J), 0.0])
    start = dataclasses.replace(rest, x=x, joints=np.full(1, amplitude))
    angle, rate = run_through(rig, None, np.zeros((5000, 1)), start=start)["measured"].T
    # Peaks: the rate falls through zero; there the angle and the rate over w make up the amplitude.
    top = np.flatnonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0))
    part = rate[top] / (rate[top] - rate[top + 1])
    stiff = np.sqrt((KP + element.stiffness) / J)  # just after the turn it sticks
    peak = np.hypot(angle[top + 1], rate[top + 1] / stiff)
    period = (top[1] + part[1] - top[0] - part[0]) * h
    delta = np.log(peak[0] / peak[1])
    return element, np.mean(peak[:2]), 2.0 * np.pi / period, delta / np.hypot(delta, 2.0 * np.pi)


@pytest.mark.parametrize("amplitude", [1.8, 4.0, 12.0])  # slip angles
def test_free_decay_agrees_to_second_order_in_the_strength_of_friction(pendulum, amplitude):
    """Averaging (Krylov and Bogoliubov) is right to first order: halved friction, a quarter of the error."""
    slip_angle = 0.001
    errors = []
    for strength in (0.1, 0.05, 0.025):
        element, mean, omega, zeta = decay(strength, amplitude * slip_angle, slip_angle)
        found = sweep_amplitude(
            pendulum, joint="hinge", elements=[element], amplitudes=np.array([mean]), select=[6],
            damping=UNDAMPED,
        )  # fmt: skip
        damped = found.omega[0, 0] * np.sqrt(1.0 - found.zeta[0, 0] ** 2)
        errors.append([omega / damped - 1.0, zeta - found.zeta[0, 0]])
        # Harmonic balance at this strength: of the order of its square.
        assert np.abs(errors[-1]).max() < 0.25 * strength**2
    order = np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))
    # Second order or better (a leading term that happens to be small gives way to the third).
    assert order.min() > 1.8


def test_the_joint_that_sticks_is_sprung_and_the_one_that_slips_is_free(modes):
    A = BEARING.slip_angle * np.array([1e-3, 0.5, 1.0, 1e8])
    select = list(range(20))
    curves = sweep_amplitude(modes, joint="pri_z", elements=[BEARING], amplitudes=A, select=select)
    stuck = sprung(modes, "pri_z", BEARING.stiffness)
    for row in curves.omega[:3]:
        # The rest state of either is good to 1e-9 or so.
        np.testing.assert_allclose(np.sort(row), stuck.omega[:20], rtol=1e-8, atol=1e-6)
    # k_eq is 3e-12 N m/rad there, on a joint of 0.06 kg m^2 6e-11 of an omega^2 of 1 or more.
    np.testing.assert_allclose(curves.omega[3], modes.omega[:20], rtol=1e-10, atol=1e-5)
    assert np.array_equal(curves.mode, select)


def test_a_gap_is_free_inside_and_on_its_flanks_far_outside(modes):
    gear = Deadband(gap=1e-3, stiffness=5.0)
    A = gear.gap * np.array([0.5, 1e9])
    curves = sweep_amplitude(modes, joint="pri_z", elements=[gear], amplitudes=A, select=range(20))
    assert np.array_equal(curves.omega[0], modes.omega[:20])
    on_flanks = sprung(modes, "pri_z", gear.stiffness)
    np.testing.assert_allclose(np.sort(curves.omega[1]), on_flanks.omega[:20], rtol=1e-8, atol=1e-6)
    moving = modes.omega[:20] > 0.0
    # A gap has no loss: the damping is that of the modes in it.
    np.testing.assert_allclose(
        curves.zeta[0, moving],
        [{"suspension": 0.03, "flexible": 0.01}[k] for k in np.array(modes.kind)[:20][moving]], rtol=1e-9,
    )  # fmt: skip
    assert np.isnan(curves.zeta[0, ~moving]).all()


def test_complex_eigenvalues_are_those_of_all_modes_with_the_element_closed(modes):
    """Against the eigenvalues of the whole plant; the basis that `solve_damped` takes is a part of it."""
    rubbing = Friction(0.002, 2.0, viscous=0.01)
    A = np.array([1.7e-3, 8e-3])
    curves = sweep_amplitude(modes, joint="pri_x", elements=[rubbing], amplitudes=A, select=range(16))
    plant = md.build_plant(
        modes, inputs=["pri_rel_x"], outputs=["pri_rel_x", "pri_rel_x_rate"], count=len(modes.omega)
    ).system
    for a in range(2):
        k = curves.stiffness[a] + 1j * curves.loss[a]
        closed = plant.A - plant.B @ (np.array([[k, rubbing.viscous]]) @ plant.C)
        s = np.linalg.eigvals(closed)
        exact = -s.real / np.abs(s)
        held = curves.omega[a] > 0.0
        for omega, zeta in zip(curves.omega[a, held], curves.zeta[a, held], strict=True):
            near = np.argmin(np.abs(np.abs(s) / omega - 1.0) + np.abs(exact - zeta))
            # 46 modes of 202: omega over omega_46, 0.02 or less, squared, on what the rest takes off (1e-5).
            assert exact[near] == pytest.approx(zeta, rel=1e-7)


def test_residual_flexibility_stands_for_modes_that_were_not_solved_for(modes):
    """Even for a joint that is all but locked, where the modes above matter most."""
    stiff = Friction(slip_torque=1.0, stiffness=2000.0)
    error = []
    for count in (26, 104):
        few = md.solve_modes(modes.equilibrium, count)
        both = [
            sweep_amplitude(m, joint="pri_z", elements=[stiff], amplitudes=np.array([1e-6]), select=range(16))
            for m in (few, modes)
        ]
        assert len(few.omega) == count
        exact, held = both[1].omega[0], both[1].omega[0] > 0.0
        ratio = (exact[held] / few.omega[-1]) ** 2
        error.append(np.max(np.abs(both[0].omega[0, held] / exact[held] - 1.0)))
        assert error[-1] < 0.1 * ratio.max()
    assert error[1] < 0.05 * error[0]


def test_curves_do_not_depend_on_the_other_amplitudes(modes):
    A = np.geomspace(1e-4, 0.1, 7)
    whole, alone = (
        sweep_amplitude(modes, joint="pri_z", elements=[BEARING], amplitudes=a, select=range(14))
        for a in (A, A[3:4])
    )
    np.testing.assert_allclose(whole.omega[3], alone.omega[0], rtol=1e-14)
    np.testing.assert_allclose(whole.zeta[3], alone.zeta[0], rtol=1e-9)  # another basis, see above
    assert whole.overlap[-1].min() > 0.99
    backwards = sweep_amplitude(
        modes, joint="pri_z", elements=[BEARING], amplitudes=A[::-1], select=range(14)
    )
    assert np.array_equal(backwards.omega[::-1], whole.omega)


def test_modes_that_hardly_couple_cross_and_those_that_do_veer():
    """Modes at 1, 2 and 3 rad^2/s^2; the joint turns in the first, and in the others a little or as much."""
    pole, k = np.array([1.0, 2.0, 3.0]), 5.0
    gear = Deadband(gap=1e-9, stiffness=k)  # at 1e5 rad short of its flank by 1e-14
    for angle, rises in (([1.0, 1e-6, 1e-6], True), ([1.0, 1.0, 1.0], False)):
        system = JointSystem(
            pole=pole, angle=np.array(angle), zeta=np.zeros(3), mode=np.arange(3), flexibility=0.0
        )
        (damped,) = follow_damped(system, [gear], np.array([1e5]), np.arange(3))
        lam, shapes = solve_undamped(system, k, 3)
        pairs = pair_undamped(damped, shapes)
        exact = np.linalg.eigvalsh(np.diag(pole) + k * np.outer(angle, angle))
        # Rounding, and the order: the first mode passes both others, or each stays below the next.
        order = [2, 0, 1] if rises else [0, 1, 2]
        np.testing.assert_allclose(lam[pairs.mode], exact[order], rtol=1e-13)
        # Without loss the damped modes are the undamped ones.
        np.testing.assert_allclose(np.abs(damped.s) ** 2, exact[order], rtol=1e-12)
        np.testing.assert_allclose(pairs.likeness, 1.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "stiffness"), repeats([("mace-simple", 20.0), ("mace-simple", 2.0), ("mace-dm", 20.0)])
)
def test_damping_is_continuous_along_the_amplitude(name, stiffness):
    """Twice as fine a grid, half the step: a hop from one mode's damping to another's would not shrink."""
    article, lab = md.load_setup(f"articles/{name}.toml", "environments/lab.toml")
    modes = md.solve_modes(md.solve_equilibrium(article, lab))
    A = np.geomspace(1.1e-3, 0.03, 161)  # from just above the slip angle, where the ratio rises at once
    curves = sweep_amplitude(
        modes, joint="pri_z", elements=[Friction(stiffness * 1e-3, stiffness)], amplitudes=A
    )
    fine = np.abs(np.diff(curves.zeta, axis=0)).max(axis=0)
    coarse = np.abs(np.diff(curves.zeta[::2], axis=0)).max(axis=0)
    # Half, to the curvature of a curve that turns within ten or so of the coarse steps.
    assert np.all(fine < 0.6 * coarse + 1e-12)
    assert coarse.max() > 0.004
    # A frequency leaps from one undamped mode to the next only where the damped one is neither.
    leaps = np.abs(np.diff(curves.omega, axis=0)) > 0.03 * curves.omega[1:]
    near = curves.doubtful[1:] | curves.doubtful[:-1]
    assert np.all(near.any(axis=1)[leaps.any(axis=1)])
    # At rest on its spring nothing is lost and no mode is in doubt.
    stuck = sweep_amplitude(
        modes, joint="pri_z", elements=[Friction(stiffness * 1e-3, stiffness)], amplitudes=np.array([1e-4])
    )
    assert stuck.likeness.min() > 0.99
    assert np.nanmax(stuck.zeta) < 0.031  # the modal damping: 3 % of a suspension mode at most


def test_what_cannot_be_asked_is_refused(modes, article):
    A = np.array([1e-3])
    with pytest.raises(ConfigError, match="no joint 'third'"):
        sweep_amplitude(modes, joint="third", elements=[BEARING], amplitudes=A)
    with pytest.raises(ConfigError, match="no element"):
        sweep_amplitude(modes, joint="pri_z", elements=[], amplitudes=A)
    with pytest.raises(ConfigError, match="amplitudes"):
        sweep_amplitude(modes, joint="pri_z", elements=[BEARING], amplitudes=-A)
    with pytest.raises(ConfigError, match="no modes"):
        sweep_amplitude(modes, joint="pri_z", elements=[BEARING], amplitudes=A, select=[500])
    locked = change_joint(article, "pri_z", state=JointState.LOCKED)
    with pytest.raises(ConfigError, match="'pri_z' is locked"):
        sweep_amplitude(
            md.solve_modes(md.solve_equilibrium(locked, md.Environment.orbit())),
            joint="pri_z", elements=[BEARING], amplitudes=A,
        )  # fmt: skip

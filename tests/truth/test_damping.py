"""Damping by kind, table, material, device and mode, against closed forms and complex eigenvalues."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.errors import ConfigError
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.model.article import (
    Actuator,
    AttachPoint,
    Damper,
    DamperPlace,
    Damping,
    DampingTable,
    Joint,
    JointState,
    Section,
    Sensor,
    Spring,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.coupled_response import LEFT_OUT
from middeck.structure.plants.damping import COUPLING_LIMIT, estimate_damping
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.systems.plants.response import evaluate_plant
from structure_builders import TURNING_TUBE, body, joint, member, node, on_cables, structure

TUBE = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4)
SOFT = Section(EA=3e5, GJ=20.0, EI_y=30.0, EI_z=40.0, rho_A=0.3, rho_I_y=1e-4, rho_I_z=1e-4)
X, Y, Z = np.eye(3)


def orbit_modes(parts: Structure) -> Modes:
    return solve_modes(solve_equilibrium(parts, Environment.orbit()))


def tangent(rest: Equilibrium) -> np.ndarray:
    active = dynamic_coordinates(rest.model)
    return assemble(rest.model, rest.config, rest.loads).tangent[active][:, active].toarray()


def mass(modes: Modes) -> np.ndarray:
    active = dynamic_coordinates(modes.equilibrium.model)
    return modes.mass[active][:, active].toarray()


# One degree of freedom


def on_a_spring(m: float = 2.0, k: float = 50.0) -> Modes:
    """A rigid body on one unstretched spring in 0-g: one mode that oscillates, along the spring."""
    parts = structure(
        [node("a", (0, 0, 0), body(m, inertia=(0.1, 0.1, 0.1)))], attach=[AttachPoint("p", "a", np.zeros(3))]
    )
    spring = AnchoredSpring(
        name="s", attach="p", anchor=np.array([0.0, 2.0, 0.0]), stiffness=k, free_length=2.0
    )
    return solve_modes(
        solve_equilibrium(
            parts, Environment(title="spring", gravity=np.zeros(3), suspension=None, springs=(spring,))
        )
    )


def test_damper_beside_a_spring_to_ground():
    # zeta = c / (2 sqrt(k m))
    modes, c = on_a_spring(), 0.7
    found = estimate_damping(modes, Damping(dampers=(Damper(DamperPlace.DEVICE, "p", c),)))
    assert found.zeta[-1] == pytest.approx(c / (2.0 * np.sqrt(50.0 * 2.0)), rel=1e-10)  # rounding
    assert found.zeta[:-1] == pytest.approx(0.0, abs=0.0)
    assert found.warnings == ()


def test_a_damper_goes_with_its_device():
    parts = on_a_spring().equilibrium.model.structure
    found = estimate_damping(orbit_modes(parts), Damping(dampers=(Damper(DamperPlace.DEVICE, "p", 0.7),)))
    assert not found.zeta.any()
    assert found.warnings == ()


def test_damper_beside_a_spring_between_two_bodies():
    # omega^2 = k (1/m1 + 1/m2), zeta = c omega / (2 k): damping in proportion to stiffness.
    places = {"a": 0.0, "b": 1.0}
    nodes = [node(n, (x, 0, 0), body(2.0 + x, inertia=(0.1, 0.1, 0.1))) for n, x in places.items()]
    attach = [AttachPoint(n, n, np.zeros(3)) for n in places]
    modes = orbit_modes(
        structure(
            nodes,
            springs=[Spring(name="s", start="a", end="b", stiffness=80.0, free_length=1.0)],
            attach=attach,
        )
    )
    found = estimate_damping(modes, Damping(dampers=(Damper(DamperPlace.SPRING, "s", 0.9),)))
    omega = np.sqrt(80.0 * (1 / 2.0 + 1 / 3.0))
    assert modes.omega[-1] == pytest.approx(omega, rel=1e-10)
    assert found.zeta[-1] == pytest.approx(0.9 * omega / (2.0 * 80.0), rel=1e-10)
    assert found.coupling == 0.0


def test_damper_at_a_sprung_joint():
    payload = joint("p", "a", X, body(2.0, inertia=(0.3, 0.2, 0.2)), angle=0.3, stiffness=7.0, target=0.3)
    modes = orbit_modes(structure([node("a", (0, 0, 0), body(1.0, inertia=(0.2, 0.1, 0.1)))], (), [payload]))
    found = estimate_damping(modes, Damping(dampers=(Damper(DamperPlace.JOINT, "p", 0.05),)))
    omega = np.sqrt(7.0 * (1 / 0.2 + 1 / 0.3))
    assert found.zeta[-1] == pytest.approx(0.05 * omega / (2.0 * 7.0), rel=1e-10)


# Material


def beam(*sections: Section, elements: int = 2) -> Structure:
    """Members in line, a lump in the middle so that no mode is symmetrical."""
    count = len(sections)
    names = "abcde"[: count + 1]
    nodes = [node(n, (0.7 * i, 0.1 * i**2, 0)) for i, n in enumerate(names)]
    nodes[1] = dataclasses.replace(nodes[1], body=body(0.4, (0.02, 0.01, 0.03), (1e-3, 2e-3, 3e-3)))
    members = [member(names[i], names[i + 1], s, elements) for i, s in enumerate(sections)]
    return structure(nodes, members)


def test_one_material_damps_every_mode_alike():
    modes = orbit_modes(beam(TUBE, SOFT))
    found = estimate_damping(modes, Damping(loss_factor=(("a-b", 0.02), ("b-c", 0.02))))
    flexible = modes.omega > 0.0
    # All energy is in members: eta / 2. The highest mode keeps eight digits of its energy.
    np.testing.assert_allclose(found.zeta[flexible], 0.01, rtol=1e-8)
    assert not found.zeta[~flexible].any()


def decay_ratio(lam: np.ndarray) -> np.ndarray:
    """-Re / |.| of the root lam^(1/2) in the upper left quadrant, from complex -lam = pole^2."""
    pole = 1j * np.sqrt(lam.astype(complex))
    return -pole.real / np.abs(pole)


def test_two_materials_against_complex_stiffness():
    """K_1 (1 + j eta_1) + K_2 (1 + j eta_2): the ratio is right up to the third power of the loss."""
    modes = orbit_modes(beam(TUBE, SOFT))
    K = tangent(modes.equilibrium)
    twice = dataclasses.replace(TUBE, EA=2 * TUBE.EA, GJ=2 * TUBE.GJ, EI_y=2 * TUBE.EI_y, EI_z=2 * TUBE.EI_z)
    K1 = tangent(solve_equilibrium(beam(twice, SOFT), Environment.orbit())) - K  # linear in the stiffnesses
    M, flexible = mass(modes), slice(6, 14)
    errors = []
    for eta in (0.2, 0.1):
        found = estimate_damping(modes, Damping(loss_factor=(("a-b", eta), ("b-c", 0.1 * eta))))
        lam = sla.eigvals(K + 1j * eta * (K1 + 0.1 * (K - K1)), M)
        lam = lam[np.argsort(lam.real)]
        exact = decay_ratio(lam[flexible])
        errors.append(np.abs(found.zeta[flexible] - exact).max() / eta)
        # Half of 0.1 to 1 of eta, according to where the mode bends.
        assert np.ptp(found.zeta[flexible]) > 0.1 * eta
    assert errors[1] < 0.02
    # Relative to eta the error is of second order: a quarter; the next term is a part eta^2 of it.
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_energy_held_by_gravity_is_not_lost():
    """A hanging article in 1-g: only the part of a mode's energy that is strain loses any."""
    nodes = [
        node(n, (x, 0, 0), body(4.0, (0, -0.05, 0.01), (0.1, 0.2, 0.3))) for n, x in (("a", 0.0), ("b", 1.0))
    ]
    attach = [AttachPoint(n, n, np.array([0, 0.02, 0])) for n in "ab"]
    parts = structure(nodes, [member("a", "b", SOFT, 3)], (), (), attach)
    lab = on_cables(4.0, 0.25, ("xyz", "yz"))
    modes = solve_modes(solve_equilibrium(parts, lab))
    eta = 0.01
    found = estimate_damping(modes, Damping(loss_factor=(("a-b", eta),)))
    # All strain there is is the member's; of a member in compression it is a little more than the whole
    # energy, where the share is cut to one.
    strain = np.minimum(found.zeta / (0.5 * eta), 1.0)
    np.testing.assert_allclose(strain, modes.strain_share, atol=1e-12)  # another order of sums
    assert 0.0 < found.zeta.max() / (0.5 * eta) - 1.0 < 1e-4
    # What gravity and cables hold keeps its energy to a part in hundreds; bending loses nearly all it should.
    assert found.zeta[:6].max() < 0.005 * 0.5 * eta
    assert found.zeta[6:].min() > 0.9 * 0.5 * eta


# Devices


def two_bars(c: float, k: float) -> tuple[Modes, Damping]:
    """Two bodies on springs to ground side by side, with a damper at one of them and a spring between."""
    places = {"a": 0.0, "b": 1.0}
    nodes = [node(n, (x, 0, 0), body(2.0, inertia=(0.1, 0.1, 0.1))) for n, x in places.items()]
    attach = [AttachPoint(n, n, np.zeros(3)) for n in places]
    parts = structure(
        nodes,
        springs=[Spring(name="between", start="a", end="b", stiffness=k, free_length=1.0)],
        attach=attach,
    )
    springs = tuple(
        AnchoredSpring(name=n, attach=n, anchor=np.array([x + s, 0.0, 0.0]), stiffness=50.0, free_length=1.0)
        for (n, x), s in zip(places.items(), (-1, 1), strict=True)
    )
    modes = solve_modes(
        solve_equilibrium(
            parts, Environment(title="springs", gravity=np.zeros(3), suspension=None, springs=springs)
        )
    )
    return modes, Damping(dampers=(Damper(DamperPlace.DEVICE, "a", c),))


def test_damper_against_complex_eigenvalues():
    """m x'' + c x' + k x in two masses: modal damping errs by the square of the coupling."""
    errors, couplings = [], []
    for c in (1.0, 0.5):
        modes, damping = two_bars(c, 40.0)
        found = estimate_damping(modes, damping)
        K = np.array([[90.0, -40.0], [-40.0, 90.0]])
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K / 2.0, -np.diag([c, 0.0]) / 2.0]])
        pole = np.linalg.eigvals(A)
        pole = np.sort_complex(pole[pole.imag > 0])
        pole = pole[np.argsort(np.abs(pole))]
        np.testing.assert_allclose(modes.omega[-2:], np.sqrt([25.0, 65.0]), rtol=1e-10)
        errors.append(np.abs(found.zeta[-2:] + pole.real / np.abs(pole)).max() / c)
        couplings.append(found.coupling)
    # phi = (1, +-1)/2: both diagonal terms and the coupling are c/4, so it is c omega_2 / (4 (65 - 25)).
    np.testing.assert_allclose(couplings, np.array([1.0, 0.5]) * np.sqrt(65.0) / 160.0, rtol=1e-9)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)  # second order in c; the next is c^2 of it


def test_coupling_that_is_left_out_is_warned_about():
    modes, damping = two_bars(1.0, 0.5)  # 5.0 and 5.1 rad/s
    found = estimate_damping(modes, damping)
    assert found.coupling > COUPLING_LIMIT
    assert "leaves that out" in found.warnings[0]
    with pytest.warns(UserWarning, match="dampers couple modes"):
        build_plant(modes, inputs=[], outputs=[], damping=damping)
    few = estimate_damping(modes, damping, count=len(modes.omega) - 1)
    assert few.coupling == 0.0  # the neighbour is not kept


def test_equal_frequencies_are_coupled_without_limit():
    modes, damping = two_bars(1e-3, 1e-12)
    assert estimate_damping(modes, damping).coupling > 1e3


def test_a_damper_on_a_rigid_mode_is_warned_about():
    payload = joint("p", "a", X, body(2.0, inertia=(0.3, 0.2, 0.2)), angle=0.3)
    modes = orbit_modes(structure([node("a", (0, 0, 0), body(1.0, inertia=(0.2, 0.1, 0.1)))], (), [payload]))
    found = estimate_damping(modes, Damping(dampers=(Damper(DamperPlace.JOINT, "p", 0.05),)))
    assert not found.zeta.any()
    assert found.warnings[0].startswith("a damper works on the rigid modes 'gimbal p'")


# Tables, modes and sums


TABLE = DampingTable(np.array([0.1, 1.0, 100.0]), np.array([0.04, 0.02, 0.01]))


def test_table_is_linear_in_the_logarithm_of_frequency():
    m = 2.0
    for hz, zeta in ((0.1, 0.04), (np.sqrt(0.1), 0.03), (10.0, 0.015), (100.0, 0.01)):
        modes = on_a_spring(m, m * (2.0 * np.pi * hz) ** 2)
        table = dataclasses.replace(TABLE, hold=True)  # the ends to rounding
        assert estimate_damping(modes, Damping(table=table)).zeta[-1] == pytest.approx(zeta, rel=1e-9)


def test_outside_of_the_table():
    modes = on_a_spring(2.0, 2.0 * (2.0 * np.pi * 300.0) ** 2)
    with pytest.raises(ConfigError, match="300 Hz is outside") as refused:
        estimate_damping(modes, Damping(table=TABLE))
    assert refused.value.where == "damping.table"
    held = dataclasses.replace(TABLE, hold=True)
    assert estimate_damping(modes, Damping(table=held)).zeta[-1] == 0.01
    # Only modes that are kept are looked up.
    assert not estimate_damping(modes, Damping(table=TABLE), count=5).zeta.any()


def test_sources_add_up_and_a_mode_of_its_own_stands_alone():
    modes = orbit_modes(beam(TUBE, SOFT))
    some = Damping(flexible=0.003, loss_factor=(("a-b", 0.02), ("b-c", 0.02)))
    found = estimate_damping(modes, some)
    np.testing.assert_allclose(found.zeta[6:], 0.013, rtol=1e-8)
    np.testing.assert_allclose(found.base + found.material + found.device, found.zeta, rtol=1e-15)
    own = dataclasses.replace(some, by_mode=((modes.name[7], 0.05), (9, 0.002)))
    given = estimate_damping(modes, own)
    assert (given.zeta[7], given.zeta[9]) == (0.05, 0.002)
    others = np.setdiff1d(np.arange(len(modes.omega)), [7, 9])
    np.testing.assert_array_equal(given.zeta[others], found.zeta[others])


def test_by_kind_is_what_it_was():
    modes = orbit_modes(beam(TUBE))
    found = estimate_damping(modes, Damping(flexible=0.02, suspension=0.1, rigid=0.0))
    assert found.zeta.tolist() == [0.0] * 6 + [0.02] * (len(modes.omega) - 6)


def test_a_name_that_no_mode_has_is_warned_about():
    """An article's file serves orbit and lab, whose modes have other names."""
    found = estimate_damping(on_a_spring(), Damping(by_mode=(("bounce", 0.05),)))
    assert found.warnings == ("a damping ratio is given for mode 'bounce', which there is not here",)


@pytest.mark.parametrize(
    ("damping", "message"),
    [
        (Damping(by_mode=((99, 0.1),)), "no mode 99"),
        (Damping(loss_factor=(("x-y", 0.1),)), "no member 'x-y'"),
        (Damping(dampers=(Damper(DamperPlace.JOINT, "q", 1.0),)), "no joint 'q'"),
        (Damping(dampers=(Damper(DamperPlace.SPRING, "q", 1.0),)), "no spring 'q'"),
        (Damping(dampers=(Damper(DamperPlace.DEVICE, "q", 1.0),)), "no attach point 'q'"),
        (Damping(dampers=(Damper(DamperPlace.DEVICE, "p", 100.0),)), "damping ratio 5"),
    ],
)
def test_what_cannot_be_is_refused(damping: Damping, message: str):
    with pytest.raises(ConfigError, match=message):
        estimate_damping(on_a_spring(), damping)


def test_a_damper_at_a_fixed_axis_is_refused():
    payload = joint("p", "a", X, body(2.0, inertia=(0.3, 0.2, 0.2)), angle=0.3, state=JointState.LOCKED)
    modes = orbit_modes(structure([node("a", (0, 0, 0), body(1.0, inertia=(0.2, 0.1, 0.1)))], (), [payload]))
    with pytest.raises(ConfigError, match="'p', which is locked"):
        estimate_damping(modes, Damping(dampers=(Damper(DamperPlace.JOINT, "p", 0.05),)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Damping(flexible=1.0), ">= 0 and < 1"),
        (lambda: Damping(by_mode=((0, -0.1),)), ">= 0 and < 1"),
        (lambda: Damping(flexible=0.01, suspension=0.03, table=TABLE), "by kind and from a table"),
        (lambda: Damping(loss_factor=(("a", -1.0),)), "negative"),
        (lambda: Damping(dampers=(Damper(DamperPlace.JOINT, "p", np.nan),)), "not finite"),
        (lambda: DampingTable(np.array([1.0, 1.0]), np.array([0.1, 0.1])), "ascending"),
        (lambda: DampingTable(np.array([1.0, 2.0]), np.array([0.1, 1.0])), "below 1"),
        (lambda: DampingTable(np.zeros(0), np.zeros(0)), "ascending"),
    ],
)
def test_bad_values_are_refused(make, message: str):
    with pytest.raises(ConfigError, match=message):
        make()


def test_a_path_that_dampers_join_is_warned_about_by_its_own_error():
    """A port that hardly sees the damped mode: coupling of 1 % is a third of its response, and is told."""
    rng = np.random.default_rng(5)
    reported, wrong = [], []
    for _ in range(12):
        k, c = 10.0 ** rng.uniform(1.0, 3.0, 2), 10.0 ** rng.uniform(-6.0, -0.5, 2)
        parts = dataclasses.replace(
            structure(
                [node("base", (0, 0, 0), body(1.0, inertia=(1.0, 1.0, 1.0)))],
                joints=[
                    Joint(
                        name=name, parent=parent, offset=np.zeros(3), axis=X, angle=0.0, slides=True,
                        body=body(m, inertia=(0.1, 0.1, 0.1)), state=JointState.SPRUNG, stiffness=stiffness,
                    )
                    for name, parent, m, stiffness in (("a", "base", 1.0, k[0]), ("b", "a", 0.5, k[1]))
                ],
                actuators=[Actuator(name="push", frame="b", axis=None)],
                sensors=[Sensor(name=n, frame=n, axis=None) for n in "ab"],
            ),
            damping=Damping(dampers=tuple(Damper(DamperPlace.JOINT, "ab"[i], c[i]) for i in (0, 1))),
        )  # fmt: skip
        modes = solve_modes(solve_equilibrium(parts, Environment.clamped("base", gravity=0.0)))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            plant = build_plant(modes, inputs=["push"], outputs=["a", "b"])
        M = np.array([[1.5, 0.5], [0.5, 0.5]])
        s = 1j * modes.omega
        exact = [np.linalg.solve(M * x**2 + np.diag(c) * x + np.diag(k), [0.0, 1.0]) for x in s]
        found = evaluate_plant(plant, modes.frequency_hz).H[:, :2, 0]
        wrong.append(np.max(np.abs(found - exact) / np.abs(exact).max(axis=0)))
        reported.append(any("losses join the modes" in str(w.message) for w in caught))
    assert reported == [error > LEFT_OUT for error in wrong]
    assert 3 <= sum(reported) <= 9


def test_large_loss_factors_are_warned_about():
    """Root of omega^2 (1 + j eta): sin(atan(eta)/2) for eta/2."""
    modes = orbit_modes(structure([node("a", (0, 0, 0), body(2.0, inertia=(0.1,) * 3)),
                                   node("b", (1, 0, 0), body(2.0, inertia=(0.1,) * 3))],
                                  [member("a", "b", TUBE, 2)]))  # fmt: skip
    for eta, off in ((0.05, False), (0.06, True)):
        found = estimate_damping(modes, Damping(loss_factor=(("a-b", eta),)))
        assert (abs(found.zeta.max() / np.sin(np.arctan(eta) / 2.0) - 1.0) > 1e-3) == off
        assert bool(found.warnings) == off


def test_a_loss_that_all_members_share_joins_no_modes() -> None:
    """Paths that are zero by symmetry were compared with their own rounding."""
    nodes = [
        node(c, (i, 0, 0), body(2.0 + i, (0, 0, 0), (0.02, 0.03, 0.04)), 0.05) for i, c in enumerate("abc")
    ]
    members = [member(*ends, TURNING_TUBE, 3, (0, 0, 1)) for ends in ("ab", "bc")]
    article = dataclasses.replace(
        structure(
            nodes,
            members,
            actuators=[
                Actuator(name=f"t{c}", frame="a", axis=e) for c, e in zip("xyz", np.eye(3), strict=True)
            ],
            sensors=[Sensor(name=f"a{c}", frame="c", axis=e) for c, e in zip("xyz", np.eye(3), strict=True)],
        ),
        damping=Damping(loss_factor=tuple((m.name, 0.02) for m in members)),
    )
    modes = solve_modes(solve_equilibrium(article, Environment.orbit()))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        build_plant(modes, inputs=["tx", "ty", "tz"], outputs=["ax", "ay", "az"], count=26)
    assert not any("losses join the modes" in str(w.message) for w in caught)

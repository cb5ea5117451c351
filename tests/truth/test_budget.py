"""The budget of gravity's effects against closed forms in which each effect stands alone."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import scipy.linalg as sla

from middeck.errors import ConfigError
from middeck.files.setups import load_setup
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.budget import (
    CORNERS,
    EFFECTS,
    ORDERS,
    GravityBudget,
    build_budget,
    corner_matrices,
)
from middeck.structure.gravity.tracking import solve_spectrum
from middeck.structure.model.article import AttachPoint, Section, Spring
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import AnchoredSpring, Device, DeviceKind, Environment
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from repeats import repeats
from structure_builders import (
    GRAVITY,
    TURNING_TUBE,
    body,
    joint,
    lab,
    member,
    node,
    on_cables,
    rigid_bar,
    spin,
    structure,
    tube_bus,
)

G = 9.80665
SUSPENSION, STIFFNESS, DEFORMATION = range(3)


def both(parts, environment) -> tuple[Modes, Modes]:
    orbit, there = (solve_modes(solve_equilibrium(parts, e)) for e in (Environment.orbit(), environment))
    return orbit, there


def hung_bus():
    """Bodies off their nodes on a tube, a turned payload, and a bow and string of its own."""
    payload = body(2.0, (0, -0.1, 0), (0.02, 0.01, 0.02))
    masses, cg, inertia = (4.0, 6.0, 3.0), (0.01, -0.05, 0.02), (0.1, 0.2, 0.15)
    string = Spring(name="string", start="a", end="b", stiffness=300.0, free_length=0.8)
    return tube_bus(masses, cg, inertia, payload, angle=0.4, above=(0.0, 0.05, 0.0), springs=[string])


@pytest.fixture(scope="module")
def bus() -> tuple[Modes, Modes]:
    return both(hung_bus(), on_cables(3.0, 0.3))


@pytest.fixture(scope="module")
def budget(bus: tuple[Modes, Modes]) -> GravityBudget:
    return build_budget(*bus)


# The cube


def test_ends_of_the_cube_are_orbit_and_laboratory(bus: tuple[Modes, Modes]):
    """All off and all on, assembled from their parts, against the tangents; the string is tight in orbit."""
    orbit, there = bus
    for on, modes in (((0, 0, 0), orbit), ((1, 1, 1), there)):
        rest = modes.equilibrium
        K, M = corner_matrices(orbit.equilibrium, there.equilibrium, on)
        whole = assemble(rest.model, rest.config, rest.loads).tangent
        mass = mass_matrix(rest.model, rest.config, rest.loads)
        # Rounding: the same terms in another order.
        assert abs(K - whole).max() <= 1e-14 * abs(whole).max()
        assert abs(M - mass).max() <= 1e-14 * abs(mass).max()
        lam = solve_spectrum(rest.model, rest.config, K, M, 30).lam[:30]
        assert lam == pytest.approx(modes.omega[:30] ** 2, rel=1e-10, abs=1e-9)


def test_contributions_add_up_to_the_shift_in_every_order(budget: GravityBudget):
    total = budget.corner[:, 1, 1, 1] - budget.corner[:, 0, 0, 0]
    largest = np.abs(budget.corner).max(axis=(1, 2, 3))
    for by_effect in budget.by_order:
        # Rounding of four numbers whose differences telescope.
        assert np.abs(by_effect.sum(axis=1) - total) == pytest.approx(0.0 * total, abs=4e-16 * largest.max())
    shift = budget.frequency_hz[:, 1] - budget.frequency_hz[:, 0]
    assert budget.share_hz.sum(axis=1) == pytest.approx(shift, rel=1e-12, abs=1e-13)
    assert len(ORDERS) == 6
    assert len(CORNERS) == 2 ** len(EFFECTS)


def test_mean_and_range_are_over_all_orders(budget: GravityBudget):
    """By hand from the corners: the mean weighs an effect first, second (twice) and last by 1/3, 1/6, 1/3."""
    c = budget.corner
    S = (c[:, 1, 0, 0] - c[:, 0, 0, 0], c[:, 1, 1, 0] - c[:, 0, 1, 0],
         c[:, 1, 0, 1] - c[:, 0, 0, 1], c[:, 1, 1, 1] - c[:, 0, 1, 1])  # fmt: skip
    mean = S[0] / 3 + S[1] / 6 + S[2] / 6 + S[3] / 3
    scale = 1.0 / (4 * np.pi**2 * budget.frequency_hz.sum(axis=1))
    assert budget.share_hz[:, SUSPENSION] == pytest.approx(mean * scale, rel=1e-12, abs=1e-13)
    assert budget.range_hz[:, SUSPENSION, 0] == pytest.approx(np.min(S, axis=0) * scale, abs=1e-13)
    assert budget.range_hz[:, SUSPENSION, 1] == pytest.approx(np.max(S, axis=0) * scale, abs=1e-13)


def test_each_mode_stands_once_and_in_the_order_of_the_laboratory(budget: GravityBudget):
    rows = budget.pairs[:, 1]
    assert np.all(np.diff(rows) > 0)
    kinds = [budget.orbit.kind[i] for i in budget.pairs[:, 0]]
    assert kinds.count("rigid") == 7
    assert budget.frequency_hz[:, 1] == pytest.approx(budget.lab.frequency_hz[rows], rel=1e-12)
    flexible = [i for i, k in enumerate(kinds) if k == "flexible"]
    own = budget.pairs[flexible, 0]
    assert budget.frequency_hz[flexible, 0] == pytest.approx(budget.orbit.frequency_hz[own], rel=1e-12)


def test_matches_that_say_little_are_named(budget: GravityBudget):
    doubtful = np.flatnonzero(budget.match.min(axis=(1, 2, 3)) < np.sqrt(0.5))
    assert budget.doubtful == tuple(doubtful)
    assert np.all((budget.match >= 0.0) & (budget.match < 1.05))  # two masses: not quite a cosine


# Closed forms


@pytest.mark.parametrize("h", [0.0, 0.3])
def test_bar_on_two_cables(h: float):
    """Springs, T/l and m g h in every corner; what hangs where it was drawn is not deformed."""
    m, a, length, bounce, Ix, Iy, Iz = 6.0, 1.0, 3.0, 0.3, 0.3, 2.1, 2.0
    bar = rigid_bar(m, 2 * a, (Ix, Iy, Iz), attach_y=h)
    env = on_cables(length, bounce, ("xyz", "yz"), attach=("left", "right"))
    found = build_budget(*both(bar, env))
    k, t = m * (2 * np.pi * bounce) ** 2, m * G / length
    for S, g, D in itertools.product((0, 1), repeat=3):
        tilt = S * (k * a**2 + t * h**2) + g * m * G * h  # k of both
        swing = np.array([[S * t, S * t * h], [S * t * h, 0.0]])
        pairs = [
            sla.eigh(swing + np.diag([0.0, x]), np.diag([m, inertia]), eigvals_only=True)
            for x, inertia in ((tilt, Iz), (S * t * h**2 + g * m * G * h, Ix))
        ]
        expected = [*pairs[0], *pairs[1], S * k / m, S * t * a**2 / Iy]
        # The rest state is found to 1e-9 of the weight.
        corner = np.sort(found.corner[:, S, g, D])
        assert corner == pytest.approx(np.sort(expected), rel=1e-8, abs=1e-7)
    assert found.share_hz[:, DEFORMATION] == pytest.approx(np.zeros(6), abs=1e-8)
    yaw = [found.lab.name[j] for j in found.pairs[:, 1]].index("yaw")
    bounce_row = [found.lab.name[j] for j in found.pairs[:, 1]].index("bounce")
    for row in (yaw, bounce_row):  # no other effect, in any order
        assert found.range_hz[row, SUSPENSION] == pytest.approx(np.full(2, found.shift_hz[row]), rel=1e-7)
    spread = np.ptp(found.by_order[:, :, STIFFNESS], axis=0).max()
    assert spread == pytest.approx(0.0, abs=1e-7) if h == 0.0 else spread > 1.0  # (rad/s)^2, of some 30


def ground(*more, nodes=(), members=(), joints=(), springs=()):
    """A base so heavy that its suspension is none to what it carries, held by stiff springs in the lab."""
    corners = {f"{x:+d}{z:+d}": (float(x), 0.0, float(z)) for x in (-1, 1) for z in (-1, 1)}
    attach = [AttachPoint(n, "base", np.array(p)) for n, p in corners.items()]
    base = node("base", (0, 0, 0), body(1e7, inertia=(1e7,) * 3))
    held = [
        AnchoredSpring(name=n, attach=n, anchor=np.add(p, (0.0, 2.0, 0.0)), stiffness=1e10, free_length=2.0)
        for n, p in corners.items()
    ]
    return structure([base, *nodes], members, joints, springs, [*attach, *more]), lab(*held)


def test_payload_pendulum_is_all_stiffness():
    """m g d / (I + m d^2) comes of the weight alone: no device touches it, and the base does not tilt."""
    m, d, inertia = 5.0, 0.08, 0.03
    payload = joint("p", "base", np.eye(3)[2], body(m, (0, -d, 0), (1, 1, inertia)))
    found = build_budget(*both(*ground(joints=[payload])))
    names = [found.lab.name[j] for j in found.pairs[:, 1]]
    row = names.index("payload pendulum p")
    exact = m * G * d / (inertia + m * d**2)
    # The base is 1e7 times heavier; its weight sinks it by 2.5e-3 m, which turns nothing.
    for contribution in found.by_order[:, row]:
        assert contribution == pytest.approx([0.0, exact, 0.0], abs=1e-5 * exact)
    assert found.match[row] == pytest.approx(np.ones((2, 2, 2)), abs=1e-5)


@pytest.mark.parametrize("weight", [40.0, 400.0])
def test_hinged_beam_in_tension_is_all_stiffness(weight: float):
    """Hinged at the base, guided at its loaded foot: omega^2 gains N (n pi / L)^2 / rho A, whatever EI."""
    L, mass = 2.0, weight / G
    string = Section(EA=1e7, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.01, rho_I_y=0.0, rho_I_z=0.0)
    nodes = [node("top", (0, 0, 0)), node("foot", (0, -L, 0), spin(mass, (0.0, 0.1, 0.0)))]
    far = 1e3  # springs so long that they do not turn
    ties = {"top": [(far, 0, 0), (0, far, 0), (0, 0, far)], "foot": [(far, -L, 0), (0, -L, far)]}
    attach = [AttachPoint(n, n, np.zeros(3)) for n in ties]
    springs: list[Spring] = []
    for end, anchors in ties.items():
        for anchor in anchors:
            name = f"{end} {len(springs)}"
            attach.append(AttachPoint(name, "base", np.array(anchor, dtype=float)))
            springs.append(Spring(name=name, start=name, end=end, stiffness=1e9, free_length=far))
    beam = member("top", "foot", string, 12, up=(1, 0, 0))
    found = build_budget(*both(*ground(*attach, nodes=nodes, members=[beam], springs=springs)), count=14)
    for n in (1, 2):
        free = (n * np.pi / L) ** 4 * string.EI_y / string.rho_A
        rows = np.argsort(np.abs(found.corner[:, 0, 0, 0] - free))[:2]  # both planes
        # The mean of the tension is the load and half of its own weight, 0.05 N more.
        exact = (weight + 0.5 * string.rho_A * L * G) * (n * np.pi / L) ** 2 / string.rho_A
        for contribution in found.by_order[:, rows].reshape(-1, 3):
            # Twelve cubic elements err by (2 pi / 12)^4 / 720 = 1e-4 of the second mode.
            assert contribution[STIFFNESS] == pytest.approx(exact, rel=2e-4)
            assert contribution[SUSPENSION] == pytest.approx(0.0, abs=2e-4 * exact)
            # It stretches by N / EA = 4e-5 at most: four times that of (n pi / L)^4 EI / rho A.
            assert contribution[DEFORMATION] == pytest.approx(0.0, abs=1e-3 * exact)


# Where the whole hangs is no deformation


def with_devices(environment: Environment, kind: DeviceKind) -> Environment:
    assert environment.suspension is not None
    return dataclasses.replace(environment, suspension=dataclasses.replace(environment.suspension, kind=kind))


@pytest.mark.parametrize("article", repeats(["bus", "mace-simple"]))
def test_springs_and_constant_forces_of_the_same_frequencies_have_one_budget(article: str):
    """At rest both hang in the same shape, on cables of one length; the springs let it sink by 3 to 4 m."""
    parts, environment = hung_bus(), on_cables(3.0, 0.3)
    if article == "mace-simple":
        parts, environment = load_setup("articles/mace-simple.toml", "environments/lab.toml")
    found = [build_budget(*both(parts, with_devices(environment, kind))) for kind in DeviceKind]
    drawn, sunk = ([m.equilibrium.config.x[0, 1] for m in (f.orbit, f.lab)] for f in found)
    assert drawn[0] - drawn[1] < 0.1 < 2.7 < sunk[0] - sunk[1]
    # Rest to 1e-9 of the weight leaves 1e-9 of each omega^2; corners of doubtful modes are no worse.
    assert found[1].shift_hz == pytest.approx(found[0].shift_hz, abs=1e-6)
    assert found[1].share_hz == pytest.approx(found[0].share_hz, abs=1e-6)
    assert found[1].range_hz == pytest.approx(found[0].range_hz, abs=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.3])
def test_heading_is_no_deformation(turn: float):
    """Anchors turned about the vertical turn a rigid bar with them; it hangs as it was drawn, elsewhere."""
    bar = rigid_bar(6.0, 2.0, (0.3, 2.1, 2.0), attach_y=0.3)
    down = solve_equilibrium(bar, on_cables(3, 0.3, ("xyz", "yz"), attach=("left", "right")))
    about = rotation_exp(np.array([0.0, turn, 0.0]))
    lines = zip(("left", "right"), down.loads.anchor, down.suspension.stiffness, strict=True)
    devices = tuple(
        Device(name=n, attach=n, force=3.0 * G, stiffness=k, anchor=about @ a) for n, a, k in lines
    )
    found = build_budget(*both(bar, Environment(title="lab", gravity=GRAVITY, devices=devices)))
    # Rounding, of shapes that have turned; the force of 1e-9 of the weight that is left tilts by no more.
    assert found.match[:, 0, 0, 1] == pytest.approx(np.ones(6), abs=1e-7)
    assert found.share_hz[:, DEFORMATION] == pytest.approx(np.zeros(6), abs=1e-6)


def test_a_tilt_is_a_deformation():
    """Gravity sees it: an article that hangs askew stands otherwise under its weight than it was drawn."""
    bar = rigid_bar(6.0, 2.0, (0.3, 2.1, 2.0), attach_y=0.3)
    drawn = solve_equilibrium(bar, on_cables(3, 0.3, ("xyz", "yz"), attach=("left", "right")))
    lines = zip(("left", "right"), drawn.loads.anchor, (32.0, 28.0), strict=True)
    devices = tuple(Device(name=n, attach=n, force=f, stiffness=10.0, anchor=a) for n, a, f in lines)
    found = build_budget(*both(bar, Environment(title="lab", gravity=GRAVITY, devices=devices)))
    assert np.abs(found.share_hz[:, DEFORMATION]).max() > 1e-4


def test_axes_of_a_clamp_change_no_budget():
    """A hinge about z holds the same turns in axes turned about z."""
    nodes = [node("root", (0, 0, 0)), node("tip", (1, 0, 0), body(1.0, inertia=(0.1, 0.1, 0.1)))]
    beam = structure(
        nodes,
        [member("root", "tip", TURNING_TUBE, 2)],
        attach=[AttachPoint("tip", "tip", np.array([0, 0.1, 0]))],
    )
    budgets = []
    for turn in (0.0, 0.7):
        clamp = Clamp(node="root", about="xy", axes=rotation_exp(np.array([0.0, 0.0, turn])))
        held = Environment(title="held", gravity=np.zeros(3), clamps=(clamp,))
        device = Device(name="d", attach="tip", bounce_hz=0.5, cable_length=2.0, held="y")
        hung = dataclasses.replace(held, title="lab", gravity=GRAVITY, devices=(device,))
        budgets.append(build_budget(*(solve_modes(solve_equilibrium(beam, e)) for e in (held, hung))))
    drawn, turned = budgets
    np.testing.assert_allclose(turned.by_order, drawn.by_order, rtol=1e-6, atol=1e-6)
    assert np.abs(drawn.by_order).max() > 1.0


# What is refused


def test_a_budget_is_of_one_structure_from_orbit(bus: tuple[Modes, Modes]):
    orbit, there = bus
    other = solve_modes(solve_equilibrium(rigid_bar(1.0, 1.0, (1, 1, 1)), Environment.orbit()))
    with pytest.raises(ConfigError, match="one structure"):
        build_budget(other, there)
    with pytest.raises(ConfigError, match="must be modes in orbit"):
        build_budget(there, there)
    assert len(build_budget(orbit, there, 3).pairs) == 3

"""The beam element against derivatives by differences and the closed forms of beam theory."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import scipy.linalg as sla
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from middeck.structure.assembly.environment_loads import no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model, mesh_structure
from middeck.structure.elements.beam import beam_properties, beam_state, beam_weight
from middeck.structure.elements.frames import frame_poses, points_in_world
from middeck.structure.elements.rotations import rotation_exp, skew
from middeck.structure.model.article import Section
from repeats import repeats
from structure_builders import TUBE, clamped_matrices, member, newton, node, straight_beam, structure

L = 2.0
EI, GJ, EA, RHO = TUBE.EI_y, TUBE.GJ, TUBE.EA, TUBE.rho_A
UNEQUAL = Section(
    EA=2e4, GJ=30.0, EI_y=50.0, EI_z=80.0, rho_A=0.5, rho_I_y=2e-4, rho_I_z=3e-4, GA_y=4e4, GA_z=3e4
)


def frequencies(model: Model, count: int, fixed=range(6), load=None, config=None) -> np.ndarray:
    """Lowest angular frequencies with ``fixed`` coordinates held; massless motions follow statically."""
    K, M, _ = clamped_matrices(model, config, fixed, load)
    mu = sla.eigh(M, K, eigvals_only=True)
    return 1.0 / np.sqrt(mu[::-1][:count])


def end_load(model: Model, force=(0, 0, 0), moment=(0, 0, 0)) -> np.ndarray:
    """Dead force and moment at the far end of a one-member model, as an energy gradient."""
    load = np.zeros((len(model.points.frame), 6))
    load[model.element_ends[-1, 1]] = -np.concatenate([force, moment])
    return load


def tip(model: Model, config) -> np.ndarray:
    return config.x[1] - model.rest.x[1]


def observed_order(errors: list[float]) -> float:
    """Order of convergence from the last two meshes, each twice as fine as the one before."""
    return float(np.log2(errors[-2] / errors[-1]))


# Derivatives


def bent_element(seed: int):
    rng = np.random.default_rng(seed)
    beams = beam_properties([UNEQUAL], np.array([0.5]))
    turn = rotation_exp(rng.standard_normal(3))
    x = np.array([[[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]]])
    x[0, 1] += turn @ [0.55, 0.1, -0.08]
    ends = [turn @ rotation_exp(0.5 * rng.standard_normal(3)) for _ in range(2)]
    return beams, x, np.array([ends])


def moved(x, T, q):
    """End poses after the increment q = (dx1, theta1, dx2, theta2)."""
    q = q.reshape(2, 6)
    return x + q[None, :, :3], np.array([[rotation_exp(q[i, 3:]) @ T[0, i] for i in range(2)]])


@pytest.mark.parametrize("which", ["strain", "weight"])
@pytest.mark.parametrize("seed", repeats(range(4)))
def test_gradient_and_hessian_are_derivatives_of_the_energy(which: str, seed: int):
    beams, x, T = bent_element(seed)
    gravity = np.array([1.0, -9.0, 2.0])

    def state(q):
        poses = moved(x, T, q)
        return beam_weight(beams, *poses, gravity) if which == "weight" else beam_state(beams, *poses)

    at, step = state(np.zeros(12)), 1e-3
    unit = np.eye(12)

    def slope(f, h):
        """Central differences of fourth order."""
        return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / 12

    gradient = np.array([slope(lambda h, a=a: state(h * unit[a]).energy[0], step) / step for a in range(12)])
    # Truncation h^4 = 1e-12 and rounding 1e-16/h = 1e-13, times the fifth derivative.
    assert np.abs(gradient - at.gradient[0]).max() < 1e-8 * np.abs(at.gradient).max()

    def energy(a, b, s, t):
        return state(s * unit[a] + t * unit[b]).energy[0]

    hessian = np.zeros((12, 12))
    for a in range(12):
        for b in range(a, 12):
            estimates = [
                (energy(a, b, h, h) - energy(a, b, h, -h) - energy(a, b, -h, h) + energy(a, b, -h, -h))
                / (4 * h * h)
                for h in (2e-3, 4e-3)
            ]
            hessian[a, b] = hessian[b, a] = (4 * estimates[0] - estimates[1]) / 3  # Richardson
    # Rounding 1e-16 E/h^2 = 1e-10 and truncation h^4 = 1e-10, times the sixth derivative.
    assert np.abs(hessian - at.hessian[0]).max() < 1e-6 * np.abs(at.hessian).max()
    assert (
        np.array_equal(at.hessian[0], at.hessian[0].T)
        or np.abs(at.hessian[0] - at.hessian[0].T).max() < 1e-12 * np.abs(at.hessian).max()
    )


@pytest.mark.parametrize("seed", range(4))
def test_energy_is_blind_to_rigid_motion(seed: int):
    beams, x, T = bent_element(seed)
    turn, shift = rotation_exp(np.array([2.0, -1.0, 0.7])), np.array([1.0, 2.0, 3.0])
    before, after = beam_state(beams, x, T), beam_state(beams, x @ turn.T + shift, turn @ T)
    assert after.energy[0] == pytest.approx(before.energy[0], rel=1e-12)  # rounding of the rotation
    rotated = np.kron(np.eye(4), turn) @ before.gradient[0]
    assert after.gradient[0] == pytest.approx(rotated, abs=1e-11 * np.abs(rotated).max())


def test_beam_is_the_same_from_either_end():
    beams, x, T = bent_element(1)
    flip = np.diag([-1.0, 1.0, -1.0])
    ahead, back = beam_state(beams, x, T), beam_state(beams, x[:, ::-1], T[:, ::-1] @ flip)
    assert back.energy[0] == pytest.approx(ahead.energy[0], rel=1e-12)  # rounding


# Statics


@pytest.mark.parametrize("elements", [1, 3])
def test_cantilever_under_small_loads(elements: int):
    """Linear closed forms are exact for cubic elements on any mesh."""
    section = Section(EA=EA, GJ=GJ, EI_y=50.0, EI_z=80.0, rho_A=RHO, rho_I_y=0.0, rho_I_z=0.0)
    model = mesh_structure(straight_beam(section, L, elements))
    K, _, keep = clamped_matrices(model)
    right_end = np.arange(6, 12)
    force = np.zeros((6, model.tree.size))
    force[:, right_end] = np.eye(6)
    flexibility = np.linalg.solve(K, force[:, keep].T)[np.searchsorted(keep, right_end)]
    expected = np.diag([L / EA, L**3 / 240.0, L**3 / 150.0, L / GJ, L / 50.0, L / 80.0])
    expected[1, 5] = expected[5, 1] = L**2 / 160.0
    expected[2, 4] = expected[4, 2] = -(L**2) / 100.0
    assert flexibility == pytest.approx(expected, rel=1e-10, abs=1e-12)  # rounding times condition


@pytest.mark.parametrize("elements", [1, 4])
def test_timoshenko_cantilever_adds_its_shear_deflection(elements: int):
    section = dataclasses.replace(TUBE, GA_y=2e3, GA_z=3e3)
    model = mesh_structure(straight_beam(section, L, elements))
    K, _, keep = clamped_matrices(model)
    at = np.searchsorted(keep, [7, 8])
    flexibility = np.diag(np.linalg.inv(K)[np.ix_(at, at)])
    expected = L**3 / (3 * EI) + L / np.array([2e3, 3e3])
    assert flexibility == pytest.approx(expected, rel=1e-10)  # rounding times condition


def test_sagging_cantilever_under_its_weight():
    """Consistent end moments make the tip exact for a uniform load: w L^4 / 8 EI."""
    model = mesh_structure(straight_beam(TUBE, L, 2))
    none = no_loads()
    g = 1e-4  # so weak that geometry stays linear: sag 1e-6 m, second-order terms 1e-12
    loads = dataclasses.replace(none, gravity=np.array([0.0, -g, 0.0]))
    config = newton(model, np.zeros((len(model.points.frame), 6)), loads=loads)
    assert tip(model, config)[1] == pytest.approx(-RHO * g * L**4 / (8 * EI), rel=1e-7)


def test_roll_up_under_an_end_moment():
    """M = 2 pi EI / L closes a beam into a circle, a regular polygon of the elements' chords.

    The moment turns about the fixed z axis and the bending stays in its plane, so that it is conservative.
    Chord and bow together keep the centre line's length: the corners lie on the circle with order four.
    """
    heights = []
    for elements in (8, 16):
        model = mesh_structure(straight_beam(TUBE, L, elements))
        load = end_load(model, moment=(0, 0, 2 * np.pi * EI / L))
        config = newton(model, load, steps=4)
        assert np.linalg.norm(config.x[1]) < 1e-7 * L  # Newton's tolerance over the softest stiffness
        heights.append(float(np.abs(np.ptp(config.x[:, 1]) / (L / np.pi) - 1.0)))
        # The rotation is exact: M L / EI for every element, whatever its chord does.
        assert config.R[1] == pytest.approx(np.eye(3), abs=1e-8)
    assert observed_order(heights) == pytest.approx(4.0, abs=0.1)


def bent_rod_tip(radius: float, angle: float, EA: float, EI: float, GJ: float, force: float) -> np.ndarray:
    """Tip of an initially circular Kirchhoff rod under a dead force across its plane, by shooting.

    Equilibrium gives the moment at once, m = (tip - r) x F; what is left is the kinematics r' = (1 + N/EA) t,
    R' = R [kappa]. Neither elements nor an energy enter.
    """
    F = np.array([0.0, 0.0, force])

    def slope(s, y, end, share):
        r, R = y[:3], y[3:].reshape(3, 3)
        kappa = R.T @ np.cross(end - r, share * F) / [GJ, EI, EI] + [0.0, 0.0, 1.0 / radius]
        stretch = 1.0 + share * R[:, 0] @ F / EA
        return np.concatenate([R[:, 0] * stretch, (R @ skew(kappa)).ravel()])

    def miss(end, share):
        start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
        run = solve_ivp(
            slope, (0, radius * angle), start, args=(end, share), rtol=1e-9, atol=1e-9, method="DOP853"
        )
        return run.y[:3, -1] - end

    end = radius * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
    for share in (0.25, 0.5, 0.75, 1.0):
        end = fsolve(miss, end, args=(share,), xtol=1e-10)
    return end


def test_forty_five_degree_bend():
    """Bathe and Bolourchi 1979: radius 100, unit square section, force 600 out of the plane."""
    radius, angle, E = 100.0, np.pi / 4, 1e7
    section = Section(EA=E, GJ=E / 12, EI_y=E / 12, EI_z=E / 12, rho_A=1.0, rho_I_y=0.1, rho_I_z=0.1)
    tips = []
    for elements in (32, 64):
        turns = np.linspace(0.0, angle, elements + 1)
        names = [f"n{i}" for i in range(elements + 1)]
        points = [(radius * np.sin(a), radius * (1.0 - np.cos(a)), 0.0) for a in turns]
        parts = structure(
            [node(n, p) for n, p in zip(names, points, strict=True)],
            [member(a, b, section, 1) for a, b in itertools.pairwise(names)],
        )
        model = mesh_structure(parts)
        tips.append(newton(model, end_load(model, force=(0, 0, 600.0)), steps=4).x[elements])
    exact = bent_rod_tip(radius, angle, E, E / 12, E / 12, 600.0)
    assert exact == pytest.approx([47.1522, 15.6854, 53.4718], abs=1e-4)
    assert tips[1] == pytest.approx(exact, abs=0.003)
    # Straight chords of the arc: order two, so that one extrapolation removes most of the error.
    assert (4 * tips[1] - tips[0]) / 3 == pytest.approx(exact, abs=1e-4)


# Vibration


def roots_of(f, count: int) -> np.ndarray:
    grid = np.linspace(0.5, 3.3 * (count + 1), 4000)
    values = np.array([f(b) for b in grid])
    hits = np.flatnonzero(values[:-1] * values[1:] < 0)[:count]
    return np.array([brentq(f, grid[i], grid[i + 1], xtol=1e-14) for i in hits])


def test_cantilever_frequencies_converge_with_order_four():
    exact = roots_of(lambda b: np.cos(b) + 1.0 / np.cosh(b), 3) ** 2 / L**2 * np.sqrt(EI / RHO)
    errors = []
    for elements in (8, 16):
        model = mesh_structure(straight_beam(TUBE, L, elements))
        # Both bending planes: every frequency twice; the massless torsion and high axial modes lie above.
        omega = frequencies(model, 6)[::2]
        errors.append(np.abs(omega / exact - 1.0))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.15)
    assert errors[1][0] < 1e-6  # (1.875/16)^4 / 1440 = 1.3e-7


def test_free_beam_frequencies():
    exact = roots_of(lambda b: np.cos(b) - 1.0 / np.cosh(b), 3)[:3] ** 2 / L**2 * np.sqrt(EI / RHO)
    model = mesh_structure(straight_beam(dataclasses.replace(TUBE, rho_I_y=1e-9, rho_I_z=1e-9), L, 16))
    K, M, _ = clamped_matrices(model, fixed=())
    lam = sla.eigh(K, M, eigvals_only=True)
    # Cubic elements are too stiff by (b h)^4 / 1440 (Strang and Fix 1973); the next term is ten times less.
    excess = (np.sqrt(exact * L**2 / np.sqrt(EI / RHO)) / 16) ** 4 / 1440
    assert np.sqrt(lam[6:12:2]) / exact - 1.0 == pytest.approx(excess, rel=0.1)


def test_torsional_and_axial_rods_converge_with_order_two():
    section = dataclasses.replace(TUBE, rho_I_y=1e-3, rho_I_z=1e-3, EI_y=1e9, EI_z=1e9)
    for coordinates, speed in (((0,), np.sqrt(EA / RHO)), ((3,), np.sqrt(GJ / 2e-3))):
        errors = []
        for elements in (8, 16):
            model = mesh_structure(straight_beam(section, L, elements))
            n = model.tree.size
            held = [i for i in range(n) if i % 6 not in coordinates or i < 6]
            omega = frequencies(model, 1, fixed=held)[0]
            errors.append(abs(omega / (0.5 * np.pi / L * speed) - 1.0))
        assert observed_order(errors) == pytest.approx(2.0, abs=0.05)
        assert errors[-1] < 5e-4  # (pi / 32)^2 / 24


def axially_loaded(force: float, elements: int) -> tuple[Model, object, np.ndarray]:
    """A beam with hinged ends, the right one free to slide, under the axial ``force`` (tension positive)."""
    model = mesh_structure(straight_beam(TUBE, L, elements))
    held = [0, 1, 2, 3, 7, 8]
    load = end_load(model, force=(force, 0, 0))
    return model, newton(model, load, held), load


@pytest.mark.parametrize("share", [-0.5, 0.5, 2.0])
def test_axially_loaded_hinged_beam(share: float):
    """rho_A omega^2 = EI k^4 / s^2 + N k^2 / s with k = pi/L and stretch s = 1 + N/EA.

    The tension works on chord and bow: order four, down to (N/EA)^2 = 2e-7, which the closed form leaves out.
    """
    errors = []
    force = share * np.pi**2 * EI / L**2
    k, stretch = np.pi / L, 1.0 + force / EA
    exact = np.sqrt((EI * k**4 / stretch**2 + force * k**2 / stretch) / RHO)
    for elements in (2, 4, 32):
        model, config, load = axially_loaded(force, elements)
        omega = frequencies(model, 1, [0, 1, 2, 3, 7, 8], load, config)[0]
        errors.append(abs(omega / exact - 1.0))
    assert observed_order(errors[:2]) == pytest.approx(4.0, abs=0.2)
    assert errors[-1] < 2e-7


def test_buckling_load():
    """The tangent loses its stiffness at P (1 - P/EA) = pi^2 EI / L^2, found with order four."""
    held = [0, 1, 2, 3, 7, 8]

    def least(force: float, elements: int) -> float:
        model, config, load = axially_loaded(force, elements)
        K = clamped_matrices(model, config, held, load)[0]
        return float(np.linalg.eigvalsh(K)[0])

    euler = np.pi**2 * EI / L**2
    errors = []
    for elements in (2, 4):
        critical = brentq(lambda f, n=elements: least(-f, n), 0.8 * euler, 1.2 * euler, xtol=1e-8 * euler)
        errors.append(abs(critical * (1.0 - critical / EA) / euler - 1.0))
    assert observed_order(errors) == pytest.approx(4.0, abs=0.2)


def test_mass_of_a_bent_beam_under_rigid_motion():
    model = mesh_structure(straight_beam(dataclasses.replace(UNEQUAL, GA_y=np.inf, GA_z=np.inf), L, 5))
    config = newton(model, end_load(model, force=(0, 20.0, 10.0), moment=(3.0, 0, 0)))
    M = mass_matrix(model, config).toarray()
    x = config.x
    motion = np.zeros((len(x), 6, 6))
    motion[:, :3, :3] = motion[:, 3:, 3:] = np.eye(3)
    for axis in range(3):
        motion[:, :3, 3 + axis] = np.cross(np.eye(3)[axis], x)
    rigid = motion.reshape(-1, 6).T @ M @ motion.reshape(-1, 6)
    assert rigid[:3, :3] == pytest.approx(0.5 * L * np.eye(3), abs=1e-12)  # rounding
    world = points_in_world(model.points, frame_poses(model.tree, config))
    ends = world[model.element_ends]
    expected = np.zeros((3, 3))
    m = 0.5 * L / 5
    for a, b in ends:  # straight rods on the chords: point integrals of (r.r I - r r'), plus section inertia
        second = m * (np.outer(a, a) + np.outer(b, b) + 0.5 * (np.outer(a, b) + np.outer(b, a))) / 3.0
        expected += np.trace(second) * np.eye(3) - second
    section = rigid[3:, 3:] - expected
    # What is left is the inertia of the sections: their polar and two own ones, whatever the attitude.
    assert np.trace(section) == pytest.approx(2 * (2e-4 + 3e-4) * L, rel=1e-8)

"""The estimated error of the mesh against closed forms and finer meshes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from random_articles import draw_article, write_tables

from middeck.errors import NumericalError
from middeck.files.setups import load_setup, load_structure
from middeck.structure.gravity.compare_modes import compare_modes
from middeck.structure.model.article import Section, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import MemberMass
from middeck.structure.modes.mesh_error import (
    BENT,
    LIMIT,
    estimate_mesh_error,
    mesh_warnings,
    rest_angles,
)
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import GRAVITY, body, member, node, straight_beam, structure

FREE = np.array([4.730040745, 7.853204624, 10.99560784, 14.13716549])  # of free-free beams, k L

STRAIGHT = Section(EA=1e6, GJ=0.0, EI_y=0.0, EI_z=0.0, rho_A=1.0, rho_I_y=0.0, rho_I_z=0.0)


def modes_in(parts: Structure, environment: Environment | None = None, count: int | None = None) -> Modes:
    return solve_modes(solve_equilibrium(parts, environment or Environment.orbit()), count)


@pytest.mark.parametrize("elements", [4, 8])
def test_error_of_a_free_beam_in_bending_torsion_and_along(elements: int):
    """Bending against the characteristic roots, bars against n pi: errors of the orders h^4 and h^2."""
    EA, GJ, EI, rho_A, L = 1e6, 80.0, 100.0, 0.5, 2.0
    modes = modes_in(
        straight_beam(
            Section(EA=EA, GJ=GJ, EI_y=EI, EI_z=EI, rho_A=rho_A, rho_I_y=1e-7, rho_I_z=1e-7), L, elements
        )
    )
    error = estimate_mesh_error(modes)
    bending = np.repeat(FREE**2, 2) * np.sqrt(EI / (rho_A * L**4))
    found = [m for m, name in enumerate(modes.name) if "bending" in name][:4]
    assert error[found] == pytest.approx(modes.omega[found] / bending[:4] - 1.0, rel=0.25)
    for kind, speed in (("first axial", np.sqrt(EA / rho_A)), ("first torsion", np.sqrt(GJ / 2e-7))):
        m = modes.name.index(kind)
        if np.isfinite(error[m]):
            assert error[m] == pytest.approx(modes.omega[m] * L / (np.pi * speed) - 1.0, rel=0.1)


@pytest.mark.parametrize("mass", [MemberMass.ROD, MemberMass.COUPLED_ROD])
@pytest.mark.parametrize("ratio", [0.05, 0.5, 2.0])
def test_error_of_a_rod_with_a_tip_mass_has_its_sign(mass: MemberMass, ratio: float):
    """beta tan beta = rho A L/m: too high with a third of the rod at the tip, too low with 5/12."""
    EA, L, tip = 1e6, 2.0, 3.0
    rod = dataclasses.replace(STRAIGHT, EA=EA, rho_A=ratio * tip / L, mass=mass)
    held = (Clamp(node="root"), Clamp(node="tip", along="yz", about="xyz"))
    parts = structure(
        [node("root", (0, 0, 0)), node("tip", (L, 0, 0), body(tip, inertia=(1.0,) * 3))],
        [member("root", "tip", rod, 1, up=(0, 1, 0))],
    )
    modes = modes_in(parts, Environment(title="slides", gravity=np.zeros(3), clamps=held))
    low, high = 0.0, 0.5 * np.pi
    for _ in range(60):
        beta = 0.5 * (low + high)
        low, high = (beta, high) if beta * np.tan(beta) < ratio else (low, beta)
    true = modes.omega[0] * L / (low * np.sqrt(EA / (ratio * tip / L))) - 1.0
    assert (true < 0.0) == (mass is MemberMass.COUPLED_ROD)
    assert estimate_mesh_error(modes)[0] == pytest.approx(true, rel=0.3)
    warnings = mesh_warnings(modes, 1)
    assert bool(warnings) == (abs(true) > LIMIT)
    for text in warnings:
        assert ("too low" if true < 0.0 else "too high") in text
        assert "elements_per_strut" not in text  # a rod that is divided is a mechanism


def test_mass_lumped_across_rods_is_an_error_too():
    """A rod goes straight between its ends: across, consistent mass is that of the rod itself."""

    def mast(mass: MemberMass) -> Modes:
        rod = dataclasses.replace(STRAIGHT, EA=1e5, rho_A=0.2, mass=mass)
        turns = 2.0 * np.pi * np.arange(3) / 3.0
        nodes = [
            node(f"{bay}{k}", (0.5 * bay, 0.3 * np.cos(turns[k]), 0.3 * np.sin(turns[k])))
            for bay in range(3)
            for k in range(3)
        ]
        pairs = [(f"{bay}{k}", f"{bay}{(k + 1) % 3}") for bay in (1, 2) for k in range(3)]
        pairs += [(f"{bay}{k}", f"{bay + 1}{k}") for bay in range(2) for k in range(3)]
        pairs += [(f"{bay}{k}", f"{bay + 1}{(k + 1) % 3}") for bay in range(2) for k in range(3)]
        parts = structure(nodes, [member(a, b, rod, 1, up=(0.3, 1.0, 0.2)) for a, b in pairs])
        held = [Clamp(node=f"0{k}") for k in range(3)]
        held += [Clamp(node=f"{bay}{k}", along="", about="xyz") for bay in (1, 2) for k in range(3)]
        return modes_in(parts, Environment(title="held", gravity=np.zeros(3), clamps=tuple(held)), 6)

    consistent, coupled = mast(MemberMass.ROD), mast(MemberMass.COUPLED_ROD)
    own = [consistent.name.index(name) for name in coupled.name]  # torsion falls below bending
    true = coupled.omega / consistent.omega[own] - 1.0 + estimate_mesh_error(consistent)[own]
    assert np.all(true < -0.03)
    np.testing.assert_allclose(estimate_mesh_error(coupled), true, rtol=0.15)


@pytest.mark.parametrize("seed", range(5))
def test_error_is_that_against_a_finer_mesh(seed: int, tmp_path: Path):
    """Within a factor of two; where shapes change their order between two meshes, nobody can say."""
    rng = np.random.default_rng(seed)
    file = str(write_tables(draw_article(rng), tmp_path / "a.toml"))
    coarse, fine = (
        modes_in(load_structure(file, [f"mesh.elements_per_strut={n}"]))
        for n in (1 + seed % 3, 8 * (1 + seed % 3))
    )
    error = estimate_mesh_error(coarse, 20)
    swings = np.flatnonzero((coarse.omega[: len(error)] > 0.0) & np.isfinite(error))
    true, estimated = coarse.omega[swings] / fine.omega[swings] - 1.0, error[swings]
    clear = np.maximum(estimated, true) < 0.01
    small = np.maximum(estimated, true) < 0.5 * LIMIT
    near = (estimated > 0.5 * true) & (estimated < 2.0 * true)
    assert np.all((near | small)[clear])


def test_the_two_articles_are_meshed_finely_enough_and_one_element_a_strut_is_not():
    for article in ("dm", "simple"):
        case = load_setup(f"articles/mace-{article}.toml", "environments/orbit.toml")
        assert mesh_warnings(modes_in(*case), 26) == ()
    coarse = modes_in(load_structure("articles/mace-simple.toml", ["mesh.elements_per_strut=1"]))
    fine = modes_in(*case)
    true = coarse.omega[10:26] / fine.omega[10:26] - 1.0
    assert true.max() == pytest.approx(estimate_mesh_error(coarse, 26).max(), rel=0.2)
    (warning,) = mesh_warnings(coarse, 26)
    assert "elements" in warning
    assert "% too high" in warning


def test_a_mesh_that_lacks_modes_says_from_where_on(tmp_path: Path):
    """One element has two modes of bending in each plane; of more it knows nothing."""
    modes = modes_in(
        straight_beam(
            Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4), 2.0, 1
        )
    )
    error = estimate_mesh_error(modes)
    assert np.isinf(error[-1])
    (warning,) = mesh_warnings(modes, 12)
    assert "modes are missing" in warning


@pytest.mark.parametrize(("elements", "ratio"), [(1, 0.3), (1, 0.9), (2, 0.9), (2, 0.97), (4, 0.99)])
def test_error_of_a_column_near_its_critical_load(elements: int, ratio: float):
    """A heavy tip on a massless column: k^3 EI/(tan kL - kL) of the beam column, k^2 = m g/EI."""
    _, modes, exact = _heavy_tip(elements, ratio)
    true, estimated = modes.omega[0] / exact - 1.0, estimate_mesh_error(modes)[0]
    # First order in what is lost of omega^2, which is up to a twelfth of it.
    assert estimated == pytest.approx(true, rel=0.15)
    assert bool(mesh_warnings(modes, 1)) == (true > LIMIT)


def _heavy_tip(elements: int, ratio: float) -> tuple[Modes, Modes, float]:
    """A column at this ratio of its critical load, without weight and with it, and its exact lowest omega."""
    EI, L = 10.0, 1.0
    mass = ratio * np.pi**2 / 4.0 * EI / (L**2 * 9.80665)
    section = Section(EA=1e9, GJ=8.0, EI_y=EI, EI_z=1.7 * EI, rho_A=1e-7, rho_I_y=0.0, rho_I_z=0.0)
    column = structure(
        [node("foot", (0, 0, 0)), node("tip", (0, L, 0), body(mass, inertia=(1e-9 * mass,) * 3))],
        [member("foot", "tip", section, elements, up=(1, 0, 0))],
    )
    held = (
        Environment(title="clamped", gravity=g, clamps=(Clamp(node="foot"),)) for g in (0 * GRAVITY, GRAVITY)
    )
    light, heavy = (modes_in(column, where, 3) for where in held)
    k = np.sqrt(mass * 9.80665 / EI)
    return light, heavy, np.sqrt(k**3 * EI / (np.tan(k * L) - k * L) / mass)


@pytest.mark.parametrize(("elements", "ratio"), [(2, 0.97), (4, 0.99), (32, 0.97)])
def test_modes_and_ratios_say_that_the_mesh_is_coarse(elements: int, ratio: float):
    """3 EI/(m L^3) without weight. Only commands said so: ratios off by 1.3 % passed in silence."""
    light, heavy, exact = _heavy_tip(elements, ratio)
    found = compare_modes(light, heavy)
    true = exact / np.sqrt(30.0 / light.equilibrium.model.structure.nodes[1].body.mass)
    off = abs(found.ratio[0] / true - 1.0) > LIMIT
    assert off == (elements < 32)
    assert any("coarse" in text for text in heavy.warnings) == off
    assert any("ratios are off" in text for text in found.warnings) == off
    assert light.warnings == ()


def test_error_of_a_stretched_beam_of_few_elements():
    """Pinned, pulled by 3 times its Euler load: omega_n^2 = (EI q^4 + N q^2)/rho_A, q = n pi/L."""
    EI, L, rho_A = 10.0, 2.0, 0.5
    pull = 3.0 * np.pi**2 * EI / L**2
    section = Section(EA=1e7, GJ=8.0, EI_y=EI, EI_z=EI, rho_A=rho_A, rho_I_y=0.0, rho_I_z=0.0)
    strut = dataclasses.replace(member("a", "b", section, 3, up=(0, 1, 0)), tension=pull)
    ends = (Clamp(node="a", along="xyz", about="xy"), Clamp(node="b", along="xyz", about="x"))
    pinned = Environment(title="pinned", gravity=np.zeros(3), clamps=ends)
    modes = modes_in(structure([node("a", (0, 0, 0)), node("b", (L, 0, 0))], [strut]), pinned)
    across = [m for m, name in enumerate(modes.name) if "x-y" in name][:2]
    q = np.arange(1, 3) * np.pi / L
    true = modes.omega[across] / np.sqrt((EI * q**4 + pull * q**2) / rho_A) - 1.0
    assert estimate_mesh_error(modes)[across] == pytest.approx(true, rel=0.25)


def test_error_of_a_string_clamped_at_one_end():
    """Without EI: c n pi/L across a pinned pair of ends; a clamp of the turn stiffens few elements."""
    L, rho_A, pull = 2.0, 0.5, 74.0
    section = Section(EA=1e7, GJ=8.0, EI_y=0.0, EI_z=0.0, rho_A=rho_A, rho_I_y=0.0, rho_I_z=0.0)
    string = dataclasses.replace(member("a", "b", section, 8, up=(0, 1, 0)), tension=pull)
    ends = (Clamp(node="a", along="xyz", about="xy"), Clamp(node="b", along="xyz", about="x"))
    held = Environment(title="held", gravity=np.zeros(3), clamps=ends)
    modes = modes_in(structure([node("a", (0, 0, 0)), node("b", (L, 0, 0))], [string]), held)
    true = modes.omega[:4] / (np.repeat([1.0, 2.0], 2) * np.pi / L * np.sqrt(pull / rho_A)) - 1.0
    estimated = estimate_mesh_error(modes)[:4]
    assert estimated[[0, 2]] == pytest.approx(true[[0, 2]], rel=0.1)
    assert np.all((estimated > 0.4 * true) & (estimated < 2.0 * true))
    assert len(mesh_warnings(modes, 2)) == 1


@pytest.mark.parametrize(("elements", "silent"), [(2, False), (4, False), (32, True)])
def test_elements_that_gravity_bends_are_named(elements: int, silent: bool):
    """An elbow, clamped at one end, whose arms sag by a third of their length, bending and twisting.

    Elements of its modes' wavelengths are short, those of its rest state are not: the error falls with the
    square of the angle, and not before that angle is small is it below 1e-3.
    """
    section = Section(EA=2e6, GJ=80.0, EI_y=100.0, EI_z=130.0, rho_A=0.8, rho_I_y=4e-5, rho_I_z=5e-5)

    def elbow(count: int) -> Modes:
        arms = [
            member("foot", "knee", section, count, up=(0, 1, 0)),
            member("knee", "tip", section, count, up=(0, 1, 0)),
        ]
        places = [node("foot", (0, 0, 0)), node("knee", (2.2, 0, 0)), node("tip", (2.2, 0, 2.2))]
        held = Environment(title="clamped", gravity=GRAVITY, clamps=(Clamp(node="foot"),))
        return modes_in(structure(places, arms), held, 4)

    coarse, fine = elbow(elements), elbow(64)
    off = np.abs(coarse.omega[:2] / fine.omega[:2] - 1.0)
    warnings = [text for text in mesh_warnings(coarse, 2) if "at rest" in text]
    assert len(warnings) == (not silent)
    assert (off.max() < 1e-3) == silent
    assert off.max() < rest_angles(coarse.equilibrium).max() ** 2


@pytest.mark.parametrize("turned", [0.3, 0.9, 1.4])
def test_bending_that_a_section_couples_is_that_of_its_principal_axes(turned: float):
    """A plate of 20 x 1 mm, its axes turned about its line: EI as a tensor, the same article."""
    thin, tall = 7e10 * 0.02 * 0.001**3 / 12.0, 7e10 * 0.02**3 * 0.001 / 12.0

    def plate(angle: float, where: Environment) -> Modes:
        c, s = np.cos(angle), np.sin(angle)
        coupling = np.zeros((6, 6))
        coupling[4, 5] = coupling[5, 4] = (thin - tall) * s * c
        section = Section(EA=1.4e6, GJ=0.18, EI_y=thin * c**2 + tall * s**2, EI_z=thin * s**2 + tall * c**2,
                          rho_A=0.054, rho_I_y=0.0, rho_I_z=0.0, coupling=coupling)  # fmt: skip
        ends = [node("foot", (0, 0, 0)), node("top", (1, 0, 0))]
        up = (0.0, np.sin(angle), np.cos(angle))
        return modes_in(structure(ends, [member("foot", "top", section, 4, up=up)]), where)

    hangs = Environment(title="clamped", gravity=GRAVITY, clamps=(Clamp(node="foot"),))
    for where in (dataclasses.replace(hangs, gravity=np.zeros(3)), hangs):
        as_drawn, coupled = plate(0.0, where), plate(turned, where)
        # An eigenvalue is known to the rounding of the largest.
        rounding = np.finfo(float).eps * (as_drawn.omega.max() / as_drawn.omega[:4]) ** 2
        assert np.all(np.abs(coupled.omega[:4] / as_drawn.omega[:4] - 1.0) < rounding)
        assert estimate_mesh_error(coupled, 4) == pytest.approx(estimate_mesh_error(as_drawn, 4), rel=1e-6)
        angles = [rest_angles(modes.equilibrium).max() for modes in (coupled, as_drawn)]
        assert angles[0] == pytest.approx(angles[1], rel=1e-6)


def drawn_frame(rng: np.random.Generator, elements: int) -> Structure:
    """Members between 4 to 7 places within 3 to 80 m, slender enough to sag by any part of their length."""
    count, size = int(rng.integers(4, 8)), 10.0 ** rng.uniform(0.5, 1.9)
    places = rng.uniform(-0.5, 0.5, (count, 3)) * size
    EA, r, rho_A = (
        10.0 ** rng.uniform(6.0, 9.0),
        10.0 ** rng.uniform(-2.2, -0.7),
        10.0 ** rng.uniform(-0.5, 1.5),
    )
    section = Section(EA=EA, GJ=0.8 * EA * r**2, EI_y=EA * r**2, EI_z=EA * r**2 * rng.uniform(0.7, 1.4),
                      rho_A=rho_A, rho_I_y=rho_A * r**2, rho_I_z=rho_A * r**2)  # fmt: skip
    pairs = {(int(rng.integers(0, i)), i) for i in range(1, count)}
    pairs |= {
        tuple(sorted(rng.choice(count, 2, replace=False).tolist())) for _ in range(int(rng.integers(count)))
    }
    arms = [
        member(
            f"n{i}", f"n{j}", section, elements, up=tuple(np.linalg.svd((places[j] - places[i])[None])[2][1])
        )
        for i, j in sorted(pairs)
    ]
    loaded = [body(rho_A * size * rng.uniform(0.05, 3.0)) for _ in places]
    return structure([node(f"n{k}", tuple(at), loaded[k]) for k, at in enumerate(places)], arms)


def test_frames_that_sag_are_off_by_the_square_of_their_angle(campaign):
    """Beside what the mesh's error says, against four times as many elements."""
    held = Environment(title="clamped", gravity=GRAVITY, clamps=(Clamp(node="n0"),))
    tried = 0
    for seed in campaign(60, share=30):
        elements = int(np.random.default_rng([1, seed]).integers(2, 4))
        try:
            coarse, fine = (
                modes_in(drawn_frame(np.random.default_rng(seed), n), held, 12)
                for n in (elements, 4 * elements)
            )
        except NumericalError:  # too soft to stand
            continue
        estimated, angle = estimate_mesh_error(coarse, 6), rest_angles(coarse.equilibrium).max()
        off = (
            np.abs(coarse.omega[:6] / fine.omega[:6] - 1.0)[np.isfinite(estimated)]
            - 2.0 * estimated[np.isfinite(estimated)]
        )
        assert off.max(initial=0.0) < max(1.2 * angle**2, 1e-3), seed
        assert off.max(initial=0.0) < 1e-3 or angle > BENT
        tried += 1
    assert tried > 0

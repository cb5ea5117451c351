"""Members and bodies that ride rigidly on a node: statics, modes and derivatives under gravity."""

import dataclasses

import numpy as np

import structure_builders as build
from middeck.structure.model.article import AttachPoint, Body, Member, MemberMass, Section, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import node_rotations, solve_equilibrium
from middeck.structure.sensitivity.frequency_derivatives import differentiate_frequencies
from middeck.structure.sensitivity.parameters import find_parameters, set_parameter

SOFT = Section(EA=2e5, GJ=20.0, EI_y=30.0, EI_z=40.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=2e-4)
ARM = np.array([0.1, 0.05, 0.2])


def beam(start: str, end: str, section: Section = SOFT, **offsets: np.ndarray) -> Member:
    return dataclasses.replace(build.member(start, end, section, 2, (0.3, 1.0, 0.2)), **offsets)


def riding(rigid: Section | None = None) -> Structure:
    """Two beams and a body on a rigid part; its far end is a node of its own where a member makes it so."""
    lump = Body(0.8, np.array([0.02, 0.01, -0.03]), np.diag([2e-3, 3e-3, 4e-3]))
    nodes = [build.node("a", (0, 0, 0)), build.node("b", (0.9, 0, 0)), build.node("d", (1.9, 0.1, 0.3))]
    if rigid is None:
        far = {"start_offset": ARM}
        nodes[1] = dataclasses.replace(nodes[1], body=dataclasses.replace(lump, cg=lump.cg + ARM))
        members = [beam("a", "b"), beam("b", "d", **far)]
    else:
        nodes.append(dataclasses.replace(build.node("c", nodes[1].position + ARM), body=lump))
        members = [beam("a", "b"), beam("c", "d"), dataclasses.replace(beam("b", "c", rigid), elements=1)]
    attach = [AttachPoint(name, name, np.zeros(3)) for name in "ad"]
    return build.structure(nodes, members, attach=attach)


def hung() -> Environment:
    places = {"a": (0.0, 2.0, 0.0), "d": (1.9, 2.1, 0.3)}
    springs = [
        AnchoredSpring(name=f"{n}{k}", attach=n, anchor=np.array(p) + shift, stiffness=400.0, free_length=1.5)
        for n, p in places.items()
        for k, shift in enumerate(([0.3, 0.0, 0.5], [-0.4, 0.0, 0.2], [0.1, 0.2, -0.6]))
    ]
    return build.lab(*springs)


def test_a_rigid_part_is_the_limit_of_a_stiff_one() -> None:
    """The difference falls as one over the stiffness, in statics and modes, after large rotations."""
    exact = solve_equilibrium(riding(), hung())
    turned, omega = node_rotations(exact), solve_modes(exact).omega[:12]
    assert np.degrees(np.linalg.norm(turned["b"])) > 5.0
    off = []
    for k in (1e3, 1e5):
        stiff = Section(EA=1e4 * k, GJ=k, EI_y=k, EI_z=k, rho_A=0.0, rho_I_y=0.0, rho_I_z=0.0)
        rest = solve_equilibrium(riding(stiff), hung())
        np.testing.assert_allclose(node_rotations(rest)["b"], turned["b"], atol=50.0 / k)
        off.append(np.abs(solve_modes(rest).omega[:12] / omega - 1.0).max())
    assert off[1] < 0.02 * off[0]
    assert off[1] < 1e-3


def test_an_offset_along_the_member_is_half_of_a_node_s_size() -> None:
    ends = [
        build.node("a", (0, 0, 0), build.body(1.0, inertia=(0.1, 0.1, 0.1))),
        build.node("d", (1.5, 0.4, -0.2)),
    ]
    along = (ends[1].position - ends[0].position) / np.linalg.norm(ends[1].position - ends[0].position)
    attach = [AttachPoint(name, name, np.zeros(3)) for name in "ad"]
    sized = build.structure(
        [dataclasses.replace(ends[0], size=0.2), ends[1]], [beam("a", "d")], attach=attach
    )
    offset = build.structure(ends, [beam("a", "d", start_offset=0.1 * along)], attach=attach)
    assert abs(sized.mass - offset.mass) < 1e-14
    omega = [solve_modes(solve_equilibrium(s, hung())).omega for s in (sized, offset)]
    np.testing.assert_allclose(omega[0], omega[1], rtol=1e-7)  # of soft modes, by rounding


def test_derivatives_by_an_offset_are_differences() -> None:
    article, environment = riding(), hung()
    rest = solve_equilibrium(article, environment)
    found = find_parameters(article, environment, ["member.*.start_offset.*"])
    assert [p.name for p in found] == [f"member.b-d.start_offset.{a}" for a in "xyz"]
    found = found[1:2]
    slopes = differentiate_frequencies(solve_modes(rest), found, count=8).d_lambda
    for i, parameter in enumerate(found):
        sides = [
            solve_modes(
                solve_equilibrium(*set_parameter(article, environment, parameter, parameter.value + h))
            )
            for h in (-1e-4, 1e-4)
        ]
        low, high = (side.omega[:8] ** 2 for side in sides)
        # Differences of this step are good to 1e-6 of the squares.
        np.testing.assert_allclose(slopes[i], (high - low) / 2e-4, rtol=1e-4, atol=1e-5 * low.max())


def test_the_coupled_mass_of_a_rod_is_the_mean_of_lumped_and_consistent() -> None:
    """Axial free-free modes of n elements: closed forms of the three tridiagonal problems."""
    n, L = 6, 1.2
    for mass, share in ((MemberMass.CONSISTENT, 0.0), (MemberMass.COUPLED, 0.5)):
        section = dataclasses.replace(SOFT, mass=mass)
        rod = dataclasses.replace(build.straight_beam(section, L, n))
        modes = solve_modes(solve_equilibrium(rod, Environment.orbit()))
        for m in range(1, n + 1):
            c = np.cos(np.pi * m / n)
            edge = (1.0 - share) * (2.0 + c) / 3.0 + share
            omega = np.sqrt(2.0 * (1.0 - c) / edge * SOFT.EA / SOFT.rho_A) * n / L
            assert np.abs(modes.omega / omega - 1.0).min() < 1e-9

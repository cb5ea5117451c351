"""Sparse and dense solutions of the same model, repeated frequencies, and what a Sturm count is for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from middeck.errors import ConfigError
from middeck.structure.assembly.factorisation import factorise, positive_factor
from middeck.structure.eigenproblem.eigen import count_zero, solve_all, solve_lowest
from middeck.structure.model.article import AttachPoint, Section
from middeck.structure.model.environment import Environment
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from repeats import repeats
from structure_builders import body, lab, member, node, springs_above, structure

TUBE = Section(EA=2e6, GJ=300.0, EI_y=400.0, EI_z=400.0, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4)


def ladder(bays: int, elements: int):
    """A lattice in space, square in its cross-section, so that bending comes in nearly equal pairs."""
    points = {(i, j, k): (0.5 * i, 0.5 * j, 0.5 * k) for i in range(bays + 1) for j in (0, 1) for k in (0, 1)}
    name = {p: "n" + "_".join(map(str, p)) for p in points}
    nodes = [node(name[p], x, body(0.3, inertia=(1e-3,) * 3)) for p, x in points.items()]
    pairs = [(p, (p[0] + 1, p[1], p[2])) for p in points if p[0] < bays]
    pairs += [(p, (p[0], 1, p[2])) for p in points if p[1] == 0]
    pairs += [(p, (p[0], p[1], 1)) for p in points if p[2] == 0]
    pairs += [((i, 0, k), (i + 1, 1, k)) for i in range(bays) for k in (0, 1)]
    pairs += [((i, j, 0), (i + 1, j, 1)) for i in range(bays) for j in (0, 1)]
    members = [member(name[a], name[b], TUBE, elements, up=(0.3, 0.8, 0.5)) for a, b in pairs]
    hung = {"left": (0, 1, 0), "right": (bays, 1, 1), "front": (bays // 2, 1, 1)}
    attach = [AttachPoint(n, name[p], np.zeros(3)) for n, p in hung.items()]
    parts = structure(nodes, members, attach=attach)
    mass = parts.mass / 3.0
    stiffness = mass * (2.0 * np.pi * 0.3) ** 2
    free = 3.0 - mass * 9.80665 / stiffness  # unloaded length, so that it hangs about level with its drawing
    return parts, lab(*springs_above({n: points[p] for n, p in hung.items()}, 3.0, stiffness, free))


def test_the_lowest_modes_are_those_of_the_dense_solution():
    """Names and kinds too. Both solve the inverse problem; what is left is rounding of 1e-16 K/M."""
    rest = solve_equilibrium(*ladder(12, 2))
    few, every = solve_modes(rest, 30), solve_modes(rest)
    assert rest.model.tree.size > 600  # sparse from here
    assert few.omega == pytest.approx(every.omega[:30], rel=1e-8)
    assert (few.kind, few.name) == (every.kind[:30], every.name[:30])
    overlap = np.abs(few.shapes.T @ (few.mass @ every.shapes[:, :30]))
    assert np.diag(overlap) == pytest.approx(np.ones(30), abs=1e-6)  # the nearest pair is 1e-3 apart
    assert few.residual.max() < 1e-9


def test_orbit_has_its_six_rigid_modes_in_the_sparse_solution():
    modes = solve_modes(solve_equilibrium(ladder(12, 2)[0], Environment.orbit()), 12)
    assert modes.kind == ("rigid",) * 6 + ("flexible",) * 6
    assert modes.rigid_residual < 1e-7


def repeated(copies: int, n: int) -> tuple[sp.csr_array, sp.csr_array]:
    """Chains of masses without connection: every frequency comes ``copies`` times."""
    chain = sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    return sp.csr_array(sp.block_diag([1e4 * chain] * copies)), sp.csr_array(sp.eye_array(copies * n))


@pytest.mark.parametrize("copies", [2, 5, 9])
def test_repeated_frequencies_are_all_found(copies: int):
    """Exact: omega^2 = 4e4 sin^2(pi k / 2(n+1)), each ``copies`` times over."""
    n, count = 120, 27
    pairs = solve_lowest(*repeated(copies, n), count)
    assert pairs is not None
    exact = 4e4 * np.sin(0.5 * np.pi * np.arange(1, n + 1) / (n + 1)) ** 2
    assert pairs.lam == pytest.approx(np.repeat(exact, copies)[:count], rel=1e-10)


def test_sparse_and_dense_agree_on_an_unstable_state():
    """A negative omega^2 is found, not shifted away."""
    K, M = repeated(1, 700)
    K = sp.csr_array(K - 3.0 * M)
    dense, sparse = solve_all(K, M), solve_lowest(K, M, 6)
    assert dense is not None
    assert sparse is not None
    assert sparse.lam == pytest.approx(dense.lam[:6], rel=1e-9)
    assert sparse.lam[0] < 0.0


def test_factors_count_negative_eigenvalues():
    rng = np.random.default_rng(5)
    A = rng.standard_normal((40, 40))
    lam = np.concatenate([-np.arange(1.0, 8.0), np.arange(1.0, 34.0)])
    Q = np.linalg.qr(A)[0]
    K = sp.csr_array(Q * lam @ Q.T)
    factor = factorise(K)
    assert factor is not None
    assert factor.negative == 7
    assert positive_factor(K) is None
    b = rng.standard_normal((40, 2))
    # Without pivoting the growth is not bounded; on this matrix it is below 1e4.
    assert factor.solve(b) == pytest.approx(np.linalg.solve(K.toarray(), b), rel=1e-8, abs=1e-10)


def test_modes_of_no_stiffness_are_counted():
    K, M = repeated(1, 50)
    ends = sp.csr_array(([-1e4, -1e4], ([0, 49], [0, 49])), shape=(50, 50))
    free = sp.csr_array(K + ends)  # a free chain: one translation
    assert count_zero(free, M) == 1
    assert count_zero(sp.csr_array(sp.block_diag([free, free])), sp.csr_array(sp.block_diag([M, M]))) == 2


def test_a_large_sag_takes_few_steps():
    """Springs from their unloaded length: the whole sinks by 2.8 m, which one step may do."""
    parts, hung = ladder(4, 1)
    slack = tuple(dataclasses.replace(s, free_length=3.0) for s in hung.springs)
    rest = solve_equilibrium(parts, dataclasses.replace(hung, springs=slack))
    assert rest.converged
    assert np.linalg.norm(rest.config.x.mean(axis=0) - rest.model.rest.x.mean(axis=0)) > 2.0
    assert len(rest.history) < 15


def star(booms: int, elements: int):
    """Equal booms around a heavy hub: every cantilever mode comes nearly as often as there are booms."""
    turns = 2.0 * np.pi * np.arange(booms) / booms
    hub = node("hub", (0, 0, 0), body(50.0, inertia=(20.0, 20.0, 20.0)))
    tips = [
        node(f"tip{i}", (3.0 * np.cos(a), 3.0 * np.sin(a), 0.0), body(1.0, inertia=(0.01,) * 3))
        for i, a in enumerate(turns)
    ]
    members = [member("hub", tip.name, TUBE, elements, up=(0, 0, 1)) for tip in tips]
    return structure([hub, *tips], members)


@pytest.mark.parametrize(("booms", "elements"), repeats([(16, 10), (12, 20), (8, 25)]))
@pytest.mark.parametrize("count", repeats([40, 12, 7], 2))
def test_equal_booms_lose_no_mode(booms: int, elements: int, count: int):
    """Frequencies up to 2 * booms - 3 fold: what one Lanczos run overlooks, the next ones find."""
    rest = solve_equilibrium(star(booms, elements), Environment.orbit())
    few, every = solve_modes(rest, count), solve_modes(rest)
    assert rest.model.tree.size > 600  # sparse from here
    assert few.omega == pytest.approx(every.omega[:count], rel=1e-7, abs=1e-9)
    gram = few.shapes.T @ (few.mass @ few.shapes)
    assert gram == pytest.approx(np.eye(count), abs=1e-8)


@pytest.mark.parametrize("count", [0, -1, 2.5])
def test_a_number_of_modes_is_a_number(count):
    rest = solve_equilibrium(ladder(2, 1)[0], Environment.orbit())
    with pytest.raises(ConfigError, match="modes"):
        solve_modes(rest, count)

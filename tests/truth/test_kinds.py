"""Kinds, pairs and damping where suspension and flexibility meet, against orbit's modes and complex ones."""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from random_articles import draw_bus, environment_of, write_tables

from middeck.errors import MiddeckError
from middeck.files.setups import load_setup
from middeck.structure.assembly.energy import inner_forces, split_tangent
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.elements.rotations import rotation_exp
from middeck.structure.gravity.budget import build_budget
from middeck.structure.gravity.compare_modes import ModeComparison, compare_modes
from middeck.structure.model.article import AttachPoint, Spring
from middeck.structure.model.environment import Environment
from middeck.structure.modes.names.kinds import find_kinds, kinds_by_rank
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.rest.equilibrium import node_rotations, solve_equilibrium
from repeats import repeats
from structure_builders import TUBE, body, lab, member, node, springs_above, structure

LAB = "environments/lab.toml"
FLEXIBLE, SUSPENSION = 0.01, 0.03
# A rigid turn says less of an article that is bent far.
FAR = np.radians(12.0)


class Met(NamedTuple):
    orbit: Modes
    lab: Modes
    found: ModeComparison


def soft_bus(seed: int, folder: Path) -> Met | None:
    """Its first bending and its suspension's frequencies within a factor of some; None if it cannot hang."""
    rng = np.random.default_rng(seed)
    tables = draw_bus(rng)
    wanted, bounce = np.exp(rng.uniform(np.log([0.3, 0.2]), np.log([3.0, 2.0])))
    environment = environment_of(tables, float(rng.uniform(0.6, 5.0)), float(bounce))
    files = (str(write_tables(tables, folder / "a.toml")), str(write_tables(environment, folder / "e.toml")))
    parts, _ = load_setup(*files)
    first = next(f for f in modes_in(parts, Environment.orbit()).frequency_hz if f > 0.0)
    softer = tables["material"]["stuff"]["E_pa"] * (wanted / first) ** 2
    try:
        parts, lab = load_setup(*files, [f"material.stuff.E_pa={softer:.6e}"])
        orbit, hung = modes_in(parts, Environment.orbit()), modes_in(parts, lab)
    except MiddeckError:
        return None
    turns = np.array(list(node_rotations(hung.equilibrium).values()))
    if np.linalg.norm(turns - turns.mean(axis=0), axis=1).max() > FAR:
        return None
    return Met(orbit, hung, compare_modes(orbit, hung))


def modes_in(parts, environment) -> Modes:
    return solve_modes(solve_equilibrium(parts, environment))


def shares_in_orbit(met: Met) -> np.ndarray:
    """Part of each lab mode, turned back by the mean rotation of the nodes, that is each mode in orbit."""
    turn = np.mean(list(node_rotations(met.lab.equilibrium).values()), axis=0)
    roots = met.lab.equilibrium.model.tree.roots
    shapes = met.lab.shapes.copy()
    for k in range(2 * roots):
        shapes[3 * k : 3 * k + 3] = rotation_exp(turn).T @ shapes[3 * k : 3 * k + 3]
    weighted = met.orbit.mass @ shapes
    return (met.orbit.shapes.T @ weighted) ** 2 / np.einsum("im,im->m", shapes, weighted)


def complex_damping(modes: Modes, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Ratios of K + 2j (zeta_f K_strain + zeta_s K_rest), and which part of each is one real mode."""
    rest = modes.equilibrium
    active = dynamic_coordinates(rest.model)
    inner = inner_forces(rest.model, rest.config, rest.loads)
    strain = split_tangent(rest.model, rest.config, rest.loads, inner).material.toarray()[
        np.ix_(active, active)
    ]
    phi = modes.shapes[active][:, :count]
    strained = phi.T @ strain @ phi
    total = np.diag(modes.omega[:count] ** 2)
    lam, V = np.linalg.eig(total + 2j * (FLEXIBLE * strained + SUSPENSION * (total - strained)))
    root = np.sqrt(lam)
    part = np.abs(V) ** 2 / np.sum(np.abs(V) ** 2, axis=0)
    own = part.argmax(axis=1)
    return np.imag(root[own]) / np.abs(root[own]), part[np.arange(count), own]


@pytest.fixture(scope="module")
def met(tmp_path_factory: pytest.TempPathFactory) -> list[Met]:
    drawn = [soft_bus(seed, tmp_path_factory.mktemp("drawn")) for seed in range(8)]
    found = [m for m in drawn if m is not None]
    assert len(found) >= 4  # the others sag too far or slacken a cable
    return found


def test_kind_is_what_orbit_says_of_the_shape(met: list[Met]):
    """More than half of a suspension mode is in the rigid-body modes of an independent solution."""
    for one in met:
        rigid = shares_in_orbit(one)[[k == "rigid" for k in one.orbit.kind]].sum(axis=0)
        clear = np.abs(rigid[:26] - 0.5) > 0.15
        expected = np.where(rigid[:26] > 0.5, "suspension", "flexible")
        held = np.array(one.lab.kind[:26]) != "rigid"
        assert np.array(one.lab.kind[:26])[clear & held].tolist() == expected[clear & held].tolist()


def test_partner_is_where_most_of_the_shape_is(met: list[Met]):
    for one in met:
        shares, pairs = shares_in_orbit(one), dict(one.found.pairs.tolist())
        for i, kind in enumerate(one.orbit.kind[:26]):
            best = int(shares[i].argmax())
            if kind == "flexible" and best < 26 and shares[i, best] > 0.67:
                assert pairs[i] == best


def test_damping_is_that_of_the_complex_modes(met: list[Met]):
    """Where a complex mode is one real mode, and nothing compressed makes the truth negative."""
    compared = 0
    for one in met:
        zeta = estimate_damping(one.lab, count=26).zeta
        true, part = complex_damping(one.lab, 26)
        clear = (part > 0.95) & (true > FLEXIBLE) & (true < SUSPENSION)
        assert zeta[clear] == pytest.approx(true[clear], rel=0.05)
        compared += int(clear.sum())
    assert compared > 60


SHARED = re.compile(r"modes (\d+) .* and (\d+) .* would be (\S+) and (\S+) in place of")


@pytest.mark.parametrize("seed", repeats([388, 294, 259, 433, 350, 412]))
def test_modes_that_share_their_losses_are_reported_with_their_ratios(seed: int, tmp_path: Path):
    """A pendulum and a bending mode within some per cent of each other: the complex modes damp otherwise."""
    one = soft_bus(seed, tmp_path)
    assert one is not None
    found = estimate_damping(one.lab, count=26)
    shown = [SHARED.match(text) for text in found.warnings]
    ratio = {int(m[k]): float(m[k + 2]) for m in shown if m for k in (1, 2)}
    true, part = complex_damping(one.lab, 26)
    mixed = (part < 0.98) & (np.abs(found.zeta - true) > 0.02 * true)
    assert mixed.any()
    assert set(np.flatnonzero(mixed)) <= set(ratio)
    assert [ratio[m] for m in np.flatnonzero(mixed)] == pytest.approx(true[mixed], rel=0.01)


def test_modes_whose_losses_are_their_own_are_not_reported(met: list[Met]):
    """Of the articles drawn, only those whose complex modes are real ones to a part in a thousand."""
    for one in met:
        true, part = complex_damping(one.lab, 26)
        if part.min() > 0.999 and true.min() > 0.0:
            assert not any(SHARED.match(text) for text in estimate_damping(one.lab, count=26).warnings)


def test_budget_has_the_same_pairs(met: list[Met]):
    one = met[0]
    budget = build_budget(one.orbit, one.lab)
    flexible = [
        pair for pair in budget.pairs.tolist() if one.orbit.kind[pair[0]] == "flexible" and pair[1] < 26
    ]
    assert sorted(flexible) == sorted(one.found.pairs.tolist())


# The two articles of the sheet


@functools.cache
def sheet(article: str, *overrides: str) -> Met:
    parts, lab = load_setup(f"articles/mace-{article}.toml", LAB, overrides)
    orbit, hung = modes_in(parts, Environment.orbit()), modes_in(parts, lab)
    return Met(orbit, hung, compare_modes(orbit, hung))


@pytest.mark.parametrize(("article", "held"), [("dm", 8), ("simple", 10)])
def test_the_sheet_damps_by_rank(article: str, held: int):
    one = sheet(article)
    assert one.lab.warnings == one.found.warnings == ()
    assert one.lab.kind[:26] == ("suspension",) * held + ("flexible",) * (26 - held)
    zeta = estimate_damping(one.lab, count=26).zeta
    assert zeta.tolist() == [SUSPENSION] * held + [FLEXIBLE] * (26 - held)


def test_without_the_rule_shares_of_energy_damp():
    one = sheet("simple", "damping.rule=shares")
    share = one.lab.strain_share[:26]
    zeta = estimate_damping(one.lab, count=26).zeta
    assert zeta == pytest.approx(share * FLEXIBLE + (1.0 - share) * SUSPENSION)
    assert estimate_damping(one.orbit, count=26).zeta.tolist() == [0.0] * 10 + [FLEXIBLE] * 16


def test_soft_struts_bend_among_the_pendulums_and_are_distinguished():
    """The 10 lowest are no longer the suspension's: pairs go by shape, and what goes by rank is said."""
    one = sheet("simple", "material.lexan.E_pa=2.35e8")
    ranked = kinds_by_rank(one.lab.equilibrium, one.lab.kind)
    for m in np.flatnonzero([a != b for a, b in zip(ranked, one.lab.kind, strict=True)]):
        (warning,) = (w for w in one.lab.warnings if f"mode {m} " in w)
        assert f"{one.lab.frequency_hz[m]:.4g} Hz" in warning
        assert "damping.rule" in warning
    assert one.lab.kind[5:7] == ("flexible", "flexible")
    pairs = dict(one.found.pairs.tolist())
    assert {pairs[10], pairs[11]} == {5, 6}
    assert one.found.ratio[:2] == pytest.approx([1.275, 1.027], abs=1e-3)


# Modes of one frequency


def test_modes_of_one_frequency_are_distinguished_in_any_basis():
    """A pendulum and a bending mode at one frequency: however mixed, they come out as they are."""
    lab = sheet("dm").lab
    lam, shapes = lab.omega**2, lab.shapes.copy()
    both = [7, 8]
    lam[both] = lam[both].mean() * np.array([1.0, 1.0 + 1e-9])
    shares = []
    for angle in (0.3, 0.8, 2.0):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        mixed = shapes.copy()
        mixed[:, both] = shapes[:, both] @ turn
        found = find_kinds(lab.equilibrium, lab.mass, lam, mixed, 0)
        assert found.kind[7:9] == ("suspension", "flexible")
        shares.append(found.rigid_share[both])
    # They are made to differ most: by more than those of the two modes do.
    assert shares[1:] == [pytest.approx(shares[0], abs=1e-9)] * 2
    assert shares[0][0] > lab.rigid_share[7]
    assert shares[0][1] < lab.rigid_share[8]


def test_rigid_shares_of_an_article_with_a_spring_of_its_own_add_up_to_six(
    campaign: Callable[[int], range],
) -> None:
    """All six strainless motions are found by their energy, however the article stands in the world."""
    for seed in campaign(300):
        rng = np.random.default_rng([6, seed])
        at = np.cumsum(rng.uniform(-0.2, 0.2, (4, 3)), axis=0)
        masses, spots = rng.uniform(1.0, 4.0, 4), {f"t{x}": p for x, p in zip("abcd", at, strict=True)}
        bodies = [body(m, inertia=(1e-3, 1.2e-3, 1.5e-3)) for m in masses]
        stiff = dataclasses.replace(TUBE, EI_y=3e3, EI_z=4e3, EA=1e8, GJ=2e3)
        reach = 0.8 * float(np.linalg.norm(at[3] - at[0]))
        parts = structure(
            [node(x, p, b) for x, p, b in zip("abcd", at, bodies, strict=True)],
            [member(*ends, stiff, 1, rng.standard_normal(3).tolist()) for ends in ("ab", "bc", "cd")],
            springs=[Spring(name="tie", start="ta", end="td", stiffness=200.0, free_length=reach)],
            attach=[AttachPoint(f"t{x}", x, np.zeros(3)) for x in "abcd"],
        )
        hung = modes_in(parts, lab(*springs_above(spots, 3.0, 2.5 * parts.mass, 2.0)))
        assert hung.rigid_share.sum() == pytest.approx(6.0, abs=1e-6)
        assert hung.kind[:6] == ("suspension",) * 6

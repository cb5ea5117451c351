"""Reduction beside soft and stiff members: right, none refused, and what is loose is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg as sla
from reduced import bent_beam
from soft_and_stiff import draw

import middeck as md
from middeck.errors import NumericalError
from middeck.structure.model.links import Link
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import NONE, body, member, node, structure

RATIO = 1e-5


def _some(rng, article):
    names = [node.name for node in article.nodes]
    return rng.choice(names, size=int(rng.integers(1, 4)), replace=False).tolist()


def test_soft_and_stiff_members_side_by_side_are_no_reason_to_refuse(campaign):
    """Of 200, 84 were: what rounding left in static motions was taken for a fault of the matrices."""
    for seed in campaign(200):
        rng = np.random.default_rng([13, seed])
        article = draw(rng, RATIO)
        made = md.reduce_structure(article, _some(rng, article), count=int(rng.integers(20)))
        assert np.linalg.eigvalsh(made.component.mass)[-1] > 0.0


def test_the_softest_modes_are_those_of_the_article(campaign):
    """All modes kept. Both round by 1e-16 of the stiffest entry, 2e-5 of the softest omega^2 of 100."""
    for seed in campaign(100):
        rng = np.random.default_rng([13, seed])
        article = draw(rng, RATIO)
        part = md.reduce_structure(article, _some(rng, article), count=10_000).component
        true = solve_modes(solve_equilibrium(article, md.Environment.orbit())).omega[6:12] ** 2
        shifted = part.stiffness + true[0] * part.mass
        size = np.sqrt(np.diagonal(shifted))
        share = sla.eigvalsh(part.mass / np.outer(size, size), shifted / np.outer(size, size))
        found = (1.0 / share[::-1] - true[0])[6:][: len(true)]
        np.testing.assert_allclose(found, true[: len(found)], rtol=1e-4)


def test_what_is_loose_inside_is_refused_and_named(campaign):
    """A bar on a ball, a cross or a hinge, with its far end free."""
    for seed in campaign(200):
        rng = np.random.default_rng([15, seed])
        article = draw(rng, RATIO)
        boundary = _some(rng, article)
        at = article.nodes[int(rng.integers(len(article.nodes)))]
        section = article.members[int(rng.integers(len(article.members)))].section
        span = np.linalg.norm(article.nodes[1].position - article.nodes[0].position)
        mass = max(article.mass, 1e-3)
        far = node(
            "far",
            at.position + span * rng.normal(size=3),
            body(mass * 10.0 ** rng.uniform(-2, 0), inertia=mass * (0.05 * span) ** 2 * np.ones(3)),
        )
        near = node("near", at.position)
        bar = member("near", "far", section, int(rng.integers(1, 8)), rng.normal(size=3))
        article = dataclasses.replace(
            article,
            nodes=(*article.nodes, near, far),
            members=(*article.members, bar),
            links=(Link(name="pin", first=at.name, second="near", about=("", "x", "xy")[seed % 3]),),
        )
        with pytest.raises(NumericalError, match="still loose, most at"):
            md.reduce_structure(article, boundary, count=3)


@pytest.mark.parametrize(("about", "more"), [("", 3), ("x", 2), ("yz", 1)])
def test_a_mechanism_of_a_component_is_rigid_in_orbit(about, more, campaign):
    """Two beams on a pin, reduced to their far ends: as many modes at zero as the whole article has."""
    for seed in campaign(60):
        rng = np.random.default_rng([16, seed])
        _, one = bent_beam(rng, 10.0 ** rng.uniform(1, 6))
        one = dataclasses.replace(one, members=(dataclasses.replace(one.members[0], end="m"), one.members[1]))
        joined = [*one.nodes[:2], node("k", one.nodes[1].position), one.nodes[2]]
        second = member("k", "b", one.members[1].section, 6, one.members[1].up)
        part = dataclasses.replace(
            structure(joined, [one.members[0], second]),
            links=(Link(name="pin", first="m", second="k", about=about),),
        )
        made = md.reduce_structure(part, ["a", "b"], count=4).component
        ends = [dataclasses.replace(n, body=NONE) for n in (joined[0], joined[3])]
        article = dataclasses.replace(structure(ends), components=(made,))
        modes = solve_modes(solve_equilibrium(article, md.Environment.orbit()))
        assert modes.kind.count("rigid") == 6 + more

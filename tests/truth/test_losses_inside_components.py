"""Dampers inside a part that is reduced, beside the whole article; and axes that mirror a part."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from reduced import bent_beam, with_component

from middeck.errors import ConfigError
from middeck.structure.model.article import (
    AttachPoint,
    Damper,
    DamperPlace,
    Damping,
    Spring,
    Structure,
)
from middeck.structure.model.environment import Environment
from middeck.structure.modes.craig_bampton import reduce_structure
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.damping import ratios_by_cause
from middeck.structure.rest.equilibrium import solve_equilibrium
from structure_builders import NONE, structure


def damped(part: Structure) -> Structure:
    """With a damper along a spring that strains nothing as drawn, from a to m."""
    a, m = part.nodes[0].position, part.nodes[1].position
    out = np.array([0.0, 0.2, 0.1])
    points = (
        AttachPoint("on a", "a", out),
        AttachPoint("on m", "m", -out),
    )
    length = float(np.linalg.norm(m - out - a - out))
    spring = Spring(name="strut", start="on a", end="on m", stiffness=500.0, free_length=length)
    losses = Damping(dampers=(Damper(DamperPlace.SPRING, "strut", 3.0),))
    coarse = tuple(dataclasses.replace(m, elements=2) for m in part.members)
    return dataclasses.replace(part, members=coarse, attach_points=points, springs=(spring,), damping=losses)


def floating(article: Structure) -> Modes:
    return solve_modes(solve_equilibrium(article, Environment.orbit()))


def test_dampers_inside_damp_the_component_and_what_takes_it():
    """Once, and once more as a part of a part."""
    part = damped(bent_beam(np.random.default_rng(5))[1])
    inside = reduce_structure(part, ["a", "b"], count=200, name="part")
    ends = [dataclasses.replace(n, body=NONE) for n in part.nodes if n.name in "ab"]
    taking = dataclasses.replace(structure(ends), components=(inside.component,), damping=Damping())
    again = reduce_structure(taking, ["b", "a"], count=200, name="part").component
    nested = dataclasses.replace(taking, components=(again,))
    whole, *both = (ratios_by_cause(floating(article)).zeta[6:16] for article in (part, taking, nested))
    assert whole.max() > 1e-4
    for reduced in both:
        np.testing.assert_allclose(reduced, whole, rtol=1e-6, atol=1e-10)
    assert inside.warnings == ()


def test_losses_that_no_matrix_of_dampers_has_are_named():
    part = damped(bent_beam(np.random.default_rng(6))[1])
    losses = Damping(loss_factor=(("m-b", 0.05),), dampers=(Damper(DamperPlace.DEVICE, "on a", 2.0),))
    made = reduce_structure(dataclasses.replace(part, damping=losses), ["a", "b"], count=6)
    assert made.component.damping is None
    assert ["'m-b'" in made.warnings[0], "on a" in made.warnings[1], len(made.warnings)] == [True, True, 2]


@pytest.mark.parametrize("lost", [{"flexible": 0.01}, {"by_mode": ((7, 0.02),)}])
def test_ratios_of_modes_are_named_as_lost(lost):
    part = dataclasses.replace(bent_beam(np.random.default_rng(6))[1], damping=Damping(**lost))
    (warning,) = reduce_structure(part, ["a", "b"], count=6).warnings
    assert "ratios of the article's modes are not in the component" in warning


@pytest.mark.parametrize("axes", [[1.0, 1.0, -1.0], [1.0, 1.0, 0.5]])
def test_axes_that_mirror_or_stretch_are_refused(axes):
    """In a plane the places fit, and frequencies were off by up to 16 %."""
    whole, part = bent_beam(np.random.default_rng(7))
    flat = [dataclasses.replace(n, position=n.position * [1.0, 1.0, 0.0]) for n in whole.nodes]
    whole, part = (
        dataclasses.replace(whole, nodes=tuple(flat)),
        dataclasses.replace(part, nodes=tuple(flat[:3])),
    )
    article = with_component(whole, part, count=6)
    turned = dataclasses.replace(article.components[0], axes=np.diag(axes))
    with pytest.raises(ConfigError, match="right-handed set"):
        floating(dataclasses.replace(article, components=(turned,)))

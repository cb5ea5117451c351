"""Articles that float, tied by springs up to 1e12 times as stiff as their members: six modes at zero."""

from __future__ import annotations

import numpy as np
import pytest

from middeck.errors import UnstableEquilibriumError
from middeck.structure.model.article import AttachPoint, Spring, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.section import Section
from middeck.structure.modes.solve import solve_modes
from middeck.structure.rest.equilibrium import solve_equilibrium
from repeats import repeats
from structure_builders import body, member, node, structure


def _tied(seed: int, ratio: float, away: float) -> Structure:
    """Three or four bodies on massless beams in a bent line, its ends tied by a spring that pulls nothing."""
    rng = np.random.default_rng([26, seed])
    count, size, bending = (
        int(rng.integers(3, 5)),
        10.0 ** rng.uniform(-2.0, 1.0),
        10.0 ** rng.uniform(0.0, 7.0),
    )
    places = size * np.cumsum(rng.standard_normal((count, 3)) + np.array([1.5, 0.0, 0.0]), axis=0) + away
    nodes = []
    for k, place in enumerate(places):
        mass = 10.0 ** rng.uniform(-2.0, 1.0)
        nodes.append(node("abcd"[k], place, body(mass, inertia=mass * size**2 * rng.uniform(0.1, 0.15, 3))))
    section = Section(
        EA=1e3 * bending / size**2,
        GJ=bending,
        EI_y=bending,
        EI_z=bending,
        rho_A=0.0,
        rho_I_y=0.0,
        rho_I_z=0.0,
    )
    members = [member("abcd"[k], "abcd"[k + 1], section, 1, (0.1, 0.9, 0.3)) for k in range(count - 1)]
    length = float(np.linalg.norm(places[-1] - places[0]))
    tie = Spring(
        name="tie",
        start="a",
        end="abcd"[count - 1],
        stiffness=ratio * bending / size**3,
        free_length=length,
    )
    attach = [AttachPoint(name=name, frame=name, offset=np.zeros(3)) for name in (tie.start, tie.end)]
    return structure(nodes, members, springs=[tie], attach=attach)


@pytest.mark.parametrize("away", [0.0, 1000.0])
@pytest.mark.parametrize("ratio", [1.0, 1e5, 1e9, 1e12])
@pytest.mark.parametrize("seed", repeats(range(60), 3))
def test_a_floating_article_has_six_modes_at_zero(seed: int, ratio: float, away: float) -> None:
    """One of them came out at 1e-4 rad/s, or growing: the rest state was refused as unstable."""
    try:
        modes = solve_modes(solve_equilibrium(_tied(seed, ratio, away), Environment.orbit()))
    except UnstableEquilibriumError as error:
        pytest.fail(str(error))
    assert np.sum(modes.omega == 0.0) == 6
    assert modes.omega[6] > 1e-3 * modes.omega[7]

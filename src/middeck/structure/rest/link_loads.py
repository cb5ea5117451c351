"""Loads of links on their frames at rest."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.energy import assemble_carried
from middeck.structure.assembly.linked import links_at, multipliers
from middeck.structure.rest.equilibrium import Equilibrium


class LinkLoad(NamedTuple):
    """Force [N] and moment [N m] in W of a link on one of its frames, the moment about its point there."""

    link: str
    frame: str
    force: Float[np.ndarray, "3"]
    moment: Float[np.ndarray, "3"]


def link_loads(equilibrium: Equilibrium) -> tuple[LinkLoad, ...]:
    """Force and moment of every link on each of its frames at rest; with those of the ground they balance.

    Those on joints' angles alone are none. Where links repeat each other, one bears the load of both
    (`rest_warnings`).

    >>> import middeck as md
    >>> article = md.load_structure("articles/mace-simple.toml")
    >>> md.structure.link_loads(md.solve_equilibrium(article, md.Environment.orbit()))
    ()
    """
    model = equilibrium.model
    if model.links is None:
        return ()
    load = -links_at(model, equilibrium.config).load(rest_multipliers(equilibrium))
    tied = [(link.name, frame) for link in model.structure.links for frame in link.frames]
    own = load[len(load) - len(tied) :]  # their points are the last ones
    return tuple(LinkLoad(*names, six[:3], six[3:]) for names, six in zip(tied, own, strict=True))


def rest_multipliers(equilibrium: Equilibrium) -> Float[np.ndarray, " row"]:
    """Multiplier at rest of each number that links hold; only for a model that has some."""
    model, config = equilibrium.model, equilibrium.config
    bare = assemble_carried(dataclasses.replace(model, links=None), config, equilibrium.loads).gradient
    return multipliers(model, config, links_at(model, config), bare)

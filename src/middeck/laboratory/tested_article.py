"""The test article on the rig, which differs from every design model.

Its mesh is finer, its struts have shear flexibility, it has every mode to 200 Hz, and its numbers have hidden
errors, drawn from a seed as in the frozen case "Updating and promise". Designs use its records only.
"""

from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.laboratory.hidden_errors import (
    HiddenErrors,
    hide_in_structure,
    hide_in_suspension,
    spread_damping,
)
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.finer_mesh import TUBE_SHEAR, refine_mesh
from middeck.structure.model.umbilical import tie_umbilical
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.plants.modal_plant import build_plant
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.systems.plants.plant import Plant
from middeck.values import record

MESH_FACTOR = 3  # times the elements of the article
RIG_MODES_HZ = 200.0


@record
class RigArticle:
    """The truth behind a rig: modes about its own rest state, and their hidden errors.

    ``hidden`` is None for an article without hidden errors.
    """

    equilibrium: Equilibrium
    modes: Modes
    hidden: HiddenErrors | None


def solve_rig_article(
    structure: Structure,
    environment: Environment,
    hidden: HiddenErrors | None = None,
    *,
    mesh_factor: int = MESH_FACTOR,
    shear: float | None = TUBE_SHEAR,
    umbilical_hz: float = 0.0,
) -> RigArticle:
    """The article on its rig in ``environment``, meshed ``mesh_factor`` times finer, its struts in shear.

    ``shear`` is the coefficient k in k G A of every member without a shear stiffness of its own, taken as
    round; None leaves it rigid in shear. In orbit ``umbilical_hz`` ties the middle attach point with springs
    that give the article that frequency in all directions. Raises `ConfigError` for a mesh that is no finer
    or an umbilical without an attach point.
    """
    if mesh_factor < 1:
        raise ConfigError(f"a mesh {mesh_factor} times as fine", where="rig article", hint="one or more")
    finer = refine_mesh(structure, mesh_factor, shear)
    if hidden is not None:
        finer, environment = hide_in_structure(finer, hidden), hide_in_suspension(environment, hidden)
    environment = tie_umbilical(finer, environment, umbilical_hz)
    equilibrium = solve_equilibrium(finer, environment)
    return RigArticle(equilibrium, solve_modes(equilibrium), hidden)


def rig_article_plant(
    article: RigArticle,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    to_hz: float = RIG_MODES_HZ,
    w: Sequence[str] = (),
    u: Sequence[str] = (),
    z: Sequence[str] = (),
    y: Sequence[str] = (),
) -> Plant:
    """All modes of the rig's article up to ``to_hz``, each with its own damping."""
    modes = article.modes
    count = int(np.searchsorted(modes.frequency_hz, to_hz))
    damping = modes.equilibrium.model.structure.damping
    if article.hidden is not None:
        damping = spread_damping(damping, modes, article.hidden.damping, count)
    return build_plant(
        modes, inputs=inputs, outputs=outputs, count=count, damping=damping, w=w, u=u, z=z, y=y
    )

"""Load cases: what is hung on an article, pushes it or displaces it in one test, and is taken off again."""

from __future__ import annotations

import dataclasses

from middeck.errors import ConfigError
from middeck.structure.model.article import AddedMass, PointLoad, Structure
from middeck.structure.model.clamps import Clamp
from middeck.structure.model.environment import Environment
from middeck.values import record


@record(kw_only=True)
class LoadCase:
    """Named loads on frames, masses on frames, and prescribed displacements of nodes.

    Gravity acts on the masses as on the article, and they take part in its modes. Forces and moments are
    dead: they keep their direction in W. ``prescribed`` are clamps with a displacement.

    >>> push = PointLoad(name="push", frame="b", force=np.array([0.0, -1.0, 0.0]))
    >>> LoadCase(name="tip", loads=(push,)).name
    'tip'
    """

    name: str
    loads: tuple[PointLoad, ...] = ()
    masses: tuple[AddedMass, ...] = ()
    prescribed: tuple[Clamp, ...] = ()


def apply_load_case(
    structure: Structure, environment: Environment, case: LoadCase | None
) -> tuple[Structure, Environment]:
    """Both with the loads, masses and prescribed displacements of ``case``; as they are without one.

    Raises `ConfigError` where the article has a load or a mass of the same name already.
    """
    if case is None:
        return structure, environment
    for what, new, old in (("load", case.loads, structure.loads), ("mass", case.masses, structure.masses)):
        taken = {part.name for part in old}
        for part in new:
            if part.name in taken:
                raise ConfigError(
                    f"a second {what} {part.name!r}", where=f"load case {case.name!r}", hint="another name"
                )
            taken.add(part.name)
    loaded = dataclasses.replace(
        structure,
        loads=(*structure.loads, *case.loads),
        masses=(*structure.masses, *case.masses),
    )
    if not case.prescribed:
        return loaded, environment
    return loaded, dataclasses.replace(environment, clamps=(*environment.clamps, *case.prescribed))

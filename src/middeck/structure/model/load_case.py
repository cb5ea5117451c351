"""Load cases: weights, loads and prescribed displacements of one test."""

import dataclasses

from middeck.errors import ConfigError
from middeck.structure.model.article import LoadCase, Structure
from middeck.structure.model.connectivity import some_names
from middeck.structure.model.environment import Environment


def apply_load_case(
    structure: Structure, environment: Environment, case: LoadCase | str | None
) -> tuple[Structure, Environment]:
    """Both with the loads, masses and prescribed displacements of ``case``; as they are without one.

    A name means one of the article's own. Raises `ConfigError` for a name that it lacks, and for a load or a
    mass with a name in use or on a missing part.
    """
    if case is None:
        return structure, environment
    if isinstance(case, str):
        known = {own.name: own for own in structure.load_cases}
        if case not in known:
            names = f"load cases are {', '.join(known)}"
            raise ConfigError(
                f"no load case {case!r}",
                where=f"structure {structure.title!r}",
                hint=names if known else "the article has none: give it [[load_case]] tables",
            )
        case = known[case]
    for what, new, old in (("load", case.loads, structure.loads), ("mass", case.masses, structure.masses)):
        taken = {part.name for part in old}
        for part in new:
            if part.name in taken:
                raise ConfigError(
                    f"a second {what} {part.name!r}", where=f"load case {case.name!r}", hint="another name"
                )
            taken.add(part.name)
    frames = [part.name for part in (*structure.nodes, *structure.joints)]
    for what, new in (("load", case.loads), ("mass", case.masses)):
        for frame in (part.frame for part in new):
            if frame not in frames:
                raise ConfigError(
                    f"a {what} names frame {frame!r}, which does not exist",
                    where=f"load case {case.name!r}",
                    hint=f"nodes and joints are {some_names(frames)}",
                )
    loaded = dataclasses.replace(
        structure, loads=(*structure.loads, *case.loads), masses=(*structure.masses, *case.masses)
    )
    if not case.prescribed:
        return loaded, environment
    return loaded, dataclasses.replace(environment, clamps=(*environment.clamps, *case.prescribed))

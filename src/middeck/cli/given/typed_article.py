"""An article in an environment, from the names that were typed."""

import dataclasses
from pathlib import Path

import numpy as np

from middeck.cli.options import TypedSetup, typed
from middeck.cli.shown.file_of_an_error import reading
from middeck.errors import MiddeckError
from middeck.files.disk.kind_of_content import ARTICLE
from middeck.files.setups import BUILT_IN, find_document, load_setup
from middeck.files.toml.source import read_source
from middeck.structure.hanging.attitude import estimate_attitude
from middeck.structure.hanging.support_warnings import sag
from middeck.structure.model.article import Structure
from middeck.structure.model.connectivity import some_names
from middeck.structure.model.environment import Environment
from middeck.structure.model.load_case import apply_load_case
from middeck.structure.modes.solve import Modes, solve_modes
from middeck.structure.rest.equilibrium import Equilibrium, solve_equilibrium
from middeck.structure.summary.environment_plausibility import warnings_on_environment
from middeck.structure.summary.summary import summarise

TILTED_DEG = 5.0  # from which every verb says how an article hangs; `check` does from one


def hung_anywhere(structure: Structure, *files: Path) -> tuple[str, ...]:
    """A warning where the built-in laboratory hangs an article by every attach point, for want of others."""
    if not files or files[-1] != BUILT_IN["lab"] or "suspension" in read_source(files[0], ARTICLE).data:
        return ()
    names = some_names([point.name for point in structure.attach_points])
    return (
        f"'lab', the {_how_named()} environment, hangs this article by every attach point ({names}), with "
        "gravity along -y: is that your test? --environment names another; [suspension] in the article names "
        "points",
    )


def _how_named() -> str:
    """Word for the program's own environment: "default" where it was not typed."""
    return "built-in" if typed("environment") or typed("environments") else "default"


def tilted(rest: Equilibrium) -> tuple[str, ...]:
    """A warning for an article that hangs tilted far from the drawing; small bending does not count."""
    environment = rest.environment
    if not rest.converged or not environment.hung or environment.clamps or not np.any(environment.gravity):
        return ()
    attitude = estimate_attitude(rest)
    tilt = float(np.degrees(np.linalg.norm(attitude.tilt)))
    if tilt < TILTED_DEG:
        return ()
    if doubt := sag(attitude):
        return (f"{doubt} (`middeck check` has more)",)
    return (f"the article hangs tilted by {tilt:.0f} deg; it was drawn level (`middeck check` has more)",)


# From this many coordinates on, all modes take longer than anybody waits for the few that are shown.
LARGE = 2000
COUNT = 26  # modes that are looked at where a verb wants all
SPARE = 12  # the comparison of two environments looks beyond what it shows


def find_case(article: str, environment: str) -> tuple[Path, Path]:
    """The two files; the environment is sought in the current folder, then beside the article."""
    body = find_document(article, "article")
    return body, find_document(environment, "environment", beside=body)


def read_case(case: TypedSetup) -> tuple[Structure, Environment, Path, Path]:
    """The article and the environment, under the load case, and the two files."""
    files = find_case(case.article, case.environment)
    return *apply_case(*load_setup(*files, case.overrides), case.load_case, *files), *files


def solve_case(
    case: TypedSetup, count: int | None = None, standstill: bool = False, top_hz: float | None = None
) -> Modes:
    """Rest state and modes; of a large article the ``count`` lowest, with a few to spare.

    Where wheels spin, modes at ``standstill`` are for callers that add their momentum. A mesh that is too
    coarse only for frequencies above ``top_hz`` gives no warning.
    """
    return solve_in(*read_case(case), count=count, standstill=standstill, top_hz=top_hz)


def apply_case(
    structure: Structure, environment: Environment, case: str | None, *files: Path
) -> tuple[Structure, Environment]:
    """Both under the load case given; errors name ``files``."""
    with reading(*files):
        return apply_load_case(structure, environment, case)


def solve_in(
    structure: Structure,
    environment: Environment,
    *files: Path,
    count: int | None = None,
    standstill: bool = False,
    top_hz: float | None = None,
) -> Modes:
    """Rest state and modes of a case already read from ``files``, which errors then name.

    Beside what `solve_modes` says, the warnings of the modes name implausible values in the files, and
    which of the ``count`` lowest frequencies the mesh is too coarse for.
    """
    doubts = case_warnings(structure, environment, *files)
    try:
        with reading(*files):
            rest = solve_equilibrium(structure, environment)
            few = count is not None and rest.model.tree.size > LARGE
            most = count + SPARE if few and count is not None else None
            modes = solve_modes(rest, most, standstill=standstill)
    except MiddeckError as error:
        # A slipped unit shows as a mechanism or as no rest at all: what may be the cause comes first.
        lab = f"'lab', the {_how_named()} environment, hangs every attach point: give one with --environment"
        hung = [lab] if files[-1] == BUILT_IN["lab"] and not hung_anywhere(structure, *files) else []
        advice = [*doubts, *hung, *error.hint.split("; ")]
        error.hint = "; ".join(a for i, a in enumerate(advice) if not any(a in b for b in advice[:i]))
        raise
    shown = count or COUNT
    if top_hz is not None:
        shown = min(shown, int(np.searchsorted(modes.frequency_hz, top_hz, side="right")))
    own_warnings = (*doubts, *tilted(rest), *modes.stated_warnings)
    return dataclasses.replace(modes, stated_warnings=own_warnings, judged=shown)


def case_warnings(structure: Structure, environment: Environment, *files: Path) -> tuple[str, ...]:
    """Plausibility warnings of both ``files``."""
    return (
        *hung_anywhere(structure, *files),
        *summarise(structure).warnings,
        *warnings_on_environment(structure, environment),
    )


def both_sides(orbit: Modes, lab: Modes) -> tuple[str, ...]:
    """Warnings of a comparison: common ones once, the others with their side."""
    place, other = (side.equilibrium.environment.title for side in (lab, orbit))
    return (
        *(w for w in orbit.warnings if w in lab.warnings),
        *(f"in {other}: {w}" for w in orbit.warnings if w not in lab.warnings),
        *(f"in {place}: {w}" for w in lab.warnings if w not in orbit.warnings),
    )

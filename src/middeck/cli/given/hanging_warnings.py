"""Warnings of every verb about how an article hangs: anywhere by default, or tilted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from middeck.files.disk.looks import ARTICLE
from middeck.files.documents import BUILT_IN
from middeck.files.toml.source import read_source
from middeck.structure.model.article import Structure
from middeck.structure.model.connectivity import some_names
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.suspension.attitude import estimate_attitude
from middeck.structure.suspension.hanging import sag

TILTED_DEG = 5.0  # from which every verb says how an article hangs; `check` does from one


def hung_anywhere(structure: Structure, *files: Path) -> tuple[str, ...]:
    """The built-in laboratory hangs an article that does not say where by every attach point that it has."""
    if not files or files[-1] != BUILT_IN["lab"] or "suspension" in read_source(files[0], ARTICLE).data:
        return ()
    names = some_names([point.name for point in structure.attach_points])
    return (
        f"'lab', the default environment, hangs this article by every attach point ({names}), with gravity "
        "along -y: is that your test? --environment names another; [suspension] in the article names points",
    )


def tilted(rest: Equilibrium) -> tuple[str, ...]:
    """An article that hangs far from how it was drawn; what bends a little is not meant."""
    environment = rest.environment
    if not rest.converged or not environment.hung or environment.clamps or not np.any(environment.gravity):
        return ()
    attitude = estimate_attitude(rest)
    tilt = float(np.degrees(np.linalg.norm(attitude.tilt)))
    if tilt < TILTED_DEG:
        return ()
    if said := sag(attitude):
        return (f"{said} (`middeck check` has more)",)
    return (f"the article hangs tilted by {tilt:.0f} deg; it was drawn level (`middeck check` has more)",)

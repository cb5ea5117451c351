"""The frozen case "Updating and promise": truths around the sheet, surveys of them, and the sheet's unknowns.

Beside the errors of the sheet a truth has a mesh three times finer, shear, one per cent of a strut's mass in
a node and, in orbit, an umbilical of 0.02 Hz, none of which the refined model has.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import middeck as md
from middeck.laboratory.hidden_errors import draw_hidden_errors, spread_damping
from middeck.laboratory.tested_article import RigArticle, solve_rig_article
from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.model.finer_mesh import TUBE_SHEAR
from middeck.structure.modes.solve import Modes
from middeck.structure.plants.damping import estimate_damping
from middeck.structure.sensitivity.parameters import find_parameters, scale_parameters, set_parameter
from middeck.updating.residuals.pairing import pair
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown

ROOT = Path(__file__).parents[2]
STRAIGHT: tuple[tuple[str, float], ...] = ()
TURNED = (("joint.pri_x.angle", 0.35), ("joint.pri_z.angle", 0.35))
NOISE = MeasurementNoise(frequency=1e-4, shape=0.02)
SUSPENSION = 8  # modes below the flexible ones, on the ground and, rigid, in orbit
UMBILICAL_HZ = 0.02
DAMPING_STD = 0.05


@functools.cache
def sheet() -> tuple[Structure, Environment]:
    """With half the elements, which moves no frequency below 30 Hz by as much as 1e-5."""
    return md.load_setup(
        ROOT / "articles/mace-dm.toml", ROOT / "environments/lab.toml", ["mesh.elements_per_strut=4"]
    )


def true_article(
    seed: int, environment: Environment, settings: Sequence[tuple[str, float]] = STRAIGHT
) -> RigArticle:
    """The truth at rest in ``environment``, solved once."""
    return _true_article(seed, environment, tuple(settings))


# A cache tells a default from the same value given.
@functools.cache
def _true_article(seed: int, environment: Environment, settings: tuple[tuple[str, float], ...]) -> RigArticle:
    article, _ = sheet()
    hidden = draw_hidden_errors(article, seed)
    strut = article.members[0]
    length = float(np.linalg.norm(article.nodes[1].position - article.nodes[0].position))
    moved = scale_parameters(
        article,
        {
            f"member.{strut.name}.rho": 0.99,
            f"node.{strut.start}.mass": 1.0
            + 0.01 * strut.section.rho_A * length / article.nodes[0].body.mass,
        },
    )
    return solve_rig_article(
        placed(moved, settings), environment, hidden, shear=TUBE_SHEAR, umbilical_hz=UMBILICAL_HZ
    )


def true_modes(
    seed: int, environment: Environment, settings: Sequence[tuple[str, float]] = STRAIGHT
) -> Modes:
    return true_article(seed, environment, settings).modes


def placed(article: Structure, settings: Sequence[tuple[str, float]]) -> Structure:
    both = article, Environment.orbit()
    for name, value in settings:
        both = set_parameter(*both, find_parameters(*both, [name])[0], value)
    return both[0]


def survey(
    seed: int,
    number: int,
    settings: Sequence[tuple[str, float]],
    chosen: Sequence[int],
    noise: MeasurementNoise = NOISE,
) -> Survey:
    """What a modal test of the truth in the laboratory gives."""
    _, lab = sheet()
    modes, rng = true_modes(seed, lab, settings), np.random.default_rng([seed, number])
    seen = measure_modes(modes, chosen=chosen, noise=noise, rng=rng)
    zeta = true_damping(seed, modes, max(chosen) + 1)[list(chosen)]
    seen = dataclasses.replace(
        seen,
        damping=zeta * np.exp(DAMPING_STD * rng.standard_normal(len(zeta))),
        damping_std=DAMPING_STD * zeta,
    )
    return Survey(name=f"test {number}", measured=seen, environment=lab, settings=tuple(settings))


def true_damping(seed: int, modes: Modes, count: int) -> np.ndarray:
    """Ratios of the lowest modes with the hidden errors."""
    hidden, model = draw_hidden_errors(sheet()[0], seed), modes.equilibrium.model
    return estimate_damping(modes, spread_damping(model.structure.damping, modes, hidden.damping, count)).zeta


def ten_in_orbit(seed: int) -> MeasuredModes:
    """The first ten flexible modes of the truth in orbit, with their shapes at the nodes."""
    orbit = true_modes(seed, Environment.orbit())
    return measure_modes(orbit, chosen=range(SUSPENSION, SUSPENSION + 10))


def log_errors(modes: Modes, hz: np.ndarray, index: np.ndarray, true: MeasuredModes) -> np.ndarray:
    """ln of predicted over true frequencies, modes paired by their shapes."""
    place = {int(i): int(j) for i, j in pair(modes, true)}
    return np.log(hz / true.frequency_hz[[place[int(i)] for i in index]])


def sheet_unknowns(article: Structure) -> list[Unknown]:
    """The 23 of the frozen case "Updating and promise", with deviations of its uniform priors."""
    third, small = np.sqrt(3.0), np.log(0.975)
    found = [Unknown(name="E", parameters=("members.E",), spread=0.15 / third)]
    for m in article.members:
        bending = (f"member.{m.name}.EI_y", f"member.{m.name}.EI_z")
        found.append(Unknown(name=m.name, parameters=bending, spread=0.05 / np.sqrt(12.0), mean=small))
    for n in ("n1", "n3", "n5"):
        found.append(Unknown(name=f"mass {n}", parameters=(f"node.{n}.mass",), spread=0.05 / third))
        for i in ("xx", "yy", "zz"):
            found.append(Unknown(name=f"{n} {i}", parameters=(f"node.{n}.inertia.{i}",), spread=0.1 / third))
    for i in ("xx", "yy", "zz"):
        found.append(
            Unknown(name=f"payload {i}", parameters=(f"joint.pri_z.inertia.{i}",), spread=0.1 / third)
        )
    found.append(Unknown(name="payload cg", parameters=("joint.pri_z.cg.*",), spread=0.1 / third))
    found.append(Unknown(name="bounce", parameters=("environment.bounce_hz",), spread=0.1 / third))
    found.append(Unknown(name="cable", parameters=("environment.cable_length",), spread=0.05 / third))
    return found

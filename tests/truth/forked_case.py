"""A fork of three struts on springs with seven unknowns, and surveys of forks with drawn values."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

import structure_builders as build
from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes
from middeck.structure.model.article import AttachPoint, Section, Structure
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.structure.modes.solve import Modes
from middeck.updating.residuals.surveys import Survey, set_up
from middeck.updating.unknowns.unknowns import Unknown

PLACE = {"a": (0, 0, 0), "b": (1.1, 0, 0), "c": (1.1, 0.8, 0.1), "d": (1.9, -0.2, 0.3)}
BODY = {
    "a": build.body(1.5, (0, 0.02, 0), (0.02, 0.015, 0.02)),
    "b": build.body(0.8, (0.01, 0, 0.02), (4e-3, 5e-3, 6e-3)),
    "c": build.body(0.5, (0, 0, 0.03), (3e-3, 3e-3, 2e-3)),
    "d": build.body(0.9, (0, 0.01, 0), (8e-3, 7e-3, 6e-3)),
}
THICK = Section(
    EA=4e5, GJ=20.0, EI_y=60.0, EI_z=75.0, GA_y=1e12, GA_z=1e12, rho_A=0.35, rho_I_y=1e-4, rho_I_z=1e-4
)
THIN = dataclasses.replace(THICK, EA=2e5, GJ=9.0, EI_y=25.0, EI_z=30.0)
UNKNOWNS = [
    *(
        Unknown(name=m, parameters=(f"member.{m}.EI_y", f"member.{m}.EI_z"), spread=0.08)
        for m in ("a-b", "b-c", "b-d")
    ),
    Unknown(name="twist", parameters=("member.*.GJ",), spread=0.1),
    Unknown(name="mass of c", parameters=("node.c.mass",), spread=0.05),
    Unknown(name="roll of d", parameters=("node.d.inertia.xx",), spread=0.1),
    Unknown(name="yaw of a", parameters=("node.a.inertia.zz",), spread=0.1),
]


def fork() -> Structure:
    members = [build.member(*ends, s, 4) for ends, s in (("ab", THICK), ("bc", THIN), ("bd", THICK))]
    nodes = [build.node(n, at, BODY[n]) for n, at in PLACE.items()]
    return build.structure(nodes, members, attach=[AttachPoint(n, n, np.zeros(3)) for n in "acd"])


@functools.cache
def on_springs() -> Environment:
    springs = tuple(
        AnchoredSpring(name=f"{n}{d}", attach=n, anchor=PLACE[n] + way, stiffness=k, free_length=1.0)
        for n in "acd"
        for d, k, way in zip("xyz", (40.0, 55.0, 70.0), np.eye(3), strict=True)
    )
    return Environment(title="springs", gravity=np.zeros(3), suspension=None, springs=springs)


def drawn(seed: int) -> tuple[np.ndarray, Modes, np.random.Generator]:
    """Hidden logarithms of factors, modes of that fork on its springs, and what draws its noise."""
    rng = np.random.default_rng([seed, 77])
    x = np.array([u.spread for u in UNKNOWNS]) * rng.standard_normal(len(UNKNOWNS))
    return x, set_up(fork(), on_springs(), (), UNKNOWNS).solve(x), rng


def survey(modes: Modes, chosen: Sequence[int], rng: np.random.Generator, shape: float = 0.02) -> Survey:
    noise = MeasurementNoise(frequency=2e-4, shape=shape)
    seen = measure_modes(modes, chosen=chosen, noise=noise, rng=rng)
    return Survey(name="springs", measured=seen, environment=on_springs())


def at_channels_of(survey: Survey, kept: Sequence[tuple[str, str]]) -> Survey:
    """The same survey of some channels alone, or of frequencies alone."""
    m = survey.measured
    rows = [i for i, channel in enumerate(zip(m.node, m.direction, strict=True)) if channel in kept]
    fewer = MeasuredModes(
        frequency_hz=m.frequency_hz,
        damping=m.damping,
        node=tuple(m.node[i] for i in rows),
        direction=tuple(m.direction[i] for i in rows),
        shape=m.shape[rows],
        frequency_std_hz=m.frequency_std_hz,
        shape_std=None if m.shape_std is None else m.shape_std[rows],
    )
    return dataclasses.replace(survey, measured=fewer)

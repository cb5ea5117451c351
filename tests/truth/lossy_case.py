"""Articles with hidden losses: their complex modes by matrices and an eigensolver of their own, and surveys.

Two members of two materials, a payload on a sprung joint, springs and dampers to the ground, unstressed:
stiffness is linear in every number, so that each part of it is a difference of two tangents.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla

import middeck as md
import structure_builders as build
from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.linked import dynamic_coordinates
from middeck.structure.correlation.measured_modes import MeasuredModes, sensor_rows
from middeck.structure.model.article import (
    AttachPoint,
    Damper,
    DamperPlace,
    Damping,
    Section,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Environment
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown

PLACE = {"a": np.array([0.0, 0.0, 0.0]), "c": np.array([1.4, 0.3, 0.0])}
HOLDS = {"x": 60.0, "y": 80.0, "z": 100.0}
LOSS, JOINT_K, JOINT_C, GROUND_C = {"a-b": 0.01, "b-c": 0.015}, 9.0, 0.002, 0.25
CHANNELS = [(n, d) for n in "abc" for d in ("x", "y", "z", "rx", "ry", "rz")] + [("p", "angle")]
MODES = 12
# Drawn with a shear stiffness, so that the model lacks none; the truth has the same mesh.
TUBE = Section(
    EA=1e6, GJ=80.0, EI_y=100.0, EI_z=130.0, GA_y=1e12, GA_z=1e12, rho_A=0.5, rho_I_y=1e-4, rho_I_z=1e-4
)
SOFT = Section(
    EA=3e5, GJ=20.0, EI_y=30.0, EI_z=40.0, GA_y=1e12, GA_z=1e12, rho_A=0.3, rho_I_y=1e-4, rho_I_z=1e-4
)


def article(ab: float = 1.0, bc: float = 1.0, joint: float = 1.0) -> Structure:
    """With stiffnesses of its members and its joint multiplied."""

    def stiffer(s: Section, by: float) -> Section:
        return dataclasses.replace(s, EA=s.EA * by, GJ=s.GJ * by, EI_y=s.EI_y * by, EI_z=s.EI_z * by)

    nodes = [
        build.node("a", PLACE["a"], build.body(2.0, (0.01, -0.02, 0.0), (0.02, 0.03, 0.03))),
        build.node("b", (0.7, 0.1, 0.0), build.body(0.4, (0.02, 0.01, 0.03), (1e-3, 2e-3, 3e-3))),
        build.node("c", PLACE["c"], build.body(1.0, (0.0, 0.0, 0.01), (0.01, 0.012, 0.011))),
    ]
    members = [build.member("a", "b", stiffer(TUBE, ab), 2), build.member("b", "c", stiffer(SOFT, bc), 2)]
    payload = build.body(0.6, (0.0, 0.05, 0.0), (4e-3, 3e-3, 3e-3))
    held = build.joint("p", "c", np.eye(3)[0], payload, angle=0.0, stiffness=joint * JOINT_K, target=0.0)
    damping = Damping(
        loss_factor=tuple(LOSS.items()),
        dampers=(
            Damper(DamperPlace.JOINT, "p", JOINT_C),
            *(Damper(DamperPlace.DEVICE, name, GROUND_C) for name in PLACE),
        ),
    )
    made = build.structure(nodes, members, [held], (), [AttachPoint(n, n, np.zeros(3)) for n in PLACE])
    return dataclasses.replace(made, damping=damping)


@functools.cache
def ground(by: float = 1.0) -> Environment:
    """Three springs and dampers at either end, unstretched, without weight."""
    springs = tuple(
        AnchoredSpring(name=f"{n}{d}", attach=n, anchor=at + way, stiffness=by * HOLDS[d], free_length=1.0)
        for n, at in PLACE.items()
        for d, way in zip(HOLDS, np.eye(3), strict=True)
    )
    return Environment(title="springs", gravity=np.zeros(3), suspension=None, springs=springs)


UNKNOWNS = [
    Unknown(name="modulus", parameters=("members.E",), spread=0.05),
    Unknown(name="tube", parameters=("damping.loss_factor.a-b",), spread=0.5),
    Unknown(name="soft", parameters=("damping.loss_factor.b-c",), spread=0.5),
    Unknown(name="joint", parameters=("damping.joint.p.c",), spread=0.5),
    Unknown(name="ground", parameters=("damping.device.*.c",), spread=0.5),
]
SPREAD = np.array([u.spread for u in UNKNOWNS])


class Parts(NamedTuple):
    """Stiffness of each part, mass, the channels' rows, and the attach points' shifts."""

    ab: np.ndarray
    bc: np.ndarray
    joint: np.ndarray
    ground: np.ndarray
    mass: np.ndarray
    rows: np.ndarray
    ends: np.ndarray


@functools.cache
def parts() -> Parts:
    """By differences of tangents, which rest states without stress have exactly linear."""

    def tangent(made: Structure, place: Environment) -> np.ndarray:
        rest = md.solve_equilibrium(made, place)
        free = dynamic_coordinates(rest.model)
        return assemble(rest.model, rest.config, rest.loads).tangent[free][:, free].toarray()

    base, held = tangent(article(), ground()), md.solve_modes(md.solve_equilibrium(article(), ground()))
    free = dynamic_coordinates(held.equilibrium.model)

    def rows_of(channels: list[tuple[str, str]]) -> np.ndarray:
        return sensor_rows(held, *zip(*channels, strict=True)).toarray()[:, free]

    return Parts(
        ab=tangent(article(ab=2.0), ground()) - base,
        bc=tangent(article(bc=2.0), ground()) - base,
        joint=tangent(article(joint=2.0), ground()) - base,
        ground=tangent(article(), ground(2.0)) - base,
        mass=held.mass[free][:, free].toarray(),
        rows=rows_of(CHANNELS),
        ends=rows_of([(n, d) for n in PLACE for d in HOLDS]),
    )


class Truth(NamedTuple):
    """Roots [rad/s], ascending in size, and shapes at the channels."""

    s: np.ndarray
    shapes: np.ndarray

    @property
    def hz(self) -> np.ndarray:
        return np.abs(self.s) / (2.0 * np.pi)

    @property
    def zeta(self) -> np.ndarray:
        return -self.s.real / np.abs(self.s)


def truth(x: np.ndarray, held: bool, other: np.ndarray | None = None, friction: complex = 0.0) -> Truth:
    """Complex modes of the article at logarithms of factors ``x``, on its springs or free.

    Loss factors make stiffness complex, dampers are dampers. ``other`` are losses that no unknown has,
    relative errors of ln zeta of the modes on springs; ``friction`` is a complex stiffness of the joint.
    """
    p, (E, tube, soft, joint, springs) = parts(), np.exp(x)
    K = E * (p.ab + p.bc) + p.joint + held * p.ground
    H = E * (LOSS["a-b"] * tube * p.ab + LOSS["b-c"] * soft * p.bc)
    C = JOINT_C * joint / JOINT_K * p.joint + held * GROUND_C * springs * p.ends.T @ p.ends
    if other is not None:
        C = C + _other_losses(x, other)
    K = K + 1j * H + friction / JOINT_K * p.joint
    n, inverse = len(K), np.linalg.inv(p.mass)
    s, V = np.linalg.eig(np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ C]]))
    up = np.flatnonzero(s.imag > 1e-2)
    up = up[np.argsort(np.abs(s[up]))]
    return Truth(s[up], p.rows @ V[:n, up])


def _other_losses(x: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Dampers that each mode on springs has alone, to first order."""
    p, plain = parts(), truth(x, held=True)
    K = np.exp(x[0]) * (p.ab + p.bc) + p.joint + p.ground
    lam, phi = sla.eigh(K, p.mass, subset_by_index=(1, len(other)))  # it turns freely about its two ends
    shapes = p.mass @ phi
    size = 2.0 * plain.zeta[: len(other)] * np.sqrt(lam) * np.expm1(other)
    return (shapes * size) @ shapes.T


def survey(
    found: Truth, rng: np.random.Generator, damping_std: float = 0.05, frequency_std: float = 3e-4
) -> Survey:
    """The lowest modes of a truth on its springs, as a test measures them."""
    shape = found.shapes[:, :MODES] / np.abs(found.shapes[:, :MODES]).max(axis=0)
    noise = rng.standard_normal((2, MODES))
    measured = MeasuredModes(
        frequency_hz=found.hz[:MODES] * np.exp(frequency_std * noise[0]),
        damping=found.zeta[:MODES] * np.exp(damping_std * noise[1]),
        node=tuple(n for n, _ in CHANNELS),
        direction=tuple(d for _, d in CHANNELS),
        shape=shape + 0.01 * rng.standard_normal(shape.shape),
        frequency_std_hz=frequency_std * found.hz[:MODES],
        damping_std=damping_std * found.zeta[:MODES],
        shape_std=np.full(shape.shape, 0.01),
    )
    return Survey(name="springs", measured=measured, environment=ground())

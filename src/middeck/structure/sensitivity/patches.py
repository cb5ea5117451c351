"""Parts of a structure that a parameter affects, perturbed and assembled side by side.

A parameter with the imaginary part h = 1e-30 makes every analytic number of the model carry h times its
derivative in its own imaginary part, exact to rounding: nothing is subtracted (Lyness and Moler 1967, SIAM J.
Numer. Anal. 4; Martins, Sturdza and Alonso 2003, ACM TOMS 29). A parameter touches little: of its perturbed
structure a *patch* has only the members, nodes and joints that it touches, and all springs and devices, whose
tuning anything may change.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.mesh import Model, lay_out
from middeck.structure.elements.frames import Configuration, move
from middeck.structure.model.article import Body, Node, Structure
from middeck.structure.model.environment import Environment
from middeck.structure.sensitivity.models_side_by_side import (
    Raft,
    merge_configurations,
    merge_loads,
    merge_models,
)
from middeck.structure.sensitivity.parameters import ModelParameter, set_parameter
from middeck.values import record

# Its square is nothing beside one, it is far from underflow, and what it multiplies comes back exactly.
STEP = 1e-30
# Poses assembled together: enough to share the overhead, few enough for the memory.
RAFT = 20_000
NOTHING = Body(0.0, np.zeros(3), np.zeros((3, 3)))


@record(kw_only=True)
class Patch:
    """A perturbed structure, the model of its patch, and the parts of the whole in it.

    Nodes that it does not touch are there without their bodies, to carry what is tied or joined to them.
    """

    structure: Structure
    environment: Environment
    model: Model
    roots: np.ndarray
    joints: np.ndarray
    coordinates: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class _Whole:
    """Data of the unperturbed structure for every patch."""

    model: Model
    frame: dict[str, int]
    carrier: dict[str, str]  # node that carries each frame
    node: tuple[str, ...]  # that carries each joint
    used: frozenset[str]  # attach points that anything is tied to
    ties: frozenset[str]  # their nodes
    jointed: frozenset[str]  # those nodes of which a joint is tied
    bare: dict[str, Node]


def make_patches(
    model: Model, environment: Environment, parameters: Sequence[ModelParameter]
) -> tuple[Patch, ...]:
    """The patch of every parameter of ``model`` in ``environment``; links and components are in `ties`."""
    whole = _survey(model, environment)
    return tuple(
        _patch(whole, *set_parameter(model.structure, environment, p, p.value + STEP * 1j))
        for p in parameters
    )


def _survey(model: Model, environment: Environment) -> _Whole:
    structure = model.structure
    carrier = {n.name: n.name for n in structure.nodes}
    for joint in structure.joints:
        carrier[joint.name] = carrier[joint.parent]
    tied = [*environment.hung, *environment.springs, *environment.bushings]
    own = [*structure.springs, *structure.bushings]
    used = frozenset([*(t.attach for t in tied), *(e for s in own for e in (s.start, s.end))])
    frames = {a.frame for a in structure.attach_points if a.name in used} | {p.frame for p in structure.loads}
    return _Whole(
        model=model,
        frame={name: i for i, name in enumerate(model.frames[: model.tree.roots])},
        carrier=carrier,
        node=tuple(carrier[j.name] for j in structure.joints),
        used=used,
        ties=frozenset(carrier[f] for f in frames),
        jointed=frozenset(carrier[f] for f in frames if carrier[f] != f),
        bare={},
    )


def _patch(whole: _Whole, structure: Structure, environment: Environment) -> Patch:
    old, heavy = whole.model.structure, np.iscomplexobj(environment.gravity)
    changed = [n for n, o in zip(structure.nodes, old.nodes, strict=True) if heavy or n is not o]
    moved = {n.name for n in changed if np.iscomplexobj(n.position) or np.iscomplexobj(n.size)}
    members = [
        m
        for m, o in zip(structure.members, old.members, strict=True)
        if heavy or m is not o or m.start in moved or m.end in moved
    ]
    turned = [
        c for j, o, c in zip(structure.joints, old.joints, whole.node, strict=True) if heavy or j is not o
    ]
    bolted = [m.frame for m, o in zip(structure.masses, old.masses, strict=True) if heavy or m is not o]
    trees = {n.name for n in changed} | set(turned) | whole.jointed | {whole.carrier[f] for f in bolted}
    kept = trees | whole.ties | {end for m in members for end in (m.start, m.end)}
    joints = np.array([i for i, c in enumerate(whole.node) if c in trees], dtype=int)
    part = lay_out(
        dataclasses.replace(
            structure,
            nodes=tuple(n if n.name in trees else _bare(whole, n) for n in structure.nodes if n.name in kept),
            members=tuple(members),
            joints=tuple(structure.joints[j] for j in joints),
            attach_points=tuple(a for a in structure.attach_points if a.name in whole.used),
            actuators=(),
            sensors=(),
            masses=tuple(m for m in structure.masses if whole.carrier[m.frame] in trees),
            links=(),
            components=(),
        )
    )
    roots = np.array([whole.frame[name] for name in part.frames[: part.tree.roots]], dtype=int)
    coordinates = np.concatenate(
        [(6 * roots[:, None] + np.arange(6)).ravel(), 6 * whole.model.tree.roots + joints]
    )
    return Patch(
        structure=structure,
        environment=environment,
        model=part,
        roots=roots,
        joints=joints,
        coordinates=coordinates,
    )


def _bare(whole: _Whole, node: Node) -> Node:
    if node.name not in whole.bare:
        whole.bare[node.name] = dataclasses.replace(node, body=NOTHING)
    return whole.bare[node.name]


def derivative(value: np.ndarray) -> np.ndarray:
    """The derivative that a perturbed value carries."""
    return np.imag(value) / STEP


def columns(arrays: Sequence[np.ndarray], size: int) -> np.ndarray:
    """The arrays as columns; (``size``, 0) for none."""
    return np.array(arrays).reshape(len(arrays), size).T


def drawn_motion(model: Model, patch: Patch) -> np.ndarray:
    """Derivative of the undeformed configuration, as coordinates of the whole."""
    out, shift = np.zeros(model.tree.size), derivative(patch.model.rest.x)
    step = np.hstack([shift, np.zeros_like(shift)])
    out[patch.coordinates] = np.concatenate([step.ravel(), derivative(patch.model.rest.angle)])
    return out


def restrict(patch: Patch, config: Configuration) -> Configuration:
    """The whole's configuration at the frames of a patch, complex so that all derived from it is complex."""
    return Configuration(
        config.x[patch.roots].astype(complex), config.R[patch.roots], config.angle[patch.joints]
    )


def follow(patch: Patch, config: Configuration, motion: np.ndarray) -> Configuration:
    """The same, perturbed along ``motion``, coordinates of the whole."""
    part = restrict(patch, config)
    return move(patch.model.tree, part, STEP * 1j * motion[patch.coordinates]) if np.any(motion) else part


class Afloat(NamedTuple):
    """Some patches, by number, on one raft."""

    which: list[int]
    raft: Raft
    config: Configuration
    loads: Loads


def float_patches(
    patches: Sequence[Patch], configs: Sequence[Configuration], loads: Sequence[Loads]
) -> tuple[Afloat, ...]:
    """Every patch at its own configuration, on as few rafts as it takes."""
    out: list[Afloat] = []
    for which in _share(patches, loads):
        raft = merge_models([patches[p].model for p in which])
        config = merge_configurations([configs[p] for p in which])
        out.append(Afloat(which, raft, config, merge_loads(raft, [loads[p] for p in which])))
    return tuple(out)


def spread_gradients(
    model: Model, patches: Sequence[Patch], gradients: Sequence[tuple[Afloat, np.ndarray]]
) -> Float[np.ndarray, "coordinate patch"]:
    """Derivatives that energy gradients on rafts carry, each in the coordinates of the whole."""
    out = np.zeros((model.tree.size, len(patches)))
    for at, gradient in gradients:
        for p, own in zip(at.which, at.raft.coordinates, strict=True):
            out[patches[p].coordinates, p] = derivative(gradient[own])
    return out


def _share(patches: Sequence[Patch], loads: Sequence[Loads]) -> Iterator[list[int]]:
    """Indices of patches under one gravity, at most as many as one raft holds."""
    by_gravity: dict[bytes, list[int]] = {}
    for p, load in enumerate(loads):
        by_gravity.setdefault(load.gravity.astype(complex).tobytes(), []).append(p)
    for group in by_gravity.values():
        some: list[int] = []
        poses = 0
        for p in group:
            size = len(patches[p].model.points.frame)
            if some and poses + size > RAFT:
                yield some
                some, poses = [], 0
            some.append(p)
            poses += size
        yield some

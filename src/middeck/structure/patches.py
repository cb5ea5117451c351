"""What parameters touch of a structure: perturbed parts of it, assembled side by side.

A parameter with the imaginary part h = 1e-30 makes every analytic number of the model carry h times its
derivative in its own imaginary part, exact to rounding: nothing is subtracted (Lyness and Moler 1967, SIAM J.
Numer. Anal. 4; Martins, Sturdza and Alonso 2003, ACM TOMS 29). A parameter touches few members: of its
perturbed structure a *patch* has only these, and all that is no member.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from middeck.structure.article import Member, Structure
from middeck.structure.assembly import Assembly, Loads, assemble
from middeck.structure.environment import Environment
from middeck.structure.frames import Configuration, move
from middeck.structure.mesh import Model, lay_out
from middeck.structure.parameters import Parameter, set_parameter
from middeck.structure.raft import Raft, merge_configurations, merge_loads, merge_models

# Its square is nothing beside one, it is far from underflow, and what it multiplies comes back exactly.
STEP = 1e-30
# Poses assembled together: enough to share the overhead, few enough for the memory.
RAFT = 20_000


class Patch(NamedTuple):
    """A perturbed structure, the model of its patch, and where that one's parts are in the whole."""

    structure: Structure
    environment: Environment
    model: Model
    roots: np.ndarray
    coordinates: np.ndarray
    members: np.ndarray


def make_patches(
    model: Model, environment: Environment, parameters: Sequence[Parameter]
) -> tuple[Patch, ...]:
    """The patch of every parameter of ``model`` in ``environment``."""
    frame = {name: i for i, name in enumerate(model.frames[: model.tree.roots])}
    number = {m.name: i for i, m in enumerate(model.structure.members)}
    joints = 6 * model.tree.roots + np.arange(len(model.tree.parent))
    patches: list[Patch] = []
    for parameter in parameters:
        whole, place = set_parameter(model.structure, environment, parameter, parameter.value + STEP * 1j)
        touched = tuple(_touched(whole, place))
        part = lay_out(dataclasses.replace(whole, members=touched))
        roots = np.array([frame[name] for name in part.frames[: part.tree.roots]], dtype=int)
        coordinates = np.concatenate([(6 * roots[:, None] + np.arange(6)).ravel(), joints])
        members = np.array([number[m.name] for m in touched], dtype=int)
        patches.append(Patch(whole, place, part, roots, coordinates, members))
    return tuple(patches)


def _touched(whole: Structure, environment: Environment) -> Iterator[Member]:
    heavy = np.iscomplexobj(environment.gravity)
    moved = {n.name for n in whole.nodes if np.iscomplexobj(n.position) or np.iscomplexobj(n.size)}
    fields = [f.name for f in dataclasses.fields(whole.members[0].section)] if whole.members else []
    for member in whole.members:
        own = np.iscomplexobj(member.up) or any(np.iscomplexobj(getattr(member.section, f)) for f in fields)
        if heavy or own or member.start in moved or member.end in moved:
            yield member


def derivative(value: np.ndarray) -> np.ndarray:
    """The derivative that a perturbed value carries."""
    return np.imag(value) / STEP


def columns(arrays: Sequence[np.ndarray], size: int) -> np.ndarray:
    """Side by side, none of them too."""
    return np.array(arrays).reshape(len(arrays), size).T


def drawn_motion(model: Model, patch: Patch) -> np.ndarray:
    """Derivative of the undeformed configuration, as coordinates of the whole."""
    out = np.zeros(model.tree.size)
    step = np.zeros((len(patch.roots), 6))
    step[:, :3] = derivative(patch.model.rest.x)
    out[patch.coordinates] = np.concatenate([step.ravel(), derivative(patch.model.rest.angle)])
    return out


def restrict(patch: Patch, config: Configuration) -> Configuration:
    """The whole's configuration at the frames of a patch, complex so that all that follows from it is."""
    return Configuration(config.x[patch.roots].astype(complex), config.R[patch.roots], config.angle)


def perturb_whole(model: Model, patch: Patch) -> Patch:
    """The same perturbed structure with all of its members."""
    everything = np.arange(len(patch.structure.members))
    part = lay_out(patch.structure)
    return Patch(
        patch.structure,
        patch.environment,
        part,
        np.arange(model.tree.roots),
        np.arange(model.tree.size),
        everything,
    )


def follow(patch: Patch, config: Configuration, motion: np.ndarray) -> Configuration:
    """The same, perturbed along ``motion``, coordinates of the whole."""
    part = restrict(patch, config)
    return move(patch.model.tree, part, STEP * 1j * motion[patch.coordinates]) if np.any(motion) else part


class Afloat(NamedTuple):
    """Some patches, by number, on one raft: where they are on it, and the potential there."""

    which: list[int]
    raft: Raft
    config: Configuration
    loads: Loads
    potential: Assembly
    devices: list[slice]


def assemble_patches(
    patches: Sequence[Patch],
    configs: Sequence[Configuration],
    loads: Sequence[Loads],
    point_loads: Sequence[np.ndarray] | None = None,
) -> Iterator[Afloat]:
    """The potential of every patch at its own configuration, a raft at a time."""
    for which in _share(patches, loads):
        raft = merge_models([patches[p].model for p in which])
        config = merge_configurations([configs[p] for p in which])
        load = merge_loads(raft, [loads[p] for p in which])
        extra = None if point_loads is None else np.concatenate([point_loads[p] for p in which])
        ends = np.cumsum([0, *(len(loads[p].attach_point) for p in which)])
        devices = [slice(a, b) for a, b in itertools.pairwise(ends)]
        yield Afloat(which, raft, config, load, assemble(raft.model, config, load, extra), devices)


def explicit_gradients(
    model: Model,
    config: Configuration,
    patches: Sequence[Patch],
    loads: Sequence[Loads],
    point_loads: Sequence[np.ndarray] | None = None,
) -> Float[np.ndarray, "coordinate patch"]:
    """Derivative of the energy gradient in each parameter with all frames where they are."""
    out = np.zeros((model.tree.size, len(patches)))
    still = [restrict(patch, config) for patch in patches]
    for at in assemble_patches(patches, still, loads, point_loads):
        for p, own in zip(at.which, at.raft.coordinates, strict=True):
            out[patches[p].coordinates, p] = derivative(at.potential.gradient[own])
    return out


def _share(patches: Sequence[Patch], loads: Sequence[Loads]) -> Iterator[list[int]]:
    """Numbers of patches under one gravity, as many as one raft holds."""
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

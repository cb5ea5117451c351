"""Several models side by side as one, so that one assembly serves them all."""

import dataclasses
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from middeck.structure.assembly.environment_loads import Ground, Loads
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.beam import BeamProperties
from middeck.structure.elements.frames import Configuration, FrameTree, PosePoints
from middeck.structure.elements.springs_and_cables import SpringLaw

_joined = np.concatenate
# Fields of a `Model` that are arrays by element or body, and those that number its poses.
ARRAYS = ("element_triad", "body_mass", "body_inertia")
POSES = ("element_ends", "body_point", "attach_point", "spring_ends", "bushing_ends", "load_point")


class Raft(NamedTuple):
    """The merged model, and of each of its models the coordinates and the first pose in it."""

    model: Model
    coordinates: tuple[np.ndarray, ...]
    first_pose: tuple[int, ...]


def merge_models(models: Sequence[Model]) -> Raft:
    """The merged model: all roots come first, then all joints, each in the order of ``models``."""
    roots = np.cumsum([0, *(m.tree.roots for m in models)])
    joints = np.cumsum([0, *(len(m.tree.parent) for m in models)])
    poses = np.cumsum([0, *(len(m.points.frame) for m in models)])
    members = np.cumsum([0, *(len(m.structure.members) for m in models)])

    def places(size: int) -> tuple[np.ndarray, ...]:
        """Places of each model's roots, so many numbers each, and of its joints."""
        spans = zip(pairwise(size * roots), pairwise(size * roots[-1] + joints), strict=True)
        return tuple(np.concatenate([np.arange(*own), np.arange(*turned)]) for own, turned in spans)

    frame = places(1)
    structure = dataclasses.replace(
        models[0].structure,
        **{k: _chained(models, k) for k in ("joints", "springs", "bushings", "loads")},
    )
    arrays: dict[str, Any] = {k: _joined([getattr(m, k) for m in models]) for k in ARRAYS}
    arrays |= {k: _shifted([getattr(m, k) for m in models], poses) for k in POSES}
    merged = Model(
        structure=structure,
        frames=tuple(f for m in models for f in m.frames[: m.tree.roots])
        + tuple(f for m in models for f in m.frames[m.tree.roots :]),
        tree=FrameTree(
            roots=int(roots[-1]),
            parent=_joined([f[m.tree.parent] for f, m in zip(frame, models, strict=True)]),
            offset=_joined([m.tree.offset for m in models]),
            axis=_joined([m.tree.axis for m in models]),
            slides=_joined([m.tree.slides for m in models]),
        ),
        rest=merge_configurations([m.rest for m in models]),
        points=PosePoints(
            _joined([f[m.points.frame] for f, m in zip(frame, models, strict=True)]),
            _joined([m.points.offset for m in models]),
        ),
        element_member=_shifted([m.element_member for m in models], members),
        beams=BeamProperties(
            **{k: _joined([getattr(m.beams, k) for m in models]) for k in BeamProperties.__dataclass_fields__}
        ),
        attach_names=tuple(a for m in models for a in m.attach_names),
        **arrays,
    )
    return Raft(merged, places(6), tuple(int(p) for p in poses[:-1]))


def _chained(models: Sequence[Model], parts: str) -> tuple[Any, ...]:
    return tuple(part for m in models for part in getattr(m.structure, parts))


def merge_configurations(configs: Sequence[Configuration]) -> Configuration:
    """One configuration of all, in the order of `merge_models`."""
    return Configuration(
        _joined([c.x for c in configs]), _joined([c.R for c in configs]), _joined([c.angle for c in configs])
    )


def merge_loads(raft: Raft, loads: Sequence[Loads]) -> Loads:
    """The loads of each model on the raft; gravity must be the same in all."""
    law = (_joined([getattr(x.law, f) for x in loads]) for f in ("preload", "stiffness", "length"))
    return Loads(
        gravity=loads[0].gravity,
        anchor=_joined([x.anchor for x in loads]),
        attach_point=_joined([x.attach_point + p for x, p in zip(loads, raft.first_pose, strict=True)]),
        law=SpringLaw(*law),
        mass=_joined([x.mass for x in loads]),
        push=_joined([x.push for x in loads]),
        ground=Ground(
            point=_joined([x.ground.point + p for x, p in zip(loads, raft.first_pose, strict=True)]),
            stiffness=_joined([x.ground.stiffness for x in loads]),
            axes=_joined([x.ground.axes for x in loads]),
        ),
    )


def _shifted(arrays: Sequence[np.ndarray], starts: np.ndarray) -> np.ndarray:
    return np.concatenate([a + s for a, s in zip(arrays, starts, strict=False)])

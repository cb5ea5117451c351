"""Small structures for the structural tests, built directly from the records."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np

from middeck.structure.assembly.energy import assemble
from middeck.structure.assembly.environment_loads import Loads, no_loads
from middeck.structure.assembly.mass import mass_matrix
from middeck.structure.assembly.mesh import Model
from middeck.structure.elements.frames import Configuration, move
from middeck.structure.model.article import (
    Actuator,
    AttachPoint,
    Body,
    Damping,
    Joint,
    JointState,
    Member,
    Node,
    Section,
    Sensor,
    Spring,
    Structure,
)
from middeck.structure.model.environment import AnchoredSpring, Environment, Suspension

GRAVITY = np.array([0.0, -9.80665, 0.0])
NONE = Body(0.0, np.zeros(3), np.zeros((3, 3)))
# EI 100, GJ 80, EA 1e6, 0.5 kg/m: the tube of the suspended bus; no rotary inertia, so that Euler-Bernoulli
# closed forms hold exactly; the polar inertia is split over both.
TUBE = Section(EA=1e6, GJ=80.0, EI_y=100.0, EI_z=100.0, rho_A=0.5, rho_I_y=0.0, rho_I_z=0.0)
TURNING_TUBE = dataclasses.replace(TUBE, rho_I_y=1e-4, rho_I_z=1e-4)


def body(
    mass: float, cg: Sequence[float] = (0.0, 0.0, 0.0), inertia: Sequence[float] = (0.0, 0.0, 0.0)
) -> Body:
    return Body(mass, np.array(cg), np.diag(inertia))


def spin(mass: float, inertia: Sequence[float]) -> Body:
    """What no body is but a model may use: inertia about some axes alone."""
    return Body(mass, np.zeros(3), np.diag(inertia), rotors_excluded=True)


def node(name: str, position: Sequence[float], body: Body = NONE, size: float = 0.0) -> Node:
    return Node(name, np.array(position, dtype=float), size, body)


def structure(
    nodes: Sequence[Node],
    members: Sequence[Member] = (),
    joints: Sequence[Joint] = (),
    springs: Sequence[Spring] = (),
    attach: Sequence[AttachPoint] = (),
    actuators: Sequence[Actuator] = (),
    sensors: Sequence[Sensor] = (),
) -> Structure:
    return Structure(
        title="test",
        nodes=tuple(nodes),
        members=tuple(members),
        joints=tuple(joints),
        springs=tuple(springs),
        attach_points=tuple(attach),
        actuators=tuple(actuators),
        sensors=tuple(sensors),
        damping=Damping(flexible=0.01, suspension=0.03),
    )


def member(
    start: str, end: str, section: Section, elements: int, up: Sequence[float] = (0.0, 1.0, 0.0)
) -> Member:
    return Member(
        name=f"{start}-{end}",
        start=start,
        end=end,
        section=section,
        elements=elements,
        up=np.array(up, dtype=float),
    )


def joint(
    name: str,
    parent: str,
    axis: Sequence[float],
    body: Body = NONE,
    *,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    angle: float = 0.0,
    **more,
) -> Joint:
    """A free axis; sprung where a stiffness is given."""
    at, about = np.array(offset, dtype=float), np.array(axis, dtype=float)
    if "stiffness" in more:
        more = {"state": JointState.SPRUNG} | more
    return Joint(name=name, parent=parent, offset=at, axis=about, angle=angle, body=body, **more)


def tube_bus(
    masses: Sequence[float],
    cg: Sequence[float],
    inertia: Sequence[float],
    payload: Body,
    *,
    above: Sequence[float] = (0.0, 0.02, 0.0),
    elements: int = 3,
    springs: Sequence[Spring] = (),
    actuators: Sequence[Actuator] = (),
    sensors: Sequence[Sensor] = (),
    **more,
) -> Structure:
    """Bodies a metre apart on a tube along x, attach points ``above`` them, a payload on an axis along x."""
    names = "abc"[: len(masses)]
    nodes = [node(n, (i, 0, 0), body(masses[i], cg, inertia), 0.05) for i, n in enumerate(names)]
    below = {"name": "p", "parent": "a", "axis": (1, 0, 0), "offset": (0, -0.05, 0)}
    members = [member(*ends, TURNING_TUBE, elements) for ends in itertools.pairwise(names)]
    attach = [AttachPoint(n, n, np.array(above)) for n in names]
    joints = [joint(**below | more, body=payload)]
    return structure(nodes, members, joints, springs, attach, actuators, sensors)


def on_cables(
    cable_length: float,
    bounce_hz: float,
    held: Sequence[str] = ("yz", "xyz", "yz"),
    *,
    attach: Sequence[str] = "abc",
    gravity: np.ndarray = GRAVITY,
) -> Environment:
    """A laboratory that hangs the points of a bus, as many as ``held`` has."""
    points = tuple(attach[: len(held)])
    hung = Suspension(attach=points, held=tuple(held), cable_length=cable_length, bounce_hz=bounce_hz)
    return Environment(title="lab", gravity=gravity, suspension=hung)


def straight_beam(section: Section, length: float, elements: int, offset: float = 0.0) -> Structure:
    """A bare beam along x between massless nodes; ``offset`` puts the nodes' half sizes outside it."""
    nodes = [node("a", (-offset, 0, 0), size=2 * offset), node("b", (length + offset, 0, 0), size=2 * offset)]
    return structure(nodes, [member("a", "b", section, elements)])


def rigid_bar(mass: float, length: float, inertia: Sequence[float], attach_y: float = 0.0) -> Structure:
    """One rigid node at the bar's middle with attach points at both ends."""
    ends = [(-0.5 * length, attach_y, 0.0), (0.5 * length, attach_y, 0.0)]
    points = [AttachPoint(n, "bar", np.array(p)) for n, p in zip(("left", "right"), ends, strict=True)]
    return structure([node("bar", (0, 0, 0), body(mass, inertia=inertia))], attach=points)


def springs_above(
    points: dict[str, Sequence[float]], height: float, stiffness: float, free_length: float
) -> tuple[AnchoredSpring, ...]:
    """Equal vertical springs to anchors ``height`` above the given points."""
    rise = np.array([0.0, height, 0.0])
    return tuple(
        AnchoredSpring(
            name=f"spring {n}",
            attach=n,
            anchor=np.array(p) + rise,
            stiffness=stiffness,
            free_length=free_length,
        )
        for n, p in points.items()
    )


def lab(*springs: AnchoredSpring, gravity: np.ndarray = GRAVITY) -> Environment:
    return Environment(title="springs", gravity=gravity, suspension=None, springs=tuple(springs))


def clamped_matrices(
    model: Model,
    config: Configuration | None = None,
    fixed: Sequence[int] = range(6),
    load: np.ndarray | None = None,
    loads: Loads | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dense K, M and the kept coordinates with ``fixed`` coordinates held."""
    config = model.rest if config is None else config
    K = assemble(model, config, no_loads() if loads is None else loads, load).tangent.toarray()
    M = mass_matrix(model, config).toarray()
    keep = np.setdiff1d(np.arange(len(K)), list(fixed))
    return K[np.ix_(keep, keep)], M[np.ix_(keep, keep)], keep


def newton(
    model: Model,
    load: np.ndarray,
    fixed: Sequence[int] = range(6),
    steps: int = 1,
    loads: Loads | None = None,
    iterations: int = 60,
) -> Configuration:
    """Plain Newton iteration with ``fixed`` coordinates held under dead pose loads (energy gradients)."""
    config = model.rest
    keep = np.setdiff1d(np.arange(model.tree.size), list(fixed))
    loads = no_loads() if loads is None else loads
    for factor in np.linspace(1.0 / steps, 1.0, steps):
        for _ in range(iterations):
            at = assemble(model, config, loads, factor * load)
            q = np.zeros(model.tree.size)
            K = at.tangent[keep][:, keep].toarray()
            q[keep] = -np.linalg.solve(K, at.gradient[keep])
            # Shorten steps that turn or shift by more than the chart follows well.
            q *= min(1.0, 0.5 / max(np.abs(q[3::1]).max(), 1e-300)) if np.abs(q).max() > 0.5 else 1.0
            config = move(model.tree, config, q)
            if np.abs(q).max() < 1e-12:
                break
        else:
            raise AssertionError("the test's Newton iteration did not converge")
    return config


def random_configuration(model: Model, rng: np.random.Generator, size: float) -> Configuration:
    """The rest configuration disturbed at random in every coordinate, to finite size."""
    return move(model.tree, model.rest, size * rng.standard_normal(model.tree.size))

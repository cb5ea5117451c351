"""The rest state of a structure in an environment (the paper's steps 1 and 2)."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Inexact

from middeck.arguments import named_kinds
from middeck.errors import EquilibriumError
from middeck.structure.assembly.component_states import PlacedComponent, place_components
from middeck.structure.assembly.energy import assemble_carried
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.linked import check_links, link_warnings, links_at, static_freedom
from middeck.structure.assembly.mesh import Model, mesh_structure
from middeck.structure.assembly.places import poses_at
from middeck.structure.assembly.springs import bushing_states
from middeck.structure.assembly.wheel_forces import check_speeds
from middeck.structure.elements.frames import Configuration, frame_poses, rigid_columns
from middeck.structure.elements.motion_since_drawn import whole_motion
from middeck.structure.elements.rotations import rotation_log
from middeck.structure.elements.trees import Poses
from middeck.structure.model.article import Bushing, JointState, LoadCase, Structure
from middeck.structure.model.clamps import free_translations
from middeck.structure.model.environment import Environment
from middeck.structure.model.environment_checks import check_environment
from middeck.structure.model.load_case import apply_load_case
from middeck.structure.rest.imbalance import article_size, imbalance_scale, imbalance_weight
from middeck.structure.rest.motion_as_a_whole import face_as_drawn
from middeck.structure.rest.rest_criteria import TOLERANCE
from middeck.structure.rest.settle import settle
from middeck.structure.rest.slack_cables import refuse_slack_cables
from middeck.structure.rest.suspension_tuning import TunedSuspension, environment_loads, tune_suspension
from middeck.values import record, require_kind

FAR_TURN = np.radians(30.0)  # three times what an unlevelled article rolls
UNLIKE = 1e-6  # of a bushing's stiffness: what it gains by other axes is felt
# Turn [rad] of a node of which one turn alone is held: its square is what the order of the two others makes.
ONE_HELD = 1e-3
# Largest turn of a bushing: its law ends at pi, and beyond a right angle a fall may have passed that.
MOST_TURN, HALF_ROUND = np.radians(179.5), 0.5 * np.pi
LEVEL = 1e-9  # part of gravity along a roller's way that is none


class Reaction(NamedTuple):
    """Force [N] and moment [N m] in W of a support on the article, the moment about where ``at`` now is."""

    at: str
    force: np.ndarray
    moment: np.ndarray


@record(kw_only=True)
class Equilibrium:
    """A rest state, converged or not.

    Attributes:
        config: Positions, rotations and angles at rest.
        residual: Largest unbalanced force over the weight, or moment over the weight times half the article's
            size (a metre at most); see `imbalance_scale`.
        history: (load factor, residual, damping) of every iteration.
        holding_torque: Torque [N m], of a slide force [N], that each joint's motor, spring or lock holds,
            positive on the carried body.
        tension: Pull [N] of each of ``devices``.
        reactions: Reaction of every clamped node, then of every bushing to the ground.
        enough: Residual that counts as rest: more than `TOLERANCE` where rounding of a stiff support leaves
            more, and Newton's own step shows that nothing is out of place by it.
        stable: Whether nothing grows there with the free joints held: false of a column that stands upright
            beyond its critical load, which the least push would bend, and of any state that did not converge.
            See `rest_warnings`.
        followed: Whether it was followed from the drawn state as all that acts grew; else the article fell.
    """

    model: Model
    environment: Environment
    config: Configuration
    loads: Loads
    suspension: TunedSuspension
    residual: float
    history: tuple[tuple[float, float, float], ...]
    holding_torque: Inexact[np.ndarray, " joint"]
    tension: Inexact[np.ndarray, " device"]
    reactions: tuple[Reaction, ...] = ()
    enough: float = TOLERANCE
    stable: bool = True
    followed: bool = True

    @functools.cached_property
    def poses(self) -> Poses:
        """Poses of the frames at rest."""
        return frame_poses(self.model.tree, self.config)

    @functools.cached_property
    def components(self) -> list[PlacedComponent]:
        """The reduced components at rest."""
        return place_components(self.model, poses_at(self.model, self.config), self.loads)

    def moves(self, shapes: Inexact[np.ndarray, "coordinate mode"]) -> Inexact[np.ndarray, "pose 6 mode"]:
        """Shift and turn of every point of the model per unit of each mode; analytic."""
        model = self.model
        changes = model.pose_map.jacobian(self.poses) @ shapes
        return changes.reshape(len(model.points.frame), 6, shapes.shape[1])

    @property
    def devices(self) -> tuple[str, ...]:
        """Names in the order of the loads: the suspension's, the environment's devices, then its springs."""
        return (*self.suspension.name, *(spring.name for spring in self.environment.springs))

    @property
    def upwards(self) -> Float[np.ndarray, "3"] | None:
        """Unit vector in W that is upwards: against gravity or its direction, else by the article."""
        up = self.environment.upwards
        return self.model.structure.up if up is None else up

    @property
    def converged(self) -> bool:
        """Whether the residual is at rounding level; `solve_modes` refuses otherwise."""
        return self.residual < self.enough


@named_kinds
def solve_equilibrium(
    structure: Structure, environment: Environment, load_case: LoadCase | str | None = None
) -> Equilibrium:
    """Rest state under gravity and suspension; `Environment.orbit()` is the undeformed structure.

    With ``load_case`` under its loads too, with its masses and with its displacements prescribed: see
    `apply_load_case`.

    Raises `EquilibriumError` for gravity or loads without any support, a slack cable, a mechanism, or a
    sprung joint that comes to rest beyond its travel; a state that did not converge is returned with its
    residual history and ``converged`` false.
    """
    require_kind(structure, Structure, "article", "the article first; load_structure(path) reads one")
    hint = "the environment second; Environment.orbit(), or load_environment(path)"
    require_kind(environment, Environment, "environment", hint)
    structure, environment = apply_load_case(structure, environment, load_case)
    model = mesh_structure(structure, environment.clamps)
    check_environment(environment, model.structure)
    check_links(model)
    check_speeds(model, environment)
    idle = [device.name for device in environment.hung if device.needs_gravity]
    if idle and not np.any(environment.gravity):
        raise EquilibriumError(
            f"device {idle[0]!r}, tuned to its load, needs gravity: its reaction would be zero",
            where=f"environment {environment.title!r}",
            hint="set constants.gravity; or give the device a force, a stiffness and an anchor",
        )
    tuned = tune_suspension(model, environment)
    loads = environment_loads(model, environment, tuned)
    _check_driven(model, environment, loads)
    settled = face_as_drawn(model, loads, settle(model, loads))
    refuse_slack_cables(tuned.name, settled.assembly.tension)
    _check_turns(model, environment, settled.config, loads)
    if settled.residual < settled.enough:
        _check_travel(model.structure, settled.config.angle)
    # At rest dE/d(angle) is the moment that the motor has to balance.
    holding = settled.assembly.gradient[6 * model.tree.roots :] + _spring_torque(model, settled.config)
    return Equilibrium(
        model=model,
        environment=environment,
        config=settled.config,
        loads=loads,
        suspension=tuned,
        residual=settled.residual,
        history=settled.history,
        holding_torque=holding,
        tension=settled.assembly.tension,
        reactions=_reactions(model, environment, settled.config, loads, settled.assembly.gradient),
        enough=settled.enough,
        stable=settled.stable,
        followed=settled.followed,
    )


def _reactions(
    model: Model, environment: Environment, config: Configuration, loads: Loads, gradient: np.ndarray
) -> tuple[Reaction, ...]:
    """Reactions of clamps (dE/dq of the coordinates that they hold), then of bushings to the ground."""
    taken = static_freedom(model, config).beyond(gradient)
    nodes = [node.name for node in model.structure.nodes]
    clamped = dict.fromkeys(clamp.node for clamp in environment.clamps)
    found = [(name, taken[6 * nodes.index(name) :][:6]) for name in clamped]
    pulls = -bushing_states(model, config, loads)[1].gradient[:, 6:]
    found += [(b.name, pull) for b, pull in zip(environment.bushings, pulls, strict=True)]
    return tuple(Reaction(name, load[:3], load[3:]) for name, load in found)


def bushing_turns(
    model: Model, environment: Environment, config: Configuration, loads: Loads
) -> tuple[tuple[str, float], ...]:
    """Relative turn [rad] of the frames of each bushing, those of the environment last."""
    angle = np.concatenate([state.angle for state in bushing_states(model, config, loads)])
    names = [b.name for b in (*model.structure.bushings, *environment.bushings)]
    return tuple(zip(names, map(float, angle), strict=True))


def _check_turns(model: Model, environment: Environment, config: Configuration, loads: Loads) -> None:
    for name, turn in bushing_turns(model, environment, config, loads):
        if turn > MOST_TURN:
            raise EquilibriumError(
                f"its frames turn by {np.degrees(turn):.1f} deg against each other: at 180 deg the rotation "
                "vector has two directions, and its torque no sense",
                where=f"bushing {name!r}",
                hint="lower the load or stiffen the bushing; for whole turns take a [[revolute]] axis",
            )


def _spring_torque(model: Model, config: Configuration) -> np.ndarray:
    """Torque of sprung axes: part of the balanced gradient, but it is what holds them."""
    return np.array(
        [
            j.stiffness * (j.target - angle) if j.state is JointState.SPRUNG else 0.0
            for j, angle in zip(model.structure.joints, config.angle, strict=True)
        ]
    )


def _check_driven(model: Model, environment: Environment, loads: Loads) -> None:
    """Whether weight and loads drive a motion of the whole that nothing can ever stop."""
    if environment.hung or environment.springs or environment.bushings:
        return
    weight = model.structure.mass > 0.0 and bool(np.any(loads.gravity))
    falls = free_translations(environment.clamps)
    if not (weight or np.any(loads.push)) or not falls.size:  # what pulls then is rounding, or is held
        return
    T = rigid_columns(model.tree, model.rest, model.rest.x.mean(axis=0))
    drawn = dataclasses.replace(model.rest, since_drawn=None)
    pull = -T.T @ assemble_carried(model, drawn, loads).gradient
    if model.links is not None:  # an equation between directions of W may hold the whole as a support does
        size = np.repeat([1.0, article_size(model)], 3)
        free = sla.null_space((links_at(model, drawn).jacobian @ T) / size, rcond=LEVEL)
        pull = size * (free @ (free.T @ (pull / size)))
    along = falls @ (falls.T @ pull[:3])
    scale = LEVEL * imbalance_weight(model, loads)
    where = f"environment {environment.title!r}"
    hint = "add a [suspension] table, devices, springs, bushings or clamps to the environment, or use orbit"
    if np.linalg.norm(along) > scale:
        way = (np.round(along / np.linalg.norm(along), 3) + 0.0).tolist()
        size = float(np.linalg.norm(environment.gravity))
        what = f"gravity of {size:.4g} m/s^2" if size else "loads that do not balance"
        raise EquilibriumError(
            f"{what} and nothing to hang from: the article falls along {way}", where=where, hint=hint
        )
    if not environment.clamps and np.linalg.norm(pull[3:]) > scale * article_size(model):
        raise EquilibriumError(
            f"loads turn the free article by a moment of {np.linalg.norm(pull[3:]):.4g} N m",
            where=where,
            hint=hint,
        )


@record(kw_only=True)
class Imbalance:
    """Residual at rest: largest force over the weight, largest moment over weight times ``length``.

    ``weight`` [N] is that on the ground where there is none; ``length`` [m] is half the article's size, or a
    metre if that is less; ``frame`` is where the larger of the two is.
    """

    force: float
    moment: float
    weight: float
    length: float
    frame: str


def rest_imbalance(equilibrium: Equilibrium) -> Imbalance:
    """Residuals of forces and moments in ``equilibrium``; its ``residual`` is the larger of both."""
    model, loads = equilibrium.model, equilibrium.loads
    scale = imbalance_scale(model, loads)
    weight = imbalance_weight(model, loads)
    gradient = assemble_carried(model, equilibrium.config, loads).gradient
    left = np.abs(static_freedom(model, equilibrium.config).within(gradient)) / scale
    tree = model.tree
    return Imbalance(
        force=float(left[~tree.turns].max(initial=0.0)),
        moment=float(left[tree.turns].max(initial=0.0)),
        weight=weight,
        length=min(article_size(model), 1.0),
        frame=model.frames[tree.frame_of(int(np.argmax(left)) if len(left) else 0)],
    )


def node_rotations(equilibrium: Equilibrium) -> dict[str, Float[np.ndarray, "3"]]:
    """Rotation vector [rad] of every node from its undeformed attitude, in W."""
    nodes = equilibrium.model.structure.nodes
    return {node.name: rotation_log(equilibrium.poses.R[i]) for i, node in enumerate(nodes)}


def node_shifts(equilibrium: Equilibrium) -> dict[str, Float[np.ndarray, "3"]]:
    """Displacement of every node since drawn [m], in W."""
    since, rest = equilibrium.config.since_drawn, equilibrium.model.rest
    shift = equilibrium.config.x - rest.x if since is None else whole_motion(since)[0]
    return {node.name: shift[i] for i, node in enumerate(equilibrium.model.structure.nodes)}


def rest_warnings(equilibrium: Equilibrium) -> tuple[str, ...]:
    """Warnings: an unstable rest state; a node that turned by more than `FAR_TURN`, probably by mistake."""
    found = list(link_warnings(equilibrium.model, equilibrium.config))
    if equilibrium.converged and not equilibrium.stable:
        found.append("the rest state is not stable: the least push would buckle or topple the article")
    rotations = node_rotations(equilibrium)
    found += [
        f"node {clamp.node!r}, held about one axis alone, turned by "
        f"{np.linalg.norm(rotations[clamp.node]):.2g} rad: how it moves on depends on which of the two free "
        "turns comes first; hold two, or none"
        for clamp in equilibrium.environment.clamps
        if len(clamp.about) == 1 and np.linalg.norm(rotations[clamp.node]) > ONE_HELD
    ]
    turns = bushing_turns(equilibrium.model, equilibrium.environment, equilibrium.config, equilibrium.loads)
    found += [
        f"bushing {name!r} turned by {np.degrees(turn):.0f} deg as the article fell: had it passed 180 deg, "
        "its torque would be another one; look at the way that it took"
        for name, turn in turns
        if turn > HALF_ROUND and equilibrium.converged and not equilibrium.followed
    ]
    found += _turned_axes(equilibrium)
    turned = {name: float(np.linalg.norm(v)) for name, v in rotations.items()}
    name = max(turned, key=lambda n: turned[n])
    if turned[name] > FAR_TURN and not _is_held(equilibrium):
        degrees = np.degrees(turned[name])
        found.append(f"the article turned by {degrees:.0f} deg from its drawn attitude (node {name!r})")
    return tuple(found)


def _turned_axes(equilibrium: Equilibrium) -> list[str]:
    """A sentence on bushings whose first frame turned by more than `FAR_TURN`, and whose second did not."""
    model, poses = equilibrium.model, equilibrium.poses
    frames = model.points.frame[model.bushing_ends]
    turned = {i: poses.R[i] @ model.drawn.R[i].T for i in np.unique(frames)}
    turn = {i: float(np.linalg.norm(rotation_log(R))) for i, R in turned.items()}
    far = [
        k
        for k, (a, b) in enumerate(frames)
        if turn[a] > FAR_TURN >= turn[b] and _has_axes(model.structure.bushings[k], turned[b].T @ turned[a])
    ]
    if not far:
        return []
    k = max(far, key=lambda k: turn[frames[k, 0]])
    first, second = (model.frames[i] for i in frames[k])
    return [
        f"the axes of bushing {model.structure.bushings[k].name!r} turned by "
        f"{np.degrees(turn[frames[k, 0]]):.0f} deg with its first frame {first!r}, while its second, "
        f"{second!r}, stayed" + (f" (and {len(far) - 1} more)" if far[1:] else "") + ": the frame that its "
        "axes belong to, such as one that stands for the ground, must be its first"
    ]


def _has_axes(bushing: Bushing, turn: Float[np.ndarray, "3 3"]) -> bool:
    """Whether its law is another where its axes follow the other frame, from which the first has turned.

    Both see the same components of the rotation vector, so that shifts alone may decide.
    """
    by = sla.block_diag(bushing.axes.T @ turn @ bushing.axes, np.eye(3))
    K = np.real(bushing.stiffness)
    size = np.repeat(np.sqrt([np.trace(K[:3, :3]), np.trace(K[3:, 3:])]), 3)
    return bool(np.any(np.abs(by @ K @ by.T - K) > UNLIKE * np.outer(size, size)))


def _is_held(equilibrium: Equilibrium) -> bool:
    """Whether the article cannot turn but by bending: of members alone, clamped against turning somewhere."""
    structure = equilibrium.model.structure
    loose = (*structure.joints, *structure.links, *structure.springs, *structure.bushings)
    return not loose and any(len(clamp.about) == 3 for clamp in equilibrium.environment.clamps)


def _check_travel(structure: Structure, angle: Float[np.ndarray, " joint"]) -> None:
    """Raise `EquilibriumError` where a sprung joint would rest beyond its stops.

    Held joints are checked with the structure; a sprung one goes where its load puts it.
    """
    for joint, at in zip(structure.joints, angle, strict=True):
        low, high = joint.travel
        if not low <= at <= high:
            unit = "m" if joint.slides else "rad"
            raise EquilibriumError(
                f"joint {joint.name!r} would rest at {at:.4g} {unit}, beyond its travel {low:g} to {high:g}",
                where=f"joint {joint.name!r}",
                hint="a stiffer spring, or one that is unstressed on the other side (rest), centres it",
                angle=float(at),
            )

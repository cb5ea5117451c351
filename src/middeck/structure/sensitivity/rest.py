"""Derivatives of a rest state in the parameters of an article and its environment.

At rest the gradient g(q, p) of the potential vanishes, hence dq/dp = -K^-1 dg/dp (implicit function theorem),
with dg/dp from perturbed patches (`patches`). Devices that are tuned follow the reactions of the pinned
article, which are differentiated in the same way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from middeck.errors import NumericalError
from middeck.structure.assembly.energy import Assembly, assemble, energy_gradient
from middeck.structure.assembly.environment_loads import Loads
from middeck.structure.assembly.linked import static_coordinates, static_freedom
from middeck.structure.assembly.mesh import Model
from middeck.structure.assembly.springs import bushing_states, device_tension
from middeck.structure.assembly.strain import strain_pull
from middeck.structure.elements.frames import Configuration, move
from middeck.structure.model.article import JointState, Structure
from middeck.structure.modes.stiff_members import check_beside_devices
from middeck.structure.rest.equilibrium import Equilibrium
from middeck.structure.rest.suspension_tuning import TunedSuspension, environment_loads, tune_suspension
from middeck.structure.sensitivity.links_and_components import TieChange, Tied, TieModel
from middeck.structure.sensitivity.parameters import ModelParameter
from middeck.structure.sensitivity.patches import (
    STEP,
    Afloat,
    Patch,
    columns,
    derivative,
    drawn_motion,
    float_patches,
    follow,
    make_patches,
    restrict,
    spread_gradients,
)
from middeck.structure.sensitivity.reactions import differentiate_support
from middeck.structure.sensitivity.static_solver import StaticSolver
from middeck.structure.sensitivity.stiff_member_derivatives import soften_rest
from middeck.values import record

NO_LOAD = np.zeros(6)
# A state with the derivative by one cause in its imaginary parts.
Perturbed = tuple[Model, Configuration, Loads]


@record(kw_only=True)
class RestMotion:
    """Derivatives of a rest state, one column a cause.

    Attributes:
        motion: Motion of tree coordinates: dx [m] and rotation vector [rad] of every root in W, joint
            angles.
        drawn: Motion of the same coordinates as drawn; ``motion`` less this is the motion since.
        tension: As of `Equilibrium`.
        support: Force [N] and moment [N m] in W of every one of ``reactions``, the moment about where it is.
    """

    motion: Float[np.ndarray, "coordinate cause"]
    drawn: Float[np.ndarray, "coordinate cause"]
    tension: Float[np.ndarray, "device cause"]
    support: Float[np.ndarray, "reaction 6 cause"]


@record(kw_only=True)
class RestSensitivities(RestMotion):
    """Derivatives of a rest state, one column a parameter.

    Attributes:
        reaction, stiffness: Load [N] and stiffness [N/m] of every device that hangs the article, as of
            `TunedSuspension`.
        holding_torque: As of `Equilibrium`.
    """

    parameters: tuple[ModelParameter, ...]
    reaction: Float[np.ndarray, "hung parameter"]
    stiffness: Float[np.ndarray, "hung parameter"]
    holding_torque: Float[np.ndarray, "joint parameter"]


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedRest:
    """Patches under their own loads, ``still`` at the places of the frames, and the motion of these."""

    patches: tuple[Patch, ...]
    tuned: tuple[TunedSuspension, ...]
    loads: tuple[Loads, ...]
    motion: np.ndarray
    gradient: np.ndarray  # gradient of the energy in all coordinates, those held by joints too
    still: tuple[tuple[Afloat, Assembly], ...]
    ties: tuple[TieChange, ...]  # changes of links and components as the rest state moves
    drawn: np.ndarray  # how the frames move as drawn, a column each


def differentiate_rest(rest: Equilibrium, parameters: Sequence[ModelParameter]) -> RestSensitivities:
    """Derivatives of the rest state and of its supports, the tuning of its suspension included.

    With a member too stiff for matrices in W, they are those with the member softer, to 1e-5
    (`stiff_member_derivatives`). Raises `NumericalError` where a parameter drives an unrestrained motion.
    """
    softer = soften_rest(rest)
    found = _differentiated(softer.rest, softer.parameters(parameters))
    scale = softer.scales(parameters)
    names = [f.name for f in dataclasses.fields(found) if f.name not in ("parameters", "drawn")]
    scaled = {name: getattr(found, name) * scale for name in names}
    return dataclasses.replace(found, parameters=tuple(parameters), **scaled)


def _differentiated(rest: Equilibrium, parameters: Sequence[ModelParameter]) -> RestSensitivities:
    moved = move_rest(rest, parameters)
    roots = 6 * rest.model.tree.roots
    springs = [
        _spring_torque(p.structure, rest, moved.motion[roots:, i]) for i, p in enumerate(moved.patches)
    ]
    along = [
        (patch.model, follow(patch, rest.config, moved.motion[:, p]), loads)
        for p, (patch, loads) in enumerate(zip(moved.patches, moved.loads, strict=True))
    ]
    return RestSensitivities(
        parameters=tuple(parameters),
        motion=moved.motion,
        reaction=columns([derivative(t.reaction) for t in moved.tuned], len(rest.suspension.reaction)),
        stiffness=columns([derivative(t.stiffness) for t in moved.tuned], len(rest.suspension.stiffness)),
        holding_torque=moved.gradient[roots:] + columns(springs, len(rest.holding_torque)),
        tension=tension_slopes(rest, along),
        drawn=moved.drawn,
        support=support_slopes(rest, moved.gradient, along),
    )


def tension_slopes(rest: Equilibrium, along: Sequence[Perturbed]) -> Float[np.ndarray, "device cause"]:
    """Derivatives of the pull of each device, one a cause."""
    return columns([derivative(device_tension(*at)) for at in along], len(rest.tension))


def support_slopes(
    rest: Equilibrium, gradient: Float[np.ndarray, "coordinate cause"], along: Sequence[Perturbed]
) -> Float[np.ndarray, "reaction 6 cause"]:
    """Derivatives of clamp forces by the energy's ``gradient``, then those of bushings to the ground,
    one a cause: in the order of ``reactions``."""
    pushed = [derivative(-bushing_states(*at)[1].gradient[:, 6:]) for at in along]
    free = static_freedom(rest.model, rest.config, in_world=True)
    taken = columns([free.beyond(own) for own in gradient.T], len(gradient))
    nodes = [node.name for node in rest.model.structure.nodes]
    clamped = dict.fromkeys(clamp.node for clamp in rest.environment.clamps)
    by_clamps = [taken[6 * nodes.index(name) :][:6] for name in clamped]
    count = len(rest.environment.bushings)
    by_bushings = np.moveaxis(np.array(pushed).reshape(len(pushed), count, 6), 0, -1)
    return np.concatenate([np.array(by_clamps).reshape(-1, 6, len(pushed)), by_bushings])


def _spring_torque(perturbed: Structure, rest: Equilibrium, turn: np.ndarray) -> np.ndarray:
    """Derivative of what springs hold, k (target - angle)."""
    at = rest.config.angle + STEP * 1j * turn
    torque = [
        j.stiffness * (j.target - a) if j.state is JointState.SPRUNG else 0.0
        for j, a in zip(perturbed.joints, at, strict=True)
    ]
    return derivative(np.array(torque, dtype=complex))


def move_rest(rest: Equilibrium, parameters: Sequence[ModelParameter]) -> MovedRest:
    """The derivative of the rest state, with the patches that it came from; the last is kept with the state.

    A refinement, its findings and its predictions ask for the same one after the other.
    """
    known = vars(rest).get("moved")
    if known is None or known[0] != tuple(parameters):
        known = vars(rest)["moved"] = tuple(parameters), _move_rest(rest, parameters)
    return known[1]


def _move_rest(rest: Equilibrium, parameters: Sequence[ModelParameter]) -> MovedRest:
    check_beside_devices(rest, "derivatives of the rest state")
    if np.any(rest.loads.push[:, 3:]):
        raise NumericalError(
            "no derivatives under a moment of fixed direction: it has no potential",
            where=f"structure {rest.model.structure.title!r}",
            hint="apply it by two forces on arms, loads with offsets",
        )
    patches = make_patches(rest.model, rest.environment, parameters)
    drawn = columns([drawn_motion(rest.model, p) for p in patches], rest.model.tree.size)
    tied = [TieModel.of(rest.model, p) for p in patches]
    for parameter, tie in zip(parameters, tied, strict=True):
        tie.check_placed(parameter)
    forces = differentiate_support(rest, patches, tied, drawn)
    tuned = [tune_suspension(p.model, p.environment, f) for p, f in zip(patches, forces, strict=True)]
    loads = [environment_loads(p.model, p.environment, t) for p, t in zip(patches, tuned, strict=True)]
    at = assemble(rest.model, rest.config, rest.loads)
    rafts = float_patches(patches, [restrict(p, rest.config) for p in patches], loads)
    still = tuple((at, assemble(at.raft.model, at.config, at.loads)) for at in rafts)
    explicit = spread_gradients(rest.model, patches, [(at, total.gradient) for at, total in still])
    links = Tied.at(rest.model, rest.config, static_coordinates(rest.model))
    bare = at.gradient
    if rest.model.links is not None:
        bare = energy_gradient(rest.model, rest.config, rest.loads, NO_LOAD)
    held = links.multipliers(bare)
    here = np.zeros(rest.model.tree.size)
    before = [
        tie.change(rest.config, here, load.gravity, held + 0j) for tie, load in zip(tied, loads, strict=True)
    ]
    explicit = explicit + columns([t.gradient for t in before], rest.model.tree.size)
    motion = drawn + links.follow(links.slope @ drawn + columns([t.value for t in before], len(held)))
    motion = motion - StaticSolver.at(rest, at).solve(explicit, at.tangent @ motion)
    gradient = explicit + at.tangent @ motion
    change = links.multipliers(gradient)
    ties = tuple(
        tie.change(rest.config, motion[:, p], load.gravity, held + STEP * 1j * change[:, p])
        for p, (tie, load) in enumerate(zip(tied, loads, strict=True))
    )
    for parameter, tie in zip(parameters, ties, strict=True):
        links.check_repeated(parameter, tie)
    return MovedRest(
        patches=patches,
        tuned=tuple(tuned),
        loads=tuple(loads),
        motion=motion,
        gradient=gradient + links.slope.T @ change,
        still=still,
        ties=ties,
        drawn=drawn,
    )


def yield_further(rest: Equilibrium, strain: Float[np.ndarray, "element 6 field"]) -> RestMotion:
    """Motion of the rest state by ``strain`` (stretch, y1, z1, y2, z2, twist) of each beam element and field.

    Forces were D e; with D (e - strain) in their place the rest state moves by K_t^-1 B' D strain. Raises
    `NumericalError` as `differentiate_rest`.
    """
    at = assemble(rest.model, rest.config, rest.loads)
    pull = strain_pull(rest.model, rest.config, strain)
    motion = StaticSolver.at(rest, at).solve(pull)
    gradient = at.tangent @ motion - pull
    links = Tied.at(rest.model, rest.config, static_coordinates(rest.model))
    gradient = gradient + links.slope.T @ links.multipliers(gradient)
    still = dataclasses.replace(rest.config, since_drawn=None)
    along = [move(rest.model.tree, still, STEP * 1j * step) for step in motion.T]
    moved = [(rest.model, there, rest.loads) for there in along]
    return RestMotion(
        motion=motion,
        drawn=np.zeros_like(motion),
        tension=tension_slopes(rest, moved),
        support=support_slopes(rest, gradient, moved),
    )

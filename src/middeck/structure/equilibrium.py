"""The rest state of a structure in an environment (the paper's steps 1 and 2)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import EquilibriumError
from middeck.structure.article import JointState, Structure
from middeck.structure.assembly import Loads
from middeck.structure.environment import Environment
from middeck.structure.frames import Configuration, frame_poses
from middeck.structure.mesh import Model, mesh_structure
from middeck.structure.rotations import rotation_log
from middeck.structure.statics import TOLERANCE, settle
from middeck.structure.suspension import TunedSuspension, environment_loads, tune_suspension
from middeck.values import record

FAR_TURN = np.radians(30.0)  # three times what an unlevelled article rolls


@record
class Equilibrium:
    """A converged, or not converged, rest state.

    Parameters
    ----------
    config:
        Positions, rotations and angles at rest.
    residual:
        Largest unbalanced force [N] or moment [N m] over the weight, or what `load_scale` puts in its place.
    history:
        (load factor, residual, damping) of every iteration.
    holding_torque:
        Torque [N m], of a slide force [N], that each joint's motor, spring or lock holds, positive on the
        carried body.
    tension:
        Pull [N] of each device: the suspension's cables first, then the environment's springs.
    """

    model: Model
    environment: Environment
    config: Configuration
    loads: Loads
    suspension: TunedSuspension
    residual: float
    history: tuple[tuple[float, float, float], ...]
    holding_torque: Float[np.ndarray, " joint"]
    tension: Float[np.ndarray, " device"]

    @property
    def converged(self) -> bool:
        """Whether the residual is at rounding level; `solve_modes` refuses otherwise."""
        return self.residual < TOLERANCE


def solve_equilibrium(structure: Structure, environment: Environment) -> Equilibrium:
    """Rest state under gravity and suspension; `Environment.orbit()` is the undeformed structure.

    Raises `EquilibriumError` for gravity without any support, a slack cable, a mechanism, or a sprung joint
    that comes to rest beyond its travel; a state that did not converge is returned with its residual history
    and ``converged`` false.
    """
    model = mesh_structure(structure)
    _check_support(environment)
    tuned = tune_suspension(model, environment)
    loads = environment_loads(model, environment, tuned)
    settled = settle(model, loads)
    _check_cables(environment, settled.assembly.tension)
    if settled.residual < TOLERANCE:
        _check_travel(model, settled.config)
    # At rest dE/d(angle) is the moment that the motor has to balance.
    holding = settled.assembly.gradient[6 * model.tree.roots :] + _spring_torque(model, settled.config)
    return Equilibrium(
        model,
        environment,
        settled.config,
        loads,
        tuned,
        settled.residual,
        settled.history,
        holding,
        settled.assembly.tension,
    )


def _spring_torque(model: Model, config: Configuration) -> np.ndarray:
    """Torque of sprung axes: part of the balanced gradient, but it is what holds them."""
    return np.array(
        [
            j.stiffness * (j.target - angle) if j.state is JointState.SPRUNG else 0.0
            for j, angle in zip(model.structure.joints, config.angle, strict=True)
        ]
    )


def _check_support(environment: Environment) -> None:
    supported = environment.suspension is not None or environment.springs
    if np.any(environment.gravity) and not supported:
        raise EquilibriumError(
            f"gravity of {np.linalg.norm(environment.gravity):.4g} m/s^2 and nothing to hang from",
            where=f"environment {environment.title!r}",
            hint="add a [suspension] table or springs to the environment, or use orbit",
        )
    if environment.suspension is not None and not np.any(environment.gravity):
        raise EquilibriumError(
            "a suspension tuned to its load needs gravity: its reactions would be zero",
            where=f"environment {environment.title!r}",
            hint="set constants.gravity, or remove the [suspension] table",
        )


def _check_cables(environment: Environment, tension: np.ndarray) -> None:
    names = () if environment.suspension is None else environment.suspension.attach
    for name, pull in zip(names, tension, strict=False):
        if pull <= 0.0:
            raise EquilibriumError(
                f"the cable at {name!r} is slack at equilibrium ({pull:.3f} N)",
                where=f"suspension at {name!r}",
                hint="a cable cannot push: move the attach points or lower the bounce frequency",
            )


def _check_travel(model: Model, config: Configuration) -> None:
    """Held joints were checked with the structure; a sprung one goes where its load puts it."""
    for joint, at in zip(model.structure.joints, config.angle, strict=True):
        low, high = joint.travel
        if not low <= at <= high:
            unit = "m" if joint.slides else "rad"
            raise EquilibriumError(
                f"joint {joint.name!r} would rest at {at:.4g} {unit}, beyond its travel {low:g} to {high:g}",
                where=f"joint {joint.name!r}",
                hint="a stiffer spring, or one that is unstressed on the other side (rest), centres it",
                angle=float(at),
            )


def node_rotations(equilibrium: Equilibrium) -> dict[str, Float[np.ndarray, "3"]]:
    """Rotation vector [rad] of every node from its undeformed attitude, in W."""
    poses = frame_poses(equilibrium.model.tree, equilibrium.config)
    nodes = equilibrium.model.structure.nodes
    return {node.name: rotation_log(poses.R[i]) for i, node in enumerate(nodes)}


def rest_warnings(equilibrium: Equilibrium) -> tuple[str, ...]:
    """A node that turned by more than `FAR_TURN`: the article hangs, but hardly as it was meant to."""
    turned = {name: float(np.linalg.norm(v)) for name, v in node_rotations(equilibrium).items()}
    name = max(turned, key=lambda n: turned[n])
    if turned[name] <= FAR_TURN:
        return ()
    return (f"the article turned by {np.degrees(turned[name]):.0f} deg on the way to rest (node {name!r})",)

"""Elements attached to the joints of a plant: their ports, viscous drag, and refusals.

A rig (`middeck.laboratory.rig.rig`) steps them. Between two substeps its linear part is exact under held
torques. The torque of an element is held too, at its mean over the way that the joint goes in this step,
found together with where the joint ends. The work of a held torque is exact, mean torque times way; it is the
work done on the element. So nothing but the excitation brings energy in, whatever the step; the discrete
gradient of Gonzalez 1996, J. Nonlinear Sci. 6, with dissipation. In time the rule is of second order.
"""

from collections.abc import Sequence

import numpy as np

from middeck.errors import ConfigError
from middeck.joints.element import JointElement
from middeck.joints.friction import Friction
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import StateSpace
from middeck.values import record


@record
class JointElements:
    """Elements side by side at one joint, named by its torque input and its angle output in a plant."""

    torque: str
    angle: str
    elements: tuple[JointElement, ...]


def only_friction(joints: Sequence[JointElements]) -> list[Friction] | None:
    """The friction of each joint; None where one has another element, or several."""
    found = [e for joint in joints for e in joint.elements if isinstance(e, Friction)]
    alone = len(found) == len(joints) and all(len(joint.elements) == 1 for joint in joints)
    return found if alone else None


def add_viscous(plant: Plant, joints: Sequence[JointElements]) -> StateSpace:
    """The plant with each joint's viscous torque on the rate of its angle fed back, exactly."""
    damping = np.array([sum(e.viscous for e in j.elements) for j in joints])
    system = plant.system
    if not np.any(damping):
        return system
    columns = plant.input_indices([j.torque for j in joints])
    rates = system.C[plant.output_indices([j.angle for j in joints])] @ system.A
    drag = damping[:, None] * rates
    A, C = system.A - system.B[:, columns] @ drag, system.C - system.D[:, columns] @ drag
    return StateSpace(A, system.B, C, system.D)


def check_collocated(compliance: np.ndarray, direct: np.ndarray, joints: Sequence[JointElements]) -> None:
    """Raise `ConfigError` for two entries of a joint, and unless each torque and angle are of one joint.

    ``compliance`` is the angle of each joint after a step under the torque of each; ``direct`` is what an
    angle responds at once, which no joint with inertia does.
    """
    for names in ([j.torque for j in joints], [j.angle for j in joints]):
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ConfigError(f"two entries for joint {twice[0]!r}", hint="put its elements in one tuple")
    for i, joint in enumerate(joints):
        if np.any(direct[i]):
            raise ConfigError(
                f"the angle {joint.angle!r} responds to a torque without delay",
                where="JointElements",
                hint="leave out residual flexibility (static=False) in a plant with friction",
            )
        if not compliance[i, i] > 0.0:
            raise ConfigError(
                f"torque {joint.torque!r} does not turn the angle {joint.angle!r} as a joint's own would",
                where="JointElements",
                hint="name the joint's torque input and its relative angle, not a rate or an inertial angle",
            )
    own = np.sqrt(np.diag(compliance))
    relative = compliance / np.outer(own, own)  # no unit: one joint may turn and another travel
    if not np.allclose(relative, relative.T, rtol=0.0, atol=1e-6):
        raise ConfigError(
            "the plant is not reciprocal between its joints",
            where="JointElements",
            hint="torque and angle of each entry must be of one joint; leave control loops open",
        )

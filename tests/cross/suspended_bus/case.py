"""The suspended bus in plain numbers: all that the frozen case says, and every detail that it leaves open.

World axes: x along the tube, y up, z = x cross y; gravity is along -y. SI units, angles in radians.
"""

from __future__ import annotations

import math

GRAVITY = 9.80665

# As the case says. A tube of 2 m; E, G and A enter through these products only.
LENGTH = 2.0
EI, GJ, EA, KGA = 100.0, 80.0, 1e6, 2e5
MASS_PER_LENGTH = 0.5
SPRING_STIFFNESS = (13.0, 26.0, 13.0)
SPRING_FREE_LENGTH = 1.0
ANCHOR_HEIGHT = 5.0
BODY_MASS = (5.0, 10.0, 5.0)
BODY_CG = (0.0, -0.05, 0.0)
PAYLOAD_MASS = 3.0
PAYLOAD_CG = (0.0, -0.2, 0.0)

# Left open by the case, chosen here.
# A homogeneous tube: rho I about either transverse axis is rho A times EI/EA, the polar one their sum.
RHO_I = MASS_PER_LENGTH * EI / EA
# The three bodies sit at the tube's ends and middle, x = -1, 0, 1 m, as points: the tube is flexible over its
# whole length and the bodies have no size. Principal inertias about their own centres of mass, axes x, y, z.
BODY_X = (-1.0, 0.0, 1.0)
BODY_INERTIA = ((0.020, 0.030, 0.025), (0.060, 0.080, 0.070), (0.020, 0.030, 0.025))
# Springs pull on the tube's axis at the bodies; each anchor is 5 m straight above, in the undeformed state. A
# spring of free length 1 m is therefore stretched by 4 m before gravity acts.
# The gimbal sits on the tube's axis at x = +1 m: both axes pass through that point. The first turns about the
# tube's x axis, the second about the z axis of what the first carries (which has no mass); the payload hangs
# on the second. Positive by the right hand. "45 degrees" is 45 degrees about both axes.
PAYLOAD_BODY = 2
PAYLOAD_INERTIA = (0.015, 0.010, 0.020)
ANGLE = math.radians(45.0)
# The motors' springs: torque = -MOTOR_STIFFNESS (angle - rest angle) about each axis, so that the angles sag.
MOTOR_STIFFNESS = 50.0

# Without springs an axis is held at its angle while the bus comes to rest, and then moves freely under the
# constant torque (about the axis, on the payload; its opposite on the bus) that held it.
VARIANTS: dict[str, dict] = {
    "bare_1g": {"gravity": True, "payload": False, "angle": 0.0, "motor_springs": False},
    "gimbal_0_1g": {"gravity": True, "payload": True, "angle": 0.0, "motor_springs": False},
    # No springs to the anchors either: the article floats.
    "gimbal_45_0g": {"gravity": False, "payload": True, "angle": ANGLE, "motor_springs": False},
    "gimbal_45_1g": {"gravity": True, "payload": True, "angle": ANGLE, "motor_springs": True},
}
# The 15 lowest modes; of the floating article the 15 lowest above its eight rigid ones (six and two axes).
MODES = 15
RIGID_MODES_0G = 8

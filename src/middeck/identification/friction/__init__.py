"""Friction at driven joints: found in periodic records by its feedback, and taken out of them.

found = find_friction(record, [("pri_rel_z", "pri_rel_z")], delay_s=0.01, band_hz=(0.1, 30.0))
linear = without_friction(record, found)
"""

from middeck.identification.friction.find import JointFriction, find_friction
from middeck.identification.friction.remove import without_friction

__all__ = ["JointFriction", "find_friction", "without_friction"]

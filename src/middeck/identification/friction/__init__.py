"""Friction at driven joints: found in periodic records by its feedback, and taken out of them.

found = find_friction(record, [("pri_rel_z", "pri_rel_z")], delay_s=0.01, band_hz=(0.1, 30.0))
linear = without_friction(record, found)
"""

"""Friction and play at the joints of a linear plant, and their simulation."""

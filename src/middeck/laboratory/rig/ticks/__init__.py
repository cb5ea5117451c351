"""Ticks of a rig: one after the other in Python, or in C, from a state to the next."""

"""Linear systems: state spaces, plants, responses, delays, norms.

Models of structures and of data end in a `Plant`; control begins with one, whatever its origin.
"""

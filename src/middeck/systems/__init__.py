"""The waist of the hourglass: signals, state spaces, plants, responses, delays, norms.

Everything above ends in a `Plant` (from a structure, or from data); everything below begins with one and
does not know where it came from.
"""

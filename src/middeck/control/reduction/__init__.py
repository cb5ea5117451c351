"""Reduction of plants and compensators, with error bound, actual error and stability of the loop."""

"""Unknowns of a refinement, in the article and in the loop."""

"""Fits to the samples of one long record, its transient among the unknowns."""

"""Environments: the form of their files, and the faults of these."""

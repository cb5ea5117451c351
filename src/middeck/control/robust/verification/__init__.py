"""Compensators on many plants: stability, rms and comparison, continuous and sampled."""

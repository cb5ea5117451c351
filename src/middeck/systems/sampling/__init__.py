"""Sampled systems: holds, true delays, simulation."""

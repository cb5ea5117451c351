"""Delays of continuous systems, and their Pade approximations."""

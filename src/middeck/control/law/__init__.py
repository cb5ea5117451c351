"""Compensators, their ports, inert modes, stabilisability, delay orders and uncertainty."""

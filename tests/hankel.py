"""Hankel singular values of the part of a system that decays, largest first."""

from middeck.control.reduction.balanced import reduce_balanced


def hankel_values(system):
    return reduce_balanced(system, len(system.A)).hankel

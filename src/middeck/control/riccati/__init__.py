"""Algebraic Riccati and Lyapunov equations, continuous and sampled, over many decades of intensity."""

from middeck.control.riccati.continuous import WORTHLESS, RiccatiSolution, solve_riccati

__all__ = ["WORTHLESS", "RiccatiSolution", "solve_riccati"]

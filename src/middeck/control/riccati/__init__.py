"""Algebraic Riccati and Lyapunov equations, continuous and sampled, over many decades of intensity."""

from middeck.control.riccati.continuous import WORTHLESS, RiccatiSolution, solve_riccati
from middeck.control.riccati.discrete import DiscreteRiccatiSolution, solve_discrete_riccati
from middeck.control.riccati.lyapunov import solve_discrete_lyapunov

__all__ = [
    "WORTHLESS",
    "DiscreteRiccatiSolution",
    "RiccatiSolution",
    "solve_discrete_lyapunov",
    "solve_discrete_riccati",
    "solve_riccati",
]

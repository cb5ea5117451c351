"""Algebraic Riccati and Lyapunov equations, continuous and sampled, over many decades of intensity."""

"""Quadratic cost of a closed loop, its gradient, and compensators of fixed structure."""

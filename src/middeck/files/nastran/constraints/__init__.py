"""Constraints of grids, to the ground or to others: rigid links, averages, equations, restraints."""

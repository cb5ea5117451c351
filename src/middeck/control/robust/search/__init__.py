"""Descent of the cost of several models: starts, steps, continuation."""

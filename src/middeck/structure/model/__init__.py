"""Inputs: articles and environments, and their checks before anything is computed."""

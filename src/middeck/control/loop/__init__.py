"""Loops closed: responses, performance, authority, participation, pointing."""

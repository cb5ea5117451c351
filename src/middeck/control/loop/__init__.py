"""Closed loops: response, performance, authority, participation, pointing."""

"""Poles and zeros: stability, integrators, resolvents."""

"""Norms: root mean squares in a band, and largest gains."""

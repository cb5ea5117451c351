"""The most probable unknowns, and what stays open."""

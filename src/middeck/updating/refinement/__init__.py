"""The most probable unknowns, and their uncertainty."""

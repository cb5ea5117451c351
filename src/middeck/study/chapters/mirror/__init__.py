"""A real steering mirror through the same programs."""

"""A deck as text: sections, cards and fields, numbers, units and coordinate systems."""

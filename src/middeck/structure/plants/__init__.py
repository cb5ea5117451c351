"""From modes to a plant: ports, damping, and what truncated modes leave behind."""

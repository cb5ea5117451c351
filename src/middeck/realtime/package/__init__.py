"""Controller packages: a sampled law as data, with names, limits and test vectors, sealed by its hash."""

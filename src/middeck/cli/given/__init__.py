"""From what was typed to what the library takes: cases, plants, compensators, settings, limits."""

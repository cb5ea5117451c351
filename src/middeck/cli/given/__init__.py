"""From typed options to the library's arguments: cases, plants, compensators, settings, limits."""

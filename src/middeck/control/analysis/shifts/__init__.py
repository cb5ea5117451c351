"""Effects of a drifting plant on a loop: allowed shifts, inverted modes, the worst of a box."""

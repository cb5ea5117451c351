"""What a drifting plant does to a loop: allowed shifts, inverted modes, the worst of a box."""

"""Stand-alone C of a controller package."""

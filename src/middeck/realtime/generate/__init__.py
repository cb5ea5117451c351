"""Stand-alone C of a controller package, and the compiler of this machine."""

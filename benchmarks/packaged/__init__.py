"""Cases of the benchmark of controller packages."""

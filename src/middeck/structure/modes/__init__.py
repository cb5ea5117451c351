"""Natural modes about a rest state: solution, kinds, names, strain, and their accuracy."""

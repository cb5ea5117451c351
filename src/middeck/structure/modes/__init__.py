"""Natural modes about a rest state: solution, kinds, names, strain, and how far to trust them."""

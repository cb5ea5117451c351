"""Where a search begins: subspaces, vector fitting, starts."""

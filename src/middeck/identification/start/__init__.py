"""Where a search begins: options, subspaces, vector fitting, starts."""

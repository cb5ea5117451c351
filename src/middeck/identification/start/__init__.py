"""Start of a search: subspaces, vector fitting, starts."""

"""State spaces: their matrices, their modal form, their balance, and the closing of loops."""

"""Effects of gravity and suspension on shape and modes (Figures 3, 4 and 5)."""

"""What gravity and suspension do to shape and modes (Figures 3, 4 and 5)."""

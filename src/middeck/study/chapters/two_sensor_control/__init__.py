"""The payload controlled by feedback of encoder and bus (Figures 10, 11 and 12)."""

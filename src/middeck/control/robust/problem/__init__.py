"""The models that a robust design is for, how they vary, and what a design returns."""

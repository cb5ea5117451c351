"""The models of a robust design, their variation, and the result of a design."""

"""Families over gimbal angles, and modes against the amplitude of a joint that rubs or has play."""

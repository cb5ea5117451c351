"""The symmetric pair: all modes or the lowest, repeated ones, and rounding."""

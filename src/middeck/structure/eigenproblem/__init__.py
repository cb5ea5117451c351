"""The symmetric pair: all modes or the lowest, repeated ones, and what rounding leaves."""

"""Tests that may be made, and what each would leave open."""

"""Robust designs for uncertain plants, and their verification on other plants."""

"""Stability with exact delays: roots found, and counted."""

"""The engine: one C process that runs controller packages at a fixed rate, and its supervisor's side."""

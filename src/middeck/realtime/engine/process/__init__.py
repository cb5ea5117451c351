"""The engine as a process: built, started, commanded, taken over."""

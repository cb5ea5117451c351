"""Control of flexible structures that must work where they cannot be tested."""

__version__ = "0.1.0"

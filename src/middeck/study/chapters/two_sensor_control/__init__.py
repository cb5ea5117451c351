"""The payload held by encoder and bus (Figures 10, 11 and 12)."""

"""Controllers designed on a measured response (Figure 9)."""

"""Controllers designed in 0-g, judged in 0-g and in 1-g (Figure 7)."""

"""One torque to payload and bus rates in 0-g, in 1-g and as measured (Figure 6)."""

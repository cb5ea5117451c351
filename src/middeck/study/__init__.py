"""The questions of the 1993 paper, one file a figure: stages, claims, and every number behind them."""

"""The least-squares problem of a fit: lines, terms, unknowns, and its normal equations."""

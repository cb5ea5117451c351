"""Cases of control, one module each: `rows(options)` gives the rows of its case."""

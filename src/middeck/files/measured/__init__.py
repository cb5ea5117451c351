"""Results of tests: models fitted to records, and modal surveys."""

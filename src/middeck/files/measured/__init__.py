"""What a test has measured: models fitted to records, and modal surveys."""

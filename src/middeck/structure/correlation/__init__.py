"""A model beside a test: criteria, profiles, and how often a correct model would pass."""

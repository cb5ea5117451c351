"""What several verbs compute alike: excitations, fits of records, loops."""

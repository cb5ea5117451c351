"""TOML documents: their keys and lines, forms, overrides, and every fault of all of them at once."""

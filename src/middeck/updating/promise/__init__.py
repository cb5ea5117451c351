"""What compensators will do where they cannot be tested."""

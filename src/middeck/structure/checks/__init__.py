"""What is wrong, doubtful or lost: before solving, and after."""

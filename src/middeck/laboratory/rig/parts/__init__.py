"""Parts of a rig: motors, sensors with their filters, and the computer with its compensator."""

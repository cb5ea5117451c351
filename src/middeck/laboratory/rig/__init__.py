"""The simulated rig: a plant with motors, sensors and a computer, stepped in time; its runs and drift."""

"""The rig's plant: behind filters and between samples, drifting and ageing."""

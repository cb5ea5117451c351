"""The suspended bus by MuJoCo, Exudyn and OpenSees."""

"""The scenes of the tabletop in MuJoCo, to tell which failures are a simulator's own."""

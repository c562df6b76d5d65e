"""Scenes of LIBERO: what they may have, how they are set up, and which of them are fair."""

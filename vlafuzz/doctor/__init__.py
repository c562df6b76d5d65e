"""Checks of a policy before its failures are believed, and of this machine."""

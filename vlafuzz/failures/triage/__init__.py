"""Triage: from a failing scene to one that a person can trust. It sees predicates and the way to nominal."""

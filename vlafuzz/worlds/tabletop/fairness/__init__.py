"""Whether a scene is fair."""

from vlafuzz.worlds.tabletop.fairness.checks import check_events, check_geometry, check_semantic, check_static

__all__ = ["check_events", "check_geometry", "check_semantic", "check_static"]

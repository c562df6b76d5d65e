"""Whether a scene is fair."""

from vlafuzz.worlds.tabletop.fairness.checks import CHECKS, check_geometry, check_semantic, check_static

__all__ = ["CHECKS", "check_geometry", "check_semantic", "check_static"]

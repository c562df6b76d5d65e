"""Whether a scene is fair."""

from vlafuzz.validity.checks import CHECKS, check_geometry, check_semantic, check_static

__all__ = ["CHECKS", "check_geometry", "check_semantic", "check_static"]

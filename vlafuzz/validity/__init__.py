"""Whether a scene is fair."""

from vlafuzz.validity.checks import CHECKS, Rejection, check_geometry, check_semantic, check_static

__all__ = ["CHECKS", "Rejection", "check_geometry", "check_semantic", "check_static"]

"""Whether a scene is fair."""

from vlafuzz.validity.checks import CHECKS, check_geometry, check_semantic, check_static
from vlafuzz.validity.visible import Visible

__all__ = ["CHECKS", "Visible", "check_geometry", "check_semantic", "check_static"]

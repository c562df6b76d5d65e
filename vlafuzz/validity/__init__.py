"""Whether a scene is fair."""

from vlafuzz.validity.checks import CHECKS, Rejection, check_geometry, check_semantic, check_static
from vlafuzz.validity.visible import Visible

__all__ = ["CHECKS", "Rejection", "Visible", "check_geometry", "check_semantic", "check_static"]

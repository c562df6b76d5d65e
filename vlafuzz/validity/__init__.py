"""Checks without a simulator whether a scene is fair. They never change a scene."""

from __future__ import annotations

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Scene
from vlafuzz.validity.geometry import check_geometry
from vlafuzz.validity.report import CHECKS, Rejection
from vlafuzz.validity.semantic import check_semantic

__all__ = ["CHECKS", "Rejection", "check_geometry", "check_semantic", "check_static"]


def check_static(scene: Scene, catalogue: Catalogue, min_distance: float) -> Rejection | None:
    """Run the checks that need no simulator, cheapest first. ``min_distance``: of centres, metres."""
    return check_semantic(scene, catalogue) or check_geometry(scene, catalogue, min_distance)

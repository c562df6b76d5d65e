"""What a validity check says of a scene."""

from __future__ import annotations

from dataclasses import dataclass

CHECKS = ("semantic", "geometry", "settling", "solved")


@dataclass(frozen=True)
class Rejection:
    """A scene is not fair: the check that it fails, one of ``CHECKS``, and why, with the values."""

    check: str
    reason: str

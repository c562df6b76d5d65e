"""Rejection: the result of a failed validity check."""

from __future__ import annotations

from dataclasses import dataclass

CHECKS = ("semantic", "geometry", "settling", "solved")


@dataclass(frozen=True)
class Rejection:
    """Why a scene is not fair: the failed check, one of ``CHECKS``, and the reason with values."""

    check: str
    reason: str

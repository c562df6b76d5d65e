"""Evaluator: scenes in, outcomes out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene


class Evaluator(Protocol):
    """Runs a subject in scenes. Never raises for what a scene does; a crash is an ERROR outcome."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome a scene, in order: the same for the same scene, whatever was evaluated before."""

    def close(self) -> None:
        """No more scenes."""

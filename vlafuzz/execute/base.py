"""Executor: where scenes are evaluated, in this process or in others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from vlafuzz.outcome import Outcome
from vlafuzz.scene import Scene


class Executor(Protocol):
    """Evaluates batches of scenes."""

    def run(self, batches: Iterable[tuple[int, Sequence[Scene]]]) -> Iterator[tuple[int, list[Outcome]]]:
        """One list of outcomes a batch, named by its tag, in the order in which they are done.

        Batches are pulled when there is room for them. Whatever breaks while a scene is evaluated becomes an
        ERROR outcome; only what the user has to install or start first, and Ctrl-C, is raised.
        """

    def close(self) -> None:
        """No more batches: let go of simulators and policies."""

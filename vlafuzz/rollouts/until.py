"""Until: an executor that takes on no more scenes after a deadline."""

from collections.abc import Iterator, Sequence

from vlafuzz.common.deadline import Deadline, TimeOverError
from vlafuzz.model.outcome import Outcome
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.executor import Batches, Executor


class Until:
    """Leaves all to another executor until the deadline; what that has begun by then, it completes."""

    def __init__(self, executor: Executor, deadline: Deadline) -> None:
        self._executor, self._deadline = executor, deadline

    def run(self, batches: Batches) -> Iterator[tuple[int, list[Outcome]]]:
        """See ``Executor``.

        Raises:
            TimeOverError: after the last outcome, if a batch was left out.
        """
        left_out = False

        def in_time() -> Iterator[tuple[int, Sequence[Scene]] | None]:
            nonlocal left_out
            for batch in batches:
                if batch is not None and (left_out := self._deadline.passed):
                    return
                yield batch

        yield from self._executor.run(in_time())
        if left_out:
            raise TimeOverError

    def close(self) -> None:
        self._executor.close()

"""What takes seconds and is most likely needed begins while a command is still being checked."""


def begin_early(policy: str | None, workers: int | None, executor: str | None) -> None:
    """Begin what the usual world needs, and loading the simulator for workers, if the flags need them."""
    from vlafuzz.rollouts import forks
    from vlafuzz.rollouts.capacity import most_workers
    from vlafuzz.worlds import known_worlds

    next(iter(known_worlds().values())).begin_early(policy)
    own = ":" in (policy or "")  # has one worker by default
    if executor in (None, "processes") and (workers or (1 if own else most_workers())) > 1:
        forks.load_early()

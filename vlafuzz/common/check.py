"""Check: what was found where something was examined, and how bad it is."""

from typing import Literal, NamedTuple

Rating = Literal["ok", "warn", "refuse"]


class Check(NamedTuple):
    """The result of one check of a policy, a machine or a world; ``refuse``: nothing is run before a correction.

    ``found``: the observation, with figures. ``follows``: the consequence, and what to do, if any.
    """

    check: str
    found: str
    verdict: Rating = "ok"
    follows: str = ""

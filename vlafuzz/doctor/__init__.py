"""Checks of a policy before its failures are believed, and of this machine."""

from typing import Literal, NamedTuple

Rating = Literal["ok", "warn", "refuse"]


class Check(NamedTuple):
    """The result of one check, a row of the doctor's report; ``refuse``: nothing is run before a correction.

    ``found``: the observation, with figures. ``follows``: the consequence, and what to do, if any.
    """

    check: str
    found: str
    verdict: Rating
    follows: str = ""

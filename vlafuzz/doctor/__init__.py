"""Checks of a policy before its failures are believed, and of this machine."""

from typing import Literal, NamedTuple

Rating = Literal["ok", "warn", "refuse"]


class Check(NamedTuple):
    """The result of one check, a row of the doctor's report; ``refuse``: nothing is run before a correction.

    ``found``: the observation, with figures. ``follows``: the consequence, and what to do, if any.
    """

    check: str
    found: str
    verdict: Rating = "ok"
    follows: str = ""


# Each fault that a policy may have is rated, with advice on what to do.
FAULTS: dict[str, tuple[Rating, str]] = {
    "guessed": ("warn", "say {options} in the policy's name"),
    "it sees no picture": ("warn", "pictures of scenes do not matter to it; a policy that sees asks for cameras"),
    "constant": ("refuse", "its actions do not depend on the scene; look at how pictures are prepared"),
    "saturated": ("refuse", "they are clipped; look at the statistics by which it scales its actions"),
    "out of range": ("warn", "{problem}; {scale}=… says what their unit is"),
    "not deterministic": ("warn", "seed it with each rollout's seed, or say deterministic=False"),
    "blind": ("refuse", "nothing that it is shown matters; look at its cameras and its libraries' versions"),
    "nearly blind": ("warn", "it notices darkness, but {view} changes nothing"),
    "deaf": ("warn", "it ignores its instruction; look at how the instruction gets to it"),
    "it asks for the pose of the hand and does not use it": ("warn", "look at the layout, state=…"),
    "mixed up": ("refuse", "{problem}"),
    "the last digits depend on the rest of the batch": ("warn", "say deterministic=False, or max_batch=1"),
    "slow": ("warn", "a robot would wait for it, here it only takes long; execute more of a chunk, or lower hz"),
    "it breaks off at times": ("warn", "the first time {broken.where}: {broken.error.message}"),
    "it mostly fails": ("warn", "most of its failures will say nothing about the scenes"),
    "it cannot do the task": ("refuse", "its failures say nothing about the scenes"),
}


def judged(check: str, found: str, fault: str | None = None, **words: object) -> Check:
    """The check, which is ok without a fault. ``words`` fill in what there is to say about the fault."""
    if fault is None:
        return Check(check, found)
    rating, advice = FAULTS[fault]
    return Check(check, found, rating, f"{fault}: {advice.format(**words)}")

"""Witness: proof that a scene can be solved: actions of an expert that solve it when replayed open loop."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from vlafuzz.model import Actions, Latency, Outcome, Scene, Solver, Verdict, Witness

TRIES = 12  # of an expert, each beginning in another way: the grasps and leans of the first one of ours
SEEING_TRIES = 2  # of the seeing expert, which only strengthens a proof that there is
Solve = Callable[[Scene, int, Solver], Outcome]
"""Gives the outcome of an expert's n-th attempt, see ``SceneRunner.solve``."""
Play = Callable[[Scene, Actions], Outcome]


@dataclass(frozen=True)
class Search:
    """The witness, if one was found, and the expert's rollouts and replays that it took.

    Attributes:
        broken: there is no witness, but some attempt was an ERROR, so this says nothing about the scene.
    """

    witness: Witness | None
    rollouts: int
    broken: bool = False
    recovery: int | None = None  # of the witness, see ``Rollout.recovery``


def prove(scene: Scene, solve: Solve, play: Play) -> Search:
    """Find a witness, of the seeing expert where it solves the scene as well.

    The expert goes first: it is cheap, and fails least. What the seeing expert does from the picture says more: that
    the picture shows all it takes.
    """
    search = find_witness(scene, solve, play)
    if search.witness is None:
        return search
    by_sight = find_witness(scene, solve, play, SEEING_TRIES, "seeing")
    best = by_sight if by_sight.witness else search
    return replace(best, rollouts=search.rollouts + by_sight.rollouts, broken=False)


def find_witness(scene: Scene, solve: Solve, play: Play, tries: int = TRIES, solver: Solver = "expert") -> Search:
    """Let an expert solve a scene, with another grasp or direction each time, until a replay succeeds.

    The expert acts without latency, as it corrects itself at every step. The replay, which does not, has the scene's
    latency.

    Args:
        play: gives the outcome of executing actions from the same initial state.
    """
    rollouts, broken, prompt = 0, False, replace(scene, latency=Latency())
    for attempt in range(tries):
        solved = solve(prompt, attempt, solver)
        rollouts += len(solved.rollouts)
        broken |= solved.verdict is Verdict.ERROR
        if solved.verdict is not Verdict.PASSED:
            continue
        actions = solved.rollouts[0].actions
        played = play(scene, actions)
        rollouts += len(played.rollouts)
        broken |= played.verdict is Verdict.ERROR
        if played.verdict is Verdict.PASSED:
            witness = Witness(actions, played.rollouts[0].states_hash, attempt, solver)
            return Search(witness, rollouts, recovery=played.rollouts[0].recovery)
    return Search(None, rollouts, broken)

"""A campaign whose workers die, hang or exhaust the memory loses nothing: all proposals are stored."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest

from tests.doubles import STAGES, ClosedForm, TinySpace, manifest
from tests.rollouts.test_processes import TROUBLES, Treacherous, same
from vlafuzz.campaign.fuzz import fuzz
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.rollouts.executor import Executor, LocalExecutor
from vlafuzz.rollouts.processes import ProcessExecutor
from vlafuzz.search.proposals import Random
from vlafuzz.store.store import Store

SPACE = TinySpace()
FATAL = next(
    scene
    for scene in (SPACE.decode(proposal.genome) for proposal in Random(SPACE, 0).ask(8))
    if ClosedForm().outcome(scene).verdict is Verdict.PASSED
)


class Erring(ClosedForm):
    """The expected outcomes: an ERROR in one scene, the others as ever."""

    def outcome(self, scene: Scene) -> Outcome:
        if scene == FATAL:
            raise OSError("this one")
        return super().outcome(scene)


def stored(path: Path, executor: Executor) -> Sequence[tuple[int, str, Verdict]]:
    with Store.open(path, "write") as store:
        about = manifest(budget=20, batch=8)
        strategy = Random(SPACE, 0)
        summary = fuzz(manifest=about, stages=STAGES, space=SPACE, strategy=strategy, executor=executor, store=store)
        executor.close()
        trials = list(store.trials(summary.run))
    assert (summary.rollouts, summary.proposals) == (20, len(trials))
    assert sum(summary.verdicts.values()) == len({trial.scene for trial in trials})
    assert summary.verdicts["error"] == 1
    return sorted((trial.proposal, trial.scene.digest, trial.outcome.verdict) for trial in trials)


@pytest.mark.parametrize("trouble", ["killed", "hung", "greedy"])
def test_only_the_scene_that_is_to_blame_is_an_error(tmp_path: Path, trouble: str):
    what, options, _ = TROUBLES[trouble]
    (tmp_path / "pids").mkdir()
    evaluator = Treacherous(what, tmp_path / "pids", always=True, where=FATAL)
    expected = stored(tmp_path / "a.db", LocalExecutor(Erring()))
    executor = ProcessExecutor(partial(same, evaluator), 2, **options)  # type: ignore[arg-type]
    assert stored(tmp_path / "b.db", executor) == expected
    assert len(list((tmp_path / "pids").iterdir())) == 2

"""The same seed gives the same scenes, outcomes and trajectories, in this process or in others."""

from pathlib import Path

import pytest

from vlafuzz.campaign import config, launch
from vlafuzz.store.store import Store


def trials(store: Path, workers: int, policy: str = "pinhole", executor: str | None = None) -> list[tuple[object, ...]]:
    flags = {"policy": policy, "strategy": "nsga2", "budget": 12, "batch": 6, "seed": 5}
    summary = launch.start(
        config.plan(config.RunConfig(**flags, store=store, workers=workers, executor=executor)), lambda tally: None
    )
    assert summary.rollouts == 12
    with Store.open(store) as opened:
        return sorted(
            (
                trial.proposal,
                trial.scene.digest,
                trial.outcome.verdict,
                trial.outcome.progress,
                *(rollout.states_hash for rollout in trial.outcome.rollouts),
            )
            for trial in opened.trials(summary.run)
        )


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    """The outcomes in this process."""
    return trials(tmp_path_factory.mktemp("alone") / "a.db", 1)


@pytest.mark.parametrize("executor", ["processes", "ray"])
def test_two_workers_do_what_one_process_does(tmp_path: Path, alone, executor: str):
    assert trials(tmp_path / "a.db", 2, executor=executor) == alone

"""Which findings of a store are triaged, in which order, by how many, and what an interruption leaves for later."""

import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.failures.triage.planted import DARK, TILTED
from tests.failures.triage.runners import PlantedRunner, fill, scenes, triaged
from vlafuzz.common.deadline import Deadline
from vlafuzz.errors import SimulatorError
from vlafuzz.failures.triage.pipeline import Allowance, Progress, cause_findings, triage
from vlafuzz.failures.triage.triager import Unjudged
from vlafuzz.model import Outcome, Scene
from vlafuzz.rollouts.registry import Place
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store


def test_a_finding_that_was_triaged_is_not_triaged_again(store):
    runner, opened = PlantedRunner([TILTED]), store(scenes([TILTED], 3))
    assert len(triaged(opened, runner, limit=2)) == 2
    spent = runner.policy_rollouts
    progress: list[Progress] = []
    triage(opened, lambda run: runner, watch=progress.append)
    assert [(each.done, each.findings) for each in progress] == [(0, 1), (1, 1)]
    assert len(opened.triaged()) == 3
    assert triage(opened, lambda run: pytest.fail("there is nothing to do")) == {}
    assert runner.policy_rollouts > spent


def test_with_a_limit_every_cell_has_its_turn(store):
    failing = scenes([TILTED], 5)
    chosen = [each.scene for each in triaged(store(failing, "aaabc"), PlantedRunner([TILTED]), limit=4)]
    assert set(chosen) == {failing[0], failing[1], failing[3], failing[4]}


def test_findings_that_show_causes_come_first(store):
    opened = store(scenes([TILTED], 4))
    shown = [opened.findings()[index].scene for index in (3, 1)]
    causes = [FoundCause(scene, ("camera-orientation",), 1) for scene in shown]
    opened.keep_causes(1, Attribution((FoundCause(None, ("light",), 1), *causes)))
    assert [finding.scene for finding in cause_findings(opened, 1)] == shown
    assert [each.scene for each in triaged(opened, PlantedRunner([TILTED]), limit=2)] == shown


class Broken(PlantedRunner):
    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        return [Outcome.error("policy: connect")] * len(scenes)


def test_a_finding_that_cannot_be_judged_is_left_for_the_next_time(store):
    opened = store(scenes([TILTED], 2))
    assert triage(opened, lambda run: Broken([TILTED])) == {Unjudged.BROKEN: 2}
    assert opened.triaged() == []
    assert triage(opened, lambda run: PlantedRunner([TILTED])) == {}
    assert len(opened.triaged()) == 2


def tilted(run) -> PlantedRunner:
    return PlantedRunner([TILTED])


def dying(run) -> PlantedRunner:
    os._exit(9)


def test_of_given_findings_the_others_are_left_alone(store):
    opened = store(scenes([TILTED], 3))
    (_, second, third) = opened.findings()
    assert triage(opened, tilted, findings=[third, second]) == {}
    assert {each.scene for each in opened.triaged()} == {second.scene, third.scene}


def test_no_finding_is_begun_once_the_rollouts_are_spent_and_the_next_triage_goes_on(store):
    opened, allowance = store(scenes([TILTED], 4)), Allowance(rollouts=60)
    assert triage(opened, tilted, allowance=allowance) == {}
    done = opened.triaged()
    assert 0 < len(done) < 4
    assert allowance.spent == sum(each.policy_rollouts for each in done) >= 60
    assert allowance.spent - done[-1].policy_rollouts < 60
    triage(opened, tilted)
    assert len(opened.triaged()) == 4


def test_what_the_deadline_interrupts_is_left_as_it_was(store):
    class Impatient(Deadline):
        """Passes in the middle of the second finding."""

        looked = 0

        @property
        def left(self) -> float:
            self.looked += 1
            return 100.0 if self.looked < 15 else 0.0

    opened = store(scenes([TILTED], 3))
    assert triage(opened, tilted, allowance=Allowance(deadline=Impatient())) == {}
    first = opened.triaged()
    assert len(first) < 3
    triage(opened, tilted)
    assert [each.bucket for each in opened.triaged()] == ["minimal"] * 3


@pytest.mark.parametrize("executor", [None, "ray"])
def test_two_workers_come_to_what_one_process_does(tmp_path: Path, executor, request):
    if executor:
        request.getfixturevalue("connected")
    made = []
    for place in (Place(), Place(2, executor)):
        with Store.open(tmp_path / f"{place.workers}.db", "write") as store:
            assert triage(fill(store, scenes([TILTED], 5)), tilted, place=place) == {}
            made.append({each.scene.digest: (each.bucket, each.shrunk) for each in store.triaged()})
    assert made[0] == made[1]
    assert len(made[0]) == 5  # of which the last knows what the first one showed


def test_workers_that_die_are_one_sentence_and_nothing_is_lost(store):
    opened = store(scenes([TILTED], 2))
    with pytest.raises(SimulatorError, match="a worker ended with exit code 9, 2 times: finished findings are stored"):
        triage(opened, dying, place=Place(2))
    assert triage(opened, tilted) == {}
    assert len(opened.triaged()) == 2


class Interrupted(PlantedRunner):
    """Ctrl-C after so many batches."""

    batches: int

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        self.batches -= 1
        if self.batches < 0:
            raise KeyboardInterrupt
        return super().evaluate(scenes, numbers)


def test_a_finding_whose_triage_was_interrupted_begins_anew(store):
    one, stopped, runner = store(scenes([TILTED, DARK], 1)), Interrupted([TILTED, DARK]), PlantedRunner([TILTED, DARK])
    stopped.batches = 10
    with pytest.raises(KeyboardInterrupt):
        triage(one, lambda run: stopped)
    assert one.triaged() == []
    triage(one, lambda run: runner)
    assert one.triaged()[0].policy_rollouts == runner.policy_rollouts

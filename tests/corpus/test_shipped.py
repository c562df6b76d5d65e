"""The corpora that come with vlafuzz: whole, of fair scenes, and true of the `mini` that comes along."""

from pathlib import Path

import pytest

from vlafuzz.corpus.bundle import Bundle
from vlafuzz.corpus.folder import is_bundle, read_bundle
from vlafuzz.desk import SimulatorDesk
from vlafuzz.objects import load_catalogue
from vlafuzz.outcome import Verdict
from vlafuzz.shipped import corpus_dir
from vlafuzz.tasks.tabletop import TASKS
from vlafuzz.validity import check_static

FOLDERS = [corpus_dir() / f"mini-{task}" for task in TASKS]


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name, scope="module")
def shipped(request: pytest.FixtureRequest) -> tuple[Path, Bundle]:
    return request.param, read_bundle(request.param)


def test_each_has_twenty_distinct_failures_with_all_proofs(shipped: tuple[Path, Bundle]):
    folder, bundle = shipped
    assert len({case.scene for case in bundle.cases}) == len(bundle.cases) >= 20
    assert (bundle.subject, f"mini-{bundle.task}") == ("mini", folder.name)
    assert "llvmpipe" in (bundle.renderer or "")
    for case in bundle.cases:
        assert case.thumbnail
        assert set(case.counterparts) == set(case.operators)
        assert len(case.operators) > 0


def test_each_is_found_by_its_name_alone(
    shipped: tuple[Path, Bundle], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, bundle = shipped
    monkeypatch.chdir(tmp_path)
    assert is_bundle(Path(folder.name))
    assert [case.scene for case in read_bundle(Path(folder.name)).cases] == [c.scene for c in bundle.cases]
    assert not is_bundle(Path("elsewhere") / folder.name)


def test_their_scenes_are_fair(shipped: tuple[Path, Bundle]):
    _, bundle = shipped
    distance = bundle.runs[0].min_distance
    unfair = [check_static(case.scene, load_catalogue(), distance) for case in bundle.cases]
    assert unfair == [None] * len(bundle.cases)


@pytest.mark.render
def test_mini_fails_in_one_passes_beside_it_and_the_witness_solves_it(shipped: tuple[Path, Bundle]):
    folder, bundle = shipped
    desk = SimulatorDesk(folder, bundle.runs[0])
    case = min(bundle.cases, key=lambda each: len(each.operators))
    here = [*case.counterparts.values(), case.scene]
    verdicts = [outcome.verdict for outcome in desk.evaluate(here, 0)]
    played = desk.play(case.scene, case.witness.actions)
    desk.close()
    assert verdicts == [Verdict.PASSED] * len(case.counterparts) + [Verdict.FAILED]
    assert played.verdict is Verdict.PASSED

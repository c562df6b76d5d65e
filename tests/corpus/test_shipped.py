"""The corpora that come with vlafuzz: whole, of fair scenes, and with witnesses that solve them."""

from collections.abc import Callable
from contextlib import closing
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

RecordProperty = Callable[[str, object], None]
SAMPLE = 4  # failures of each corpus that are run again; scripts/check_corpora.py runs all of them
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
def test_every_witness_solves_its_scene(shipped: tuple[Path, Bundle], record_property: RecordProperty):
    """The verdicts of a learned policy depend on last bits, which differ between processors and renderers:
    how many of the failures and counterparts hold on this machine is shown, not asserted."""
    folder, bundle = shipped
    cases = sorted(bundle.cases, key=lambda case: len(case.operators))
    with closing(SimulatorDesk(folder, bundle.runs[0])) as desk:
        solved = [desk.play(case.scene, case.witness.actions).verdict for case in cases]
        failures = desk.evaluate([case.scene for case in cases[:SAMPLE]], 0)
        passes = desk.evaluate([next(iter(case.counterparts.values())) for case in cases[:SAMPLE]], 0)
    failed = sum(outcome.verdict is Verdict.FAILED for outcome in failures)
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in passes)
    record_property(
        "figure", f"{bundle.name}: {failed} of {SAMPLE} failures hold here, {passed} counterparts"
    )
    assert solved == [Verdict.PASSED] * len(cases)
    assert all(outcome.rollouts for outcome in (*failures, *passes)), "every scene is fair and can be run"

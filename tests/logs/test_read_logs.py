"""`scripts/read_logs.py`: what it says of the logs of others, and how it ends."""

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vlafuzz.common.statistics import wilson

ROOT = Path(__file__).parents[2]
LEROBOT = Path(__file__).with_name("eval_info.json")  # of `lerobot-eval` 0.4.4, but for the paths of videos
SCRIPT = runpy.run_path(str(ROOT / "scripts" / "read_logs.py"))
main = SCRIPT["main"]
EPISODES = [
    {"episode_id": 0, "metrics": {"success": True}, "steps": 90},
    {"episode_id": 1, "metrics": {"success": False}, "steps": 300},
    {"episode_id": 2, "metrics": {}, "failure_reason": "timeout"},
]
VLA_EVAL = {"benchmark": "libero_goal", "tasks": [{"task": "open the drawer", "episodes": EPISODES}]}


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def rates(capsys: pytest.CaptureFixture[str], *logs: object) -> list[dict[str, Any]]:
    assert main([*map(str, logs), "--json"]) == 0
    return json.loads(capsys.readouterr().out)["rates"]  # type: ignore[no-any-return]


def test_a_log_of_lerobot_has_the_figures_that_lerobot_computed(capsys):
    overall = json.loads(LEROBOT.read_text())["overall"]
    rate = rates(capsys, LEROBOT)[0]
    count, of = rate["success"]["count"], rate["success"]["of"]
    assert (rate["suite"], of, 100 * count / of) == ("pusht", overall["n_episodes"], overall["pc_success"])


def test_a_log_of_vla_eval_tells_errors_from_failures(capsys):
    Path("a.json").write_text(json.dumps(VLA_EVAL))
    (rate,) = rates(capsys, "a.json")
    assert (rate["success"]["count"], rate["success"]["of"], rate["errors"]) == (1, 2, 1)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_of_csv_are_known_by_several_names(separator, capsys):
    lines = ["task_suite_name,task_index,init_state_index,is_success", "a,3,7,true", "a,3,8,0.0", "a,4,9,"]
    Path("a.csv").write_text("\r\n".join(lines).replace(",", separator))
    told = [(rate["suite"], rate["task"], rate["success"]["count"], rate["errors"]) for rate in rates(capsys, "a.csv")]
    assert told == [("a", "", 1, 1), ("a", "3", 1, 0), ("a", "4", 0, 1)]


def test_repeats_of_one_initial_state_count_for_fewer(capsys):
    alike = [f"{state},{run},{state % 2}" for state in range(4) for run in range(5)]
    Path("a.csv").write_text("\n".join(["state,run,success", *alike]))
    success = rates(capsys, "a.csv")[0]["success"]
    assert (success["count"], success["of"]) == (10, 20)
    assert success["low"] < 0.1 < 0.9 < success["high"]  # of 20 independent episodes: 0.3 to 0.7


def test_without_json_there_is_a_table_for_people(capsys):
    Path("a.csv").write_text("\n".join(["suite,success", *["goal,0"] * 20]))
    assert main(["a.csv"]) == 0
    assert "0% (0–16.1%)" in capsys.readouterr().out


BAD = {
    "a.csv: is empty": "",
    "a.csv: no column is known to say whether an episode succeeded: task, ok": "task,ok\na,1\n",
    "a.csv, line 3: has 1 cells, expected 2": "task,success\na,1\nb\n",
    "a.csv, line 2: success is '0.5'": "task,success\na,0.5\n",
    "a.csv: no episode says whether it succeeded": "task,success\na,\n",
    "a.csv, line 3: is the same episode as": "run,episode,success\nx,1,1\nx,1,0\n",
    "a.csv: is no log that is known: it has ['accuracy']": '{"accuracy": 1}',
    "a.csv: not JSON": '{"per_task": [',
    "a.csv: is laid out in another way: KeyError: 'metrics'": '{"per_task": [{"task_group": "a", "task_id": 1}]}',
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_wrong_with_a_file_is_one_sentence(message, capsys):
    Path("a.csv").write_text(BAD[message])
    assert main(["a.csv"]) == 2
    assert message in capsys.readouterr().err


def test_a_file_that_is_given_twice_would_count_twice(capsys):
    Path("a.csv").write_text("success\n1\n")
    assert main(["a.csv", "./a.csv"]) == 2
    assert "a file is given twice" in capsys.readouterr().err


def cases(*runs: tuple[int, int]) -> list[tuple[int, bool]]:
    """Of each run, how many of how many are so."""
    return [(run, number < so) for run, (so, of) in enumerate(runs) for number in range(of)]


def grouped(sample: list[tuple[int, bool]]) -> tuple[float, float]:
    share = SCRIPT["grouped"](sample)
    return share.low, share.high


def test_the_interval_of_a_share_is_wilsons_of_fewer_cases_where_runs_differ():
    # Shares 0.2, 0.5, 0.8: of 30 cases a variance of 0.03, against 0.25/30; t is 4.303 with 3 runs.
    effective = 0.25 / 0.03 * (1.959964 / 4.302653) ** 2
    expected = wilson(effective / 2, effective)
    assert grouped(cases((2, 10), (5, 10), (8, 10))) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("runs", [[(3, 10)], [(0, 10), (0, 5)], [(10, 10), (5, 5)], [(5, 10)] * 3, []])
def test_where_runs_differ_by_no_more_than_chance_it_is_wilsons(runs: list[tuple[int, int]]):
    so, of = sum(value[0] for value in runs), sum(value[1] for value in runs)
    assert grouped(cases(*runs)) == wilson(so, of)


def test_the_interval_of_a_share_holds_what_it_says_where_wilsons_does_not():
    rng = np.random.default_rng([0, 4])
    covered = {grouped: 0, lambda sample: wilson(sum(so for _, so in sample), len(sample)): 0}
    for _ in range(200):
        shares = rng.beta(0.6 * 4, 0.4 * 4, size=5)  # failures of one run correlate by 0.2
        sample = cases(*((int(rng.binomial(10, share)), 10) for share in shares))
        for method in covered:
            low, high = method(sample)
            covered[method] += low <= 0.6 <= high
    ours, theirs = covered.values()
    assert ours >= 184
    assert theirs <= 164

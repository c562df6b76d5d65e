"""What is read from the logs of others."""

from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from tests.logs.samples import VLA_EVAL, suite_csv, write_json
from vlafuzz.common.reading import read_json
from vlafuzz.errors import UsageError
from vlafuzz.logs.episodes import rates
from vlafuzz.logs.formats import read_logs, read_table

LEROBOT = Path(__file__).with_name("eval_info.json")  # of `lerobot-eval` 0.4.4, but for the paths of videos


def read(*paths: Path) -> list[tuple[str, str, str, bool | None]]:
    return [(one.suite, one.task, one.state, one.success) for one in read_logs(paths)]


def test_a_log_of_lerobot_has_the_figures_that_lerobot_computed():
    overall = read_json(LEROBOT, UsageError)["overall"]
    rate = rates(read_logs([LEROBOT]))[0]
    assert (rate.suite, rate.success.of) == ("pusht", overall["n_episodes"])
    assert 0 < 100 * rate.success.share == overall["pc_success"]


def test_a_log_of_vla_eval_tells_errors_from_failures(tmp_path: Path):
    task = ("libero_goal", "open the drawer")
    outcomes = [(*task, "0", True), (*task, "1", False), (*task, "2", None)]
    assert read(write_json(tmp_path / "a.json", VLA_EVAL)) == outcomes


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_of_csv_are_known_by_several_names(separator, tmp_path: Path):
    lines = ["task_suite_name,task_index,init_state_index,is_success", "a,3,7,true", "a,3,8,0.0", "a,3,9,"]
    (tmp_path / "a.csv").write_text("\r\n".join(lines).replace(",", separator))
    assert read(tmp_path / "a.csv") == [("a", "3", "7", True), ("a", "3", "8", False), ("a", "3", "9", None)]


BAD = {
    "a.csv: is empty": "",
    "a.csv: no column is known to say whether an episode succeeded: task, ok": "task,ok\na,1\n",
    "a.csv, line 3: has 1 cells, expected 2": "task,success\na,1\nb\n",
    "a.csv, line 2: success is 'nan'": "task,success\na,nan\n",
    "a.csv, line 2: success is '0.5'": "task,success\na,0.5\n",
    "a.csv: no episode says whether it succeeded": "task,success\na,\n",
    "a.csv, line 3: is the same episode as": "run,episode,success\nx,1,1\nx,1,0\n",
    "a.csv: is no log that is known: it has ['accuracy']": '{"accuracy": 1}',
    "a.csv: not JSON": '{"per_task": [',
    "a.csv: is laid out in another way: KeyError: 'metrics'": '{"per_task": [{"task_group": "a", "task_id": 1}]}',
    "a.csv: a: episodes.0: success is 0.5": ('{"tasks": [{"task": "a", "episodes": [{"metrics": {"success": 0.5}}]}]}'),
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_wrong_with_a_file_is_one_sentence(message, tmp_path: Path):
    (tmp_path / "a.csv").write_text(BAD[message])
    with pytest.raises(UsageError) as raised:
        read_logs([tmp_path / "a.csv"])
    assert message in str(raised.value)


def test_a_file_that_is_given_twice_would_count_twice(tmp_path: Path):
    path = suite_csv(tmp_path / "a.csv", a="sf")
    with pytest.raises(UsageError, match="is given twice"):
        read_logs([path, tmp_path / "." / "a.csv"])


NAMES = st.text("ab ,;\"'é\t\n", max_size=6).map(str.strip)


@given(st.lists(st.tuples(NAMES, st.sampled_from(["1", "0", ""])), min_size=1))
def test_what_csv_quotes_is_read_as_it_was_written(cells):
    import csv
    import io

    text = io.StringIO(newline="")
    csv.writer(text).writerows([("task", "success"), *cells])
    outcomes = {"1": True, "0": False, "": None}
    found = [(one.task, one.success) for one in read_table(Path("a.csv"), text.getvalue())]
    assert found == [(task, outcomes[success]) for task, success in cells]

"""What README and the pages say is so."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import threading
from ast import literal_eval
from http.server import ThreadingHTTPServer
from pathlib import Path
from unittest.mock import MagicMock
from urllib.parse import parse_qsl, urlsplit

import pytest

from tests.cli.typed import told
from tests.documentation import ROOT, files, text
from tests.doubles import ClosedForm
from tests.report.stores import store
from tests.worlds.tabletop.sim.scenes import evaluate, nominal, pick_up, put
from vlafuzz.campaign import config
from vlafuzz.cli import COMMANDS, main
from vlafuzz.model import Verdict
from vlafuzz.policies.serving import serving
from vlafuzz.rollouts.policies import known_policies, make_policy
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.worlds.tabletop.space import load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

README, COMMANDS_PAGE, SCENES = (text(name) for name in ("README.md", "docs/commands.md", "docs/operators.md"))
OWN_POLICY = files(ROOT / "docs" / "your-policy.md")["mine.py"]
OWN_STRATEGY = files(ROOT / "docs" / "strategies.md")["climb.py"]
SAMPLES = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "samples").glob("*.py")}
PANDAS = files(ROOT / "docs" / "python.md")["to_pandas.py"]
PYTHON = re.findall(r"```python\n(.*?)```", text("docs/python.md"), re.DOTALL)


def test_readme_has_at_most_150_lines():
    assert len(README.splitlines()) <= 150


def test_the_pages_have_every_command_operator_and_task():
    assert [name for name in COMMANDS if f"`vlafuzz {name.split()[0]}" not in COMMANDS_PAGE] == []
    rows = re.findall(r"^\| \d+ \| `(.*?)`", SCENES, flags=re.MULTILINE)
    assert [name for name in load_operators().operators if name not in rows] == []
    assert [name for name in TASKS if f"`{name}`" not in SCENES] == []


@pytest.mark.parametrize(
    ("page", "kind", "names"),
    [("docs/builtin.md", "policy", known_policies()), ("docs/strategies.md", "strategy", STRATEGIES)],
)
def test_every_policy_and_strategy_has_a_row_and_so_has_your_own(page, kind, names):
    table = text(page).partition(f"| {kind} | is |\n")[2].partition("\n\n")[0]
    first = " ".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE))
    assert {*names, "python:pkg.mod:factory"} <= set(re.findall(r"`(.*?)`", first))


@pytest.fixture
def save(tmp_path, monkeypatch):
    """Saves an example as ``mine.py``, where vlafuzz is then called."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield (tmp_path / "mine.py").write_text
    sys.modules.pop("mine", None)


@pytest.mark.render
def test_the_example_of_an_own_policy_picks_up_what_it_sees(save):
    save(OWN_POLICY)
    outcomes = evaluate(make_policy("python:mine:make"), nominal("pick-up"), pick_up(put("pepsi_can", 0.05, 0.1)))
    assert [outcome.verdict for outcome in outcomes] == [Verdict.PASSED, Verdict.PASSED]


@pytest.mark.usefixtures("few_random_scenes")
def test_the_example_of_an_own_strategy_runs(save, monkeypatch, capsys):
    save(OWN_STRATEGY)
    monkeypatch.setattr(config, "make_evaluator", lambda *_: ClosedForm())
    assert told(capsys, "run --strategy python:mine:make --budget 30 --store a.db --json")["rollouts"] == 30


def output_of(example: str, folder: Path) -> str:
    (folder / "example.py").write_text(example)
    done = subprocess.run([sys.executable, "example.py"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_example_from_python_lists_the_causes_of_two_failures_in_four_lines(tmp_path):
    example = PYTHON[1]
    causes = literal_eval(output_of(example, tmp_path))
    assert [re.match(r"pick-up\|\w+\|[\w+-]+", cause) is not None for cause in causes] == [True, True]
    assert len([line for line in example.splitlines() if line]) == 4


@pytest.mark.usefixtures("few_random_scenes")
def test_the_example_of_the_page_on_python_lists_failures_and_causes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(PYTHON[0], {})
    assert re.search(r"^[0-9a-f]{32} (grasp|lift|success)", capsys.readouterr().out, re.MULTILINE)


@pytest.mark.parametrize(
    ("name", "package"), [("to_wandb.py", "wandb"), ("to_tensorboard.py", "torch.utils.tensorboard")]
)
def test_a_recipe_logs_the_failure_rate_of_each_run(name, package, tmp_path, monkeypatch):
    """The packages are not installed for tests; the store has two runs of four scenes."""
    monkeypatch.chdir(tmp_path)
    store(tmp_path / "pinhole.db", triaged=0)
    monkeypatch.setitem(sys.modules, package, package_ := MagicMock())
    exec(SAMPLES[name], {})
    assert len([call for call in package_.mock_calls if "'failure rate of random scenes'" in str(call)]) == 2 * 4


def test_the_recipe_of_pandas_prints_rates_by_model_and_light(tmp_path, monkeypatch, capsys):
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    store(tmp_path / "pinhole.db", triaged=0)
    exec(PANDAS, {})
    assert "idle" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.render
def test_the_example_of_a_server_answers_a_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example = {"__name__": "server"}
    exec(SAMPLES["server.py"], example)
    server = ThreadingHTTPServer(("127.0.0.1", 0), example["Handler"])
    threading.Thread(target=server.serve_forever, daemon=True).start()
    policy = f"http://127.0.0.1:{server.server_port}/act?hz=5&deterministic=1"
    try:
        run = ["run", "--policy", policy, "--label", "first", "--budget", "2", "--unchecked", "--no-certify"]
        assert main([*run, "--store", "a.db", "--json"]) == 0
    finally:
        server.shutdown()
        server.server_close()
    assert json.loads(capsys.readouterr().out)["verdicts"]["failed"] == 2


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("policy", ["mini", "python:network:make"])
def test_networks_with_pictures_are_served_as_the_pages_say(policy, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("network.py").write_text(SAMPLES["network.py"])
    (shown,) = [line for line in text("docs/served-model.md").splitlines() if line.startswith("$ vlafuzz run")]
    asked = dict(parse_qsl(urlsplit(shlex.split(shown)[4]).query))
    with serving(make_policy(policy)) as name:
        assert asked.items() <= dict(parse_qsl(urlsplit(name).query)).items()
        run = ["run", "--policy", name, "--label", "a", "--budget", "2", "--no-certify", "--unchecked"]
        verdicts = told(capsys, [*run, "--store", "a.db", "--json"])["verdicts"]
    assert verdicts["passed" if policy == "mini" else "failed"] >= 1
    assert verdicts["error"] == 0


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "operators/README.md", "corpus/README.md"])
def test_links_lead_somewhere(page):  # those of docs/ are checked by scripts/check
    for link in re.findall(r"\]\((?!http)([^)#]+)", text(page)):
        assert (ROOT / page).parent.joinpath(link).exists(), link


@pytest.mark.parametrize("script", ["demo", "test", "setup", "check"])
def test_scripts_are_executable_and_parse(script):
    path = Path(__file__).parent.parent / "scripts" / script
    assert path.stat().st_mode & 0o111
    assert subprocess.run([shutil.which("bash"), "-n", path], check=False).returncode == 0

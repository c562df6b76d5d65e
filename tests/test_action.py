"""The GitHub action: its steps are run here, with the files and variables that GitHub provides."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from vlafuzz.store.store import Store

ROOT = Path(__file__).parent.parent
ACTION: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
STEPS: list[dict[str, Any]] = ACTION["runs"]["steps"]


class Job:
    """A job that uses the action; steps that use other actions are left out, and so is installing."""

    def __init__(self, folder: Path, **inputs: str) -> None:
        self.folder = folder
        defaults = {name: value.get("default", "") for name, value in ACTION["inputs"].items()}
        unknown = inputs.keys() - defaults.keys()
        assert not unknown
        self._known = {f"inputs.{name}": value for name, value in (defaults | inputs | {"install": ""}).items()}
        self._known |= {"github.run_number": "7", "github.action_path": str(ROOT), "always()": "true"}
        self.summary = ""
        self.code = 0
        (folder / "bin").mkdir(exist_ok=True)
        for name, module in (("vlafuzz", "-m vlafuzz "), ("python", "")):
            program = folder / "bin" / name
            program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {module}"$@"\n')
            program.chmod(0o755)

    def run(self) -> None:
        """All steps; after a failure only those that always run."""
        for step in STEPS:
            condition = step.get("if", "true")
            wanted = self._true(condition) and (self.code == 0 or condition == "always()")
            if wanted and "run" in step:
                self._step(step)

    def _step(self, step: dict[str, Any]) -> None:
        files = {name: self.folder / name for name in ("GITHUB_STEP_SUMMARY", "GITHUB_OUTPUT")}
        for file in files.values():
            file.write_text("")
        path = f"{self.folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
        environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
        environment |= {name: str(file) for name, file in files.items()}
        environment |= {name: self._filled(value) for name, value in step["env"].items()}
        bash = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        done = subprocess.run(bash, cwd=self.folder, env=environment, capture_output=True, text=True, check=False)
        self.code = self.code or done.returncode
        self.summary += files["GITHUB_STEP_SUMMARY"].read_text()
        for line in files["GITHUB_OUTPUT"].read_text().splitlines():
            name, _, value = line.partition("=")
            self._known[f"steps.{step['id']}.outputs.{name}"] = value

    def output(self, step: str, name: str) -> str:
        return self._known[f"steps.{step}.outputs.{name}"]

    def _filled(self, text: str) -> str:
        return re.sub(r"\$\{\{(.*?)\}\}", lambda found: self._value(found[1]), text)

    def _value(self, expression: str) -> str:
        """Of alternatives, the first that is not empty."""
        return next((value for part in expression.split("||") if (value := self._atom(part.strip()))), "")

    def _atom(self, text: str) -> str:
        if found := re.fullmatch(r"format\('\{0\}(.*)', (.*)\)", text):
            return self._atom(found[2]) + found[1]
        return text.strip("'") if text[0] in "'0123456789" else self._known.get(text, "")

    def _true(self, condition: str) -> bool:
        """Conditions of comparisons that are joined by ``&&`` or ``||``, and ``always()``."""
        if "||" in condition:
            return any(map(self._true, condition.split("||")))
        return all(map(self._holds, condition.split("&&")))

    def _holds(self, comparison: str) -> bool:
        left, sign, right = re.fullmatch(r"\s*(\S+)(?: (==|!=|<) (\S+))?\s*", comparison).groups()
        if sign is None:
            return left in ("true", "always()")
        if sign == "<":
            return int(self._atom(left) or 0) < int(right)
        return (self._atom(left) == self._atom(right)) is (sign == "==")


def test_a_worse_policy_fails_the_job_and_the_summary_says_why(tmp_path: Path):
    corpus = str(ROOT / "corpus" / "mini-pick-up")
    job = Job(tmp_path, mode="regress", policy="frozen", label="v2", corpus=corpus)
    job.run()
    assert job.code == 1
    assert job.summary.startswith("```\nv2 (frozen) is worse than mini as recorded: 9 worse and 0 better of")
    results = tmp_path / "vlafuzz-results"
    assert json.loads((results / "regress.json").read_text())["alarm"]


@pytest.mark.slow
def test_failures_of_several_nights_are_in_one_store(tmp_path: Path):
    tiny = {"mode": "fuzz", "policy": "pinhole", "budget": "6", "controls": "4"}
    for night in (1, 2):
        job = Job(tmp_path, **tiny, seed=str(night), arguments="--strategy random")
        job.run()
        assert job.code == 0
        assert f"seed {night}" in job.summary
    results = tmp_path / "vlafuzz-results"
    with Store.open(results / "all.db") as store:
        assert [run.manifest.seed for run in store.runs()] == [1, 2]
    assert "<html" in (results / "report.html").read_text()
    assert not (results / "new.db").exists()


# In place of vlafuzz: says that the policy is worse.
WORSE = """#!/bin/sh
echo '{"verdict": "worse in '$2'", "changes": ""}'
exit 1
"""


def test_every_task_of_a_folder_of_corpora_is_compared(tmp_path: Path):
    for task in ("pick-up", "put-on"):
        (tmp_path / "corpora" / task).mkdir(parents=True)
        (tmp_path / "corpora" / task / "manifest.json").touch()
    job = Job(tmp_path, mode="regress", policy="p", corpus="corpora", task="all")
    (tmp_path / "bin" / "vlafuzz").write_text(WORSE)
    job.run()
    assert job.code == 1
    assert sorted(re.findall("worse in (.*)", job.summary)) == ["corpora/pick-up", "corpora/put-on"]
    assert (tmp_path / "vlafuzz-results" / "put-on" / "regress.json").is_file()


def test_names_tell_tasks_apart_and_fit_caches_and_artifacts(tmp_path: Path):
    kept = []
    for task in ("pick-up", "pick-up,put-on", "libero_object/0", "all"):
        job = Job(tmp_path, mode="none", policy="expert", task=task)
        job.run()
        kept.append(job.output("names", "kept"))
    assert kept == ["vlafuzz-pick-up", "vlafuzz-pick-up+put-on", "vlafuzz-libero_object-0", "vlafuzz-all"]
    names = [step["with"].get("key") or step["with"].get("name") for step in STEPS if "with" in step]
    assert all("steps.names.outputs.kept" in name for name in names if name)


def test_a_wrong_mode_or_name_fails_the_job(tmp_path: Path):
    for inputs in ({"mode": "regres", "policy": "expert"}, {"mode": "regress", "policy": "exprt", "corpus": "x"}):
        job = Job(tmp_path, **inputs)
        job.run()
        assert job.code == 2


def said_to(program: str, job: Job) -> list[str]:
    """The arguments of a program that fails, once the job is run."""
    stub = job.folder / "bin" / program
    stub.write_text('#!/bin/sh\nprintf "%s\\n" "$@" > said.txt\nexit 3\n')
    stub.chmod(0o755)
    job.run()
    return (job.folder / "said.txt").read_text().splitlines()


@pytest.mark.parametrize("mode", ["fuzz", "regress"])
def test_words_of_the_arguments_are_no_patterns_of_files(tmp_path: Path, mode: str):
    (tmp_path / "a.yaml").touch()
    words = said_to("vlafuzz", Job(tmp_path, mode=mode, policy="p", arguments="--operators *.yaml"))
    assert words[words.index("--operators") + 1] == "*.yaml"


def test_what_to_install_is_no_option_of_pip(tmp_path: Path):
    job = Job(tmp_path, mode="fuzz", policy="p")
    job._known["inputs.install"] = "--index-url=https://example.org"
    assert said_to("python", job)[-2:] == ["--", "--index-url=https://example.org"]


def test_a_run_that_could_not_judge_its_budget_fails_the_job_and_is_not_kept(tmp_path: Path):
    job = Job(tmp_path, mode="fuzz", policy="p")
    assert said_to("vlafuzz", job)[0] == "run"  # and nothing after it
    assert job.code == 3
    assert [step["uses"] for step in STEPS if "cache/save" in step.get("uses", "") and job._true(step["if"])] == []


def test_actions_of_others_are_pinned_by_their_commits():
    used = [step["uses"] for step in STEPS if "uses" in step]
    assert used
    assert [name for name in used if not re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", name)] == []


def test_no_step_puts_an_input_into_its_code():
    assert [step["name"] for step in STEPS if "${{" in step.get("run", "")] == []


def test_every_input_is_used_and_described():
    text = (ROOT / "action.yml").read_text(encoding="utf-8")
    for name, value in ACTION["inputs"].items():
        assert f"inputs.{name}" in text
        assert value["description"]

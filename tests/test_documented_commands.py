"""What the pages tell a reader to type is typed here, or the page says why not; flags exist in any case."""

import re
import sys
from pathlib import Path

import pytest

from tests.documentation import NOT_RUN, PAGES, ROOT, SLOW, blocks, calls, files
from vlafuzz.cli import COMMANDS, load, main

TEMPLATE = files(ROOT / "docs" / "your-policy.md")  # README's commands name it, too

OTHERS = {"--arms", "--flat", "--use-sim-policy-wrapper"}  # of our scripts, and of GR00T's server


def having(mark: str) -> list[Path]:
    return [page for page in PAGES if any(block.mark == mark for block in blocks(page))]


def name_of(page: Path) -> str:
    return page.name


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_block_of_commands_is_run_or_says_why_not(page):
    for block in blocks(page):
        if block.mark in ("", SLOW):
            assert {words[0] for words in block.commands} == {"vlafuzz"}
        else:
            assert block.mark.startswith(NOT_RUN)
            assert len(block.mark) > len(NOT_RUN) + 5


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_flags_on_a_page_exist(page):
    for _, name, *words in calls(page):
        if name.startswith("-") or name == "COMMAND":
            continue
        if name == "list" and words:
            name, *words = f"{name} {words[0]}", *words[1:]
        if name in ("list", "list WHAT"):
            continue
        command = load(name)
        flags = {word.partition("=")[0] for word in words if word.startswith("-")}
        params = [param for param in command.params if not getattr(param, "hidden", False)]
        known = {flag for param in params for flag in (*param.opts, *param.secondary_opts)}
        assert flags <= {*known, "--help"}, (name, *words)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_flags_that_a_page_names_belong_to_some_command(page):
    named = set(re.findall(r"`(--[a-z-]+)[^`]*`", page.read_text(encoding="utf-8")))
    params = [param for name in COMMANDS for param in load(name).params if not getattr(param, "hidden", False)]
    assert named <= {flag for param in params for flag in (*param.opts, *param.secondary_opts)} | OTHERS


@pytest.mark.usefixtures("few_random_scenes")
@pytest.mark.parametrize("page", having(""), ids=name_of)
def test_the_commands_of_a_page_work(page, tmp_path, monkeypatch):
    follow(page, {""}, tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("page", having(SLOW), ids=name_of)
def test_all_commands_of_a_page_work(page, tmp_path, monkeypatch):
    follow(page, {"", SLOW}, tmp_path, monkeypatch)


def follow(page: Path, marks: set[str], folder: Path, monkeypatch) -> None:
    """Type the commands of a page one after the other, in a folder with the files that it shows."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name, content in (TEMPLATE | files(page)).items():
        Path(name).write_text(content)
        monkeypatch.delitem(sys.modules, name.removesuffix(".py"), raising=False)
    for block in blocks(page):
        for words in block.commands if block.mark in marks else ():
            assert main(words[1:]) in (0, 1), words

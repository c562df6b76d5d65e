#!/usr/bin/env python3
"""Make the example of the documentation from one run: docs/example-report.html, its picture, and what README prints.

Takes some minutes, a renderer, and chromium with playwright (`pip install '.[dev]'`). tests/test_shown_causes.py
compares the results.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
# Of the seeds from 1 on the first whose causes are all certified, and fail from places on axes of the page on.
RUN = ("run", "--policy", "mini", "--task", "pick-up", "--budget", "120", "--seed", "3", "--store", "mini.db")
REPORT = ("report", "mini.db", "--limit", "3", "--out", "example-report.html")  # films of its causes
_CAUSES = re.compile(r"^Causes of run 1: .*?^Next, [^\n]*\n", re.DOTALL | re.MULTILINE)
_PROBABILITY = re.compile(r"failure probability of random scenes: ([\d.]+)% \(([\d.]+)–([\d.]+)%\)")
_RATE = re.compile(r"fails in [\d.]+ % \([\d.]+–[\d.]+ %\) of random scenes")


def vlafuzz(folder: Path, *words: str) -> str:
    """The output of a command that is typed in a folder, on a terminal as wide as README."""
    command = [sys.executable, "-m", "vlafuzz", *words]
    environment = os.environ | {"COLUMNS": "100", "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout


def photograph(page: Path, picture: Path) -> None:
    """The first screen of a page, as a JPEG."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        opened = browser.new_page(viewport={"width": 1400, "height": 620})
        opened.goto(page.as_uri())
        opened.wait_for_timeout(2000)  # until the films show their first pictures
        opened.screenshot(path=str(picture), type="jpeg", quality=85)
        browser.close()


def replace(path: Path, pattern: re.Pattern[str], new: str) -> None:
    old = path.read_text(encoding="utf-8")
    path.write_text(pattern.sub(lambda _: new, old), encoding="utf-8")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        told = re.sub(r" +$", "", vlafuzz(folder, *RUN), flags=re.MULTILINE)
        vlafuzz(folder, *REPORT)
        shutil.copy(folder / "example-report.html", DOCS)
    (causes,) = _CAUSES.findall(told)
    (rate,) = _PROBABILITY.findall((DOCS / "example-report.html").read_text(encoding="utf-8"))
    for page in (ROOT / "README.md", DOCS / "causes.md"):
        replace(page, _CAUSES, causes)
        replace(page, _RATE, f"fails in {rate[0]} % ({rate[1]}–{rate[2]} %) of random scenes")
    photograph(DOCS / "example-report.html", DOCS / "report.jpg")


if __name__ == "__main__":
    main()

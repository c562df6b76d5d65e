"""What a comparison says as SARIF: of names and places from a corpus that somebody sent."""

import json
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

from tests.failures.corpus.corpora import control, make_corpus
from tests.failures.corpus.sides import Planned
from vlafuzz.failures.corpus.corpus import Control
from vlafuzz.failures.corpus.pairs import probes
from vlafuzz.failures.corpus.regress import Recorded, compare
from vlafuzz.failures.corpus.sarif import write_sarif

HOSTILE = "open [the report](http://gpu/?) of {0} \\\\"


def test_texts_have_no_links_and_places_are_encoded(tmp_path: Path):
    named = [
        Control(replace(control(number).scene, instruction=HOSTILE), passed=True) for number in range(20)
    ]
    corpus = replace(make_corpus(), controls=tuple(named))
    compared = compare(probes(corpus), Planned(lambda number, repeat: False), Recorded("old"))
    write_sarif(compared, corpus, Path("sent [by] 5%/a:b c"), tmp_path / "a.sarif")
    alarm, *broken = json.loads((tmp_path / "a.sarif").read_text())["runs"][0]["results"]
    assert alarm["ruleId"] == "worse-policy"
    assert broken[0]["message"]["text"].startswith(
        "open \\[the report\\](http://gpu/?) of {{0}} \\\\\\\\ (control"
    )
    uri = broken[0]["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]
    assert uri == "sent%20%5Bby%5D%205%25/a%3Ab%20c/controls.jsonl"
    assert unquote(uri) == "sent [by] 5%/a:b c/controls.jsonl"

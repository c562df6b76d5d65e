"""How the pages are written: they begin with their question, and no sentence is longer than forty words."""

import re

import pytest

from tests.documentation import PAGES, ROOT

LONGEST = 40
_LEFT_OUT = re.compile(
    r"^```.*?^```$|<!--.*?-->|^\|.*?$|^#.*?$|^!\[.*?\]\(.*?\)$|^\s*\[!\[.*?$", re.DOTALL | re.MULTILINE
)
_LINK, _CODE = re.compile(r"!?\[([^\]]*)\]\([^)]*\)"), re.compile(r"`[^`]*`")
_PARAGRAPH, _END = re.compile(r"\n\s*\n|\n\s*(?=(?:[-*]|\d+\.) )"), re.compile(r"(?<=[.!?])[*\"”)]*\s+(?=\S)")


def sentences(page: str) -> list[str]:
    """The sentences of a page, without blocks, tables, headings, pictures and link targets; code counts as one word."""
    prose = _CODE.sub("code", _LINK.sub(r"\1", _LEFT_OUT.sub("", page)))
    return [" ".join(one.split()) for part in _PARAGRAPH.split(prose) for one in _END.split(part) if one.strip()]


def test_blocks_tables_and_targets_of_links_are_no_sentences():
    page = "# A title\n\n```text\nOne. Two.\n```\n\n| a | b. |\n\nSee [the page](its.md). `vlafuzz run it` is code.\n"
    assert sentences(page) == ["See the page.", "code is code."]


def test_each_item_of_a_list_is_a_sentence_of_its_own():
    assert sentences("It has\n\n- one thing;\n- another.\n") == ["It has", "- one thing;", "- another."]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_sentence_is_longer_than_forty_words(page):
    assert [one for one in sentences(page.read_text(encoding="utf-8")) if len(one.split()) > LONGEST] == []


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_a_page_begins_with_the_question_that_it_answers(page):
    _, _, first, *_ = page.read_text(encoding="utf-8").splitlines()
    assert re.fullmatch(r"This (page|documentation) answers: .*\?", first)

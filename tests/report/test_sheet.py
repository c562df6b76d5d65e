from tests.report.test_page import Page
from vlafuzz.report.page import render_sheet
from vlafuzz.report.sheet import Picture, Sheet, Table

ROWS = ({"strategy": "random", "cells": "7 (6–8)", "shown": "more"}, {"strategy": "mine", "cells": "–", "shown": ""})


def sheet(title: str = "Compared", rows: tuple[dict[str, str], ...] = ROWS) -> Page:
    page = Sheet(
        title=title,
        source="a.db",
        headline="All of it.",
        conclusions=("mine finds more",),
        pictures=(Picture("Curves", b"\x89PNG", "Two curves."),),
        tables=(Table("Found", rows, "medians"),),
    )
    return Page(render_sheet(page))


def test_a_sheet_has_all_its_parts():
    page = sheet()
    for part in ("Compared", "a.db", "All of it.", "mine finds more", "Curves", "Found", "medians", "7 (6–8)"):
        assert part in page.text


def test_its_pictures_are_inside_of_it_and_described():
    (picture,) = sheet().all("img")
    assert picture["src"] == "data:image/png;base64,iVBORw=="
    assert picture["alt"] == "Two curves."


def test_columns_of_numbers_are_set_to_the_right():
    table = Table("Found", ROWS)
    assert table.columns == {"strategy": False, "cells": True, "shown": False}
    assert [cell.get("class") for cell in sheet().all("td")] == ["number", None] * 2

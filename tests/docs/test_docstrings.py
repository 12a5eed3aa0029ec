"""Docstrings on the site: entries become lists, and nothing else changes."""

from __future__ import annotations

from docstrings import as_markdown


def test_entries_become_a_list() -> None:
    text = "What it is.\n\nname      : what it is\n            called\nshape, size: (n, 3); see there"
    expected = "What it is.\n\n- `name`: what it is called\n- `shape`, `size`: (n, 3); see there"
    assert as_markdown(text, {"name", "shape", "size"}) == expected


def test_several_entries_in_a_line_are_several_items() -> None:
    text = "name: what configs say. summary: one line; kind: of it"
    expected = "- `name`: what configs say.\n- `summary`: one line;\n- `kind`: of it"
    assert as_markdown(text, ["name", "summary", "kind"]) == expected


def test_what_stands_before_the_first_entry_stays_a_paragraph() -> None:
    text = "The letters\n(of the paper):\narea: A"
    assert as_markdown(text, ["area"]) == "The letters (of the paper):\n\n- `area`: A"


def test_sentences_and_code_stay_as_they_are() -> None:
    text = "Contract: called once.\nRaises OptionError: never.\n\n    name: of an example\n    x = 1"
    assert as_markdown(text, ["names", "area"]) == text

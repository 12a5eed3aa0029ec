"""The project's docstrings as Markdown, for the site and for generated tables.

A docstring says what its fields and arguments are in lines "name : meaning", several to a line where they are short. These
become a list; everything else stays as it is. `Entries` does it to all of the Python reference (mkdocs.yml names it).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

NAMED = re.compile(r"(?:^|(?<=[.;] ))(\w+(?:, \w+)*) *: (?=\S)", re.MULTILINE)


def parts(paragraph: str, names: Collection[str]) -> Iterator[tuple[str, str]]:
    """(names, meaning) of every entry in a paragraph; what stands before the first one has no names."""
    found = [match for match in NAMED.finditer(paragraph) if all(name in names for name in match[1].split(", "))]
    ends = [*(match.start() for match in found), len(paragraph)]
    if before := " ".join(paragraph[: ends[0]].split()):
        yield "", before
    for match, end in zip(found, ends[1:], strict=True):
        yield match[1], " ".join(paragraph[match.end() : end].split())


def as_markdown(text: str, names: Collection[str]) -> str:
    """`text` with a list item for every entry about one of `names`; paragraphs without any stay as they are."""
    paragraphs = re.split(r"\n\s*\n", text.strip("\n"))
    return "\n\n".join(_paragraph(each, list(parts(each, names))) for each in paragraphs)


def _paragraph(text: str, entries: list[tuple[str, str]]) -> str:
    if not any(name for name, _ in entries):
        return text
    lines = [f"- {code_names(name)}: {meaning}" if name else f"{meaning}\n" for name, meaning in entries]
    return "\n".join(lines)


def code_names(names: str) -> str:
    """ "a, b" as code."""
    return ", ".join(f"`{name}`" for name in names.split(", "))


def described_names(thing: Any) -> set[str]:
    """What the docstring of a griffe object may have entries about: its parameters, and the members of a class."""
    if thing.is_function:
        return {parameter.name for parameter in thing.parameters}
    if thing.is_class:
        return {*thing.all_members, *(parameter.name for parameter in thing.parameters)}
    return set()


def rewrite(thing: Any) -> None:
    """Rewrite the docstrings of `thing` and all below it; what is imported from elsewhere is left to its own place."""
    if thing.is_alias:
        return
    if thing.docstring is not None:
        thing.docstring.value = as_markdown(thing.docstring.value, described_names(thing))
    for member in thing.members.values():
        rewrite(member)


try:
    import griffe
except ImportError:  # the tables are generated without it
    pass
else:

    class Entries(griffe.Extension):
        """For mkdocstrings: every package's docstrings, rewritten once it is loaded."""

        def on_package(self, *, pkg: Any, **_: Any) -> None:
            rewrite(pkg)

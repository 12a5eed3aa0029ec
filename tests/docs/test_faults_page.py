"""docs/faults.md has the table of faults that the tests inject."""

from __future__ import annotations

import needs
from fault_kit import table


def test_the_page_has_every_injected_fault_and_what_comes_of_it() -> None:
    page = (needs.PROJECT / "docs" / "faults.md").read_text(encoding="utf-8")
    missing = [line for line in table().splitlines() if line not in page.splitlines()]
    assert not missing, "docs/faults.md lacks:\n" + "\n".join(missing)
    rows = [line for line in page.splitlines() if line.startswith(("| effect", "| heuristic", "| tracer", "| gbuffer"))]
    assert [line for line in rows if line not in table().splitlines()] == []

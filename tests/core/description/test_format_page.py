"""docs/scene_format.md cannot fall behind: its tables are those of the models, and its snippets load."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from phrt.description.document import Document
from phrt.description.reference import with_tables
from phrt.scene import Scene

PAGE = Path(__file__).resolve().parents[3] / "docs" / "scene_format.md"


def test_the_tables_are_fresh() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert with_tables(page) == page, "run: python -m phrt.description.reference docs/scene_format.md"
    assert "| `attenuation_distance` | number > 0 | `.inf` |" in page


def test_every_section_of_a_file_is_described() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in page for name in Document.model_fields)


def test_the_first_scene_loads(load: Callable[..., Scene]) -> None:
    first = re.search(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert first is not None
    scene = load(first[1])
    assert len(scene.objects) == 2
    assert len(scene.lights) == len(scene.cameras) == 1

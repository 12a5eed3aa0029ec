"""A page to look at in tests: a made-up comparison, its report, and a real browser without a network."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import needs

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
HOSTILE = "<img src=x onerror=a()>&'\"$x^2$"
"""What no page may run: a label, a title, a path."""


def browser_path() -> str:
    """A Chromium on PATH."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        needs.absent(f"no browser: none of {', '.join(BROWSERS)} is on PATH")
    return found


@contextmanager
def browser() -> Iterator[Any]:
    """A headless Chromium (playwright's Browser)."""
    api = needs.package("playwright.sync_api")
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=browser_path(), args=arguments)
        try:
            yield opened
        finally:
            opened.close()


class Visit:
    """A page that is open. said: what its console said, errors too; asked: what it asked the network for."""

    def __init__(self, page: Any, path: Path) -> None:
        self.page = page
        self.said: list[str] = []
        self.asked: list[str] = []
        page.on("console", lambda message: self.said.append(message.text))
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on("request", self._note)
        page.goto(path.as_uri())

    def _note(self, request: Any) -> None:
        if not request.url.startswith(("file:", "data:")):
            self.asked.append(request.url)


@contextmanager
def visit(opened: Any, path: Path, width: int = 1280, **options: Any) -> Iterator[Visit]:
    """The file at `path` in a window of `width` pixels, without a network."""
    context = opened.new_context(viewport={"width": width, "height": 800}, offline=True, **options)
    try:
        yield Visit(context.new_page(), path)
    finally:
        context.close()


def renamed(folder: Path, label: str, new: str, title: str | None = None) -> Path:
    """The comparison in `folder`, with another label for a contestant, and another title."""
    about = json.loads((folder / "bench.json").read_text())
    for cell in about["plan"]["cells"]:
        cell["label"] = new if cell["label"] == label else cell["label"]
    about["title"] = title or about["title"]
    (folder / "bench.json").write_text(json.dumps(about))
    for path in (folder / "cells").glob("*/cell.json"):
        settings = json.loads(path.read_text())
        settings["label"] = new if settings["label"] == label else settings["label"]
        path.write_text(json.dumps(settings))
    return folder

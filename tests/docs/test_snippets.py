"""Every snippet of README.md and docs/ runs as it is printed.

`python` snippets run as scripts. `bash` snippets run as scripts that stop at the first failure. In `console` snippets
the lines after "$ " run, and the other lines must appear in what they print ("..." stands for anything).
An HTML comment on the line before the fence changes that: `<!-- not run: REASON -->` leaves the snippet out,
`<!-- continues -->` puts the page's earlier python snippets in front of it. Snippets of a page run in order in one
scratch copy of the project's scenes and docs, with the environment's commands first in PATH.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import needs
import pytest

PROJECT = Path(__file__).resolve().parents[2]
PAGES = [PROJECT / "README.md", *sorted((PROJECT / "docs").rglob("*.md"))]
LANGUAGES = ("python", "bash", "console")
FENCE = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
TIME_LIMIT_S = 300


@dataclass(frozen=True)
class Snippet:
    language: str
    text: str
    line: int
    mark: str


def snippets(page: str) -> list[Snippet]:
    """The snippets of a page that can run, in order."""
    found = []
    for match in FENCE.finditer(page):
        before = page[: match.start()].rstrip("\n").rpartition("\n")[2].strip()
        mark = before if before.startswith("<!--") else ""
        if match[1] in LANGUAGES:
            found.append(Snippet(match[1], match[2], page[: match.start()].count("\n") + 1, mark))
    return found


def scratch_copy(folder: Path) -> Path:
    """A folder to run snippets in: a copy of what pages refer to."""
    for name in ("scenes", "docs"):
        shutil.copytree(PROJECT / name, folder / name)
    (folder / "out").mkdir()
    return folder


def run(command: list[str], folder: Path) -> str:
    """What `command` prints, standard error included. Fails the test when it fails."""
    search = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    environment = os.environ | {"PATH": search, "PHRT_ASSETS": str(needs.ASSETS)}
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=TIME_LIMIT_S,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def run_console(text: str, folder: Path) -> None:
    """Run the commands of a console snippet; the lines printed after each must be in its output."""
    for block in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        command, _, expected = block.partition("\n")
        printed = run(["bash", "-euo", "pipefail", "-c", command], folder)
        for line in filter(None, map(str.strip, expected.splitlines())):
            pattern = ".*".join(re.escape(part) for part in line.split("..."))
            assert re.search(pattern, printed), f"'{line}' is not in the output of '{command}':\n{printed}"


def run_page(page: str, folder: Path) -> int:
    """Run all snippets of a page, and say how many ran."""
    ran, earlier = 0, ""
    for snippet in snippets(page):
        if snippet.mark.startswith("<!-- not run:"):
            continue
        if snippet.language == "python":
            code = earlier + snippet.text if "continues" in snippet.mark else snippet.text
            run([sys.executable, "-W", "error", "-c", code], folder)
            earlier += snippet.text
        elif snippet.language == "bash":
            run(["bash", "-euo", "pipefail", "-c", snippet.text], folder)
        else:
            run_console(snippet.text, folder)
        ran += 1
    return ran


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(PROJECT)))
def test_every_snippet_of_the_page_runs(path: Path, tmp_path: Path) -> None:
    page = path.read_text()
    runnable = [s for s in snippets(page) if not s.mark.startswith("<!-- not run:")]
    assert run_page(page, scratch_copy(tmp_path)) == len(runnable)


def test_a_snippet_that_fails_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="boom"):
        run_page("```python\nraise ValueError('boom')\n```\n", tmp_path)
    with pytest.raises(AssertionError):
        run_page("```bash\nfalse\ntrue\n```\n", tmp_path)
    with pytest.raises(AssertionError, match="not in the output"):
        run_page("```console\n$ echo one\ntwo\n```\n", tmp_path)


def test_marks_leave_out_and_continue(tmp_path: Path) -> None:
    page = (
        "```python\na = 1\n```\n<!-- continues -->\n```python\nassert a == 1\n```\n"
        "<!-- not run: it would fail -->\n```bash\nfalse\n```\n```console\n$ echo first second\nfirst ...\n```\n"
    )
    assert run_page(page, tmp_path) == 3

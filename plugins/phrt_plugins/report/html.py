"""The page: what was gathered, put into the template, and written whole or not at all."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from phrt.errors import OptionError
from phrt.output.files import complete_file


def page_of(values: Mapping[str, Any]) -> str:
    """The HTML of a page. values: what the template names. Raises OptionError where jinja2 is missing."""
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError as error:
        raise OptionError(f"reports need jinja2 ({error}): pip install 'phrt[bench]'") from error
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    environment.filters["csv_link"] = csv_link
    environment.filters["breakable"] = breakable
    script = asset("script.js")
    return environment.from_string(asset("template.html.j2")).render(
        style=asset("style.css"), script=script, script_hash=content_hash(script), **values
    )


def breakable(text: str) -> Any:
    """Escaped text that may be broken after underscores and slashes."""
    from markupsafe import Markup, escape

    return Markup(escape(text).replace("_", Markup("_<wbr>")).replace("/", Markup("/<wbr>")))


def asset(name: str) -> str:
    """A file beside this one."""
    return files("phrt_plugins.report").joinpath(name).read_text(encoding="utf-8")


def content_hash(script: str) -> str:
    """What a content security policy names an inline script by: nothing else on the page may run."""
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")


def csv_link(text: str) -> str:
    """CSV as a data: link."""
    return "data:text/csv;charset=utf-8;base64," + base64.b64encode(text.encode(errors="replace")).decode("ascii")


def write_page(path: Path, page: str) -> None:
    """Write the page, whole or not at all. Raises OptionError where the system refuses."""
    with complete_file(path) as temporary:
        # What has no place in UTF-8, such as half a surrogate in a file name, becomes a question mark.
        temporary.write_bytes(page.encode("utf-8", errors="replace"))

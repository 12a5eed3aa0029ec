"""What `phrt new` writes: packages for plugins of one's own, and a scene to begin with; found, named, written whole or not at all.

A template is a package that works as it is, called `my_KIND`; writing one replaces that name in paths and text.
"""

from __future__ import annotations

import keyword
import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

import phrt
from phrt.errors import OptionError, PhrtError, did_you_mean
from phrt.interfaces.metric import RESERVED_COLUMNS
from phrt.registry.manager import get_registry

KINDS = ("heuristic", "effect", "tracer", "metric")
"""Plugins that there is a template for."""
SCENE = "scene"
SUFFIXES = (".toml", ".md", ".py", ".yaml")
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LONGEST_NAME = 40
OURS = ("backends", "heuristics", "plugins")
"""`phrt_` and one of these is a package of PHRT's own."""


def template_folder() -> Path:
    """Where the templates are: in an installed phrt beside its modules, in a checkout under plugins/template.

    Raises OptionError where neither is there.
    """
    package = Path(phrt.__file__).parent
    for folder in (package / "_template", package.parents[1] / "plugins" / "template"):
        if folder.is_dir():
            return folder
    raise OptionError(f"the templates of plugins are missing from this installation of PHRT: {package / '_template'}")


def template_files(kind: str) -> dict[str, str]:
    """The text of every file of the template for `kind`, by its path in the package.

    Raises OptionError for a kind that has none.
    """
    known = [*KINDS, SCENE]
    if kind not in known:
        raise OptionError(f"there is no template for '{kind}'. Known: {', '.join(known)}.{did_you_mean(kind, known)}")
    folder = template_folder() / kind
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix in SUFFIXES)
    relative = [path.relative_to(folder) for path in paths]
    hidden = [any(part.startswith((".", "__")) for part in path.parts[:-1]) for path in relative]
    return {
        inside.as_posix(): path.read_text(encoding="utf-8")
        for path, inside, hide in zip(paths, relative, hidden, strict=True)
        if not hide
    }


def class_name(name: str) -> str:
    """`my_name` as a class is called: MyName."""
    return "".join(part.capitalize() for part in name.split("_"))


def renamed(files: Mapping[str, str], kind: str, name: str) -> dict[str, str]:
    """`files` of the template for `kind` with `name` in place of its own, in paths and text."""
    placeholders = {
        f"my-{kind}": name.replace("_", "-"),
        f"my_{kind}": name,
        class_name(f"my_{kind}"): class_name(name),
    }

    def replaced(text: str) -> str:
        for placeholder, own in placeholders.items():
            text = text.replace(placeholder, own)
        return text

    return {replaced(path): replaced(text) for path, text in files.items()}


def check_name(kind: str, name: str, files: Mapping[str, str]) -> None:
    """Raises OptionError where what is new cannot be called `name`, and says why."""
    if not NAME.fullmatch(name) or len(name) > LONGEST_NAME:
        likely = re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()).strip("_0123456789")
        near = f" Did you mean '{likely}'?" if likely != name and NAME.fullmatch(likely) else ""
        raise OptionError(
            f"NAME is '{name}'; allowed: lower case letters, digits and single underscores, a letter first, at most "
            f"{LONGEST_NAME} of them, as in nearest_first.{near}"
        )
    if kind != SCENE and (taken := taken_by(kind, name, files)):
        raise OptionError(f"NAME is '{name}'; {taken}. Choose another name")


def taken_by(kind: str, name: str, files: Mapping[str, str]) -> str | None:
    """Who else has what a plugin called `name` brings: its name, its class or its column; None where nobody has."""
    for entry in get_registry().plugins(kind):
        if entry.name == name:
            whose = "PHRT has one" if entry.origin == "built-in" else f"{entry.source} has one"
            return f"{whose}, and names of {kind}s are unique"
    if keyword.iskeyword(class_name(name)):
        return f"{class_name(name)} is a word of Python's"
    own = class_name(f"my_{kind}")
    code = "\n".join(text for path, text in files.items() if path.endswith(".py"))
    others = set(re.findall(r"\b[A-Z]\w+", code)) - {own, f"{own}Options"}
    clash = sorted(others & {class_name(name), f"{class_name(name)}Options"})
    if clash or name in OURS:
        return f"PHRT itself has {clash[0] if clash else f'phrt_{name}'}"
    return column_owner(name) if kind == "metric" else None


def column_owner(name: str) -> str | None:
    """Whose column is called `name`, among all metrics that can be made here; None where it is free."""
    if name in RESERVED_COLUMNS:
        return f"every comparison has a column '{name}'"
    registry = get_registry()
    for entry in registry.plugins("metric"):
        try:
            columns = registry.create("metric", entry.name).columns
        except PhrtError:
            continue
        if any(column.name == name for column in columns):
            return f"metric '{entry.name}' has a column '{name}', and names of columns are unique"
    return None


def write_new(kind: str, name: str, parent: Path) -> list[Path]:
    """Write what is new into `parent`, whole or not at all: folder phrt-NAME with the package of a plugin, or the files of a scene.
    Returns the folder, or the files.

    Raises OptionError for a kind or a name that cannot be, a parent that is no folder or cannot be written, and for what exists.
    """
    files = template_files(kind)
    check_name(kind, name, files)
    if not parent.is_dir():
        raise OptionError(f"--dir is '{parent}', which is no folder")
    texts = renamed(files, kind, name)
    places = [parent / path for path in texts] if kind == SCENE else [parent / f"phrt-{name.replace('_', '-')}"]
    for place in places:
        if place.exists() or place.is_symlink():
            raise OptionError(f"'{place}' exists already; choose another name, or another folder with --dir")
    try:
        with tempfile.TemporaryDirectory(prefix=".phrt-new-", dir=parent) as scratch:
            written = Path(scratch) if kind == SCENE else Path(scratch) / places[0].name
            for path, text in texts.items():
                file = written / path
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(text, encoding="utf-8")
            # Only what is complete gets its place.
            for place in places:
                shutil.move(Path(scratch) / place.name, place)
    except OSError as error:
        raise OptionError(f"'{places[0]}' cannot be written: {error.strerror or error}") from error
    return places

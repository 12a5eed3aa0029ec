"""The plugin packages that `phrt new` writes: found, named and written whole or not at all.

A template is a package that works as it is, called `my_KIND`; writing one replaces that name in paths and text.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

import phrt
from phrt.errors import OptionError, did_you_mean
from phrt.registry.manager import get_registry

KINDS = ("heuristic", "effect", "tracer", "metric")
SUFFIXES = (".toml", ".md", ".py")
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
    if kind not in KINDS:
        raise OptionError(
            f"there is no template for '{kind}'. Known: {', '.join(KINDS)}.{did_you_mean(kind, [*KINDS])}"
        )
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
    """Raises OptionError where a plugin of `kind` cannot be called `name`, and says why."""
    if not NAME.fullmatch(name) or len(name) > LONGEST_NAME:
        likely = re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()).strip("_0123456789")
        near = f" Did you mean '{likely}'?" if likely != name and NAME.fullmatch(likely) else ""
        raise OptionError(
            f"NAME is '{name}'; allowed: lower case letters, digits and single underscores, a letter first, at most "
            f"{LONGEST_NAME} of them, as in nearest_first.{near}"
        )
    taken = {entry.name: entry.source for entry in get_registry().plugins(kind)}
    if name in taken:
        whose = "PHRT has one" if taken[name] == "built-in" else f"{taken[name]} has one"
        raise OptionError(f"NAME is '{name}'; {whose}, and names of {kind}s are unique. Choose another name")
    own = class_name(f"my_{kind}")
    code = "\n".join(text for path, text in files.items() if path.endswith(".py"))
    others = set(re.findall(r"\b[A-Z]\w+", code)) - {own, f"{own}Options"}
    clash = sorted(others & {class_name(name), f"{class_name(name)}Options"})
    if clash or name in OURS:
        raise OptionError(
            f"NAME is '{name}'; PHRT itself has {clash[0] if clash else f'phrt_{name}'}. Choose another name"
        )


def write_package(kind: str, name: str, parent: Path) -> Path:
    """Write the package of a new plugin into folder phrt-NAME of `parent`, whole or not at all; returns the folder.

    Raises OptionError for a kind or a name that cannot be, a parent that is no folder or cannot be written, and a folder that
    exists.
    """
    files = template_files(kind)
    check_name(kind, name, files)
    if not parent.is_dir():
        raise OptionError(f"--dir is '{parent}', which is no folder")
    target = parent / f"phrt-{name.replace('_', '-')}"
    if target.exists() or target.is_symlink():
        raise OptionError(f"'{target}' exists already; choose another name, or another folder with --dir")
    try:
        with tempfile.TemporaryDirectory(prefix=".phrt-new-", dir=parent) as scratch:
            package = Path(scratch) / target.name
            for path, text in renamed(files, kind, name).items():
                file = package / path
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(text, encoding="utf-8")
            # Only a package that is complete gets its place.
            shutil.move(package, target)
    except OSError as error:
        raise OptionError(f"'{target}' cannot be written: {error.strerror or error}") from error
    return target

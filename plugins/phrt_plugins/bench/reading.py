"""A benchmark's config, from its file: structure first, then `phrt_plugins.bench.checks` looks at what it names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from phrt.description.problems import Mark, Problems
from phrt.description.validation import validated
from phrt.description.values import Value, read_file, value_of
from phrt.errors import OptionError, SceneError
from phrt_plugins.bench.config import BenchConfig


@dataclass(frozen=True)
class ConfigFile:
    """A config and where its parts were written.

    value : as given, marks and all
    folder: what its paths are relative to
    text  : of the file; None where there is none
    """

    config: BenchConfig
    value: Value
    folder: Path
    text: str | None = None


def read_config(path: str | Path, changes: Iterable[str] = ()) -> ConfigFile:
    """The config in file `path`. changes: "key=value" of `--set`, such as "repeats=3" or "scenes.0.frames='0:20'".

    Raises OptionError with every problem: file, line, key, what was given and what is allowed.
    """
    file = Path(path).expanduser()
    if not file.is_file():
        raise OptionError(f"{file}: {'is not a file' if file.exists() else 'there is no such file'}")
    with said_of_configs():
        value = read_file(file, str(path))
        for change in changes:
            value = changed(value, change)
        return checked_config(value, file.resolve().parent, file.read_text(encoding="utf-8-sig"))


def config_of(values: Mapping[str, Any], folder: Path | None = None) -> ConfigFile:
    """The config that is given as plain Python data. Raises OptionError as `read_config`."""
    with said_of_configs():
        return checked_config(value_of(dict(values), Mark("config")), (folder or Path.cwd()).resolve())


def with_frames(file: ConfigFile, frames: str) -> ConfigFile:
    """`file` with these frames, "A:B" or "A", of every scene. Raises OptionError."""
    from phrt.cli.parsing import parse_frames

    chosen = parse_frames(frames)
    text = f"{chosen.first}:{chosen.stop}"
    scenes = [entry.model_copy(update={"frames": text}) for entry in file.config.scenes]
    return replace(file, config=file.config.model_copy(update={"scenes": scenes}))


def checked_config(value: Value, folder: Path, text: str | None = None) -> ConfigFile:
    """`value` against the models. Raises SceneError."""
    problems = Problems("config")
    if not isinstance(value.data, dict):
        keys = ", ".join(BenchConfig.model_fields)
        raise SceneError(f"{value.mark}: a benchmark is a mapping with {keys}; given {value.kind}")
    config = validated(BenchConfig, value, "", problems)
    problems.raise_if_any()
    assert config is not None
    return ConfigFile(config, value, folder, text)


def changed(value: Value, change: str) -> Value:
    """`value` with one "key=value" of `--set`. Raises OptionError for a key that leads nowhere."""
    key, equals, text = change.partition("=")
    if not (equals and key.strip()):
        raise OptionError(f"--set is '{change}', expected KEY=VALUE, as in repeats=3")
    from phrt.cli.parsing import parse_value

    mark = Mark(f"--set {change}")
    return _put(value, key.strip().split("."), value_of(parse_value(text), mark), change)


def _put(value: Value, steps: list[str], new: Value, change: str) -> Value:
    """`value` with `new` at the end of `steps`."""
    if not steps:
        return new
    first, rest = steps[0], steps[1:]
    if isinstance(value.data, list):
        if not first.isdigit() or int(first) >= len(value.data):
            raise OptionError(
                f"--set is '{change}': '{first}' is no entry; there are {len(value.data)}, counted from 0"
            )
        items = list(value.data)
        items[int(first)] = _put(items[int(first)], rest, new, change)
        return Value(items, value.mark)
    inner = value.data.get(first) if isinstance(value.data, dict) else None
    below = _put(inner or Value({}, new.mark), rest, new, change)
    if not isinstance(value.data, dict):
        return Value({first: below}, new.mark)
    return Value({**value.data, first: below}, value.mark)


@contextmanager
def said_of_configs() -> Iterator[None]:
    """The reader of scene files reads configs as well: messages then speak of configs, and are OptionErrors."""
    try:
        yield
    except SceneError as error:
        text = str(error).replace("a scene needs at least `prims:`", "a benchmark needs at least `name:`")
        text = text.replace("a scene file", "a config").replace("scene files", "configs")
        raise OptionError(text.replace("the prim: ", "the config: ")) from None

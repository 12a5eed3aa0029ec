"""Scene text as plain values that remember the line they were written on. YAML 1.2's types, and so JSON too.

The text is read event by event: nothing in it can construct an object, and size, depth and what aliases expand to are
bounded before anything is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml

from phrt.description.problems import Mark
from phrt.errors import SceneError

MAX_TEXT_BYTES = 32 * 1024 * 1024
MAX_DEPTH = 64
MAX_VALUES = 4_000_000

Scalar = str | int | float | bool | None

_INT = re.compile(r"[-+]?[0-9]+$")
_HEX = re.compile(r"0x[0-9a-fA-F]+$")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$")
_TAGS = (None, "!", *(f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "seq", "map")))
_WORDS: dict[str, Scalar] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf"), float("inf")),
    "-.inf": float("-inf"),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}


@dataclass(frozen=True)
class Value:
    """A value and its place. data: a scalar, a list of `Value`s, or a mapping of names to `Value`s."""

    data: Scalar | list[Value] | dict[str, Value]
    mark: Mark

    def plain(self) -> Any:
        """Without marks, as pydantic reads it."""
        if isinstance(self.data, dict):
            return {key: value.plain() for key, value in self.data.items()}
        if isinstance(self.data, list):
            return [value.plain() for value in self.data]
        return self.data

    def mark_of(self, location: tuple[int | str, ...]) -> Mark:
        """The mark of what lies at `location` (keys and indices), or of the deepest part of it that exists."""
        value = self
        for step in location:
            data = value.data
            if isinstance(data, dict) and step in data:
                value = data[str(step)]
            elif isinstance(data, list) and isinstance(step, int) and step < len(data):
                value = data[step]
        return value.mark

    @property
    def kind(self) -> str:
        """What it is, in the words of YAML."""
        if isinstance(self.data, dict):
            return "a mapping"
        if isinstance(self.data, list):
            return "a list"
        return "nothing" if self.data is None else f"{self.data!r}"


def value_of(data: Any, mark: Mark) -> Value:
    """Plain Python data (of an override, say) as a `Value` with one mark. Raises SceneError for other types."""
    if isinstance(data, Value):
        return data
    if isinstance(data, Mapping):
        return Value({str(key): value_of(item, mark) for key, item in data.items()}, mark)
    if isinstance(data, (list, tuple)):
        return Value([value_of(item, mark) for item in data], mark)
    if hasattr(data, "tolist"):
        return value_of(data.tolist(), mark)
    if data is None or isinstance(data, (str, int, float, bool)):
        return Value(data, mark)
    raise SceneError(
        f"{mark}: a {type(data).__name__} cannot be a value; allowed: numbers, text, true/false, lists, mappings"
    )


def merge(stronger: Value, weaker: Value) -> Value:
    """Mappings merged key by key, `stronger` winning; anything else is `stronger` alone."""
    if not (isinstance(stronger.data, dict) and isinstance(weaker.data, dict)):
        return stronger
    result = dict(weaker.data)
    for key, value in stronger.data.items():
        result[key] = merge(value, result[key]) if key in result else value
    return Value(result, stronger.mark)


def read_file(path: Path, shown: str) -> Value:
    """The one document in the YAML or JSON file `path`; `shown` is how messages call it. Raises SceneError."""
    try:
        if path.stat().st_size > MAX_TEXT_BYTES:
            raise SceneError(f"{shown}: {path.stat().st_size} bytes; a scene file may have at most {MAX_TEXT_BYTES}")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise SceneError(f"{shown}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{shown}: is not UTF-8 text (byte {error.start})") from None
    return read_text(text, shown, path)


def read_text(text: str, shown: str, path: Path | None = None) -> Value:
    """The one YAML or JSON document in `text`. Raises SceneError with file and line."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    reader = _Reader(shown, path)
    try:
        return reader.document(yaml.parse(text, Loader=loader))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 0
        raise SceneError(f"{Mark(shown, line)}: not valid YAML: {error.problem or error.context or error}") from None
    except yaml.YAMLError as error:
        raise SceneError(f"{shown}: not valid YAML: {str(error).splitlines()[0]}") from None


class _Reader:
    """Builds `Value`s from YAML events."""

    def __init__(self, shown: str, path: Path | None) -> None:
        self._shown = shown
        self._path = path
        self._anchors: dict[str, tuple[Value, int, int]] = {}
        self._count = 0
        self._deepest = 0

    def document(self, events: Iterator[yaml.Event]) -> Value:
        result: Value | None = None
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                if result is not None:
                    self._refuse(event, "a second YAML document; a scene file holds one")
                result = self._value(next(events), events, 1)
        if result is None:
            raise SceneError(f"{self._shown}: the file is empty; a scene needs at least `prims:`")
        return result

    def _value(self, event: yaml.Event, events: Iterator[yaml.Event], depth: int) -> Value:
        if depth > MAX_DEPTH:
            self._refuse(event, f"nested more than {MAX_DEPTH} levels deep")
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, depth)
        count_before, deepest_before = self._count, self._deepest
        self._deepest = depth
        self._counted(event, 1)
        tag = getattr(event, "tag", None)
        if tag not in _TAGS:
            self._refuse(event, f"the tag '{tag}' is not allowed; scene files are plain data")
        mark = self._mark(event)
        if isinstance(event, yaml.MappingStartEvent):
            value = Value(self._mapping(events, depth), mark)
        elif isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(item := next(events), yaml.SequenceEndEvent):
                items.append(self._value(item, events, depth + 1))
            value = Value(items, mark)
        else:
            assert isinstance(event, yaml.ScalarEvent)
            value = Value(self._scalar(event), mark)
        anchor = getattr(event, "anchor", None)
        if anchor is not None:
            self._anchors[anchor] = (value, self._count - count_before, self._deepest - depth)
        self._deepest = max(self._deepest, deepest_before)
        return value

    def _mapping(self, events: Iterator[yaml.Event], depth: int) -> dict[str, Value]:
        result: dict[str, Value] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                self._refuse(event, "a key must be a name")
            key = str(event.value)
            if key == "<<":
                self._refuse(event, "merge keys (<<) are not read; use sublayers, `over` or an alias for a whole value")
            if key in result:
                self._refuse(event, f"the key '{key}' is given twice, first on line {result[key].mark.line}")
            value = self._value(next(events), events, depth + 1)
            # A scalar stands where its key stands; so does the heading of a mapping.
            result[key] = Value(value.data, self._mark(event))
        return result

    def _alias(self, event: yaml.AliasEvent, depth: int) -> Value:
        name = str(event.anchor)
        if name not in self._anchors:
            self._refuse(event, f"the alias '*{name}' names no finished anchor above it")
        value, size, height = self._anchors[name]
        self._counted(event, size)
        if depth + height > MAX_DEPTH:
            self._refuse(event, f"nested more than {MAX_DEPTH} levels deep (aliases expanded)")
        self._deepest = max(self._deepest, depth + height)
        return value

    def _scalar(self, event: yaml.ScalarEvent) -> Scalar:
        text: str = event.value
        tag = event.tag
        if tag == "tag:yaml.org,2002:str" or (event.style is not None and event.style != "") or tag == "!":
            return text
        if text in _WORDS:
            return _WORDS[text]
        if _INT.match(text) and len(text) <= 20:
            return int(text)
        if _HEX.match(text) and len(text) <= 18:
            return int(text, 16)
        return float(text) if _FLOAT.match(text) else text

    def _counted(self, event: yaml.Event, count: int) -> None:
        self._count += count
        if self._count > MAX_VALUES:
            self._refuse(event, f"more than {MAX_VALUES} values (aliases expanded)")

    def _mark(self, event: yaml.Event) -> Mark:
        return Mark(self._shown, event.start_mark.line + 1 if event.start_mark else 0, self._path)

    def _refuse(self, event: yaml.Event, message: str) -> NoReturn:
        raise SceneError(f"{self._mark(event)}: {message}")

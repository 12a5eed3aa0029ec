"""JSON that is not trusted: the text is checked before it is parsed, and every value before it is used.

`Element` is a JSON object with its place in the file; its getters return a value of the right type and range or raise
AssetError naming the place. `Document` adds glTF's references between arrays ("mesh": 3).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, NoReturn

from phrt.errors import AssetError

MAX_JSON_TOKENS = 4_000_000
"""Most commas and brackets a file may have: a parsed JSON value is up to fifty times larger than its text."""

MAX_ENTRIES = 100_000
"""Most objects one JSON array may hold."""

MAX_WARNINGS = 50
"""Most different things said about one file."""

MAX_MAGNITUDE = 1e18
"""Numbers beyond this make infinities in float32 as soon as they are multiplied."""


def fail(where: str, reason: str) -> NoReturn:
    """Raise AssetError for a place in the file."""
    raise AssetError(f"{where}: {reason}")


def parse_json(text: bytes, where: str) -> dict[str, Any]:
    """The JSON object in `text`. AssetError when it is not UTF-8, malformed, too deep or large, or has a key twice."""
    if sum(text.count(token) for token in (b",", b"{", b"[")) > MAX_JSON_TOKENS:
        fail(where, f"has more than {MAX_JSON_TOKENS:,} JSON values")
    try:
        value = json.loads(text.decode("utf-8"), object_pairs_hook=_unique_keys, parse_constant=_no_constant)
    except UnicodeDecodeError as error:
        fail(where, f"is not UTF-8 (byte {error.start})")
    except RecursionError:
        fail(where, "is nested too deeply")
    except ValueError as error:
        fail(where, f"is not valid JSON: {error}")
    if not isinstance(value, dict):
        fail(where, f"must be a JSON object, not {json_type(value)}")
    return value


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"duplicate key {twice!r}")
    return values


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def json_type(value: Any) -> str:
    """What JSON calls a parsed value."""
    names: list[tuple[type, str]] = [(bool, "a boolean"), (dict, "an object"), (list, "an array"), (str, "a string")]
    if value is None:
        return "null"
    return next((name for kind, name in names if isinstance(value, kind)), "a number")


class Element:
    """One JSON object and where it stands in the file, such as `meshes[0].primitives[1]`."""

    __slots__ = ("data", "where")

    def __init__(self, data: dict[str, Any], where: str) -> None:
        self.data = data
        self.where = where

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def place(self, key: str) -> str:
        return f"{self.where}.{key}" if self.where else key

    def fail(self, key: str, reason: str) -> NoReturn:
        fail(self.place(key), reason)

    def _missing(self, key: str) -> NoReturn:
        fail(self.where or "glTF", f"has no '{key}', which is required")

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 2**53) -> int:
        """A whole number in [low, high]; required when there is no default."""
        if key not in self.data:
            return self._missing(key) if default is None else default
        return self.whole(self.data[key], self.place(key), low, high)

    @staticmethod
    def whole(value: Any, where: str, low: int, high: int) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int):
            fail(where, f"must be a whole number, not {value if isinstance(value, float) else json_type(value)}")
        if not low <= value <= high:
            given = value if abs(value) < 10**20 else "a huge number"
            fail(where, f"is {given}; it must be between {low} and {high}")
        return value

    @staticmethod
    def _number(value: Any, where: str, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            fail(where, f"must be a number, not {json_type(value)}")
        if not low <= value <= high:
            given = value if isinstance(value, float) or abs(value) < 10**20 else "a huge number"
            fail(where, f"is {given}; it must be between {low:g} and {high:g}")
        return float(value)

    def number(
        self, key: str, default: float | None = None, low: float = -MAX_MAGNITUDE, high: float = MAX_MAGNITUDE
    ) -> float:
        """A number in [low, high], finite; required when there is no default."""
        if key not in self.data:
            return self._missing(key) if default is None else default
        return self._number(self.data[key], self.place(key), low, high)

    def numbers(
        self,
        key: str,
        length: int | None,
        default: tuple[float, ...] | None = None,
        low: float = -MAX_MAGNITUDE,
        high: float = MAX_MAGNITUDE,
    ) -> tuple[float, ...]:
        """`length` numbers in [low, high] (any count when None); required when there is no default."""
        if key not in self.data:
            return self._missing(key) if default is None else default
        values, where = self.array(key), self.place(key)
        if length is not None and len(values) != length:
            fail(where, f"has {len(values)} numbers; it must have {length}")
        return tuple(self._number(value, f"{where}[{i}]", low, high) for i, value in enumerate(values))

    def string(self, key: str, default: str | None = None) -> str:
        """A string that can be printed (lone surrogates replaced); required when there is no default."""
        if key not in self.data:
            return self._missing(key) if default is None else default
        value = self.data[key]
        if not isinstance(value, str):
            self.fail(key, f"must be a string, not {json_type(value)}")
        return value.encode("utf-8", "replace").decode("utf-8")

    def boolean(self, key: str, default: bool = False) -> bool:
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {json_type(value)}")
        return value

    def child(self, key: str) -> Element | None:
        """The object under `key`, None where there is none."""
        if key not in self.data:
            return None
        value = self.data[key]
        if not isinstance(value, dict):
            self.fail(key, f"must be an object, not {json_type(value)}")
        return Element(value, self.place(key))

    def required(self, key: str) -> Element:
        """The object under `key`."""
        return self.child(key) or self._missing(key)

    def extension(self, name: str) -> Element | None:
        extensions = self.child("extensions")
        return extensions.child(name) if extensions else None

    def array(self, key: str) -> list[Any]:
        values = self.data[key]
        if not isinstance(values, list):
            self.fail(key, f"must be an array, not {json_type(values)}")
        return values

    def items(self, key: str) -> list[Element]:
        """The objects of the array under `key`; empty where there is none."""
        if key not in self.data:
            return []
        values, where = self.array(key), self.place(key)
        if len(values) > MAX_ENTRIES:
            fail(where, f"has {len(values):,} entries; at most {MAX_ENTRIES:,} are read")
        for i, value in enumerate(values):
            if not isinstance(value, dict):
                fail(f"{where}[{i}]", f"must be an object, not {json_type(value)}")
        return [Element(value, f"{where}[{i}]") for i, value in enumerate(values)]

    def strings(self, key: str) -> list[str]:
        if key not in self.data:
            return []
        values = self.array(key)
        if any(not isinstance(value, str) for value in values):
            self.fail(key, "must hold strings only")
        return [value.encode("utf-8", "replace").decode("utf-8") for value in values]


LISTS = (
    "accessors",
    "animations",
    "bufferViews",
    "buffers",
    "cameras",
    "images",
    "materials",
    "meshes",
    "nodes",
    "samplers",
    "scenes",
    "skins",
    "textures",
)


class Document:
    """A parsed glTF: its top-level arrays, references between them, and `warn`, which says each thing once."""

    def __init__(self, data: dict[str, Any], warn: Callable[[str], None]) -> None:
        self.root = Element(data, "")
        self.lists = {name: self.root.items(name) for name in LISTS}
        lights = self.root.extension("KHR_lights_punctual")
        self.lists["lights"] = lights.items("lights") if lights else []
        self._warn = warn
        self._warned: set[str] = set()

    def warn(self, message: str) -> None:
        """Pass `message` on, unless it was said before."""
        if message in self._warned or len(self._warned) > MAX_WARNINGS:
            return
        self._warned.add(message)
        self._warn(message if len(self._warned) <= MAX_WARNINGS else "has more faults than are listed")

    def refer(self, element: Element, key: str, target: str) -> int | None:
        """The index under `key` into the array `target`, None where absent. AssetError when it points nowhere."""
        return self._check(element.integer(key), element.place(key), target) if key in element else None

    def refer_required(self, element: Element, key: str, target: str) -> int:
        return self._check(element.integer(key), element.place(key), target)

    def refer_all(self, element: Element, key: str, target: str) -> list[int]:
        """The indices in the array under `key`; empty where there is none."""
        if key not in element:
            return []
        values, where = element.array(key), element.place(key)
        return [
            self._check(Element.whole(v, f"{where}[{i}]", 0, 2**53), f"{where}[{i}]", target)
            for i, v in enumerate(values)
        ]

    def _check(self, index: int, where: str, target: str) -> int:
        count = len(self.lists[target])
        if index >= count:
            fail(where, f"points at {target}[{index}], but there are {count} {target}")
        return index

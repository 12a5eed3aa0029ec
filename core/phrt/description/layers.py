"""Composition: sublayers, references to other descriptors, overs, variants and overrides become one flat set of prims.

Strength, strongest first: overrides of the caller, the selected variant, `over`, `prims`, sublayers in their order; and
what a file says about a path below a Reference is stronger than what the referenced file says there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from phrt.description.assets import AssetRoots
from phrt.description.document import FORMAT_VERSION, Document, Variant
from phrt.description.fields import PRIM_NAME
from phrt.description.prims import PRIM_TYPES
from phrt.description.problems import ELSEWHERE, Mark, Problems, listed
from phrt.description.values import Value, merge, read_file
from phrt.errors import AssetError, SceneError, did_you_mean

DESCRIPTOR_SUFFIXES = (".yaml", ".yml", ".json")
MAX_FILES = 256
MAX_PRIMS = 200_000
PATH_ATTRIBUTES = ("material", "inherits", "camera")
"""Attributes that hold prim paths; they move along when a descriptor is placed under a Reference."""


@dataclass(frozen=True)
class Opinion:
    """What is said about one prim. defined: by `prims`, or only overridden."""

    value: Value
    defined: bool


@dataclass
class Stage:
    """A composed scene: attributes by prim path, parents before children."""

    name: str
    prims: dict[str, Value] = field(default_factory=dict)
    overs: dict[str, Value] = field(default_factory=dict)
    """Opinions about paths that no descriptor defines: they must lie in referenced models."""
    variants: list[str] = field(default_factory=list)


Opinions = dict[str, Opinion]


class Composer:
    """Reads descriptors and everything they name. One use, one scene."""

    def __init__(self, roots: AssetRoots, problems: Problems) -> None:
        self._roots = roots
        self._problems = problems
        self._texts: dict[Path, Value] = {}
        self._layers = 0
        self.variant = "default"
        self.variants: list[str] = []

    def file(self, path: Path, variant: str | None, shown: str) -> tuple[str, Opinions]:
        """Name and opinions of the descriptor at `path`, references expanded."""
        value = self._read(path, shown)
        return self.document(value, path, variant)

    def document(self, value: Value, path: Path, variant: str | None) -> tuple[str, Opinions]:
        """Name and opinions of a descriptor already read from `path`."""
        if not isinstance(value.data, dict):
            self._problems.add(
                value.mark, "", f"a scene is a mapping with {listed(list(Document.model_fields))}; given {value.kind}"
            )
            return path.stem, {}
        chosen = variant or _text(value, "variant") or "default"
        known: dict[str, Mark] = {}
        self.variant = chosen
        opinions = self._layer(value, path, chosen, (path,), known)
        if chosen != "default" and chosen not in known:
            mark = value.mark_of(("variant",))
            names = ["default", *known]
            self._problems.add(
                mark, "", f"the variant '{chosen}' is not one of: {', '.join(names)}.{did_you_mean(chosen, names)}"
            )
        self.variants = list(dict.fromkeys(["default", *known]))
        self._expand(opinions, (path,))
        return _text(value, "name") or path.stem, opinions

    def _read(self, path: Path, shown: str) -> Value:
        if path not in self._texts:
            self._texts[path] = read_file(path, shown)
        return self._texts[path]

    @staticmethod
    def opinions(prims: Mapping[str, Value]) -> Opinions:
        """Opinions of prims that no file describes."""
        return {path: Opinion(value, defined=True) for path, value in prims.items()}

    # Layers

    def _layer(
        self, value: Value, path: Path, variant: str, chain: tuple[Path, ...], known: dict[str, Mark]
    ) -> Opinions:
        """Opinions of one file over those of its sublayers, weakest first."""
        self._layers += 1
        if self._layers > MAX_FILES:
            raise SceneError(f"{value.mark}: the scene reads more than {MAX_FILES} layers")
        sections = self._sections(value)
        result: Opinions = {}
        for sublayer in reversed(_items(sections.get("sublayers"))):
            for prim_path, opinion in self._sublayer(sublayer, path, variant, chain, known).items():
                _strengthen(result, prim_path, opinion)
        self._prims(sections.get("prims"), "", result)
        self._overs(sections.get("over"), result)
        variants = sections.get("variants")
        for name, entry in _entries(variants):
            known.setdefault(name, entry.mark)
            self._known_keys(entry, list(Variant.model_fields), f"variant '{name}'")
            if name == variant:
                parts = dict(_entries(entry))
                self._prims(parts.get("prims"), "", result)
                self._overs(parts.get("over"), result)
        return result

    def _sublayer(
        self, name: Value, path: Path, variant: str, chain: tuple[Path, ...], known: dict[str, Mark]
    ) -> Opinions:
        found = self._descriptor(name, path, "sublayers")
        if found is None:
            return {}
        if found in chain:
            cycle = " -> ".join(part.name for part in (*chain[chain.index(found) :], found))
            self._problems.add(name.mark, "", f"the sublayers form a cycle: {cycle}")
            return {}
        value = self._read(found, str(name.data))
        if not isinstance(value.data, dict):
            self._problems.add(value.mark, "", f"a scene is a mapping; given {value.kind}")
            return {}
        return self._layer(value, found, variant, (*chain, found), known)

    def _descriptor(self, name: Value, path: Path, what: str) -> Path | None:
        """The descriptor file `name` says, or None with a problem added."""
        if not isinstance(name.data, str) or Path(name.data).suffix.lower() not in DESCRIPTOR_SUFFIXES:
            self._problems.add(
                name.mark, "", f"{what}: given {name.kind}; wanted a file ending in {', '.join(DESCRIPTOR_SUFFIXES)}"
            )
            return None
        try:
            return self._roots.find(name.data, path.parent)
        except AssetError as error:
            self._problems.add(name.mark, "", f"{what}: {error}")
            return None

    def _sections(self, value: Value) -> dict[str, Value]:
        """The top-level sections with the right kinds of value."""
        self._known_keys(value, list(Document.model_fields), "the scene")
        sections = dict(_entries(value))
        kinds: dict[str, tuple[type, str]] = {
            "sublayers": (list, "a list of files"),
            **dict.fromkeys(("prims", "over", "variants"), (dict, "a mapping")),
            **dict.fromkeys(("name", "variant"), (str, "text")),
        }
        for key, (kind, wanted) in kinds.items():
            if key in sections and not isinstance(sections[key].data, kind):
                if sections[key].data is not None:
                    self._problems.add(sections[key].mark, "", f"{key}: given {sections[key].kind}; wanted {wanted}")
                del sections[key]
        version = sections.get("phrt")
        if version is not None and version.data != FORMAT_VERSION:
            self._problems.add(
                version.mark, "", f"phrt: given {version.kind}; this program reads format version {FORMAT_VERSION}"
            )
        return sections

    def _known_keys(self, value: Value, allowed: list[str], where: str) -> None:
        if not isinstance(value.data, dict):
            if value.data is not None:
                self._problems.add(value.mark, "", f"{where}: given {value.kind}; wanted a mapping")
            return
        for key, entry in value.data.items():
            if key not in allowed:
                message = ELSEWHERE.get(
                    key,
                    f"unknown key '{key}' in {where}; allowed: {', '.join(allowed)}.{did_you_mean(key, allowed)}",
                )
                self._problems.add(entry.mark, "", message)

    # Prims and overs

    def _prims(self, value: Value | None, parent: str, into: Opinions) -> None:
        """Add the prims of a `prims` section or of `children`, parents first."""
        seen: dict[str, str] = {}
        for name, entry in _entries(value):
            path = self._path_of(name, parent, entry.mark)
            if path is None:
                continue
            if path in seen:
                self._problems.add(entry.mark, path, f"this prim is given twice, as '{seen[path]}' and as '{name}'")
                continue
            seen[path] = name
            self._prim(path, entry, into)

    def _prim(self, path: str, entry: Value, into: Opinions) -> None:
        if not isinstance(entry.data, dict):
            if entry.data is not None:
                self._problems.add(entry.mark, path, f"a prim is a mapping of attributes; given {entry.kind}")
                return
            entry = Value({}, entry.mark)
        assert isinstance(entry.data, dict)
        children = entry.data.get("children")
        own = {key: value for key, value in entry.data.items() if key != "children"}
        _strengthen(into, path, Opinion(Value(own, entry.mark), defined=True))
        if children is not None and not isinstance(children.data, dict) and children.data is not None:
            self._problems.add(
                children.mark, path, f"children: given {children.kind}; wanted a mapping of names to prims"
            )
            return
        self._prims(children, path, into)

    def _overs(self, value: Value | None, into: Opinions) -> None:
        for name, entry in _entries(value):
            path = self._path_of(name, "", entry.mark)
            if path is None:
                continue
            if not isinstance(entry.data, dict):
                self._problems.add(entry.mark, path, f"over: given {entry.kind}; wanted a mapping of attributes")
                continue
            if "children" in entry.data:
                self._problems.add(entry.mark, path, "over: children are overridden by their own paths")
                continue
            _strengthen(into, path, Opinion(entry, defined=False))

    def _path_of(self, name: str, parent: str, mark: Mark) -> str | None:
        """The absolute path of `name` below `parent`, or None with a problem added."""
        if parent and name.startswith("/"):
            self._problems.add(mark, parent, f"'{name}': a child's name is relative to its parent")
            return None
        path = f"{parent}/{name.lstrip('/')}"
        for part in path[1:].split("/"):
            if not PRIM_NAME.match(part):
                self._problems.add(
                    mark,
                    parent,
                    f"'{name}' is not a prim name or path; names have no spaces, dots, colons, quotes or brackets",
                )
                return None
        return path

    # References to descriptors

    def _expand(self, opinions: Opinions, chain: tuple[Path, ...]) -> None:
        """Bring in what Reference prims to descriptors name, as opinions weaker than those at hand."""
        for path in list(opinions):
            value = opinions[path].value
            asset = _text(value, "asset")
            if (
                _text(value, "type") != "Reference"
                or asset is None
                or Path(asset).suffix.lower() not in DESCRIPTOR_SUFFIXES
            ):
                continue
            mark = value.mark_of(("asset",))
            assert isinstance(value.data, dict)
            if _text(value, "loader") is not None:
                message = f"loader: '{asset}' is a scene description, which no loader reads; leave it out"
                self._problems.add(value.mark_of(("loader",)), path, message)
            found = self._descriptor(value.data["asset"], mark.file or chain[-1], "asset")
            if found is None:
                continue
            if found in chain:
                cycle = " -> ".join(part.name for part in (*chain[chain.index(found) :], found))
                self._problems.add(mark, path, f"the references form a cycle: {cycle}")
                continue
            self._place(path, found, asset, value, (*chain, found), opinions)

    def _place(
        self, path: str, found: Path, shown: str, value: Value, chain: tuple[Path, ...], opinions: Opinions
    ) -> None:
        """Put the prims of descriptor `found` below `path`."""
        document = self._read(found, shown)
        if not isinstance(document.data, dict):
            self._problems.add(document.mark, "", f"a scene is a mapping; given {document.kind}")
            return
        variant = _text(value, "variant") or _text(document, "variant") or "default"
        known: dict[str, Mark] = {}
        inner = self._layer(document, found, variant, (found,), known)
        if variant != "default" and variant not in known:
            names = ["default", *known]
            mark = value.mark_of(("variant",))
            self._problems.add(
                mark, path, f"the variant '{variant}' is not one of: {', '.join(names)}.{did_you_mean(variant, names)}"
            )
        self._expand(inner, chain)
        if len(opinions) + len(inner) > MAX_PRIMS:
            raise SceneError(f"{value.mark}: {path}: the scene has more than {MAX_PRIMS} prims")
        for inner_path, opinion in inner.items():
            if _text(opinion.value, "type") == "RenderSettings":
                continue
            placed = Opinion(_moved(opinion.value, path), opinion.defined)
            _weaken(opinions, path + inner_path, placed)


def stage_of(name: str, opinions: Opinions, variants: list[str], problems: Problems) -> Stage:
    """Sort opinions into prims (parents made where they are missing, parents first) and overs of what models bring."""
    stage = Stage(name, variants=variants)
    references = [
        path for path, opinion in opinions.items() if opinion.defined and _text(opinion.value, "type") == "Reference"
    ]
    for path, opinion in opinions.items():
        if opinion.defined:
            _with_parents(stage, path, opinions)
        elif any(path.startswith(reference + "/") for reference in references):
            stage.overs[path] = opinion.value
        else:
            known = [other for other, entry in opinions.items() if entry.defined]
            problems.add(opinion.value.mark, path, f"over: there is no such prim.{did_you_mean(path, known)}")
    return stage


def _with_parents(stage: Stage, path: str, opinions: Opinions) -> None:
    """Add the prim at `path` after its parents; a parent nobody describes is an Xform."""
    value = opinions[path].value
    parts = path[1:].split("/")
    for depth in range(1, len(parts) + 1):
        parent = "/" + "/".join(parts[:depth])
        if parent not in stage.prims:
            known = opinions.get(parent)
            stage.prims[parent] = known.value if known else Value({"type": Value("Xform", value.mark)}, value.mark)


def overridden(opinions: Opinions, overrides: Mapping[str, Value], problems: Problems) -> None:
    """Add the caller's overrides, keyed "/World/Lamp.intensity" or "settings key", as the strongest opinions."""
    for key, value in overrides.items():
        path, _, attribute = split_key(key, opinions)
        if path is None:
            problems.add(value.mark, "", _neither(key.split(".")[0], opinions))
            continue
        if not attribute:
            problems.add(
                value.mark, path, "an override names an attribute: PRIM.ATTRIBUTE=VALUE, as in /World/Lamp.intensity=3"
            )
            continue
        nested = value
        for part in reversed(attribute.split(".")):
            nested = Value({part: nested}, value.mark)
        if path not in opinions and attribute and path == SETTINGS_PATH:
            nested = merge(nested, Value({"type": Value("RenderSettings", value.mark)}, value.mark))
            _strengthen(opinions, path, Opinion(nested, defined=True))
        else:
            _strengthen(opinions, path, Opinion(nested, defined=False))


def _neither(head: str, opinions: Opinions) -> str:
    """What is wrong with an override that begins with `head`, and the prim of that name or what is spelt like it."""
    named = [path for path in opinions if path.endswith(f"/{head}")]
    names = [*PRIM_TYPES["RenderSettings"].model_fields, "variant", *opinions]
    near = f" Did you mean '{named[0]}'?" if named else did_you_mean(head, names)
    return f"'{head}' is neither a prim nor a render setting; a prim's path begins with '/'.{near}"


SETTINGS_PATH = "/RenderSettings"


def split_key(key: str, opinions: Opinions) -> tuple[str | None, str, str]:
    """Prim path, "." and attribute path of an override's key. A key without a prim is a render setting."""
    head, slash, tail = key.rpartition("/")
    name, dot, attribute = tail.partition(".")
    path = f"{head}{slash}{name}"
    if slash or f"/{path}" in opinions:
        return "/" + path.lstrip("/"), dot, attribute
    if name in PRIM_TYPES["RenderSettings"].model_fields:
        settings = [p for p, opinion in opinions.items() if _text(opinion.value, "type") == "RenderSettings"]
        return (settings[0] if settings else SETTINGS_PATH), ".", key
    return None, dot, attribute


def _strengthen(opinions: Opinions, path: str, opinion: Opinion) -> None:
    weaker = opinions.get(path)
    opinions[path] = opinion if weaker is None else _over(opinion, weaker)


def _weaken(opinions: Opinions, path: str, opinion: Opinion) -> None:
    stronger = opinions.get(path)
    opinions[path] = opinion if stronger is None else _over(stronger, opinion)


def _over(stronger: Opinion, weaker: Opinion) -> Opinion:
    """Both opinions as one; a prim that is given another type starts anew."""
    types = (_text(stronger.value, "type"), _text(weaker.value, "type"))
    retyped = None not in types and types[0] != types[1]
    value = stronger.value if retyped else merge(stronger.value, weaker.value)
    return Opinion(value, stronger.defined or weaker.defined)


def _moved(value: Value, prefix: str) -> Value:
    """`value` with the prim paths it holds below `prefix`."""
    assert isinstance(value.data, dict)
    data = dict(value.data)
    for key in PATH_ATTRIBUTES:
        entry = data.get(key)
        if entry is not None and isinstance(entry.data, str) and entry.data.startswith("/"):
            data[key] = Value(prefix + entry.data, entry.mark)
    return Value(data, value.mark)


def _text(value: Value, key: str) -> str | None:
    """The text at `key` of a mapping, or None."""
    if not isinstance(value.data, dict) or key not in value.data:
        return None
    data = value.data[key].data
    return data if isinstance(data, str) else None


def _entries(value: Value | None) -> list[tuple[str, Value]]:
    return list(value.data.items()) if value is not None and isinstance(value.data, dict) else []


def _items(value: Value | None) -> list[Value]:
    return value.data if value is not None and isinstance(value.data, list) else []

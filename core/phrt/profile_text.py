"""A profile as text: one line an object where a designer edits, what was measured below."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from phrt.output.files import complete_file
from phrt.profile import Given, Measured, Profile

HEAD = """\
# Profile of {name}, written by `phrt analyze`. Use it with `phrt render SCENE --profile THIS_FILE`.
#
# objects: what is used, the objects that gain most from rays first. Change what you like:
#   importance   how much the object matters, a number or one per situation; 1 is ordinary, 2 twice as much
#   effects      {{shadows: always}} is traced first, never is never traced, auto is left to the heuristic
#   note         a remark of yours
# What you change is kept when the scene is analysed again (and listed under `edited`). A value that you delete
# is taken from the analysis. Comments are not kept; they say: what it is made of; how much of the picture it covers and in
# how many probes; how much tracing an effect changes at its pixels.
# measured: what the analysis found; written anew every time.
"""

_WIDTH = 4096
"""Columns before YAML breaks a line: objects stay on one."""


def profile_text(profile: Profile) -> str:
    """`profile` as a YAML file that `read_profile` reads."""
    parts = [HEAD.format(name=_one_line(profile.scene.name)), f"phrt_profile: {profile.phrt_profile}\n"]
    parts += [
        _section("scene", {"name": profile.scene.name, "objects": profile.scene.objects}),
        _section("probes", profile.probes.model_dump(mode="json")),
        _section("effects", {name: _rounded(cost.model_dump()) for name, cost in profile.effects.items()}),
        "\nobjects:\n",
    ]
    lines = [
        (f"  {_inline(path)}: {_inline(_given(given))}", _remark(profile, path))
        for path, given in profile.objects.items()
    ]
    width = min(max((len(line) for line, _ in lines), default=0), 100)
    parts += [f"{line:{width}}  # {remark}\n" for line, remark in lines]
    parts.append("\nmeasured:\n")
    parts += [f"  {_inline(path)}: {_inline(_measured(found))}\n" for path, found in profile.measured.items()]
    return "".join(parts)


def write_profile(path: Path, profile: Profile) -> None:
    """`profile` into file `path`, which is replaced only by something complete. Raises OptionError where it cannot be."""
    with complete_file(path) as temporary:
        temporary.write_text(profile_text(profile), encoding="utf-8")


def _section(name: str, content: Mapping[str, Any]) -> str:
    """A mapping, one line an entry."""
    lines = "".join(f"  {_inline(key)}: {_inline(value)}\n" for key, value in content.items())
    return f"\n{name}:{chr(10) + lines if lines else ' {}' + chr(10)}"


class _Dumper(yaml.SafeDumper):
    """Plain data only, and no text on several lines."""


def _text_node(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if text.isprintable() else '"')


_Dumper.add_representer(str, _text_node)


def _inline(data: Any) -> str:
    """YAML on one line."""
    text = yaml.dump(data, Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=_WIDTH, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...").strip()


def _given(given: Given) -> dict[str, Any]:
    """What of an object's line is not the default."""
    content: dict[str, Any] = {}
    if given.importance is not None:
        content["importance"] = _short(given.importance)
    content |= {name: value for name in ("effects", "note", "edited") if (value := getattr(given, name))}
    return content


def _measured(found: Measured) -> dict[str, Any]:
    content = _rounded(found.model_dump())
    content["importance"] = _short(content["importance"])
    return {name: value for name, value in content.items() if value not in ({}, 0, 0.0) or name == "seen"}


def _short(importance: Mapping[str, float]) -> Any:
    """One number where there is only the default."""
    return importance["default"] if list(importance) == ["default"] else dict(importance)


def _remark(profile: Profile, path: str) -> str:
    """What a designer wants to know about an object at a glance."""
    found = profile.measured.get(path)
    if found is None:
        return "not in the scene"
    probes = profile.probes.frames * len(profile.probes.situations)
    if not found.seen:
        return f"{found.kind}; in none of {probes}"
    changes = {
        effect: max(values.values()) for effect, values in found.change.items() if values and max(values.values()) > 0
    }
    most = sorted(changes.items(), key=lambda entry: -entry[1])
    said = "; " + ", ".join(f"{effect} {_percent(value)}" for effect, value in most) if most else ""
    return f"{found.kind}; {_percent(found.area)} in {found.seen}/{probes}{said}"


def _percent(share: float) -> str:
    return f"{share:.1%}" if share >= 0.0005 else "under 0.1%"


def _rounded(data: Any) -> Any:
    """Floats with three digits that count."""
    if isinstance(data, float):
        return float(f"{data:.3g}")
    if isinstance(data, Mapping):
        return {key: _rounded(value) for key, value in data.items()}
    return data


def _one_line(text: str) -> str:
    return " ".join(text.split())

"""`phrt doctor`: what runs on this machine, shown by running it, and what is missing where something does not."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from phrt.cli.console import escape, results
from phrt.cli.options import DebugOption, JsonOption, PluginOption
from phrt.errors import InputError, OptionError, did_you_mean
from phrt.registry.manager import RegisteredPlugin, Registry, describe, get_registry

PROBED_KINDS = ("tracer", "gbuffer")
REPORTED_PACKAGES = ("numpy", "numba", "embreex", "moderngl", "open3d", "trimesh", "av", "DracoPy")


@dataclass(frozen=True)
class Finding:
    """One backend. works: it was started and answered right; note: how it works, or why not and what to install."""

    kind: str
    name: str
    works: bool
    note: str


def doctor(
    require: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME,...", help="Leave with 1 when one of these backends does not work."),
    ] = None,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
    debug: DebugOption = False,
) -> None:
    """Check this machine: Python, threads, OpenGL, and one real ray or triangle through every backend."""
    registry = get_registry()
    required = check_required(registry, require or [])
    findings = examine(registry)
    report = machine() | {
        "opengl": opengl(registry),
        "auto": auto_choices(registry),
        "backends": [asdict(finding) for finding in findings],
        "broken_plugins": [str(broken) for broken in registry.broken],
        "kernel_cache": kernel_cache(),
    }
    missing = [finding for finding in findings if finding.name in required and not finding.works]
    report["missing"] = [finding.name for finding in missing]
    if as_json:
        print(json.dumps(report, indent=2))
    else:
        print_report(report)
    if missing:
        raise typer.Exit(1)


def check_required(registry: Registry, given: list[str]) -> list[str]:
    """The backends named, commas split. Raises OptionError where one is not a tracer or G-buffer producer at all."""
    names = [name.strip() for each in given for name in each.split(",") if name.strip()]
    known = [name for kind in PROBED_KINDS for name in registry.names(kind)]
    for name in names:
        if name not in known:
            near = did_you_mean(name, known)
            raise OptionError(f"--require names '{name}', which is no backend. Known: {', '.join(known)}.{near}")
    return names


def examine(registry: Registry) -> list[Finding]:
    """Every tracer, then every G-buffer producer: by its own word, then by trying it."""
    findings = [check(registry, entry, "") for entry in registry.plugins("tracer")]
    working = [finding.name for finding in findings if finding.works]
    chosen = auto_choices(registry)["tracer"]["name"]
    tracer = chosen if chosen in working or not working else working[0]
    return findings + [check(registry, entry, tracer) for entry in registry.plugins("gbuffer")]


def check(registry: Registry, entry: RegisteredPlugin, tracer: str) -> Finding:
    """One backend: available, and answering right?"""
    from phrt.cli.probes import probe_gbuffer, probe_tracer

    if reason := entry.unavailable_reason():
        return Finding(entry.kind, entry.name, False, reason)
    try:
        note = probe_tracer(registry, entry) if entry.kind == "tracer" else probe_gbuffer(registry, entry, tracer)
    except InputError as error:
        return Finding(entry.kind, entry.name, False, str(error))
    except (Exception, SystemExit) as error:
        return Finding(entry.kind, entry.name, False, f"it failed its trial: {describe(error)}")
    return Finding(entry.kind, entry.name, True, note)


def machine() -> dict[str, Any]:
    """Versions and processor."""
    from importlib.metadata import PackageNotFoundError, version

    from phrt.workers import usable_cores

    packages: dict[str, str | None] = {}
    for name in REPORTED_PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = None
    return {
        "phrt": version("phrt"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "threads": usable_cores(),
        "packages": packages,
    }


def opengl(registry: Registry) -> dict[str, Any]:
    """What every producer that has a device draws with, or why that cannot be told."""
    from phrt.registry.auto import gbuffer_device
    from phrt.registry.descriptors import Device

    found: dict[str, Any] = {}
    for entry in registry.plugins("gbuffer"):
        device = entry.unavailable_reason() or gbuffer_device(entry.plugin)
        if isinstance(device, Device):
            found[entry.name] = {"device": device.description, "hardware": device.is_hardware}
        elif device is not None:
            found[entry.name] = {"device": None, "reason": device}
    return found


def auto_choices(registry: Registry) -> dict[str, dict[str, str]]:
    """What `auto` picks, and why."""
    from phrt.registry.auto import choose_gbuffer, choose_tracer

    return {"gbuffer": asdict(choose_gbuffer(registry)), "tracer": asdict(choose_tracer(registry))}


def kernel_cache() -> dict[str, Any]:
    """Where compiled kernels are kept, and how many there are; with none, the first picture waits."""
    import phrt.kernels

    given = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(given) if given else Path(phrt.kernels.__file__).parent / "__pycache__"
    if not given and not os.access(folder if folder.exists() else folder.parent, os.W_OK):
        return {"folder": "the user's numba cache", "kernels": None}
    return {"folder": str(folder), "kernels": sum(1 for _ in folder.rglob("*.nbi")) if folder.exists() else 0}


def print_report(report: dict[str, Any]) -> None:
    """The report for people, one line a fact."""
    out = results()
    lines = [
        f"phrt     {report['phrt']}",
        f"python   {report['python']}, {report['platform']}",
        f"threads  {report['threads']}",
        "packages " + ", ".join(f"{name} {found or 'missing'}" for name, found in report["packages"].items()),
    ]
    for name, found in report["opengl"].items():
        kind = "" if found["device"] is None else (", a GPU" if found["hardware"] else ", on the processor")
        lines.append(f"OpenGL   {name}: {found['device'] or found['reason']}{kind}")
    for kind, choice in report["auto"].items():
        lines.append(f"auto     {kind} {choice['name']}: {choice['reason']}")
    cache = report["kernel_cache"]
    count = "" if cache["kernels"] is None else f", {cache['kernels']} kernels compiled"
    lines.append(f"kernels  {cache['folder']}{count}")
    for line in lines:
        out.print(line, markup=False)
    out.print("")
    for finding in report["backends"]:
        mark = "[green]works[/green]  " if finding["works"] else "[red]missing[/red]"
        note = f": {finding['note']}" if finding["note"] else ""
        out.print(f"{mark} {finding['kind']} {finding['name']}{escape(note)}")
    for broken in report["broken_plugins"]:
        out.print(f"[red]broken[/red]  {escape(broken)}")
    if report["missing"]:
        out.print(f"\nrequired and missing: {', '.join(report['missing'])}", style="red", markup=False)

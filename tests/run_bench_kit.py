"""A small benchmark to run, for tests: a scene of three balls and a config, written into a folder, and what a run of it left."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import needs
import yaml
from cli_kit import Outcome, phrt

needs.package("pyarrow")

SCENE = """
phrt: 1
name: Three balls
prims:
  Floor: {type: Plane, size: [12, 12]}
  Mirror: {type: Sphere, radius: 0.5, xform: {translate: [-1.1, 0.5, 0]}, material: /Chrome}
  Glass: {type: Sphere, radius: 0.5, xform: {translate: [0.1, 0.5, 0.4]}, material: /Clear}
  Clay: {type: Sphere, radius: 0.5, xform: {translate: [1.3, 0.5, 0]}}
  Chrome: {type: Material, base_color: 0.95, metallic: 1.0, roughness: 0.0}
  Clear: {type: Material, roughness: 0.0, transmission: 1.0, ior: 1.5, thickness: 1.0}
  Lamp: {type: SphereLight, intensity: 50, xform: {translate: [2, 4, 3]}}
  Sky: {type: DomeLight, intensity: 0.5}
  Eye:
    type: Camera
    fov: 40
    path:
      keys:
        - {time: 0.0, eye: [0, 1.7, 5.0], target: [0, 0.4, 0]}
        - {time: 1.0, eye: [2, 1.9, 4.6], target: [0, 0.4, 0]}
  Settings: {type: RenderSettings, fps: 30, frames: 24}
"""

CONFIG: dict[str, Any] = {
    "name": "small",
    "scenes": [{"scene": "balls.yaml", "frames": "0:12"}],
    "sizes": ["64x36"],
    "budgets": ["half"],
    "heuristics": ["gain", "selection_graph"],
    "tracers": ["embree"],
    "gbuffers": ["raycast"],
    "clock": {"rays": 100},
    "block": 4,
    "warm_up": 2,
    "judge_every": 2,
    "pictures": 2,
    "metrics": ["error", "temporal"],
}


def write_config(folder: Path, **changes: Any) -> Path:
    """The scene and a config, CONFIG with `changes`, in `folder`; the config's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "balls.yaml").write_text(SCENE, encoding="utf-8")
    path = folder / "config.yaml"
    path.write_text(yaml.safe_dump({**CONFIG, **changes}, sort_keys=False), encoding="utf-8")
    return path


def bench(config: Path, run: Path, *arguments: str) -> Outcome:
    """`phrt bench CONFIG -o RUN ARGUMENTS`, in this process; references are kept beside the config."""
    cache = config.parent / "cache"
    return phrt("bench", str(config), "-o", str(run), "--cache", str(cache), "--quiet", *arguments)


def cells(run: Path) -> dict[str, Path]:
    """Cells by label, where labels tell them apart."""
    import json

    return {json.loads((path / "cell.json").read_text())["label"]: path for path in (run / "cells").iterdir()}


def results(run: Path) -> dict[str, str]:
    """Hashes of everything that a run came to and that depends on no clock, by path: measures, decisions, pictures, settings."""
    wanted = ("measures.parquet", "candidates.parquet", "cell.json")
    found = [
        p for p in run.rglob("*") if p.is_file() and (p.name in wanted or p.suffix == ".png" or "oracle" in p.parts)
    ]
    return {p.relative_to(run).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(found)}


def table(path: Path) -> dict[str, list[Any]]:
    """A Parquet file by column."""
    import pyarrow.parquet

    columns: Mapping[str, list[Any]] = pyarrow.parquet.ParquetFile(path).read().to_pydict()
    return dict(columns)

"""What the registry costs a frame: nothing. It is asked while a renderer is made, and never while one renders."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from scene_kit import LAMBERT, Stage, at, ball

from phrt.registry import manager
from phrt.renderer import Renderer


def test_a_frame_asks_the_registry_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: Counter[str] = Counter()
    counting = False

    def counted(name: str) -> None:
        original = getattr(manager.Registry, name)

        def wrapper(self: Any, *arguments: Any, **named: Any) -> Any:
            asked[name] += counting
            return original(self, *arguments, **named)

        monkeypatch.setattr(manager.Registry, name, wrapper)

    for name in ("plugins", "names", "find", "get", "create", "loader_for"):
        counted(name)
    stage = Stage().add("/ball", ball(0.5, 1), LAMBERT, at(0, 0, 0)).camera((0, 0, 3), (0, 0, 0))
    counting = True
    with Renderer(stage.scene, size=(32, 18), heuristic="gain", budget="500rays") as renderer:
        made = dict(asked)
        for index in range(3):
            renderer.render(index / 30, frame_index=index)
        assert dict(asked) == made
        assert made["create"] >= 5  # G-buffer, tracer, heuristic, and the effects
        renderer.restart(heuristic="greedy_ratio")
        assert asked["create"] > made["create"]

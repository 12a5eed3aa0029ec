"""PHRT: rasterize everything, ray trace only what pays.

    import phrt

    scene = phrt.load_scene("scenes/atrium.yaml")
    with phrt.Renderer(scene, size=(640, 360)) as renderer:
        frame = renderer.render(time=1.5)

The names below are the public API. They are imported when they are first used, so that `import phrt` stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phrt.errors import (
        AssetError,
        InputError,
        OptionError,
        PhrtError,
        PhrtWarning,
        PluginError,
        ProfileError,
        SceneError,
    )
    from phrt.loading import load_scene
    from phrt.registry.manager import register
    from phrt.renderer import Renderer
    from phrt.scene import Scene
    from phrt.world import World

    __version__: str

__all__ = [
    "AssetError",
    "InputError",
    "OptionError",
    "PhrtError",
    "PhrtWarning",
    "PluginError",
    "ProfileError",
    "Renderer",
    "Scene",
    "SceneError",
    "World",
    "__version__",
    "load_scene",
    "register",
]

_ERRORS = (
    "AssetError", "InputError", "OptionError", "PhrtError", "PhrtWarning", "PluginError", "ProfileError", "SceneError",
)  # fmt: skip

_HOME = dict.fromkeys(_ERRORS, "phrt.errors") | {
    "Renderer": "phrt.renderer",
    "Scene": "phrt.scene",
    "World": "phrt.world",
    "load_scene": "phrt.loading",
    "register": "phrt.registry.manager",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        value: object = version("phrt")
    elif name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
    else:
        raise AttributeError(f"module 'phrt' has no attribute '{name}'")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

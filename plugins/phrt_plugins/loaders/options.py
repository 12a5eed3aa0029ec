"""The options of the scene loaders: what a scene descriptor may say beside `asset:`."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options


class GltfOptions(Options):
    """Options of the glTF loader."""

    scene: int | str | None = Field(
        default=None,
        description="Which of the file's scenes to load, by index or name; the file's default scene when absent.",
    )
    animation: int | str | None = Field(
        default=None,
        description="Which of the file's animations to play, by index or name; all of them when absent.",
    )
    max_texture_size: int = Field(
        default=8192,
        ge=1,
        le=16384,
        description="Textures wider or higher than this many pixels are made smaller when they are read.",
    )

"""Options of the `moderngl` G-buffer producer. Light: nothing here imports OpenGL."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options


class ModernglOptions(Options):
    """Options of the `moderngl` G-buffer producer."""

    device: int = Field(default=0, ge=0, description="Which EGL device draws, counted from 0 as EGL lists them.")
    cull: bool = Field(default=True, description="Leave out triangle clusters outside the view; off only to compare.")

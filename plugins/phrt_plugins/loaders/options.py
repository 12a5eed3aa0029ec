"""The options of the scene loaders: what a scene descriptor may say beside `asset:`."""

from __future__ import annotations

from typing import Any, Literal

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
        json_schema_extra={"unit": "texels"},
        description="Textures wider or higher than this many pixels are made smaller when they are read.",
    )


class AtriumOptions(Options):
    """Options of the procedural atrium."""

    bays_x: int = Field(
        default=6,
        ge=2,
        le=40,
        json_schema_extra={"unit": "bays"},
        description="Open bays of the courtyard along X; a bay is 3 m.",
    )
    bays_z: int = Field(
        default=4, ge=2, le=40, json_schema_extra={"unit": "bays"}, description="Open bays of the courtyard along Z."
    )
    storeys: int = Field(
        default=2,
        ge=1,
        le=4,
        json_schema_extra={"unit": "storeys"},
        description="Gallery levels; the ground floor is vaulted, the top is timbered.",
    )
    detail: float = Field(
        default=1.0,
        ge=0.25,
        le=4.0,
        description="How finely round things are divided; triangles grow with its square at most.",
    )
    seed: int = Field(default=7, ge=0, description="Equal seeds give equal textures and equal small variations.")
    statues: int = Field(
        default=6, ge=0, le=64, description="Statues on plinths, in the courtyard first, then the galleries."
    )
    spheres: int = Field(default=10, ge=0, le=64, description="Spheres on the floor, mirrors and glass in turn.")


class MeshOptions(Options):
    """Options of the OBJ, PLY and STL loader."""

    normals: Literal["auto", "smooth", "flat"] = Field(
        default="auto",
        description="auto: the file's own, computed where it has none; smooth: always computed; flat: one a triangle.",
    )
    crease_angle: float = Field(
        default=45.0,
        ge=0.0,
        le=180.0,
        json_schema_extra={"unit": "degrees"},
        description="Computed normals are smooth across edges whose faces differ by at most this many degrees.",
    )
    weld: bool = Field(
        default=True, description="Computed normals are smooth across vertices that lie at exactly one place."
    )
    group_by: Literal["auto", "object", "group", "none"] = Field(
        default="auto",
        description="What becomes an object of an OBJ file: its `o`, its `g`, or the whole file; auto: `o`, else `g`.",
    )
    max_texture_size: int = Field(
        default=8192,
        ge=1,
        le=16384,
        json_schema_extra={"unit": "texels"},
        description="Textures wider or higher than this are made smaller when read.",
    )


class SimplifiedOptions(Options):
    """Options of the loader that simplifies what another loader reads."""

    share: float = Field(default=0.25, gt=0.0, le=1.0, description="Share of its triangles that every mesh keeps.")
    of: str | None = Field(
        default=None, description="The other loader by name; by default the one that reads files like this one."
    )
    options: dict[str, Any] = Field(default_factory=dict, description="Options of the other loader.")

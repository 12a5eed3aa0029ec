"""Every prim type and its attributes. One `Field` holds an attribute's default, range, unit and meaning.

Names and meanings follow OpenUSD (UsdGeom, UsdLux, UsdShade) and glTF 2.0 materials.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, field_validator, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from phrt.description.fields import (
    BudgetText,
    Color,
    Described,
    Flag,
    Importance,
    Matrix,
    NotNegative,
    Pair,
    Positive,
    PrimPath,
    Quaternion,
    Real,
    RealOrInf,
    Scale,
    Text,
    Triple,
    Unit,
    Whole,
)
from phrt.limits import MAX_SIDE, MOST_FRAMES

Switch = Literal["auto", "always", "never"]
Interpolation = Literal["step", "linear", "smooth"]


class Key(Described):
    """One keyframe of an animation. What a key leaves out stays as the `xform` says."""

    time: NotNegative = Field(description="Seconds from the start.")
    translate: Triple | None = Field(None, description="Metres.")
    rotate: Triple | None = Field(None, description="Degrees about X, then Y, then Z.")
    scale: Scale | None = Field(None, description="Factor, or one per axis.")


class Animation(Described):
    """Keyframes of a prim's place. Angles are interpolated as given, so 0 to 360 is a whole turn."""

    interpolation: Interpolation = Field("linear", description="smooth is a Catmull-Rom curve through the keys.")
    keys: list[Key] = Field(min_length=1, description="At rising times.")

    @model_validator(mode="after")
    def _check(self) -> Animation:
        _rising([key.time for key in self.keys])
        for name in ("translate", "rotate", "scale"):
            given = [getattr(key, name) is not None for key in self.keys]
            if any(given) and not all(given):
                raise ValueError(f"'{name}' must be given in every key or in none")
        return self


class Xform(Described):
    """A place: scale first, then rotation, then translation; or a whole matrix."""

    translate: Triple | None = Field(None, description="Metres.")
    rotate: Triple | None = Field(None, description="Degrees about X, then Y, then Z (USD rotateXYZ).")
    quaternion: Quaternion | None = Field(None, description="x, y, z, w; instead of rotate.")
    scale: Scale | None = Field(None, description="Factor, or one per axis.")
    matrix: Matrix | None = Field(
        None, description="Four rows, translation in the last column; instead of all the others."
    )
    animation: Animation | None = Field(
        None, description="Keyframes that replace translate, rotate or scale over time."
    )

    @model_validator(mode="after")
    def _check(self) -> Xform:
        if self.rotate is not None and self.quaternion is not None:
            raise ValueError("rotate and quaternion exclude each other")
        others = [name for name in type(self).model_fields if name != "matrix" and getattr(self, name) is not None]
        if self.matrix is not None and others:
            raise ValueError(f"matrix excludes {', '.join(others)}")
        if self.matrix is not None and self.matrix[3] != (0.0, 0.0, 0.0, 1.0):
            raise ValueError("the last row of matrix must be [0, 0, 0, 1]; the translation is the last column")
        if self.quaternion is not None and sum(part * part for part in self.quaternion) < 1e-12:
            raise ValueError("quaternion must not be zero")
        return self


class PrimBase(Described):
    """What every prim may say."""

    xform: Xform | None = Field(None, description="Place relative to the parent prim.")
    material: PrimPath | None = Field(
        None, description="Path of a Material; holds for everything below, also for what models bring along."
    )
    importance: Importance | None = Field(
        None, description="How much the object matters: a number, or one per situation. Inherited."
    )
    effects: dict[Text, Switch] = Field(
        default_factory=dict, description="Per effect auto (the heuristic decides), always or never. Inherited."
    )
    tags: list[Text] = Field(
        default_factory=list, description="What it is, for heuristics that follow attention. Added to those above."
    )
    casts_shadow: Flag | None = Field(
        None, description="Does it block light (objects), or do others block it (lights)? Inherited; default true."
    )
    visible: Flag = Field(True, description="false leaves the prim and everything below out of the scene.")


class Prim(PrimBase):
    children: dict[str, AnyPrim] = Field(default_factory=dict, description="Prims below this one, by name.")


def _rising(times: list[float]) -> None:
    for before, after in pairwise(times):
        if after <= before:
            raise ValueError(f"keys must be at rising times; {after:g} follows {before:g}")


class XformPrim(Prim):
    """A group: a place that its children share."""

    type: Literal["Xform"] = "Xform"


class Split(Described):
    """How one huge mesh becomes several objects that can be chosen one by one."""

    by: Literal["none", "material", "components", "grid"] = Field(
        "none", description="material: one object per material; components: per connected part; grid: per cell."
    )
    cells: tuple[Whole, Whole, Whole] | None = Field(
        None, description="Cells along X, Y, Z of the mesh's bounds; grid only."
    )
    size: Positive | None = Field(
        None, description="Edge of a cell in the mesh's own units; grid only, instead of cells."
    )
    min_triangles: Whole = Field(0, ge=0, description="Meshes with fewer triangles stay whole.")

    @model_validator(mode="after")
    def _check(self) -> Split:
        if self.by != "grid" and (self.cells is not None or self.size is not None):
            raise ValueError("cells and size belong to `by: grid`")
        if self.cells is not None and self.size is not None:
            raise ValueError("cells and size exclude each other")
        if self.cells is not None and (min(self.cells) < 1 or self.cells[0] * self.cells[1] * self.cells[2] > 100_000):
            raise ValueError("cells must be at least 1 each, and at most 100000 together")
        return self


def _split(value: Any) -> Any:
    return {"by": value} if isinstance(value, str) else value


class _OrMode:
    """Says in the JSON Schema that the mode alone will do."""

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [{"enum": ["none", "material", "components", "grid"]}, handler(core)]}


SplitOptions = Annotated[Split, BeforeValidator(_split), _OrMode()]


class SplitField(Described):
    """Mixed into prims that read files or hold large meshes."""

    split: SplitOptions = Field(default_factory=Split, description="A mode, or a mapping with its options.")


class MeshPrim(Prim, SplitField):
    """Triangles: inline points and faces, or all of a model file's surfaces as one object."""

    type: Literal["Mesh"]
    asset: Text | None = Field(None, description="Model file; its hierarchy is dropped, its materials stay.")
    points: list[Triple] | None = Field(None, description="Vertices, metres.")
    faces: list[list[Annotated[Whole, Field(ge=0)]]] | None = Field(
        None, description="Convex polygons: indices of points, counter-clockwise from the front."
    )
    normals: list[Triple] | None = Field(None, description="One per point.")
    uv: list[Pair] | None = Field(None, description="One per point; v runs down, as in glTF.")
    smooth: Flag = Field(False, description="Smooth normals where none are given, instead of flat ones.")
    options: dict[str, Any] = Field(default_factory=dict, description="The loader's own options.")

    @model_validator(mode="after")
    def _check(self) -> MeshPrim:
        inline = self.points is not None and self.faces is not None
        if (self.asset is None) == (not inline) or (self.asset is not None and (self.points or self.faces)):
            raise ValueError("give either asset, or points and faces")
        for name in ("normals", "uv"):
            values = getattr(self, name)
            if values is not None and (self.points is None or len(values) != len(self.points)):
                raise ValueError(f"{name} needs one entry per point")
        for number, face in enumerate(self.faces or []):
            if len(face) < 3:
                raise ValueError(f"faces[{number}] has {len(face)} corners; a face needs at least 3")
            if max(face) >= len(self.points or []):
                raise ValueError(
                    f"faces[{number}] names point {max(face)}; the last one is {len(self.points or []) - 1}"
                )
        return self


class SpherePrim(Prim):
    """An icosphere around the origin with exact smooth normals."""

    type: Literal["Sphere"]
    radius: Positive = Field(1.0, description="Metres.")
    subdivision: Whole = Field(3, ge=0, le=7, description="20 * 4^n triangles.")


class PlanePrim(Prim):
    """A rectangle in X and Z, facing +Y."""

    type: Literal["Plane"]
    size: tuple[Positive, Positive] = Field((1.0, 1.0), description="Metres along X and Z.")


class BoxPrim(Prim):
    """A box around the origin."""

    type: Literal["Box"]
    size: tuple[Positive, Positive, Positive] = Field((1.0, 1.0, 1.0), description="Metres along X, Y and Z.")


class Texture(Described):
    """An image on a material: a file, or a checkerboard of two colours."""

    asset: Text | None = Field(None, description="PNG, JPEG or another 8-bit image.")
    checker: tuple[Color, Color] | None = Field(
        None, description="Two linear colours instead of a file; one repeat is 2 x 2 squares."
    )
    uv_set: Literal[0, 1] = Field(0, description="Which UV set.")
    wrap: Literal["repeat", "clamp", "mirror"] = Field("repeat", description="Outside 0..1.")
    nearest: Flag = Field(False, description="No filtering.")
    scale: Pair = Field((1.0, 1.0), description="Repeats along u and v.")
    offset: Pair = Field((0.0, 0.0), description="In units of the texture.")
    rotation: Real = Field(0.0, description="Degrees, counter-clockwise.")

    @model_validator(mode="after")
    def _check(self) -> Texture:
        if (self.asset is None) == (self.checker is None):
            raise ValueError("give either asset or checker")
        return self


class MaterialPrim(Described):
    """glTF 2.0 metallic-roughness with transmission, volume, ior and emission."""

    type: Literal["Material"]
    inherits: PrimPath | None = Field(
        None, description="Another material, also one of a referenced model; what is not given here is as there."
    )
    base_color: Color = Field((1.0, 1.0, 1.0), description="Linear RGB.")
    opacity: Unit = Field(1.0, description="Alpha, where alpha_mode is not OPAQUE.")
    metallic: Unit = Field(0.0, description="0 dielectric, 1 metal.")
    roughness: Unit = Field(1.0, description="GGX, perceptual; 0 is a mirror.")
    specular: Unit = Field(1.0, description="0 makes a dielectric purely diffuse.")
    ior: Real = Field(1.5, ge=1.0, le=5.0, description="Index of refraction.")
    transmission: Unit = Field(0.0, description="How much passes through instead of being scattered.")
    thickness: NotNegative = Field(
        0.0, description="0: thin-walled, rays pass unbent; above 0: a volume bounded by the mesh."
    )
    attenuation_color: Color = Field(
        (1.0, 1.0, 1.0), description="What is left of white light after attenuation_distance."
    )
    attenuation_distance: Annotated[RealOrInf, Field(gt=0)] = Field(float("inf"), description="Metres; .inf is clear.")
    emissive: Color = Field((0.0, 0.0, 0.0), description="Nits.")
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = Field("OPAQUE", description="What opacity means.")
    alpha_cutoff: Unit = Field(0.5, description="Below it a MASK surface is a hole.")
    double_sided: Flag = Field(False, description="Is the back a surface too?")
    unlit: Flag = Field(False, description="Shows base_color whatever the light.")
    normal_scale: Real = Field(1.0, description="Strength of the normal map.")
    occlusion_strength: Unit = Field(1.0, description="Strength of the occlusion map.")
    base_color_texture: Texture | None = Field(None, description="sRGB, times base_color.")
    metallic_roughness_texture: Texture | None = Field(None, description="Green roughness, blue metallic.")
    normal_texture: Texture | None = Field(None, description="Tangent space.")
    occlusion_texture: Texture | None = Field(None, description="Red.")
    emissive_texture: Texture | None = Field(None, description="sRGB, times emissive.")
    transmission_texture: Texture | None = Field(None, description="Red.")


class MaterialOver(MaterialPrim):
    """Changes to a material of a referenced model file: any of a material's attributes."""

    type: Literal["Material"] = "Material"


class ReferencePrim(Prim, SplitField):
    """A model file, another scene description, or a procedural model, placed under this prim."""

    type: Literal["Reference"]
    asset: Text | None = Field(None, description="Model file or scene description.")
    loader: Text | None = Field(
        None, description="Loader by name; needed only for procedural ones, which take no file."
    )
    options: dict[str, Any] = Field(default_factory=dict, description="The loader's own options.")
    variant: Text | None = Field(None, description="Variant of a referenced scene description.")
    all_materials: MaterialOver | None = Field(
        None, description="Attributes given to every material of the model; an over of one material is stronger."
    )
    smooth: Flag = Field(False, description="Smooth normals where a model has none, instead of flat ones.")

    @model_validator(mode="after")
    def _check(self) -> ReferencePrim:
        if self.asset is None and self.loader is None:
            raise ValueError("give asset (a file), or loader (a procedural model)")
        return self


class LookAt(Described):
    """A camera's place by where it is and what it looks at."""

    eye: Triple = Field(description="Metres, in the parent's space.")
    target: Triple = Field(description="Metres, in the parent's space; in the middle of the picture.")
    up: Triple = Field((0.0, 1.0, 0.0), description="What is up in the picture.")


class CameraKey(Described):
    """One keyframe of a camera path: eye and target, or translate and rotate."""

    time: NotNegative = Field(description="Seconds from the start.")
    eye: Triple | None = Field(None, description="Metres, in the parent's space.")
    target: Triple | None = Field(None, description="What is in the middle of the picture.")
    up: Triple | None = Field(None, description="Default +Y.")
    translate: Triple | None = Field(None, description="Metres.")
    rotate: Triple | None = Field(None, description="Degrees about X, then Y, then Z.")

    @model_validator(mode="after")
    def _check(self) -> CameraKey:
        looks = self.eye is not None and self.target is not None
        if (
            looks == (self.translate is not None)
            or (not looks and (self.eye or self.target or self.up))
            or (looks and self.rotate)
        ):
            raise ValueError("a key needs eye and target (and up), or translate (and rotate)")
        if looks and self.eye == self.target:
            raise ValueError("eye and target must differ")
        return self


class CameraPath(Described):
    """A walk of the camera."""

    interpolation: Interpolation = Field("smooth", description="smooth is a Catmull-Rom curve through the keys.")
    keys: list[CameraKey] = Field(min_length=1, description="At rising times.")

    @model_validator(mode="after")
    def _check(self) -> CameraPath:
        _rising([key.time for key in self.keys])
        if len({key.eye is None for key in self.keys}) > 1:
            raise ValueError("keys with eye and keys with translate must not be mixed")
        return self


class CameraPrim(Prim):
    """A camera, looking down its -Z with +Y up."""

    type: Literal["Camera"]
    fov: Annotated[Real, Field(gt=0, lt=180)] = Field(45.0, description="Vertical field of view, degrees.")
    near: Positive = Field(0.01, description="Metres; nearer surfaces are not seen.")
    far: Annotated[RealOrInf, Field(gt=0)] = Field(float("inf"), description="Metres.")
    exposure: Positive = Field(1.0, description="Multiplies the linear picture.")
    orthographic: Positive | None = Field(
        None, description="Height of the view in metres; makes the camera orthographic."
    )
    look_at: LookAt | None = Field(None, description="Place and direction; instead of xform.")
    path: CameraPath | None = Field(None, description="Keyframes; instead of xform.")

    @model_validator(mode="after")
    def _check(self) -> CameraPrim:
        places = [name for name in ("xform", "look_at", "path") if getattr(self, name) is not None]
        if len(places) > 1:
            raise ValueError(f"{' and '.join(places)} exclude each other")
        if self.far <= self.near:
            raise ValueError(f"far ({self.far:g}) must be larger than near ({self.near:g})")
        if self.look_at is not None and self.look_at.eye == self.look_at.target:
            raise ValueError("look_at: eye and target must differ")
        return self


class LightBase(Prim):
    color: Color = Field((1.0, 1.0, 1.0), description="Linear RGB, times intensity.")


class Cone(Described):
    """Narrows a sphere light to a spot that shines down its -Z."""

    inner: Annotated[Real, Field(ge=0, lt=90)] = Field(0.0, description="Half-angle of full light, degrees.")
    outer: Annotated[Real, Field(gt=0, lt=90)] = Field(45.0, description="Half-angle where light ends, degrees.")

    @model_validator(mode="after")
    def _check(self) -> Cone:
        if self.inner >= self.outer:
            raise ValueError(f"inner ({self.inner:g}) must be smaller than outer ({self.outer:g})")
        return self


class SphereLightPrim(LightBase):
    """Light from a point or, with a radius, from a sphere with soft shadows."""

    type: Literal["SphereLight"]
    intensity: NotNegative = Field(1.0, description="Candela.")
    radius: NotNegative = Field(0.0, description="Metres; 0 is a point.")
    range: Annotated[RealOrInf, Field(gt=0)] = Field(float("inf"), description="Metres; no light beyond.")
    cone: Cone | None = Field(None, description="Makes it a spot.")


class DistantLightPrim(LightBase):
    """Parallel light down the prim's -Z: a sun."""

    type: Literal["DistantLight"]
    intensity: NotNegative = Field(1.0, description="Lux.")
    angle: Annotated[Real, Field(ge=0, lt=90)] = Field(0.0, description="Angular diameter, degrees; the sun has 0.53.")


class RectLightPrim(LightBase):
    """A glowing rectangle in X and Y that shines down its -Z."""

    type: Literal["RectLight"]
    intensity: NotNegative = Field(1.0, description="Nits.")
    width: Positive = Field(1.0, description="Metres along X.")
    height: Positive = Field(1.0, description="Metres along Y.")


class DomeLightPrim(LightBase):
    """Light from all around, constant or from an equirectangular picture. A scene has at most one."""

    type: Literal["DomeLight"]
    intensity: NotNegative = Field(1.0, description="Nits; times the picture.")
    asset: Text | None = Field(
        None, description="Equirectangular .hdr (Radiance) or .exr; its centre column looks down -Z."
    )
    rotation: Real = Field(0.0, description="Degrees about +Y.")
    background: Flag = Field(True, description="Is it seen where there is no surface?")


class TrackKey(Described):
    """A moment of the scene's own walk from which on something holds; what a key leaves out stays as it was."""

    time: NotNegative = Field(description="Seconds from the start.")
    situation: Text | None = Field(None, description="Which values of the importance maps hold.")
    budget: BudgetText | None = Field(None, description="As 33ms, rays:20ms, 200000rays or none.")
    persistence: NotNegative | None = Field(None, description="How much having been traced counts: I of the paper.")
    attention: dict[Text, NotNegative] | None = Field(
        None, description="Factor on the importance of objects by tag; replaces the attention before."
    )
    view_speed: NotNegative | None = Field(
        None, description="How much motion in the picture lowers visibility; 0 is off."
    )
    parameters: dict[Text, Any] | None = Field(None, description="Values by name for heuristics that know them.")


class RenderSettingsPrim(Described):
    """What the scene's own pictures are made with. The command line comes first. A scene has at most one."""

    type: Literal["RenderSettings"]
    size: tuple[Annotated[Whole, Field(ge=1, le=MAX_SIDE)], Annotated[Whole, Field(ge=1, le=MAX_SIDE)]] | None = Field(
        None, description="Width and height, pixels."
    )
    camera: PrimPath | None = Field(None, description="The camera to start with; default the first.")
    heuristic: Text | None = Field(None, description="Heuristic by name.")
    tone_map: Text | None = Field(None, description="Tone curve by name.")
    exposure: Positive = Field(1.0, description="Multiplies the linear picture.")
    fps: Positive = Field(30.0, description="Frames per second of the scene's animation.")
    frames: Annotated[Whole, Field(ge=1, le=MOST_FRAMES)] = Field(1, description="Frames of the scene's animation.")
    effects: dict[Text, dict[str, Any]] = Field(
        default_factory=dict, description="Options of effects, by the effect's name."
    )
    track: list[TrackKey] = Field(
        default_factory=list, description="What changes along the scene's time: situations, budgets; at rising times."
    )

    @field_validator("track")
    @classmethod
    def _check_track(cls, track: list[TrackKey]) -> list[TrackKey]:
        _rising([key.time for key in track])
        return track


AnyPrim = Annotated[
    XformPrim
    | MeshPrim
    | SpherePrim
    | PlanePrim
    | BoxPrim
    | ReferencePrim
    | MaterialPrim
    | CameraPrim
    | SphereLightPrim
    | DistantLightPrim
    | RectLightPrim
    | DomeLightPrim
    | RenderSettingsPrim,
    Field(discriminator="type"),
]


PRIM_TYPES: dict[str, type[Described]] = {
    "Xform": XformPrim,
    "Mesh": MeshPrim,
    "Sphere": SpherePrim,
    "Plane": PlanePrim,
    "Box": BoxPrim,
    "Reference": ReferencePrim,
    "Material": MaterialPrim,
    "Camera": CameraPrim,
    "SphereLight": SphereLightPrim,
    "DistantLight": DistantLightPrim,
    "RectLight": RectLightPrim,
    "DomeLight": DomeLightPrim,
    "RenderSettings": RenderSettingsPrim,
}

Prim.model_rebuild()
for _prim_type in PRIM_TYPES.values():
    _prim_type.model_rebuild()


class ModelOver(PrimBase):
    """What `over` may say about a node or object inside a referenced model file."""


class LightOver(ModelOver):
    """What `over` may say about a light inside a referenced model file."""

    color: Color | None = Field(None, description="Linear RGB, times intensity.")
    intensity: NotNegative | None = Field(None, description="In the light's own unit.")
    radius: NotNegative | None = Field(None, description="Metres, of point and sphere lights.")


class CameraOver(ModelOver):
    """What `over` may say about a camera inside a referenced model file."""

    fov: Annotated[Real, Field(gt=0, lt=180)] | None = Field(None, description="Vertical field of view, degrees.")
    near: Positive | None = Field(None, description="Metres.")
    far: Annotated[RealOrInf, Field(gt=0)] | None = Field(None, description="Metres.")
    exposure: Positive | None = Field(None, description="Multiplies the linear picture.")

"""MTL: Wavefront materials and their textures as glTF metallic-roughness.

Source of the statements: "MTL material format (Lightwave, OBJ)", Wavefront Advanced Visualizer, appendix B1, and the
PBR extension that Blender and tinyobjloader write (Pr, Pm, norm). What maps to what is listed in docs/loaders/mesh.md.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext
from phrt.model import Image, Material, TextureRef
from phrt_plugins.loaders.mesh_textures import placeholder, read_texture

MAX_MTL_BYTES = 16 * 1024 * 1024
MAX_TEXTURE_BYTES = 2 * 1024 * 1024 * 1024
"""Of all textures of a file together, decoded."""

_NUMBERS = {"Kd": 3, "Ks": 3, "Ke": 3, "Tf": 3, "Ns": 1, "Ni": 1, "d": 1, "Tr": 1, "illum": 1, "Pr": 1, "Pm": 1}
_MAPS = {"map_Kd", "map_Ke", "map_d", "norm"}
_UNSUPPORTED = {
    "map_Ks",
    "map_Ns",
    "map_Bump",
    "map_bump",
    "bump",
    "disp",
    "refl",
    "decal",
    "map_Pr",
    "map_Pm",
    "map_Tr",
}
_OPTION_WORDS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-mm": 2, "-texres": 1, "-bm": 1}
_OPTION_WORDS |= {"-boost": 1, "-type": 1}

DEFAULT_MATERIAL = Material(name="default", base_color=(0.8, 0.8, 0.8, 1.0), double_sided=True)
"""For triangles without a usable material. Two-sided, as these formats do not say which side is out."""


@dataclass
class MtlEntry:
    """One `newmtl` as written: numbers by statement, and texture statements with their options unparsed."""

    name: str
    numbers: dict[str, list[float]] = field(default_factory=dict)
    maps: dict[str, str] = field(default_factory=dict)

    def value(self, key: str, default: float) -> float:
        return self.numbers[key][0] if self.numbers.get(key) else default

    def color(self, key: str) -> tuple[float, float, float] | None:
        values = self.numbers.get(key)
        if not values:
            return None
        # One number stands for all three.
        return (values[0], values[0], values[0]) if len(values) < 3 else (values[0], values[1], values[2])


def parse_mtl(text: str, name: str, warn: Callable[[str], None]) -> dict[str, MtlEntry]:
    """The materials of MTL `text` by name; the first of equal names counts. Odd lines are left out with one warning."""
    entries: dict[str, MtlEntry] = {}
    entry = MtlEntry("")
    odd: list[str] = []
    unsupported: set[str] = set()
    for number, line in enumerate(text.splitlines(), 1):
        key, _, rest = line.split("#")[0].strip().partition(" ")
        key, _, tab_rest = key.partition("\t")
        rest = f"{tab_rest} {rest}".strip()
        if key == "newmtl":
            entry = MtlEntry(rest)
            entries.setdefault(rest, entry)
        elif key in _NUMBERS:
            try:
                values = [float(word) for word in rest.split()[:3]]
            except ValueError:
                values = []
            if values and (np.abs(values) <= 1e18).all():
                entry.numbers[key] = values
            else:
                odd.append(f"line {number}: '{line.strip()[:40]}'")
        elif key in _MAPS or key.lower() == "map_kd":
            entry.maps["map_Kd" if key.lower() == "map_kd" else key] = rest
        elif key in _UNSUPPORTED:
            unsupported.add(key)
    if odd:
        warn(f"'{name}': {len(odd)} lines have no usable numbers and were left out, {odd[0]}")
    if unsupported:
        warn(f"'{name}': not supported and left out: {', '.join(sorted(unsupported))}")
    return entries


class MaterialLibrary:
    """The materials of an OBJ's MTL files, made when asked for, with the images they use."""

    def __init__(self, context: LoadContext, max_texture_size: int) -> None:
        self.context = context
        self.max_texture_size = max_texture_size
        self.entries: dict[str, MtlEntry] = {}
        self.images: list[Image] = []
        self._image_index: dict[tuple[str, str], tuple[int, bool]] = {}

    def add_files(self, statement: str) -> None:
        """Read the files of one `mtllib` statement: one name, which may hold spaces, or several. Missing ones warn."""
        try:
            paths = [resolve_loosely(self.context, statement)]
        except AssetError as first:
            paths = []
            for word in statement.split() if " " in statement else []:
                try:
                    paths.append(resolve_loosely(self.context, word))
                except AssetError as error:
                    self.context.warn(f"material library '{word}' is not used: {error}")
            if " " not in statement:
                self.context.warn(f"material library '{statement}' is not used: {first}")
        for path in paths:
            self._read(path)

    def _read(self, path: Path) -> None:
        if path.stat().st_size > MAX_MTL_BYTES:
            raise AssetError(f"material library '{path.name}' is larger than {MAX_MTL_BYTES} bytes")
        text = path.read_bytes().decode("utf-8-sig", "replace")
        for name, entry in parse_mtl(text, path.name, self.context.warn).items():
            self.entries.setdefault(name, entry)

    def material(self, entry: MtlEntry) -> Material:
        """`entry` as glTF."""
        material = base_material(entry)
        opacity = entry.maps.get("map_d")
        if "map_Kd" in entry.maps:
            material.base_color_texture, cutout = self._texture(entry.maps["map_Kd"], opacity or "")
            if max(material.base_color[:3]) == 0.0:
                # Many exporters write black beside a texture and mean the texture.
                material.base_color = (1.0, 1.0, 1.0, material.base_color[3])
            if opacity is not None and cutout and material.alpha_mode == "OPAQUE":
                material.alpha_mode = "MASK"
        elif opacity is not None:
            self.context.warn(f"material '{entry.name}': map_d without map_Kd is not supported and was left out")
        if "map_Ke" in entry.maps:
            material.emissive_texture, _ = self._texture(entry.maps["map_Ke"], "")
            if max(material.emissive) == 0.0:
                material.emissive = (1.0, 1.0, 1.0)
        if "norm" in entry.maps:
            material.normal_texture, _ = self._texture(entry.maps["norm"], "")
        return material

    def _texture(self, statement: str, opacity: str) -> tuple[TextureRef, bool]:
        """The texture of `statement`, its alpha from `opacity`; and whether that alpha is anywhere below 1."""
        reference, ref = parse_map(statement)
        opacity_reference = parse_map(opacity)[0] if opacity else ""
        key = (reference, opacity_reference)
        if key not in self._image_index:
            if sum(image.pixels.nbytes for image in self.images) > MAX_TEXTURE_BYTES:
                full = f"those before it have more than {MAX_TEXTURE_BYTES} bytes; a smaller 'max_texture_size' helps"
                self.context.warn(f"texture '{reference}' is replaced by a checker: {full}")
                pixels, cutout = placeholder(), False
            else:
                pixels, cutout = read_texture(self.context, reference, opacity_reference, self.max_texture_size)
            self._image_index[key] = (len(self.images), cutout)
            self.images.append(Image(reference, pixels))
        ref.image, cutout = self._image_index[key]
        return ref, cutout


def base_material(entry: MtlEntry) -> Material:
    """`entry` without textures. Colours are taken as linear reflectances, as in the Cornell boxes."""
    diffuse = _unit_range(entry.color("Kd") or (0.8, 0.8, 0.8))
    specular = _unit_range(entry.color("Ks") or (0.0, 0.0, 0.0))
    exponent = max(entry.value("Ns", 0.0), 0.0)
    # Blinn-Phong exponent n and GGX: alpha^2 = 2 / (n + 2), alpha = roughness^2 (Karis 2013, course notes).
    roughness = (2.0 / (exponent + 2.0)) ** 0.25
    alpha = min(max(entry.value("d", 1.0 - entry.value("Tr", 0.0)), 0.0), 1.0)
    index = entry.value("Ni", 1.5)
    material = Material(
        name=entry.name,
        base_color=(*diffuse, alpha),
        # Up to a dielectric's 4 % Ks scales the reflection; more than that is what a dielectric cannot show.
        specular=min(max(specular) / 0.04, 1.0),
        roughness=roughness if max(specular) > 0.0 else 1.0,
        # Exporters write 1 for "not set"; as a surface it would reflect nothing.
        ior=min(index, 4.0) if index > 1.0 else 1.5,
        emissive=_positive(entry.color("Ke") or (0.0, 0.0, 0.0)),
        double_sided=True,
    )
    _illumination(material, entry, specular)
    material.roughness = min(max(entry.value("Pr", material.roughness), 0.0), 1.0)
    material.metallic = min(max(entry.value("Pm", material.metallic), 0.0), 1.0)
    if material.base_color[3] < 1.0:
        material.alpha_mode = "BLEND"
    return material


def _illumination(material: Material, entry: MtlEntry, specular: tuple[float, float, float]) -> None:
    """What the illumination model adds: 0 and 1 no highlight, 5 a mirror, 6 and 7 glass."""
    model = int(entry.value("illum", 2))
    if model in (0, 1):
        material.specular, material.roughness = 0.0, 1.0
    elif model == 5 and max(specular) > 0.0:
        material.base_color = (*specular, material.base_color[3])
        material.metallic, material.roughness, material.specular = 1.0, 0.0, 1.0
    elif model in (6, 7):
        tint = _unit_range(entry.color("Tf") or (1.0, 1.0, 1.0))
        # A filter of 0 would be black glass; it is what exporters write for "none". Refraction replaces dissolve.
        material.base_color = (*(tint if max(tint) > 0.0 else (1.0, 1.0, 1.0)), 1.0)
        material.transmission, material.thickness = 1.0, 1.0
        material.roughness, material.specular = 0.0, 1.0


def parse_map(statement: str) -> tuple[str, TextureRef]:
    """File name and sampler of a texture statement such as `-s 2 2 1 -clamp on wood.png`. `image` is not set."""
    ref = TextureRef(image=-1)
    words = _words(statement)
    scale, offset = [1.0, 1.0], [0.0, 0.0]
    while words and words[0] in (*_OPTION_WORDS, "-s", "-o", "-t"):
        option = words.pop(0)
        if option in ("-s", "-o", "-t"):
            numbers: list[float] = []
            while words and len(numbers) < 3 and _is_number(words[0]):
                numbers.append(float(words.pop(0)))
            target = {"-s": scale, "-o": offset}.get(option, [])
            target[: min(len(numbers), len(target))] = numbers[: len(target)]
            continue
        values, words = words[: _OPTION_WORDS[option]], words[_OPTION_WORDS[option] :]
        if option == "-clamp" and values == ["on"]:
            ref.wrap_s = ref.wrap_t = "clamp"
    # OBJ's v runs up, ours down: 1 - (s (1 - v) + o).
    ref.scale = (scale[0], scale[1])
    ref.offset = (offset[0], 1.0 - scale[1] - offset[1])
    return " ".join(words), ref


def resolve_loosely(context: LoadContext, reference: str) -> Path:
    """`reference` through the context; where that fails, its bare file name: MTL files are full of paths of the machine
    they were made on. Raises the first AssetError."""
    reference = reference.strip().strip('"').replace("\\", "/")
    try:
        return context.resolve(reference)
    except AssetError:
        name = reference.rpartition("/")[2]
        if not name or name == reference:
            raise
        try:
            return context.resolve(name)
        except AssetError:
            pass
        raise


def _words(statement: str) -> list[str]:
    if '"' not in statement:
        return statement.split()
    try:
        return shlex.split(statement.replace("\\", "/"))
    except ValueError:
        return statement.split()


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _unit_range(color: tuple[float, float, float]) -> tuple[float, float, float]:
    r, g, b = (min(max(c, 0.0), 1.0) for c in color)
    return (r, g, b)


def _positive(color: tuple[float, float, float]) -> tuple[float, float, float]:
    r, g, b = (max(c, 0.0) for c in color)
    return (r, g, b)

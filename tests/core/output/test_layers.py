"""The folder of layers: which files, and that they show what is in the arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from phrt.channels import GBuffer
from phrt.errors import OptionError
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_NONE, MASK_TRACED
from phrt.output.layers import depth_preview, id_preview, layer_preview, normal_preview, write_layers
from phrt.output.tonemap import to_8bit

HEIGHT, WIDTH = 8, 12


@dataclass
class Frame:
    image: np.ndarray
    gbuffer: GBuffer
    direct: np.ndarray
    layers: dict[str, np.ndarray] = field(default_factory=dict)
    masks: dict[str, np.ndarray] = field(default_factory=dict)


@pytest.fixture
def frame() -> Frame:
    random = np.random.default_rng(2)

    def noise(components: int) -> np.ndarray:
        return random.random((HEIGHT, WIDTH, components), dtype=np.float32)

    gbuffer = GBuffer.allocate(WIDTH, HEIGHT)
    gbuffer.arrays["depth"][2:, :] = 3.0
    gbuffer.arrays["object_id"][2:, :] = 1
    gbuffer.arrays["object_id"][2:, 6:] = 2
    gbuffer.arrays["normal_world"][2:] = (0.0, 1.0, 0.0)
    layers = {"visibility": noise(3), "reflection": noise(3), "refraction": noise(3)}
    layers["ambient_occlusion"] = noise(1)
    layers["several"] = noise(6)
    masks = {"shadows": random.integers(0, 4, (HEIGHT, WIDTH), dtype=np.uint8)}
    gbuffer.arrays["emissive"][0, 0] = (1.0, 2.0, 3.0)
    direct = random.random((HEIGHT, WIDTH, 2, 3), dtype=np.float32)
    return Frame(noise(3), gbuffer, direct, layers, masks)


def read(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image)


def test_the_four_images_of_figure_1_and_every_layer_are_written(tmp_path: Path, frame: Frame) -> None:
    files = {path.name for path in write_layers(tmp_path / "new" / "folder", frame)}
    assert files == {path.name for path in (tmp_path / "new" / "folder").iterdir()}
    figure = {
        "figure1_a_raster",
        "figure1_b_shadows",
        "figure1_c_reflections",
        "figure1_c_refractions",
        "figure1_d_composite",
    }
    assert {f"{name}.png" for name in figure} <= files
    assert {f"layer_{name}.png" for name in frame.layers} <= files
    assert {"layer_visibility_0.png", "layer_visibility_2.png", "traced_shadows.png", "layers.exr"} <= files
    assert {"gbuffer_depth.png", "gbuffer_normal_world.png", "gbuffer_base_color.png", "gbuffer_object_id.png"} <= files


def test_previews_show_the_arrays(tmp_path: Path, frame: Frame) -> None:
    write_layers(tmp_path, frame, tone_map="aces")
    assert np.array_equal(read(tmp_path / "figure1_d_composite.png"), to_8bit(frame.image, "aces"))
    assert np.array_equal(read(tmp_path / "figure1_c_reflections.png"), to_8bit(frame.layers["reflection"], "aces"))
    mean = np.repeat(frame.layers["visibility"].mean(axis=2, keepdims=True), 3, axis=2)
    assert np.array_equal(read(tmp_path / "figure1_b_shadows.png"), to_8bit(mean, "srgb")[:, :, 0])
    traced = read(tmp_path / "traced_shadows.png")
    for value, shade in ((MASK_NONE, 0), (MASK_FALLBACK, 85), (MASK_TRACED, 255), (MASK_FILLED, 170)):
        assert (traced[frame.masks["shadows"] == value] == shade).all()


def test_the_exr_holds_every_value(tmp_path: Path, frame: Frame) -> None:
    write_layers(tmp_path, frame)
    with OpenEXR.File(str(tmp_path / "layers.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert np.array_equal(channels["G"], frame.image[:, :, 1])
    assert np.array_equal(channels["visibility.B"], frame.layers["visibility"][:, :, 2])
    assert np.array_equal(channels["several.5"], frame.layers["several"][:, :, 5])
    assert np.array_equal(channels["direct_1.B"], frame.direct[:, :, 1, 2])
    assert np.array_equal(channels["depth.Z"], frame.gbuffer.depth)
    assert np.array_equal(channels["normal_world.Y"], frame.gbuffer.normal_world[:, :, 1])
    assert np.array_equal(channels["object_id.id"], frame.gbuffer.object_id)
    assert np.array_equal(channels["traced_shadows.Y"], frame.masks["shadows"])


def test_the_raster_picture_is_direct_light_and_emission_exposed(tmp_path: Path, frame: Frame) -> None:
    write_layers(tmp_path, frame, tone_map="srgb", exposure=0.25)
    expected = (frame.direct[:, :, 0] + frame.direct[:, :, 1] + frame.gbuffer.emissive) * np.float32(0.25)
    shown = read(tmp_path / "figure1_a_raster.png").astype(int)
    assert np.abs(shown - to_8bit(expected, "srgb")).max() <= 1
    reflection = frame.layers["reflection"] * np.float32(0.25)
    assert np.array_equal(read(tmp_path / "layer_reflection.png"), to_8bit(reflection, "srgb"))


def test_a_frame_without_effects_still_gives_its_composite(tmp_path: Path, frame: Frame) -> None:
    frame.layers, frame.masks = {"visibility": np.zeros((HEIGHT, WIDTH, 0), np.float32)}, {}
    files = {path.name for path in write_layers(tmp_path, frame)}
    assert {"figure1_d_composite.png", "layers.exr"} <= files


def test_depth_preview_orders_near_before_far_and_background_black() -> None:
    shades = depth_preview(np.array([[1.0, 2.0, 10.0, np.inf]], np.float32))[0]
    assert shades[0] > shades[1] > shades[2] > shades[3] == 0


def test_normal_preview_maps_axes_to_colours() -> None:
    assert normal_preview(np.array([[[0, 1, 0], [-1, 0, 0], [0, 0, 0]]], np.float32)).tolist() == [
        [[128, 255, 128], [0, 128, 128], [0, 0, 0]]
    ]


def test_id_colours_are_distinct_for_hundreds_of_objects() -> None:
    ids = np.arange(300, dtype=np.uint32)[None, :]
    colors = id_preview(ids)[0].astype(int)
    assert colors[0].tolist() == [0, 0, 0]
    assert id_preview(np.array([[0xFFFFFFFF]], np.uint32)).max() == 0
    assert len({tuple(color) for color in colors}) > 280
    neighbours = np.abs(np.diff(colors[1:], axis=0)).sum(axis=1)
    assert neighbours.min() > 60


def test_scalar_and_wide_layers_are_grey() -> None:
    layer = np.full((2, 2, 5), 0.5, np.float32)
    assert (layer_preview("anything", layer, "neutral") == 188).all()
    assert layer_preview("anything", layer[:, :, 0], "neutral").shape == (2, 2)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, frame: Frame) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OptionError, match="cannot make the folder"):
        write_layers(tmp_path / "file" / "layers", frame)

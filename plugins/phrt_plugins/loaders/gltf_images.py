"""glTF images: found, checked and decoded to RGBA bytes, several at once; a checker stands in for unreadable ones."""

from __future__ import annotations

import io
import os
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image as Pillow
from PIL import UnidentifiedImageError, features

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext
from phrt.model import Image
from phrt_plugins.loaders.gltf_accessors import Accessors, Budget
from phrt_plugins.loaders.gltf_container import (
    check_uri,
    decode_data_uri,
    is_data_uri,
    read_bytes,
    resolve_uri,
    shorten,
    stays_beside,
)
from phrt_plugins.loaders.gltf_json import Document, Element, fail

FORMATS = ["PNG", "JPEG", "WEBP"]
MAX_PIXELS = 8192 * 8192
"""Largest image that is decoded, pixels."""


class ImageUnreadableError(Exception):
    """An image that a placeholder stands in for; the message is the reason."""


@dataclass
class OpenImage:
    """An image whose header was read: `picture` is not decoded yet; None means placeholder."""

    name: str
    picture: Any | None


class Images:
    """The images that materials use. `use` hands out indices into `Model.images`; `decode` makes the images."""

    def __init__(self, document: Document, accessors: Accessors, context: LoadContext, max_size: int) -> None:
        self.document = document
        self.accessors = accessors
        self.context = context
        self.max_size = max_size
        self.budget = Budget()
        self.slots: dict[int | None, int] = {}
        for element in document.lists["images"]:
            self._check(element)

    def _check(self, element: Element) -> None:
        """References and URI schemes of every image, used or not."""
        if "uri" in element:
            check_uri(element.string("uri"), element.place("uri"))
        elif self.document.refer(element, "bufferView", "bufferViews") is None:
            fail(element.where, "has neither 'uri' nor 'bufferView'")

    def use(self, texture: Element) -> int:
        """Index into `Model.images` of a texture's image."""
        image = self._source(texture)
        return self.slots.setdefault(image, len(self.slots))

    def _source(self, texture: Element) -> int | None:
        """A texture's image: WebP where Pillow reads it, else PNG or JPEG; None (placeholder) without either."""
        webp = texture.extension("EXT_texture_webp")
        if webp is not None and "source" in webp and features.check("webp"):
            return self.document.refer(webp, "source", "images")
        source = self.document.refer(texture, "source", "images")
        if source is None:
            others = [name for name in (texture.child("extensions") or texture).data if "_texture_" in name]
            why = f" other than in {', '.join(sorted(others))}, which is not supported" if others else ""
            self.document.warn(f"{texture.where} has no image{why}; a placeholder is shown")
        return source

    def decode(self) -> list[Image]:
        """Every image in use, in the order of `use`."""
        opened = [self._open(index) for index in self.slots]
        with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
            futures = [
                pool.submit(to_rgba, image.picture, self.max_size) if image.picture is not None else None
                for image in opened
            ]
            images = []
            for image, future in zip(opened, futures, strict=True):
                try:
                    images.append(Image(image.name, placeholder() if future is None else future.result()))
                except ImageUnreadableError as error:
                    images.append(self._replace(image.name, str(error)))
                image.picture = None
        return images

    def _replace(self, name: str, reason: str) -> Image:
        self.document.warn(f"image '{shorten(name)}' {reason}; a placeholder is shown")
        return Image(name, placeholder())

    def _open(self, index: int | None) -> OpenImage:
        if index is None:
            return OpenImage("missing", None)
        element = self.document.lists["images"][index]
        uri = element.string("uri", "")
        name = element.string("name", "") or (uri if uri and not is_data_uri(uri) else element.where)
        try:
            picture = open_picture(self._bytes(element, uri), element.where)
        except ImageUnreadableError as error:
            self._replace(name, str(error))
            return OpenImage(name, None)
        self._check_size(picture.size, element.where)
        return OpenImage(name, picture)

    def _check_size(self, size: tuple[int, int], where: str) -> None:
        width, height = size
        if width < 1 or height < 1:
            fail(where, f"is an image of {width} x {height} pixels")
        if width * height > MAX_PIXELS:
            fail(where, f"has {width} x {height} pixels; at most {MAX_PIXELS:,} are read")
        smaller = min(1.0, self.max_size / max(width, height))
        try:
            self.budget.spend(int(4 * width * height * smaller * smaller), where)
        except AssetError as error:
            raise AssetError(f"{error}; a smaller 'max_texture_size' makes the textures fit") from None

    def _bytes(self, element: Element, uri: str) -> bytes:
        where = element.place("uri")
        if "uri" not in element:
            view = self.document.refer_required(element, "bufferView", "bufferViews")
            return bytes(self.accessors.view_bytes(view, element.where))
        if is_data_uri(uri):
            try:
                return decode_data_uri(uri, where)
            except AssetError as error:
                raise ImageUnreadableError(f"is broken ({shorten(str(error), 200)})") from None
        try:
            path = resolve_uri(uri, where, self.context)
        except AssetError as error:
            # What is missing beside the file is shown as missing; what leaves the asset roots is an error.
            if not stays_beside(uri):
                raise
            raise ImageUnreadableError(f"cannot be opened ({shorten(str(error), 300)})") from None
        return read_bytes(path)


def open_picture(data: bytes, where: str) -> Any:
    """A Pillow image with its header read. Raises ImageUnreadableError; AssetError for a PNG of zero size."""
    if (
        data[:8] == b"\x89PNG\r\n\x1a\n"
        and len(data) >= 24
        and 0 in (int.from_bytes(data[16:20]), int.from_bytes(data[20:24]))
    ):
        fail(where, "is an image of zero width or height")
    try:
        # Pillow's own limit on pixels is replaced by ours, which is an error instead of a warning.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return Pillow.open(io.BytesIO(data), formats=FORMATS)
    except Pillow.DecompressionBombError:
        raise AssetError(f"{where}: is too large an image; at most {MAX_PIXELS:,} pixels are read") from None
    except Exception as error:  # what image decoders raise on broken data is open-ended
        what = "is empty" if not data else "is not a readable PNG, JPEG or WebP image"
        # What Pillow does not know at all it tells by an address in memory.
        reason = "" if isinstance(error, UnidentifiedImageError) else f" ({shorten(str(error), 120)})"
        raise ImageUnreadableError(what + reason) from None


def to_rgba(picture: Any, max_size: int) -> np.ndarray:
    """Decode to (H, W, 4) uint8, with no side over `max_size` pixels. Raises ImageUnreadableError."""
    try:
        if max(picture.size) > max_size:
            picture.draft(None, (max_size, max_size))
        picture.load()
        if picture.mode.startswith("I"):
            # 16-bit grey: Pillow's own conversion clips instead of scaling.
            picture = Pillow.fromarray((np.asarray(picture).astype(np.uint32) >> 8).astype(np.uint8))
        if picture.mode != "RGBA":
            picture = picture.convert("RGBA")
        if max(picture.size) > max_size:
            scale = max_size / max(picture.size)
            width, height = (max(1, round(side * scale)) for side in picture.size)
            picture = picture.resize((width, height), Pillow.Resampling.BOX)
        return np.array(picture, dtype=np.uint8)
    except Exception as error:  # what image decoders raise on broken data is open-ended
        raise ImageUnreadableError(f"is broken ({shorten(str(error), 120)})") from None


def placeholder(size: int = 64, squares: int = 8) -> np.ndarray:
    """(size, size, 4) uint8: a magenta and black checker, which nobody takes for the real texture."""
    row, column = np.indices((size, size)) * squares // size
    pixels = np.zeros((size, size, 4), np.uint8)
    pixels[(row + column) % 2 == 0] = (255, 0, 255, 0)
    pixels[..., 3] = 255
    return pixels

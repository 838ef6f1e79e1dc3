# SPDX-License-Identifier: MIT
"""sensor_msgs/CompressedImage: JPEG and PNG, and compressed_depth_image_transport's depth."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import Image
from slamcli.recordings.adapters.adapter import Adapter, Encoder
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.image import MILLIMETRES_PER_M, to_metres
from slamcli.recordings.adapters.messages import MessageFactory

_MAX_PIXELS = 100_000_000
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_JPEG_MAGIC, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
# compressed_depth_image_transport: int32 format, float32 A, float32 B, then the PNG.
_DEPTH_HEADER = struct.Struct("<iff")


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFile:
    """An image as it lies in a file, to be written as it is."""

    stamp_ns: int
    frame_id: str
    data: bytes
    """JPEG or PNG."""
    format: str = "jpeg"
    topic: str = ""


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[Image]:
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    if "compresseddepth" in message.format.lower() or context.topic.endswith("/compressedDepth"):
        encoding, pixels = "depth", _depth(message.format, data, context)
    else:
        encoding, pixels = _camera(message.format, uncompress(data), context)
    image = Image(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        encoding=encoding,
        pixels=pixels,
        topic=context.topic,
    )
    return (image,)


def _camera(format: str, raw: NDArray[Any], context: DecodeContext) -> tuple[str, NDArray[Any]]:
    """Return encoding and pixels of an uncompressed image: OpenCV's order is blue, green, red.

    Grey of 16 bit is depth unless the format says mono16, as compressed_image_transport does for a camera's.
    """
    if raw.ndim == 2 and raw.dtype == np.uint16 and not format.startswith("mono16"):
        return "depth", to_metres(raw, context)
    if raw.dtype == np.uint16:
        raw = (raw >> 8).astype(np.uint8)
    if raw.dtype != np.uint8:
        raise DataError(f"compressed image of {raw.dtype} pixels is not decoded")
    if raw.ndim == 2:
        return "mono8", raw
    return "bgr8", np.ascontiguousarray(raw[..., :3])


def _depth(format: str, data: bytes, context: DecodeContext) -> NDArray[np.float32]:
    """Return the depth in metres of a compressedDepth message."""
    if len(data) <= _DEPTH_HEADER.size:
        raise DataError(f"compressed depth of {len(data)} bytes")
    payload = data[_DEPTH_HEADER.size :]
    if "rvl" in format.lower() or payload[:8] != _PNG_MAGIC:
        raise DataError(f"compressed depth of format {format!r}: only PNG is decoded")
    raw = uncompress(payload)
    if raw.ndim != 2 or raw.dtype not in (np.uint8, np.uint16):
        raise DataError(f"compressed depth of {raw.dtype} pixels of shape {raw.shape}")
    if not format.startswith("32FC1"):
        return to_metres(raw, context)
    # Inverse depth, quantised: depth = A / (value - B), 0 for no reading.
    _, a, b = _DEPTH_HEADER.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.float32(a) / (raw.astype(np.float32) - np.float32(b))
    depth[(raw == 0) | ~np.isfinite(depth)] = np.nan
    return depth / np.float32(context.mends.depth_units_per_m or 1.0)


def uncompress(data: bytes) -> NDArray[Any]:
    """Return the pixels of a JPEG or PNG file as they lie in it.

    Raises
    ------
    DataError
        If it is damaged, or claims more pixels than any camera has.
    """
    cv2 = _opencv()
    width, height = image_size(data)
    if width * height > _MAX_PIXELS:
        raise DataError(f"compressed image of {width} x {height} pixels is larger than any camera's")
    damage = damage_of(data)
    if damage:
        raise DataError(f"compressed image of {len(data)} bytes is {damage}")
    try:
        raw = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError(f"compressed image of {len(data)} bytes is damaged") from error
    if raw is None:
        raise DataError(f"compressed image of {len(data)} bytes is no image, or damaged")
    return np.asarray(raw)


@cache
def _opencv() -> Any:
    """Return OpenCV, which writes about damaged files to the terminal unless it is told not to: they are told here."""
    import cv2

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2


def image_format(data: bytes, suffix: str) -> str:
    """Return what CompressedImage calls the format of a camera's image file: ``jpeg``, ``png``, or mono16 said aloud."""
    if data.startswith(_JPEG_MAGIC):
        return "jpeg"
    if not data.startswith(_PNG_MAGIC):
        return suffix.lower().lstrip(".")
    # The header chunk: width and height (4 bytes each) from byte 16, bit depth, colour type (0 is grey).
    return "mono16; png compressed " if data[24:26] == b"\x10\x00" else "png"


def damage_of(data: bytes) -> str:
    """Return what is wrong with a PNG or JPEG file that shows without decoding it, empty if nothing does.

    A PNG is damaged if a critical chunk has another checksum than it says, or there is no end; a JPEG if it has no mark
    of its end. Other formats tell nothing.
    """
    if data.startswith(_PNG_MAGIC):
        return _png_damage(memoryview(data))
    cut = data.startswith(_JPEG_MAGIC) and data.rfind(_JPEG_END) < 0
    return f"damaged (cut off after {len(data)} bytes)" if cut else ""


def _png_damage(data: memoryview) -> str:
    position = len(_PNG_MAGIC)
    while position + 12 <= len(data):
        length = int.from_bytes(data[position : position + 4], "big")
        end = position + 12 + length
        if end > len(data):
            break
        kind = bytes(data[position + 4 : position + 8])
        stored = int.from_bytes(data[end - 4 : end], "big")
        if kind[:1].isupper() and zlib.crc32(data[position + 4 : end - 4]) != stored:
            return f"damaged (checksum of {kind.decode('ascii', 'replace')} at byte {position})"
        if kind == b"IEND":
            return ""
        position = end
    return f"damaged (cut off after {len(data)} bytes)"


def image_size(data: bytes) -> tuple[int, int]:
    """Return width and height that a PNG or JPEG file claims, (0, 0) for another or damaged one."""
    if data[:8] == _PNG_MAGIC and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    position = 2
    while data[:2] == b"\xff\xd8" and position + 9 <= len(data):
        marker = data[position + 1]
        if data[position] != 0xFF or marker == 0xDA:
            break
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # a start of frame
            height, width = struct.unpack_from(">HH", data, position + 5)
            return int(width), int(height)
        position += 1 if marker == 0xFF else 2 + int.from_bytes(data[position + 2 : position + 4], "big")
    return 0, 0


def _encode(image: Image, messages: MessageFactory) -> Any:
    import cv2

    header = messages.header(image.stamp_ns, image.frame_id)
    if image.encoding == "depth":
        depth = np.nan_to_num(
            np.asarray(image.pixels, dtype=np.float64) * MILLIMETRES_PER_M, nan=0.0, posinf=0.0, neginf=0.0
        )
        millimetres = np.clip(np.rint(depth), 0, 65535).astype(np.uint16)
        _, png = cv2.imencode(".png", millimetres)
        data = np.concatenate([np.frombuffer(_DEPTH_HEADER.pack(0, 0.0, 0.0), dtype=np.uint8), np.asarray(png)])
        return messages.make("sensor_msgs/msg/CompressedImage", header, "16UC1; compressedDepth png", data)
    pixels = np.asarray(image.pixels)
    if image.encoding == "rgb8":
        pixels = pixels[..., ::-1]
    _, jpeg = cv2.imencode(".jpg", np.ascontiguousarray(pixels), [cv2.IMWRITE_JPEG_QUALITY, 95])
    compressed = "mono8; jpeg compressed mono8" if image.encoding == "mono8" else "bgr8; jpeg compressed bgr8"
    return messages.make("sensor_msgs/msg/CompressedImage", header, compressed, np.asarray(jpeg))


def _encode_file(image: ImageFile, messages: MessageFactory) -> Any:
    data = np.frombuffer(image.data, dtype=np.uint8)
    header = messages.header(image.stamp_ns, image.frame_id)
    return messages.make("sensor_msgs/msg/CompressedImage", header, image.format, data)


FILE_ENCODER = Encoder(msgtypes=("sensor_msgs/msg/CompressedImage",), produces=ImageFile, encode=_encode_file)
ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/CompressedImage",), produces=Image, decode=_decode, encode=_encode)

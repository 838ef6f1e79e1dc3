# SPDX-License-Identifier: MIT
"""Images and depth as bytes and back."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import FormatError
from slamcli.vision.image_coding import decode_depth, decode_image, encode_depth, encode_image, is_depth


def picture() -> np.ndarray:
    rows, columns = np.mgrid[:40, :60]
    return np.dstack([rows * 6, columns * 4, 255 - rows * 3]).astype(np.uint8)


def test_png_keeps_colours_and_their_order() -> None:
    image = picture()
    assert np.array_equal(decode_image(encode_image(image, ".png")), image)
    assert np.array_equal(decode_image(encode_image(image[:, :, 0], ".png")), image[:, :, 0])


def test_jpeg_is_close_and_a_tenth_of_the_size() -> None:
    image = picture()
    data = encode_image(image)
    assert np.abs(decode_image(data).astype(int) - image).max() <= 6
    assert len(data) < image.size / 4
    assert data == encode_image(image.copy())


@pytest.mark.parametrize("encoding", [".rvl", ".png"])
def test_whole_millimetres_are_kept_exactly_in_16_bits(encoding: str) -> None:
    values = np.random.default_rng(0).integers(0, 65536, (30, 40))
    depth = (values / 1000.0).astype(np.float32)
    data = encode_depth(depth, encoding)
    assert data.startswith(b"DEPTHRVL" if encoding == ".rvl" else b"\x89PNG")
    assert np.array_equal(decode_depth(data), depth)
    assert is_depth(data)


def test_other_depth_is_kept_as_it_is() -> None:
    depth = np.random.default_rng(1).uniform(0.3, 90.0, (30, 40)).astype(np.float32)
    depth[0, :3] = [0.0, np.nan, -1.0]
    data = encode_depth(depth)
    back = decode_depth(data)
    assert back[0, :3].tolist() == [0.0, 0.0, 0.0]
    assert np.array_equal(back[1:], depth[1:])
    assert is_depth(data)


def test_depth_is_rounded_to_millimetres_if_asked() -> None:
    depth = np.array([[0.5004, 1.00061, 70.0, 0.0]], dtype=np.float32)
    back = decode_depth(encode_depth(depth, whole_millimetres=True))
    np.testing.assert_allclose(back, [[0.5, 1.001, 0.0, 0.0]], rtol=1e-7)


def test_a_right_image_is_no_depth_image() -> None:
    assert not is_depth(encode_image(picture()[:, :, 0]))
    assert not is_depth(encode_image(picture()[:, :, 0], ".png"))
    assert not is_depth(encode_image(picture(), ".png"))
    assert not is_depth(b"")


@pytest.mark.parametrize("data", [b"", b"nonsense", encode_image(picture(), ".png")[:60]])
def test_bytes_that_are_no_image_are_refused(data: bytes) -> None:
    with pytest.raises(FormatError, match="no image"):
        decode_image(data)


def test_depth_and_images_are_not_mistaken_for_each_other() -> None:
    with pytest.raises(FormatError, match="depth image was expected"):
        decode_depth(encode_image(picture(), ".png"))
    with pytest.raises(FormatError, match="8 bits"):
        decode_image(encode_depth(np.ones((4, 4), dtype=np.float32), ".png"))

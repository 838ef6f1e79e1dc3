# SPDX-License-Identifier: MIT
"""Which topics of a recording are the cameras of a rig: colour and depth, left and right, and the calibration of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from slamcli.errors import RecordingError, UsageError
from slamcli.measurements import CameraModel, Image
from slamcli.recordings.raw import Topic
from slamcli.recordings.recording import Recording

_SIDES = (
    ("left", "right"), ("cam0", "cam1"), ("camera0", "camera1"), ("infra1", "infra2"), ("image_0", "image_1"),
    ("image_2", "image_3"),
)  # fmt: skip
_ODD_COLOUR = (
    "infra",
    "/ir",
    "right",
    "cam1",
    "camera1",
    "image_1",
    "image_3",
    "rear",
    "mask",
    "label",
    "debug",
    "thumb",
)
_USUAL_COLOUR = ("rgb", "color", "colour")
_ODD_DEPTH = ("confidence", "infra", "disparity", "debug")
_USUAL_DEPTH = ("aligned_depth", "depth_registered", "registered")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraNames:
    """What the caller names; None: found from the recording."""

    rgb: str | None = None
    depth: str | None = None
    left: str | None = None
    right: str | None = None
    camera_info: str | None = None
    """Calibration of the left, colour or only camera."""

    def named(self) -> dict[str, str]:
        """Return what is named, by option."""
        options = {
            "--rgb-topic": self.rgb, "--depth-topic": self.depth, "--left-topic": self.left, "--right-topic": self.right,
            "--camera-info-topic": self.camera_info,
        }  # fmt: skip
        return {option: name for option, name in options.items() if name is not None}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTopics:
    """The images of a recording that can be used, the best of each kind first."""

    colour: tuple[Image, ...]
    """First image of each topic of grey or colour images; its topic says which."""
    depth: tuple[Image, ...]
    pair: tuple[Image, Image] | None
    """Left and right."""
    modes: frozenset[str]
    """Of ``mono``, ``stereo`` and ``rgbd``."""

    def of(self, mode: str) -> tuple[Image, Image | None]:
        """Return the first image of the main camera and of its partner (right camera, depth)."""
        if mode == "stereo" and self.pair is not None:
            return self.pair
        return self.colour[0], self.depth[0] if mode == "rgbd" else None


def find_camera_topics(recording: Recording, names: CameraNames) -> CameraTopics:
    """Return the image topics of a recording: those that are named, else what their names and first images say.

    Raises
    ------
    RecordingError
        If a named topic is missing, empty or holds no such images, or there are no images at all.
    UsageError
        If one of two cameras is named, and its partner is not to be found.
    """
    if (names.left or names.right) and (names.rgb or names.depth):
        raise UsageError("name either --left-topic and --right-topic or --rgb-topic and --depth-topic, not both")
    if names.left or names.right:
        left, right = _named_pair(recording, names)
        return CameraTopics(colour=(left,), depth=(), pair=(left, right), modes=frozenset({"stereo", "mono"}))
    firsts = _first_images(recording, names)
    colour = sorted((i for i in firsts if i.encoding != "depth"), key=lambda image: colour_name_rank(image.topic))
    colour = [i for i in colour if names.rgb is None or i.topic == _full_name(recording, names.rgb)]
    depth = [i for i in firsts if i.encoding == "depth"]
    depth = [i for i in depth if names.depth is None or i.topic == _full_name(recording, names.depth)]
    if names.rgb is not None and not colour:
        raise RecordingError(f"--rgb-topic {names.rgb}: holds depth, not colour")
    if names.depth is not None and not depth:
        raise RecordingError(
            f"--depth-topic {names.depth}: holds {_encoding(firsts, recording, names.depth)}, not depth"
        )
    if not colour:
        raise RecordingError(f"{recording.name}: no camera images ({_what_there_is(recording)})")
    pair = None if names.rgb or names.depth else _pair(colour)
    depth.sort(key=lambda image: depth_rank(image, colour[0]))
    modes = {"mono"} if names.depth is None else set()
    modes |= ({"stereo"} if pair is not None else set()) | ({"rgbd"} if depth else set())
    return CameraTopics(colour=tuple(colour), depth=tuple(depth), pair=pair, modes=frozenset(modes))


def stereo_partner(name: str, others: Iterable[str]) -> str | None:
    """Return the right camera's topic that belongs to a left camera's topic, by their names."""
    others = set(others)
    for left, right in _SIDES:
        for partner in (name.replace(left, right), name.replace(left, right, 1)):
            if partner != name and partner in others:
                return partner
    return None


def info_topic(image_topic: str, info_topics: Sequence[str]) -> str | None:
    """Return the CameraInfo topic of an image topic: the one that shares the longest name space with it."""
    best, longest = None, 0
    parts = image_topic.strip("/").split("/")
    for info in info_topics:
        space = info.strip("/").split("/")[:-1]
        shared = 0
        while shared < min(len(space), len(parts)) and space[shared] == parts[shared]:
            shared += 1
        # All of the info's own name space must be shared: /left/camera_info is not /right/image_raw's.
        if shared == len(space) and shared + 1 > longest:
            best, longest = info, shared + 1
    return best


def find_model(recording: Recording, image_topic: str, named: str | None = None) -> CameraModel | None:
    """Return the calibration of the camera of an image topic: by a given file, else of its CameraInfo topic.

    Raises
    ------
    RecordingError
        If `named` is no CameraInfo topic.
    """
    mends = recording.mends.camera_models
    for key in (image_topic, ""):
        if key in mends:
            return mends[key]
    infos = {topic.name: topic for topic in recording.topics(CameraModel) if topic.count != 0}
    if named is not None:
        topic = recording.topic(named, CameraModel)
    else:
        found = info_topic(image_topic, list(infos))
        if found is None:
            return None
        topic = infos[found]
    model: CameraModel | None = next(iter(recording.measurements([topic])), None)
    return model


def _first_images(recording: Recording, names: CameraNames) -> list[Image]:
    """Return the first image of every topic that can be meant."""
    topics = sorted((t for t in recording.topics(Image) if t.count != 0), key=lambda topic: -(topic.count or 0))
    for name in (names.rgb, names.depth):
        if name is not None:
            recording.topic(name, Image)
    return [image for topic in topics if (image := first_image(recording, topic)) is not None]


def first_image(recording: Recording, topic: Topic) -> Image | None:
    """Return the first image of a topic that can be decoded."""
    image: Image | None = next(iter(recording.measurements([topic])), None)
    return image


def _named_pair(recording: Recording, names: CameraNames) -> tuple[Image, Image]:
    images = {topic.name: topic for topic in recording.topics(Image) if topic.count != 0}
    left = recording.topic(names.left, Image).name if names.left else None
    right = recording.topic(names.right, Image).name if names.right else None
    if left is None and right is not None:
        left = next((name for name in images if stereo_partner(name, [right]) is not None), None)
        if left is None:
            raise UsageError(f"--right-topic {names.right}: name the left camera's images too, with --left-topic")
    if right is None and left is not None:
        right = stereo_partner(left, images)
        if right is None:
            raise UsageError(f"--left-topic {names.left}: name the right camera's images too, with --right-topic")
    if left == right:
        raise UsageError(f"--left-topic and --right-topic are both {left}")
    found = [first_image(recording, images[name]) if name in images else None for name in (left or "", right or "")]
    for name, image in zip((left, right), found, strict=True):
        if image is None or image.encoding == "depth":
            raise RecordingError(
                f"{recording.name}: topic {name} holds {'depth' if image else 'no images that can be decoded'}"
            )
    if found[0] is None or found[1] is None:
        raise RecordingError(f"{recording.name}: no pair of images")
    return found[0], found[1]


def _pair(colour: Sequence[Image]) -> tuple[Image, Image] | None:
    by_name = {image.topic: image for image in colour}
    # Grey before colour: half the bytes, the same corners.
    for image in sorted(colour, key=lambda image: image.encoding != "mono8"):
        partner = stereo_partner(image.topic, by_name)
        if partner is not None:
            return image, by_name[partner]
    return None


def colour_name_rank(topic: str) -> tuple[bool, bool, bool]:
    """Return how much a topic's name is that of a main camera: less comes first."""
    name = topic.lower()
    return (
        any(word in name for word in _ODD_COLOUR),
        not any(word in name for word in _USUAL_COLOUR),
        name.endswith("compressed"),
    )


def depth_name_rank(topic: str) -> tuple[bool, bool]:
    """Return how much a topic's name is that of depth registered to the colour camera: less comes first."""
    name = topic.lower()
    return any(word in name for word in _ODD_DEPTH), not any(word in name for word in _USUAL_DEPTH)


def depth_rank(image: Image, colour: Image) -> tuple[bool, bool, bool, bool]:
    """Registered depth first: of the colour camera's frame and size, or named so."""
    odd, unnamed = depth_name_rank(image.topic)
    apart = image.frame_id != colour.frame_id
    return odd, apart, image.pixels.shape[:2] != colour.pixels.shape[:2], unnamed


def _full_name(recording: Recording, name: str) -> str:
    return recording.topic(name, Image).name


def _encoding(firsts: Sequence[Image], recording: Recording, name: str) -> str:
    full = _full_name(recording, name)
    return next((image.encoding for image in firsts if image.topic == full), "no images that can be decoded")


def _what_there_is(recording: Recording) -> str:
    held = ", ".join(
        f"{topic.name} ({topic.msgtype.replace('/msg/', '/')})" for topic in recording.contents.topics[:12]
    )
    return f"it has {held or 'no topics at all'}"

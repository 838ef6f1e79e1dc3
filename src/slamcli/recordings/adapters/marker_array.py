# SPDX-License-Identifier: MIT
"""visualization_msgs/MarkerArray: shapes for RViz and Foxglove, written only (a marker says how something looks, not what it is)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.recordings.adapters.adapter import Encoder
from slamcli.recordings.adapters.messages import MessageFactory

Shape = Literal["lines", "points", "text"]
_TYPES = {"lines": 5, "points": 7, "text": 9}  # LINE_LIST, SPHERE_LIST, TEXT_VIEW_FACING


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marker:
    """Things of one shape that are shown and hidden together."""

    namespace: str
    shape: Shape
    points_m: NDArray[np.float64]
    """float64 (N, 3): both ends of each line, the points, or the place of one text."""
    colours: NDArray[np.float64]
    """float64 (N, 4), red, green, blue, opacity, 0 to 1; (1, 4) for all the same."""
    size_m: float
    """Width of lines, diameter of points, height of letters."""
    text: str = ""
    lifetime_s: float = 0.0
    """How long it is shown unless it comes again; 0: for ever."""
    number: int | None = None
    """Tells markers of one namespace apart, and which one of the message before is replaced; None: the place in the message."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StampedMarkers:
    """Markers as they stood at one time."""

    stamp_ns: int
    frame_id: str
    markers: tuple[Marker, ...]
    topic: str = ""


def _encode(stamped: StampedMarkers, messages: MessageFactory) -> Any:
    header = messages.header(stamped.stamp_ns, stamped.frame_id)
    made = [
        _marker(marker, place if marker.number is None else marker.number, header, messages)
        for place, marker in enumerate(stamped.markers)
    ]
    return messages.make("visualization_msgs/msg/MarkerArray", made)


def _marker(marker: Marker, number: int, header: Any, messages: MessageFactory) -> Any:
    make = messages.make
    is_text = marker.shape == "text"
    place = marker.points_m[0] if is_text else np.zeros(3)
    colours = [make("std_msgs/msg/ColorRGBA", *map(float, colour)) for colour in marker.colours]
    lifetime_ns = round(marker.lifetime_s * 1e9)
    lifetime = make("builtin_interfaces/msg/Duration", lifetime_ns // 1_000_000_000, lifetime_ns % 1_000_000_000)
    points = [] if is_text else [make("geometry_msgs/msg/Point", *map(float, point)) for point in marker.points_m]
    fields = [
        header, marker.namespace, number, _TYPES[marker.shape], 0, messages.pose(place, np.array([0.0, 0.0, 0.0, 1.0])),
        messages.vector(np.full(3, marker.size_m)), colours[0], lifetime, False, points, colours if len(colours) > 1 else [],
    ]  # fmt: skip
    if messages.ros1:
        return make("visualization_msgs/msg/Marker", *fields, marker.text, "", False)
    no_bytes = np.zeros(0, dtype=np.uint8)
    texture = make("sensor_msgs/msg/CompressedImage", messages.header(0, ""), "", no_bytes)
    mesh = make("visualization_msgs/msg/MeshFile", "", no_bytes)
    return make("visualization_msgs/msg/Marker", *fields, "", texture, [], marker.text, "", mesh, False)


ENCODER = Encoder(msgtypes=("visualization_msgs/msg/MarkerArray",), produces=StampedMarkers, encode=_encode)

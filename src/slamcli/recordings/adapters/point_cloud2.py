# SPDX-License-Identifier: MIT
"""sensor_msgs/PointCloud2 of any layout: organised or not, padded, either byte order, with times and intensities."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import PointCloud
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory
from slamcli.recordings.point_times import point_times

# sensor_msgs/PointField datatypes.
_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
_TIME_FIELDS = (
    "t",
    "time",
    "timestamp",
    "offset_time",
    "time_stamp",
    "time_offset",
    "t_offset",
    "point_time_offset",
    "relative_time",
)
_INTENSITY_FIELDS = ("intensity", "intensities", "i", "reflectivity")


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[PointCloud]:
    columns = _columns(message)
    missing = [name for name in ("x", "y", "z") if name not in columns]
    if missing:
        raise DataError(f"point cloud without field {missing[0]} (it has {', '.join(columns) or 'none'})")
    points = np.column_stack([columns[name].astype(np.float32) for name in ("x", "y", "z")])
    # Drivers of organised clouds write NaN, or exactly zero, where a beam had no return.
    valid = np.isfinite(points).all(axis=1) & points.any(axis=1)
    times = next((columns[name] for name in _TIME_FIELDS if name in columns), None)
    intensities = next((columns[name] for name in _INTENSITY_FIELDS if name in columns), None)
    recorded_ns = int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
    offset_ns = None
    if times is not None:
        valid &= np.isfinite(times)
        offset_ns, own_clock = point_times(times[valid], recorded_ns)
        if offset_ns is None:
            context.count("clouds whose point times are no times")
        elif own_clock:
            context.count("clouds whose point times are of another clock than the stamp: the first is put at the stamp")
    cloud = PointCloud(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        points_m=points[valid],
        offset_ns=offset_ns,
        intensities=None if intensities is None else intensities[valid].astype(np.float32),
        topic=context.topic,
    )
    return (cloud,)


def _columns(message: Any) -> dict[str, NDArray[Any]]:
    """Return the scalar fields of a cloud by name, each (height * width,), in the order of the message."""
    height, width, step, row_step = (
        int(n) for n in (message.height, message.width, message.point_step, message.row_step)
    )
    order = ">" if message.is_bigendian else "<"
    layout: dict[str, tuple[str, int]] = {}
    for field in message.fields:
        kind = _DATATYPES.get(int(field.datatype))
        if kind is None:
            raise DataError(f"point cloud field {field.name!r} has unknown datatype {field.datatype}")
        if int(field.offset) + np.dtype(kind).itemsize > step:
            raise DataError(f"point cloud field {field.name!r} lies beyond point_step {step}")
        layout.setdefault(field.name, (order + kind, int(field.offset)))
    if height * width == 0 or not layout:
        return {name: np.zeros(0, dtype=kind) for name, (kind, _) in layout.items()}
    if height == 1 or row_step == 0:
        row_step = width * step
    data = np.frombuffer(message.data, dtype=np.uint8)
    if row_step < width * step or len(data) < (height - 1) * row_step + width * step:
        raise DataError(f"point cloud of {width} x {height} points of {step} bytes in {len(data)} bytes of data")
    columns = {}
    for name, (kind, offset) in layout.items():
        shape, strides = (height, width), (row_step, step)
        columns[name] = np.ndarray(shape, dtype=kind, buffer=data, offset=offset, strides=strides).reshape(-1)
    return columns


def _encode(cloud: PointCloud, messages: MessageFactory) -> Any:
    names = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if cloud.intensities is not None:
        names.append(("intensity", "<f4"))
    timed = cloud.offset_ns is not None and len(cloud.points_m) > 0
    # Offsets before the stamp do not fit an unsigned "t": then they are float64 seconds, as "time".
    unsigned = timed and cloud.offset_ns is not None and cloud.offset_ns.min() >= 0 and cloud.offset_ns.max() >= 2e5
    if timed:
        names.append(("t", "<u4") if unsigned else ("time", "<f8"))
    table = np.zeros(len(cloud.points_m), dtype=names)
    for axis, name in enumerate("xyz"):
        table[name] = cloud.points_m[:, axis]
    if cloud.intensities is not None:
        table["intensity"] = cloud.intensities
    if timed and cloud.offset_ns is not None:
        table[names[-1][0]] = cloud.offset_ns if unsigned else cloud.offset_ns / 1e9
    datatypes = {"<f4": 7, "<u4": 6, "<f8": 8}
    offsets = np.cumsum([0] + [np.dtype(kind).itemsize for _, kind in names])
    fields = [
        messages.make("sensor_msgs/msg/PointField", name, int(offset), datatypes[kind], 1)
        for (name, kind), offset in zip(names, offsets, strict=False)
    ]
    return messages.make(
        "sensor_msgs/msg/PointCloud2",
        messages.header(cloud.stamp_ns, cloud.frame_id),
        1,
        len(table),
        fields,
        False,
        table.dtype.itemsize,
        table.nbytes,
        table.view(np.uint8).reshape(-1),
        True,
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/PointCloud2",), produces=PointCloud, decode=_decode, encode=_encode)

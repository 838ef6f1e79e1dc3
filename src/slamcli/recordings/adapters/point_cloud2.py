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
_RING_FIELDS = ("ring", "channel", "line", "laser_id")


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
    rings = next((columns[name] for name in _RING_FIELDS if name in columns and columns[name].dtype.kind in "iu"), None)
    organised = int(message.height) > 1
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
        rings=None if rings is None else rings[valid].astype(np.uint16),
        shape=(int(message.height), int(message.width)) if organised else None,
        cells=np.flatnonzero(valid) if organised else None,
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
    columns: dict[str, NDArray[Any]] = {name: cloud.points_m[:, axis] for axis, name in enumerate("xyz")}
    if cloud.intensities is not None:
        columns["intensity"] = cloud.intensities
    if cloud.rings is not None:
        columns["ring"] = cloud.rings
    if cloud.colours is not None:
        # As PCL packs them: three bytes of a number that is called a float.
        red, green, blue = cloud.colours.T.astype(np.uint32)
        columns["rgb"] = (red << 16 | green << 8 | blue).view(np.float32)
    if cloud.offset_ns is not None and len(cloud.points_m) > 0:
        # Offsets before the stamp do not fit an unsigned "t": then they are float64 seconds, as "time".
        unsigned = cloud.offset_ns.min() >= 0 and 2e5 <= cloud.offset_ns.max() < 1 << 32
        columns["t" if unsigned else "time"] = cloud.offset_ns.astype(np.uint32) if unsigned else cloud.offset_ns / 1e9
    order = sorted(columns, key=lambda name: name == "ring")  # its two bytes last: the others keep to multiples of four
    kinds = {
        name: "<u2" if name == "ring" else "<u4" if name == "t" else "<f8" if name == "time" else "<f4"
        for name in order
    }
    table = _laid_out(cloud, [(name, kinds[name]) for name in order])
    for name in order:
        table[name][slice(None) if cloud.cells is None else cloud.cells] = columns[name]
    datatypes = {"<u2": 4, "<u4": 6, "<f4": 7, "<f8": 8}
    offsets = np.cumsum([0] + [np.dtype(kinds[name]).itemsize for name in order])
    fields = [
        messages.make("sensor_msgs/msg/PointField", name, int(offset), datatypes[kinds[name]], 1)
        for name, offset in zip(order, offsets, strict=False)
    ]
    height, width = cloud.shape or (1, len(table))
    return messages.make(
        "sensor_msgs/msg/PointCloud2",
        messages.header(cloud.stamp_ns, cloud.frame_id),
        height,
        width,
        fields,
        False,
        table.dtype.itemsize,
        table.dtype.itemsize * width,
        table.view(np.uint8).reshape(-1),
        cloud.shape is None,
    )


def _laid_out(cloud: PointCloud, layout: list[tuple[str, str]]) -> NDArray[Any]:
    """Return a table (N,) for the points, or (height * width,) full of NaN for an organised cloud."""
    if cloud.shape is None:
        return np.zeros(len(cloud.points_m), dtype=layout)
    table = np.zeros(cloud.shape[0] * cloud.shape[1], dtype=layout)
    for name in "xyz":
        table[name] = np.nan
    return table


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/PointCloud2",), produces=PointCloud, decode=_decode, encode=_encode)

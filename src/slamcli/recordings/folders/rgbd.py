# SPDX-License-Identifier: MIT
"""The streams of a colour camera with depth registered to it."""

from __future__ import annotations

from slamcli.measurements import CameraModel
from slamcli.recordings.folders.layout import Reading
from slamcli.recordings.folders.listings import ImageList
from slamcli.recordings.folders.streams import CameraInfos, DepthFiles, ImageFiles, Stream

COLOUR_TOPIC = "/camera/rgb/image_color/compressed"
COLOUR_INFO_TOPIC = "/camera/rgb/camera_info"
DEPTH_TOPIC = "/camera/depth/image"
DEPTH_INFO_TOPIC = "/camera/depth/camera_info"
FRAME = "camera_rgb_optical_frame"


def rgbd_streams(
    colour: ImageList, depth: ImageList, camera: CameraModel | None, units_per_m: float, reading: Reading
) -> list[Stream]:
    """Return images, depth and, where the camera is known, its calibration with each of them.

    `units_per_m` is the data set's value of one metre; what the reading was given wins.
    """
    streams: list[Stream] = []
    if camera is not None:
        streams.append(CameraInfos(topic=COLOUR_INFO_TOPIC, model=camera, stamps_ns=colour.stamps_ns))
        streams.append(CameraInfos(topic=DEPTH_INFO_TOPIC, model=camera, stamps_ns=depth.stamps_ns))
    streams.append(ImageFiles(topic=COLOUR_TOPIC, frame_id=FRAME, stamps_ns=colour.stamps_ns, paths=colour.paths))
    streams.append(
        DepthFiles(
            topic=DEPTH_TOPIC,
            frame_id=FRAME,
            stamps_ns=depth.stamps_ns,
            paths=depth.paths,
            units_per_m=reading.depth_units_per_m or units_per_m,
        )
    )
    return streams

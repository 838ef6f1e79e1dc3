# SPDX-License-Identifier: MIT
"""Which sensors Cartographer takes: what its options say, and where they leave it open what the recording has."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from slamcli.cartographer.parameters import CartographerParameters
from slamcli.mapper import InputPlan, SensorOffer
from slamcli.runtime import RunLog

MODES = ("2d", "3d")
ROLES = frozenset({"scans", "points", "odometry", "imu", "fixes", "landmarks"})
_IMU_2D = "TRAJECTORY_BUILDER_2D.use_imu_data"


def plan_inputs(
    parameters: CartographerParameters, given: Collection[str], offer: SensorOffer, log: RunLog
) -> InputPlan:
    """Return the sensors to take, and the parameters with every choice that they left open made.

    Topics that the user names are taken whatever the options say; numbers of scanners that the options give hold as far
    as the recording goes. Left open, one scanner (in 3D: one sensor of clouds) is taken, and every other sensor that
    there is. The log says where the recording offers more or less than the options ask for.
    """
    asked = int(offer.mode[0]) if offer.mode else parameters.map_builder.dimensions
    dimensions = asked or (3 if offer.spatial else 2)
    if asked is None and (dimensions == 3 or offer.num_point_clouds):
        log.note(f"mapping in {dimensions}D, as the recording's range sensors are (choose with --mode 2d or 3d)")
    num_scans, num_echoes, num_clouds = _range_sensors(parameters, offer, dimensions, log)
    options = parameters.options
    taken = {
        "odometry": _taken("odometry", options.use_odometry, "use_odometry", offer, log),
        "imu": _taken("imu", _imu_asked(parameters, given, dimensions), _IMU_2D, offer, log),
        "fixes": _taken("fixes", options.use_nav_sat, "use_nav_sat", offer, log),
        "landmarks": _taken("landmarks", options.use_landmarks, "use_landmarks", offer, log),
    }
    if dimensions == 3 and taken["landmarks"]:
        log.warn("landmarks are not used in 3D")
        taken["landmarks"] = False
    if not (offer.odometry or taken["imu"]):
        log.warn("no odometry and no IMU: only the range sensors tell how the robot moved")
    settled = replace(
        parameters,
        options=replace(
            options,
            num_laser_scans=num_scans,
            num_multi_echo_laser_scans=num_echoes or 0,
            num_point_clouds=num_clouds,
            use_odometry=taken["odometry"],
            use_nav_sat=taken["fixes"],
            use_landmarks=taken["landmarks"],
        ),
        map_builder=replace(
            parameters.map_builder,
            use_trajectory_builder_2d=dimensions == 2,
            use_trajectory_builder_3d=dimensions == 3,
        ),
        trajectory_builder_2d=replace(
            parameters.trajectory_builder_2d,
            use_imu_data=taken["imu"] if dimensions == 2 else parameters.trajectory_builder_2d.use_imu_data,
        ),
    )
    return InputPlan(
        parameters=settled,
        num_laser_scans=num_scans,
        num_multi_echo_laser_scans=num_echoes,
        num_point_clouds=num_clouds,
        spatial=dimensions == 3,
        base_frame=options.tracking_frame if "tracking_frame" in given else None,
        map_frame=options.map_frame,
        ratios={
            "ranges": options.rangefinder_sampling_ratio,
            "odometry": options.odometry_sampling_ratio,
            "imu": options.imu_sampling_ratio,
            "fixes": options.fixed_frame_pose_sampling_ratio,
            "landmarks": options.landmarks_sampling_ratio,
        },
        odometry=taken["odometry"],
        imu=taken["imu"],
        fixes=taken["fixes"],
        landmarks=taken["landmarks"],
    )


def _range_sensors(
    parameters: CartographerParameters, offer: SensorOffer, dimensions: int, log: RunLog
) -> tuple[int, int | None, int]:
    """Return how many scanners, scanners of several echoes (None: they count as the former) and clouds to take."""
    options = parameters.options
    there = (offer.num_laser_scans, offer.num_multi_echo_laser_scans, offer.num_point_clouds)
    if offer.named & {"scans", "points"}:
        return there
    asked = (options.num_laser_scans, options.num_multi_echo_laser_scans, options.num_point_clouds)
    if all(number is None for number in asked):
        return _by_offer(offer, dimensions, log)
    wanted = tuple(number or 0 for number in asked)
    numbers = tuple(min(pair) for pair in zip(wanted, there, strict=True))
    text = "num_laser_scans {}, num_multi_echo_laser_scans {}, num_point_clouds {}"
    if sum(numbers) == 0:
        log.warn(
            f"the options ask for {text.format(*wanted)}, and the recording has none of these: what it has is used"
        )
        return _by_offer(offer, dimensions, log)
    if numbers != wanted:
        log.warn(f"the options ask for {text.format(*wanted)}, and the recording has only {text.format(*there)}")
    return numbers[0], numbers[1], numbers[2]


def _by_offer(offer: SensorOffer, dimensions: int, log: RunLog) -> tuple[int, int | None, int]:
    has_scans = offer.num_laser_scans + offer.num_multi_echo_laser_scans > 0
    if offer.num_point_clouds and (dimensions == 3 or not has_scans):
        if has_scans:
            log.note("scans are not used, in 3D point clouds are (choose with --scan-topic)")
        return 0, 0, 1
    if offer.num_point_clouds:
        log.note("point clouds are not used, there are scans (choose with --points-topic)")
    return 1, None, 0


def _imu_asked(parameters: CartographerParameters, given: Collection[str], dimensions: int) -> bool | None:
    """Return whether the IMU is asked for; None where that is left to the recording."""
    use = parameters.trajectory_builder_2d.use_imu_data
    return None if dimensions == 3 or (use and _IMU_2D not in given) else use


def _taken(role: str, asked: bool | None, option: str, offer: SensorOffer, log: RunLog) -> bool:
    """Return whether a sensor is used: if the user names its topic, else as asked, else (None) if it is there."""
    there = bool(getattr(offer, role))
    if role in offer.named:
        return True
    if asked and not there:
        log.note(f"{option} is true, and the recording has no {_WORDS[role]}: it runs without")
    elif asked is False and there:
        log.note(f"{_WORDS[role]} is not used: {option} is false")
    return there and asked is not False


_WORDS = {"odometry": "odometry", "imu": "IMU", "fixes": "GPS", "landmarks": "landmark topic"}

# SPDX-License-Identifier: MIT
"""What is wrong with RTAB-Map's parameters: in its ``.ini`` files and as its ROS nodes get them."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at
from slamcli.native.checks.rtabmap_traps import Values, check_traps
from slamcli.native.rtabmap_ini import read_rtabmap_ini
from slamcli.native.rtabmap_names import NODES, ODOMETRY_NODES, of_today
from slamcli.native.rtabmap_nodes import MAPPING_GROUPS, NodeGiven
from slamcli.native.settings import Setting, merge
from slamcli.parameters import Declaration, convert, unknown_name

_COMPLETE = 200
_FALSE = {"no", "off", "none", "disabled"}
_OF_NODES = {
    "config_path", "database_path", "odom_frame_id_init", "ground_truth_frame_id", "ground_truth_base_frame_id",
    "odom_tf_angular_variance", "odom_tf_linear_variance", "odom_default_angular_variance", "odom_default_linear_variance",
    "landmark_default_angular_variance", "landmark_default_linear_variance", "tf_prefix", "latch", "initial_pose",
    "use_action_for_goal", "use_saved_map", "gen_scan", "gen_scan_max_depth", "gen_scan_min_depth", "gen_depth",
    "gen_depth_decimation", "gen_depth_fill_holes_size", "gen_depth_fill_iterations", "gen_depth_fill_holes_error",
    "scan_cloud_max_points", "scan_cloud_is_2d", "stereo_to_depth", "odom_sensor_sync", "map_filter_radius", "map_filter_angle",
    "map_cleanup", "map_always_update", "map_negative_poses_ignored", "map_negative_scan_ray_tracing", "map_empty_ray_tracing",
    "cloud_output_voxelized", "cloud_subtract_filtering", "cloud_subtract_filtering_min_neighbors", "octomap_tree_depth",
    "is_rtabmap_paused", "subscribe_rgbd", "rgbd_cameras", "depth_cameras", "subscribe_sensor_data", "subscribe_scan_descriptor",
    "subscribe_user_data", "subscribe_odom_info", "subscribe_imu", "stereo_approx_sync", "approx_rgbd_sync", "rgb/image_transport",
    "depth/image_transport", "image_transport", "use_sim_time", "log_to_rosout_level", "guess_frame_id", "guess_min_translation",
    "guess_min_rotation", "guess_min_time", "publish_null_when_lost", "wait_imu_to_init", "always_check_imu_tf",
    "expected_update_rate", "max_update_rate", "min_update_rate", "always_process_most_recent_frame", "deskewing", "deskewing_slerp",
    "scan_range_min", "scan_range_max", "scan_voxel_size", "scan_normal_k", "scan_normal_radius", "scan_normal_ground_up",
    "scan_downsampling_step", "plugins", "keep_color", "publish_compressed_sensor_data", "qos", "qos_image", "qos_camera_info",
    "qos_scan", "qos_odom", "qos_user_data", "qos_imu",
}  # fmt: skip
"""Parameters of the nodes that have no meaning here, and are not known to slamcli otherwise."""


def check_rtabmap_ini(path: Path, table: Sequence[Declaration]) -> Iterator[Finding]:
    """Yield what is wrong with an ``.ini`` file; in one that lists everything only what differs from the defaults."""
    found = read_rtabmap_ini(path)
    if found.skipped:
        yield Finding(NOTE, str(path), 0, f"RTAB-Map reads [Core] alone: {', '.join(found.skipped)} are the window's")
    given = merge(found.settings)
    if len(given) >= _COMPLETE:
        known = {entry.name: entry for entry in table}
        given = {
            name: setting
            for name, setting in given.items()
            if name not in known or not _is_default(setting, known[name])
        }
    yield from _check(given, table, path.name)
    yield from check_traps(Values(given, table))


def check_rtabmap_nodes(
    nodes: Sequence[NodeGiven], table: Sequence[Declaration], *, ros2: bool = False
) -> Iterator[Finding]:
    """Yield what is wrong with what RTAB-Map's nodes are given; `ros2`: by parameter YAML of ROS 2."""
    for node in nodes:
        yield from _check(node.settings, table, node.type)
        for name, setting in node.settings.items():
            if ros2 and "/" in name and not isinstance(setting.value, str):
                text = str(setting.value).lower() if isinstance(setting.value, bool) else setting.value
                yield at(
                    setting, WARNING, f'{name} is a text for ROS 2\'s node, which refuses anything else: write "{text}"'
                )
        yield from _for_another_node(node)
    mapping = next((node for node in nodes if node.type in NODES), None)
    if mapping is not None:
        yield from check_traps(Values(mapping.settings, table, node=mapping))


def _check(given: Mapping[str, Setting], table: Sequence[Declaration], owner: str) -> Iterator[Finding]:
    """Yield what is wrong with names and values alone."""
    known = {entry.name: entry for entry in table}
    absent: dict[str, Setting] = {}
    for name, setting in given.items():
        today = of_today(setting)
        if today.absent:
            absent.setdefault(today.absent, setting)
            continue
        if today.remark:
            yield at(setting, ERROR if today.setting is None else WARNING, today.remark)
        if today.setting is not None and today.setting.name in known:
            yield from _check_value(today.setting, known[today.setting.name])
        elif today.setting is not None and "/" in name and name not in _OF_NODES:
            yield at(setting, ERROR, f"{unknown_name(name, known)} ({owner} ignores it and says nothing)")
        elif today.setting is not None and name not in _OF_NODES:
            yield from _unknown_of_node(setting, known, owner)
    if absent:
        first = next(iter(absent.values()))
        yield at(first, NOTE, f"not checked, as these parts are not here: {', '.join(f'{group}/' for group in absent)}")


def _check_value(setting: Setting, entry: Declaration) -> Iterator[Finding]:
    value = setting.value
    if value is None:
        yield at(setting, WARNING, f"{setting.name} has no value: the default {entry.default} is used")
        return
    if entry.kind is bool and str(value).strip().lower() in _FALSE:
        yield at(setting, ERROR, f"{setting.name}={value!r} counts as true: for RTAB-Map only false and 0 are false")
        return
    try:
        convert(entry, value)
    except ConfigError as error:
        is_there = str(value) in entry.unavailable
        yield at(setting, WARNING if is_there else ERROR, str(error))
        return
    if not entry.effective and not _is_default(setting, entry):
        yield at(setting, NOTE, f"{setting.name} is accepted and has no effect: {entry.help}")


def _is_default(setting: Setting, entry: Declaration) -> bool:
    try:
        return bool(convert(entry, setting.value) == entry.default)
    except ConfigError:
        return False


def _unknown_of_node(setting: Setting, known: Mapping[str, Declaration], owner: str) -> Iterator[Finding]:
    plain = [name for name in known if "/" not in name and "." not in name]
    near = difflib.get_close_matches(setting.name, [*plain, *_OF_NODES], n=1, cutoff=0.8)
    if near:
        yield at(setting, WARNING, f"{owner} reads no parameter {setting.name!r}; did you mean {near[0]}?")
    else:
        yield at(setting, NOTE, f"{setting.name} of {owner} is not known here: not checked")


def _for_another_node(node: NodeGiven) -> Iterator[Finding]:
    """Yield parameters that this node does not read and another one does."""
    for name, setting in node.settings.items():
        group, slash, _ = name.partition("/")
        if not slash:
            continue
        if node.type in ODOMETRY_NODES and group in MAPPING_GROUPS:
            yield at(setting, WARNING, f"{node.type} does not read {name}: it belongs to the rtabmap node")
        elif node.type in NODES and group.startswith("Odom"):
            yield at(setting, WARNING, f"the rtabmap node does not read {name}: it belongs to the odometry node")

# SPDX-License-Identifier: MIT
"""Parameter files of nav2 in the names of ROS 1's navigation stack, as far as there is a counterpart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.native.settings import Setting
from slamcli.navigation.planner_plugins import PLUGINS
from slamcli.navigation.pursuit_parameters import PursuitParameters
from slamcli.navigation.teb import TebParameters
from slamcli.parameters import declarations

_MARK = "ros__parameters"
_SILENT = frozenset({"use_sim_time", "plugin"})
"""Of no interest where they are not read."""


def _pairs(text: str) -> dict[str, str]:
    """Return nav2's names and ours from words ``theirs=ours``, or ``name`` where they are the same."""
    words = (word.partition("=") for word in text.split())
    return {theirs: ours or theirs for theirs, _, ours in words}


_AMCL = _pairs(
    """alpha1=odom_alpha1 alpha2=odom_alpha2 alpha3=odom_alpha3 alpha4=odom_alpha4 alpha5=odom_alpha5 z_hit=laser_z_hit
    z_max=laser_z_max z_rand=laser_z_rand z_short=laser_z_short sigma_hit=laser_sigma_hit lambda_short=laser_lambda_short
    max_beams=laser_max_beams pf_err=kld_err pf_z=kld_z initial_pose/x=initial_pose_x initial_pose/y=initial_pose_y
    initial_pose/yaw=initial_pose_a min_particles max_particles update_min_a update_min_d resample_interval do_beamskip
    beam_skip_distance beam_skip_threshold beam_skip_error_threshold recovery_alpha_fast recovery_alpha_slow
    laser_likelihood_max_dist laser_max_range laser_min_range laser_model_type base_frame_id odom_frame_id global_frame_id
    first_map_only tf_broadcast transform_tolerance save_pose_rate"""
)
_DWB = _pairs(
    """max_speed_xy=max_vel_trans min_speed_xy=min_vel_trans min_speed_theta=min_vel_theta linear_granularity=sim_granularity
    angular_granularity=angular_sim_granularity vtheta_samples=vth_samples trans_stopped_velocity=trans_stopped_vel
    rot_stopped_velocity=theta_stopped_vel BaseObstacle.scale=occdist_scale BaseObstacle.sum_scores=sum_scores
    Twirling.scale=twirling_scale PathAlign.forward_point_distance=forward_point_distance
    Oscillation.oscillation_reset_dist=oscillation_reset_dist Oscillation.oscillation_reset_angle=oscillation_reset_angle
    min_vel_x max_vel_x min_vel_y max_vel_y max_vel_theta acc_lim_x acc_lim_y acc_lim_theta vx_samples vy_samples sim_time
    xy_goal_tolerance yaw_goal_tolerance"""
)
_DWB_HALVED = {"PathDist.scale": "path_distance_bias", "GoalDist.scale": "goal_distance_bias"}
"""DWB multiplies these by half a cell, DWAPlannerROS of noetic by a cell."""

_MPPI = _pairs(
    "vx_max=max_vel_x vx_min=min_vel_x vy_max=max_vel_y wz_max=max_vel_theta ax_max=acc_lim_x ay_max=acc_lim_y az_max=acc_lim_theta"
)
_BEHAVIOURS = _pairs(
    """max_rotational_vel=rotate_recovery/max_rotational_vel min_rotational_vel=rotate_recovery/min_in_place_rotational_vel
    rotational_acc_lim=rotate_recovery/acc_lim_theta"""
)
_RECOVERIES = {"spin": "rotate_recovery", "backup": "back_up"}
_GOAL = ("xy_goal_tolerance", "yaw_goal_tolerance", "stateful")
_PLANNER = _pairs(
    """tolerance=default_tolerance allow_unknown minimum_turning_radius motion_model_for_search angle_quantization_bins
    reverse_penalty non_straight_penalty analytic_expansion_ratio"""
)


@dataclass(frozen=True, slots=True)
class Nav2Settings:
    """What a file of nav2 says in ROS 1's names."""

    settings: tuple[Setting, ...]
    notes: tuple[str, ...]
    """What is not read."""


def is_nav2(settings: Iterable[Setting]) -> bool:
    """Return whether parameters are those of ROS 2 nodes."""
    return any(_MARK in setting.name.split("/") for setting in settings)


def translate_nav2(settings: Iterable[Setting]) -> Nav2Settings:
    """Return what the nodes of nav2 are told that has a counterpart, the rest in one note.

    Costmaps keep their names. The first controller and the first planner are taken, and the first goal checker.

    Raises
    ------
    ConfigError
        If a list of plugins is none.
    """
    nodes: dict[str, dict[str, Setting]] = {}
    for setting in settings:
        parts = setting.name.split("/")
        if _MARK not in parts:
            nodes.setdefault("", {})[setting.name] = setting
            continue
        place = parts.index(_MARK)
        nodes.setdefault(parts[place - 1] if place else "", {})["/".join(parts[place + 1 :])] = setting
    found: list[Setting] = []
    left: list[str] = []
    remarks: list[str] = []
    for node, given in nodes.items():
        reader = _READERS.get(node)
        if reader is None:
            if set(given) - _SILENT:
                left.append(node or ", ".join(given))
            continue
        part = _Part(given)
        found.extend(reader(part))
        unread = sorted(name for name in given if name not in part.read and name.rpartition("/")[2] not in _SILENT)
        remarks += part.remarks
        left += [f"{node}/{name}" for name in unread]
    notes = (f"of nav2's parameters these are not read: {', '.join(left)}",) if left else ()
    return Nav2Settings(settings=tuple(found), notes=(*remarks, *notes))


class _Part:
    """The parameters of one node; remembers which were read."""

    def __init__(self, given: Mapping[str, Setting]) -> None:
        self.given = given
        self.read: set[str] = set()
        self.remarks: list[str] = []
        """What is said besides."""

    def renamed(
        self, names: Mapping[str, str], below: str, into: str, factor: float | None = None
    ) -> Iterator[Setting]:
        """Yield those of `names` (nav2's to ours) under `below`, as parameters of section `into`."""
        for name, ours in names.items():
            setting = self.take(f"{below}{name}")
            if setting is not None:
                value = setting.value
                if factor is not None and isinstance(value, (int, float)) and not isinstance(value, bool):
                    value = factor * value
                yield Setting(f"{into}{ours}", value, setting.file, setting.line)

    def take(self, name: str) -> Setting | None:
        """Return a setting, which now counts as read."""
        setting = self.given.get(name) or self.given.get(name.replace(".", "/"))
        if setting is not None:
            self.read |= {name, name.replace(".", "/")}
        return setting

    def first(self, *lists: str, default: str) -> str:
        """Return the first plugin that one of these lists names."""
        for name in lists:
            setting = self.take(name)
            if setting is None:
                continue
            value = setting.value
            if isinstance(value, list) and value and all(isinstance(entry, str) for entry in value):
                return str(value[0])
            if isinstance(value, str) and value:
                return value
            raise ConfigError(f"{setting.source}: {name} is no list of names")
        return default


def _of_amcl(part: _Part) -> Iterator[Setting]:
    yield from part.renamed(_AMCL, "", "amcl/")
    model = part.take("robot_model_type")
    omni = model is not None and "omni" in str(model.value).lower()
    place = model or next(iter(part.given.values()))
    # nav2's models take roots of variances, as the corrected ones of ROS 1 do
    yield Setting("amcl/odom_model_type", "omni-corrected" if omni else "diff-corrected", place.file, place.line)


def _of_controller(part: _Part) -> Iterator[Setting]:
    yield from part.renamed({"controller_frequency": "controller_frequency"}, "", "")
    patience = part.take("failure_tolerance")
    if patience is not None and isinstance(patience.value, (int, float)) and patience.value >= 0:
        yield Setting("controller_patience", patience.value, patience.file, patience.line)
    progress = part.first("progress_checker_plugins", "progress_checker_plugin", default="progress_checker")
    names = {"required_movement_radius": "oscillation_distance", "movement_time_allowance": "oscillation_timeout"}
    yield from part.renamed(names, f"{progress}/", "")
    name = part.first("controller_plugins", default="FollowPath")
    checker = part.first("goal_checker_plugins", "goal_checker_plugin", default="goal_checker")
    plugin = part.take(f"{name}/plugin")
    kind = "dwb_core/DWBLocalPlanner" if plugin is None else str(plugin.value).replace("::", "/")
    if "RotationShim" in kind:
        primary = part.take(f"{name}/primary_controller")
        kind = kind if primary is None else str(primary.value).replace("::", "/")
    place = plugin or next(iter(part.given.values()))
    yield from _of_local_planner(part, kind, f"{name}/", f"{checker}/", place)


def _of_local_planner(part: _Part, kind: str, below: str, checker: str, place: Setting) -> Iterator[Setting]:
    goal = {name: name for name in _GOAL}
    if "RegulatedPurePursuit" in kind:
        ours, section = "pursuit", "FollowPath/"
        yield from part.renamed({entry.name: entry.name for entry in declarations(PursuitParameters)}, below, section)
    elif "Teb" in kind:
        ours, section = "teb", "TebLocalPlannerROS/"
        names = {entry.name.replace(".", "/"): entry.name for entry in declarations(TebParameters)}
        yield from part.renamed(names, below, section)
        goal.pop("stateful")
    else:
        ours, section = "dwa", "DWAPlannerROS/"
        goal["stateful"] = "latch_xy_goal_tolerance"
        if "DWBLocalPlanner" not in kind:
            part.remarks.append(f"nav2's controller {kind} has no counterpart: DWA drives, unless told otherwise")
        if "MPPI" in kind:
            yield from part.renamed(_MPPI, below, section)
            yield from part.renamed({"vx_max": "max_vel_trans"}, below, section)
        else:
            yield from part.renamed(_DWB, below, section)
            yield from part.renamed(_DWB_HALVED, below, section, 0.5)
    yield from part.renamed(goal, checker, section)
    yield Setting("base_local_planner", ours, place.file, place.line)


def _of_planner(part: _Part) -> Iterator[Setting]:
    name = part.first("planner_plugins", default="GridBased")
    plugin = part.take(f"{name}/plugin")
    star = part.take(f"{name}/use_astar")
    method = "navfn" if plugin is None else PLUGINS.get(str(plugin.value).replace("::", "/"))
    if star is not None and str(star.value).lower() == "true":
        yield Setting("base_global_planner", "astar", star.file, star.line)
    elif plugin is not None and method is not None:
        yield Setting("base_global_planner", method, plugin.file, plugin.line)
    elif plugin is not None:
        part.remarks.append(f"nav2's planner {plugin.value} has no counterpart: NavFn plans, unless told otherwise")
    yield from part.renamed(_PLANNER, f"{name}/", "planner/")
    limit = part.given.get(f"{name}/max_iterations")
    if limit is not None and isinstance(limit.value, int) and limit.value > 0:
        yield from part.renamed({"max_iterations": "max_iterations"}, f"{name}/", "planner/")


def _of_behaviours(part: _Part) -> Iterator[Setting]:
    yield from part.renamed(_BEHAVIOURS, "", "")
    for listed in ("behavior_plugins", "recovery_plugins"):
        plugins = part.take(listed)
        if plugins is None:
            continue
        if not isinstance(plugins.value, list):
            raise ConfigError(f"{plugins.source}: {listed} is no list of names")
        # as nav2's usual tree: clear, then what there is
        tried = [
            "conservative_reset",
            *(_RECOVERIES[str(p)] for p in plugins.value if str(p) in _RECOVERIES),
            "aggressive_reset",
        ]
        yield Setting("recovery_behaviors", " ".join(tried), plugins.file, plugins.line)


def _of_costmap(name: str) -> Callable[[_Part], Iterator[Setting]]:
    def read(part: _Part) -> Iterator[Setting]:
        part.read |= set(part.given)
        for key, setting in part.given.items():
            yield Setting(f"{name}/{key}", setting.value, setting.file, setting.line)

    return read


_READERS: Mapping[str, Callable[[_Part], Iterator[Setting]]] = {
    "amcl": _of_amcl,
    "controller_server": _of_controller,
    "planner_server": _of_planner,
    "behavior_server": _of_behaviours,
    "recoveries_server": _of_behaviours,
    "local_costmap": _of_costmap("local_costmap"),
    "global_costmap": _of_costmap("global_costmap"),
}

# SPDX-License-Identifier: MIT
"""Traps of amcl, move_base and the planners it loads."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Mapping

from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.native.checks.costmap import check_costmap
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, below, check_declared, check_value, number
from slamcli.native.checks.navigation_traps import check_finite, check_scanner, check_together
from slamcli.native.ros_parameters.amcl import AMCL
from slamcli.native.ros_parameters.declare import Table
from slamcli.native.ros_parameters.move_base import CLEAR_COSTMAP, MOVE_BASE, RECOVERIES, RECOVERY_TYPES
from slamcli.native.ros_parameters.planners import DWA, DWA_OLD_NAMES, GLOBAL_PLANNER, NAVFN, TEB, TRAJECTORY_PLANNER
from slamcli.native.settings import Setting
from slamcli.navigation.collision_monitor import CollisionMonitorParameters
from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import Declaration, declarations, unknown_name

_COSTMAPS = ("global_costmap", "local_costmap")
_OURS: dict[str, tuple[Declaration, ...]] = {
    "NavfnROS": declarations(PlannerParameters),
    "GlobalPlanner": declarations(PlannerParameters),
    **{planner.section: declarations(planner.parameters) for planner in LOCAL_PLANNERS.values()},
}
_TEB_LISTS = {"footprint_model/vertices", "footprint_model/line_start", "footprint_model/line_end"}


def check_amcl(settings: Mapping[str, Setting], range_m: float | None = None) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of one amcl node; `range_m` is what the scanner sees, if known."""
    yield from check_finite(settings)
    yield from check_scanner(settings, range_m)
    settings = yield from _without_own(settings, declarations(AmclParameters), "amcl")
    yield from check_declared(settings, AMCL, "amcl")
    if number(settings, "min_particles", 100) > number(settings, "max_particles", 5000):
        setting = settings.get("min_particles") or settings["max_particles"]
        yield at(setting, ERROR, "min_particles is above max_particles")
    model = settings.get("odom_model_type")
    if model is not None and str(model.value).endswith("-corrected"):
        large = [
            n for n in ("odom_alpha1", "odom_alpha2", "odom_alpha3", "odom_alpha4") if number(settings, n, 0.2) >= 0.1
        ]
        if large:
            yield at(
                settings.get(large[0], model),
                WARNING,
                f"{', '.join(large)}: with {model.value} an alpha is a variance, so that 0.2 means noise of 45 % of the "
                "motion; suggested for this model: 0.005, 0.005, 0.010, 0.005 (alpha5 0.003)",
            )
    total = sum(number(settings, f"laser_z_{part}", d) for part, d in (("hit", 0.95), ("rand", 0.05)))
    if total > 1.001 and ("laser_z_hit" in settings or "laser_z_rand" in settings):
        setting = settings.get("laser_z_hit") or settings["laser_z_rand"]
        yield at(setting, WARNING, f"laser_z_hit + laser_z_rand is {total:g}: weights should add up to 1")
    if "map_topic" in settings and "use_map_topic" not in settings:
        yield at(settings["map_topic"], WARNING, "the map comes from a service unless use_map_topic is true")


def check_move_base(
    settings: Mapping[str, Setting], range_m: float | None = None, *, whole: bool = False
) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of one move_base node, its costmaps and planners.

    Parameters
    ----------
    settings
        By names with their sections.
    range_m
        What the scanner sees, in metres, if known.
    whole
        These are all that the node gets.
    """
    yield from check_scanner(settings, range_m)
    yield from check_together(settings, whole=whole)
    settings = yield from _without_own(settings, declarations(CollisionMonitorParameters), "move_base")
    recoveries: dict[str, Table] = dict(RECOVERIES)
    recoveries.update((yield from _listed(settings.get("recovery_behaviors"))))
    known = {entry.name for entry in MOVE_BASE}
    groups = [*_COSTMAPS, *PLANNERS, *recoveries]
    top = {}
    for name, setting in settings.items():
        head = name.partition("/")[0]
        if head == "recovery_behaviors" or head in groups:
            continue
        if "/" in name:
            yield at(setting, ERROR, f"{unknown_name(head, groups)} (move_base has no such part)")
        else:
            top[name] = setting
    yield from check_finite(top)
    yield from check_declared(top, MOVE_BASE, "move_base")
    for costmap in _COSTMAPS:
        part = below(settings, costmap)
        if part:
            yield from check_costmap(part, cleared=_cleared(settings, recoveries))
    for planner, check in PLANNERS.items():
        part = below(settings, planner)
        if part:
            yield from check_finite(part)
            yield from check((yield from _without_own(part, _OURS.get(planner, ()), planner)))
    for name, table in recoveries.items():
        part = {key: s for key, s in below(settings, name).items() if key != "layer_names"}
        yield from check_finite(part)
        yield from check_declared(part, table, name, strict=bool(table))
    yield from _chosen(settings, known)


def _listed(behaviours: Setting | None) -> Generator[Finding, None, dict[str, Table]]:
    """Yield what is wrong with recovery_behaviors; return what each behaviour reads."""
    found: dict[str, Table] = {}
    if behaviours is None:
        return found
    for entry in behaviours.value if isinstance(behaviours.value, list) else []:
        if not isinstance(entry, dict) or not {"name", "type"} <= set(entry):
            yield at(behaviours, ERROR, "each entry of recovery_behaviors needs a name and a type")
            continue
        kind = str(entry["type"])
        if kind not in RECOVERY_TYPES:
            yield at(behaviours, NOTE, f"a recovery behaviour of type {kind!r} is not checked; slamcli has none")
        found[str(entry["name"])] = RECOVERY_TYPES.get(kind, ())
    return found


def _cleared(settings: Mapping[str, Setting], recoveries: Mapping[str, Table]) -> tuple[str, ...]:
    """Return the layers that clear_costmap_recovery clears, whatever its behaviours are called."""
    names: list[str] = []
    listed = "recovery_behaviors" in settings
    for behaviour, table in recoveries.items():
        if table is not CLEAR_COSTMAP or (listed and behaviour in RECOVERIES and not below(settings, behaviour)):
            continue
        own = settings.get(f"{behaviour}/layer_names")
        names += (
            ["obstacles"]
            if own is None
            else [str(n) for n in own.value]
            if isinstance(own.value, list)
            else [str(own.value)]
        )
    return tuple(dict.fromkeys(names)) or ("obstacles",)


def _without_own(
    settings: Mapping[str, Setting], ours: Iterable[Declaration], owner: str
) -> Generator[Finding, None, Mapping[str, Setting]]:
    """Yield notes on parameters that slamcli alone has; return the others."""
    own = {entry.name: entry for entry in ours if entry.extension}
    for name, setting in settings.items():
        if name.replace("/", ".") in own:
            yield from check_value(setting, own[name.replace("/", ".")])
            yield at(setting, NOTE, f"{name} is slamcli's own: the real {owner} ignores it")
    return {name: setting for name, setting in settings.items() if name.replace("/", ".") not in own}


def _chosen(settings: Mapping[str, Setting], known: set[str]) -> Iterator[Finding]:
    """Yield planners that are configured and not chosen."""
    local = settings.get("base_local_planner")
    if local is not None:
        name = str(local.value).rpartition("/")[2]
        for planner in ("DWAPlannerROS", "TrajectoryPlannerROS", "TebLocalPlannerROS"):
            part = below(settings, planner)
            if part and planner != name:
                yield at(
                    next(iter(part.values())),
                    WARNING,
                    f"{planner} is configured, and base_local_planner is {local.value}: not read",
                )
        if "base_global_planner" in known and "base_global_planner" not in settings:
            yield at(local, NOTE, "base_global_planner is not set: navfn/NavfnROS plans")


def check_dwa(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of DWAPlannerROS."""
    rest = {}
    for name, setting in settings.items():
        if name == "vtheta_samples":
            yield at(
                setting,
                WARNING,
                "vtheta_samples belongs to TrajectoryPlannerROS: DWAPlannerROS reads vth_samples (20 unless set)",
            )
        elif name in DWA_OLD_NAMES and DWA_OLD_NAMES[name] != name:
            yield at(
                setting, WARNING, f"{name} is the name before release 1.16 (kinetic): later it is {DWA_OLD_NAMES[name]}"
            )
        else:
            rest[name] = setting
    yield from check_declared(rest, DWA, "DWAPlannerROS")
    path = rest.get("path_distance_bias")
    if path is not None and number(rest, "path_distance_bias", 0.6) > 5:
        yield at(
            path,
            WARNING,
            "path_distance_bias, goal_distance_bias and occdist_scale look like values for kinetic: from release 1.16 on "
            "biases are not halved and occdist_scale is not multiplied by the resolution, which makes obstacles weigh ten "
            "times more against the path (at 0.05 m); slamcli navigate --dwa-scaling kinetic counts them as kinetic did",
        )
    for low, high in (("min_vel_x", "max_vel_x"), ("min_vel_y", "max_vel_y"), ("min_vel_trans", "max_vel_trans")):
        if low in rest and number(rest, low, -1e9) > number(rest, high, 1e9):
            yield at(rest[low], ERROR, f"{low} is above {high}")


def _declared(
    table: tuple[Declaration, ...], owner: str, lists: set[str] | None = None
) -> Callable[[Mapping[str, Setting]], Iterator[Finding]]:
    def check(settings: Mapping[str, Setting]) -> Iterator[Finding]:
        return check_declared({k: s for k, s in settings.items() if k not in (lists or set())}, table, owner)

    return check


PLANNERS: dict[str, Callable[[Mapping[str, Setting]], Iterator[Finding]]] = {
    "NavfnROS": _declared(NAVFN, "NavfnROS"),
    "GlobalPlanner": _declared(GLOBAL_PLANNER, "GlobalPlanner"),
    "DWAPlannerROS": check_dwa,
    "TrajectoryPlannerROS": _declared(TRAJECTORY_PLANNER, "TrajectoryPlannerROS"),
    "TebLocalPlannerROS": _declared(TEB, "TebLocalPlannerROS", _TEB_LISTS),
}
"""Planner blocks of move_base by their name and what checks them."""

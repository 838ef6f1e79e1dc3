# SPDX-License-Identifier: MIT
"""Parameters of frontier exploration under the names of explore_lite, and slamcli's own."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter

_NO_MIDDLEWARE = "Accepted; there is no middleware that it could matter to."


@dataclass(frozen=True, slots=True, kw_only=True)
class ExploreParameters:
    """Which frontiers there are, which is next, and when to stop: names of explore_lite, and its defaults unless the help says otherwise."""

    planner_frequency: float = parameter(
        1.0, "How often frontiers are looked for.", unit="Hz", minimum=0.01, maximum=100.0
    )
    progress_timeout: float = parameter(
        90.0,
        "A goal that the robot does not come nearer to for this long is put on the blacklist. explore_lite: 30 s, less than all of"
        " move_base's recoveries take.",
        unit="s", minimum=0.0, maximum=3600.0,
    )  # fmt: skip
    potential_scale: float = parameter(
        20.0,
        "Cost of the distance: times metres times the size of a cell. explore_lite: 0.001, and 3.0 in its launch file, where the largest"
        " frontier comes first, however far.",
        minimum=0.0,
    )
    orientation_scale: float = parameter(
        0.0, "Cost of turning; explore_lite does not use it either.", minimum=0.0, effective=False
    )
    gain_scale: float = parameter(
        1.0, "What size is worth: times cells times the size of a cell, taken off the cost.", minimum=0.0
    )
    min_frontier_size: float = parameter(
        0.75,
        "Least length of a frontier: its number of cells times their size. explore_lite: 0.5.",
        unit="m",
        minimum=0.0,
    )
    visualize: bool = parameter(False, _NO_MIDDLEWARE, effective=False)
    robot_base_frame: str = parameter("base_link", _NO_MIDDLEWARE, effective=False)
    costmap_topic: str = parameter("costmap", _NO_MIDDLEWARE, effective=False)
    costmap_updates_topic: str = parameter("costmap_updates", _NO_MIDDLEWARE, effective=False)
    transform_tolerance: float = parameter(0.3, _NO_MIDDLEWARE, unit="s", minimum=0.0, effective=False)
    # slamcli's own
    goal_point: str = parameter(
        "initial",
        "Which point of a frontier is the goal: the mean of its cells, the cell nearest to the robot, or the one with the"
        " shortest way. explore_lite: centroid.",
        choices=("centroid", "middle", "initial"),
        extension=True,
    )
    snap_goal: bool = parameter(
        True,
        "Move the goal to the cell nearest to the frontier where the robot fits and to which there is a way; false: the point as it"
        " is, which may lie in a wall (as explore_lite).",
        extension=True,
    )
    goal_clearance: float = parameter(
        1.0,
        "With snap_goal: so much farther from the frontier's point a goal may lie that costs nothing, instead of one beside a wall (cost 252).",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        extension=True,
    )
    goal_distance: float = parameter(
        0.0,
        "A goal is so far from the robot at least, where the frontier reaches farther: a robot that is there already sees nothing"
        " new. Helps where the scanner's range ends before the walls; small frontiers then may keep the robot going to and fro.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
        extension=True,
    )
    distance: str = parameter(
        "way",
        "What potential_scale counts: the shortest way over known cells, or the straight line (as explore_lite).",
        choices=("way", "straight"),
        extension=True,
    )
    gain: str = parameter(
        "size",
        "What gain_scale counts: the frontier's cells, or the unknown cells in sight of its goal within gain_range, over"
        " gain_range in cells (so that both are lengths).",
        choices=("size", "visible"),
        extension=True,
    )
    gain_range: float = parameter(
        4.0, "How far the sensor sees, for gain: visible.", unit="m", minimum=0.1, maximum=100.0, extension=True
    )
    through_cost: int = parameter(
        252, "Costs up to this are gone through on the way to frontiers; explore_lite: 0, nothing that is inflated.",
        minimum=0, maximum=252, extension=True,
    )  # fmt: skip
    look_in: bool = parameter(
        True,
        "Count frontiers behind cells where the robot does not fit but which it can stand in front of (explore_lite: false).",
        extension=True,
    )
    goal_hysteresis: float = parameter(
        2.0, "By so much another frontier must cost less than the present one for the robot to turn to it (explore_lite: 0).",
        minimum=0.0, extension=True,
    )  # fmt: skip
    blacklist_radius: float = parameter(
        0.25, "Goals so near to one on the blacklist, in x and in y, are left out (5 cells of explore_lite).",
        unit="m", minimum=0.0, maximum=100.0, extension=True,
    )  # fmt: skip
    blacklist_retries: int = parameter(
        1, "How often goals that failed are tried again when nothing else is left (explore_lite: 0).", minimum=0, maximum=100,
        extension=True,
    )  # fmt: skip
    visit_patience: float = parameter(
        6.0,
        "How long a frontier may stay after the robot has been at its goal, before it is put on the blacklist: the map may be"
        " late. Others are taken in the meantime.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
        extension=True,
    )
    return_home: bool = parameter(
        True, "Drive back to where the exploration began when nothing is left (explore_lite: false).", extension=True
    )

# SPDX-License-Identifier: MIT
"""``RGBD``, ``Bayes`` and ``VhEp``: the metric graph, loop hypotheses and what becomes of them."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.rtabmap.parameters.declaring import count, length, number, numbers, share, switch, text

_PREDICTION = (
    "0.1 0.36 0.30 0.16 0.062 0.0151 0.00255 0.000324 2.5e-05 1.3e-06 4.8e-08 1.2e-09 1.9e-11 2.2e-13 1.7e-15 8.5e-18"
    " 2.9e-20 6.9e-23"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RgbdGroup:
    """``RGBD``."""

    enabled: bool = switch("Enabled", True, "metric graph; false: loop hypotheses from images alone")
    linear_update: float = length("LinearUpdate", 0.1, "a node is kept after moving this far; 0: always")
    angular_update: float = number(
        "AngularUpdate", 0.1, "or after turning by this; 0: always", "rad", maximum=6.283185307179586
    )
    linear_speed_update: float = number(
        "LinearSpeedUpdate", 0.0, "no node is kept while the robot is faster; 0: any speed", "m/s"
    )
    angular_speed_update: float = number(
        "AngularSpeedUpdate", 0.0, "no node is kept while the robot turns faster; 0: any speed", "rad/s"
    )
    aggressive_loop_thr: float = share(
        "AggressiveLoopThr", 0.05, "Rtabmap/LoopThr while the session is not linked to the hypothesis' one"
    )
    new_map_odom_change_distance: float = length(
        "NewMapOdomChangeDistance", 0.0, "odometry that jumps farther begins a new map; 0: never"
    )
    optimize_from_graph_end: bool = switch(
        "OptimizeFromGraphEnd", False, "the newest node stays where it is; false: the oldest"
    )
    optimize_max_error: float = number(
        "OptimizeMaxError",
        3.0,
        "loop closures that leave a link with an error of more standard deviations are refused; 0: none",
    )
    optimize_max_error_repair_radius: float = length(
        "OptimizeMaxErrorRepairRadius",
        0.0,
        "if two closures in a row are refused for one old link, links within this are dropped; 0: none",
    )
    max_loop_closure_distance: float = length(
        "MaxLoopClosureDistance", 0.0, "loop closures over a longer distance are refused; 0: none"
    )
    force_odom_3dof: bool = switch("ForceOdom3DoF", True, "with Reg/Force3DoF odometry is put into the plane too")
    start_at_origin: bool = switch(
        "StartAtOrigin",
        False,
        "localisation begins at the map's origin instead of where the last session ended; here places known again alone tell where",
        effective=False,
    )
    goal_reached_radius: float = length(
        "GoalReachedRadius", 0.5, "planning: a goal is reached within this", effective=False
    )
    plan_stuck_iterations: int = count("PlanStuckIterations", 0, "planning: when a goal is given up", effective=False)
    plan_linear_velocity: float = number("PlanLinearVelocity", 0.0, "planning: speed on a path", "m/s", effective=False)
    plan_angular_velocity: float = number(
        "PlanAngularVelocity", 0.0, "planning: turning speed on a path", "rad/s", effective=False
    )
    goals_saved_in_user_data: bool = switch(
        "GoalsSavedInUserData", False, "planning: keep reached goals", effective=False
    )
    max_local_retrieved: int = count(
        "MaxLocalRetrieved", 2, "nodes near the robot fetched from long-term memory per update", "nodes"
    )
    local_radius: float = length("LocalRadius", 10.0, "nodes within this of the robot are near")
    local_immunization_ratio: float = share(
        "LocalImmunizationRatio", 0.25, "share of working memory of near nodes that is not transferred"
    )
    scan_matching_ids_saved_in_links: bool = switch(
        "ScanMatchingIdsSavedInLinks",
        True,
        "a note for viewers: which scans were merged for a proximity link",
        effective=False,
    )
    neighbor_link_refining: bool = switch(
        "NeighborLinkRefining", False, "odometry between nodes is refined by registration"
    )
    loop_closure_identity_guess: bool = switch(
        "LoopClosureIdentityGuess",
        False,
        "a loop is registered from the guess that both poses are the same; false: from none",
    )
    loop_closure_reextract_features: bool = switch(
        "LoopClosureReextractFeatures",
        False,
        "find key points again in the images of a loop (Vis): all are kept here, so that they are the same",
        effective=False,
    )
    local_bundle_on_loop_closure: bool = switch(
        "LocalBundleOnLoopClosure", False, "adjust a loop with the neighbours of its old node"
    )
    inverted_reg: bool = switch("InvertedReg", False, "register a loop from the new node to the old one")
    create_occupancy_grid: bool = switch(
        "CreateOccupancyGrid", True, "make local occupancy grids (on, as in the ROS node; RTAB-Map's library: off)"
    )
    marker_detection: bool = switch(
        "MarkerDetection", False, "look for markers in images: they become landmarks (Marker)"
    )
    loop_cov_limited: bool = switch(
        "LoopCovLimited", False, "no closure counts as more certain than the most certain odometry link"
    )
    max_odom_cache_size: int = count(
        "MaxOdomCacheSize",
        10,
        "poses of odometry that a localisation is smoothed with; here all nodes of the session are optimised together",
        "poses",
        effective=False,
    )
    localization_smoothing: bool = switch(
        "LocalizationSmoothing",
        True,
        "a localisation is smoothed over the odometry's cache; here always, over the whole session",
        effective=False,
    )
    localization_prior_error: float = number(
        "LocalizationPriorError",
        0.001,
        "standard deviation with which the map's poses are held in that",
        "m, rad",
        1e-9,
        1e3,
    )
    localization_second_try_without_proximity_links: bool = switch(
        "LocalizationSecondTryWithoutProximityLinks",
        True,
        "a refused localisation is tried again without proximity links",
    )
    proximity_by_time: bool = switch("ProximityByTime", False, "look for closures among nodes of short-term memory")
    proximity_by_space: bool = switch("ProximityBySpace", True, "look for closures among nodes that are near")
    proximity_max_graph_depth: int = count(
        "ProximityMaxGraphDepth", 50, "near nodes are at most this many links from the last closure; 0: any", "links"
    )
    proximity_max_paths: int = count(
        "ProximityMaxPaths", 3, "near paths that are compared, newest first; 0: all", "paths"
    )
    proximity_path_filtering_radius: float = length(
        "ProximityPathFilteringRadius",
        1.0,
        "of a near path one node per this radius is compared, and its nearest must lie within",
    )
    proximity_path_max_neighbors: int = count(
        "ProximityPathMaxNeighbors", 0, "scans of a near path that are merged and matched as one; 0: none", "nodes"
    )
    proximity_path_raw_poses_used: bool = switch(
        "ProximityPathRawPosesUsed", True, "they are merged by odometry; false: by the optimised poses"
    )
    proximity_angle: float = number(
        "ProximityAngle", 45.0, "near nodes look in directions that differ by less (images)", "deg", maximum=180.0
    )
    proximity_odom_guess: bool = switch(
        "ProximityOdomGuess", False, "images of near nodes are matched from the guess of odometry; false: from none"
    )
    proximity_global_scan_map: bool = switch(
        "ProximityGlobalScanMap", False, "when localising, scans are matched with all of the map's instead of near ones"
    )
    proximity_merged_scan_cov_factor: float = number(
        "ProximityMergedScanCovFactor", 100.0, "covariance of merged scans' links is larger by this", minimum=1e-6
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class BayesGroup:
    """``Bayes``."""

    virtual_place_prior_thr: float = share(
        "VirtualPlacePriorThr", 0.9, "probability that a new place follows a new place"
    )
    prediction_lc: str = text(
        "PredictionLC", _PREDICTION, "probabilities of moving: to a new place, nowhere, 1 link, 2 links ... both ways"
    )
    full_prediction_update: bool = switch(
        "FullPredictionUpdate",
        False,
        "compute the whole prediction anew each time; the result is the same",
        effective=False,
    )

    def __post_init__(self) -> None:
        """Refuse a text that is no prediction."""
        self.prediction  # noqa: B018

    @property
    def prediction(self) -> tuple[float, ...]:
        """`prediction_lc` as numbers.

        Raises
        ------
        ConfigError
            If they are not at least two probabilities.
        """
        what = "probabilities: of a new place, of the same place, of 1 link on ..."
        found = numbers("Bayes/PredictionLC", self.prediction_lc, None, what)
        if len(found) < 2 or not all(0.0 <= x <= 1.0 for x in found):
            raise ConfigError(f"Bayes/PredictionLC={self.prediction_lc!r}: write at least two {what}")
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class VhEpGroup:
    """``VhEp``."""

    enabled: bool = switch("Enabled", False, "check a hypothesis by its epipolar geometry before it is registered")
    match_count_min: int = count("MatchCountMin", 8, "matches that it needs", "points", 8)
    ransac_param_1: float = number(
        "RansacParam1", 3.0, "distance from the epipolar line up to which a match fits", "px", 1e-3, 1000.0
    )
    ransac_param_2: float = number("RansacParam2", 0.99, "confidence of RANSAC", "", 0.01, 0.9999999)

# SPDX-License-Identifier: MIT
"""Parameters of how bands are found and chosen, and of what happens when all fail."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slamcli.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class HomotopyParameters:
    """Alternatives that pass obstacles on other sides."""

    enable_homotopy_class_planning: bool = parameter(True, "Optimise several alternatives side by side.")
    enable_multithreading: bool = parameter(True, "Accepted; alternatives are optimised in turn.", effective=False)
    simple_exploration: bool = parameter(
        False, "Look for alternatives left and right of each obstacle, not by random samples."
    )
    max_number_classes: int = parameter(5, "Most alternatives.", minimum=1, maximum=100)
    max_number_plans_in_current_class: int = parameter(
        1,
        "Accepted; one is kept of each class: several soon are the same.",
        minimum=1,
        effective=False,
    )
    selection_cost_hysteresis: float = parameter(
        1.0, "The last choice's cost counts times this.", minimum=0.0, maximum=2.0
    )
    selection_prefer_initial_plan: float = parameter(
        0.95, "The cost of the alternative along the global plan counts times this.", minimum=0.0, maximum=1.0
    )
    selection_obst_cost_scale: float = parameter(
        100.0, "Cost of obstacles counts times this in the choice.", minimum=0.0, maximum=1e6
    )
    selection_viapoint_cost_scale: float = parameter(
        1.0, "Cost of via-points counts times this in the choice.", minimum=0.0, maximum=1e6
    )
    selection_alternative_time_cost: bool = parameter(False, "Choose by the whole time, not by the sum of its squares.")
    selection_dropping_probability: float = parameter(
        0.0, "An alternative that was not chosen is dropped with this probability.", minimum=0.0, maximum=1.0
    )
    obstacle_keypoint_offset: float = parameter(
        0.1,
        "Of simple_exploration: distance beside obstacles, on top of the robot's.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    obstacle_heading_threshold: float = parameter(
        0.45, "Cosine of the angle to the goal's direction that a stretch must exceed.", minimum=-1.0, maximum=1.0
    )
    roadmap_graph_no_samples: int = parameter(15, "Random points.", minimum=1, maximum=100)
    roadmap_graph_area_width: float = parameter(
        6.0, "Width of where they lie, across the way to the goal.", unit="m", minimum=0.1, maximum=100.0
    )
    roadmap_graph_area_length_scale: float = parameter(
        1.0, "Length of it, as a share of the way to the goal.", minimum=0.1, maximum=10.0
    )
    h_signature_prescaler: float = parameter(
        1.0, "Scale of H-signatures; smaller for very many obstacles.", minimum=0.1, maximum=1.0
    )
    h_signature_threshold: float = parameter(
        0.1, "Signatures that differ less are the same.", minimum=0.0, maximum=100.0
    )
    switching_blocking_period: float = parameter(
        0.0, "Time after a change of alternative in which there is no other.", unit="s", minimum=0.0, maximum=1000.0
    )
    viapoints_all_candidates: bool = parameter(
        True, "Via-points draw all alternatives, not only that along the global plan."
    )
    delete_detours_backwards: bool = parameter(
        True, "Drop alternatives that begin the other way round than the best one."
    )
    detours_orientation_tolerance: float = parameter(
        math.pi / 2, "How much their beginning must differ.", unit="rad", minimum=0.0, maximum=math.pi
    )
    length_start_orientation_vector: float = parameter(
        0.4, "Length of that beginning.", unit="m", minimum=0.01, maximum=10.0
    )
    max_ratio_detours_duration_best_duration: float = parameter(
        3.0, "Drop alternatives that take so many times as long as the best one.", minimum=1.0, maximum=1000.0
    )
    visualize_hc_graph: bool = parameter(False, "Accepted; no meaning offline.", effective=False)
    visualize_with_time_as_z_axis_scale: float = parameter(0.0, "Accepted; no meaning offline.", effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveryParameters:
    """What the planner tries by itself when it fails."""

    shrink_horizon_backup: bool = parameter(True, "Look less far ahead after a band that cannot be driven.")
    shrink_horizon_min_duration: float = parameter(10.0, "How long, at least.", unit="s", minimum=0.0, maximum=1000.0)
    oscillation_recovery: bool = parameter(True, "Prefer one turning direction when the robot swings to and fro.")
    oscillation_v_eps: float = parameter(
        0.1, "Mean speed, as a share of the greatest, below which it may.", minimum=0.0, maximum=1.0
    )
    oscillation_omega_eps: float = parameter(
        0.1, "Mean turning rate, as a share of the greatest, below which it may.", minimum=0.0, maximum=1.0
    )
    oscillation_recovery_min_duration: float = parameter(
        10.0, "How long the direction is preferred, at least.", unit="s", minimum=0.0, maximum=1000.0
    )
    oscillation_filter_duration: float = parameter(
        10.0, "Time over which means are taken.", unit="s", minimum=0.1, maximum=1000.0
    )
    divergence_detection_enable: bool = parameter(False, "Give no velocity from a band whose cost is too great.")
    divergence_detection_max_chi_squared: float = parameter(10.0, "That bound.", minimum=0.0, maximum=1e9)

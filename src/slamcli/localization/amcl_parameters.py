# SPDX-License-Identifier: MIT
"""Every parameter of ROS amcl under its name, and slamcli's own, declared once."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.parameters import parameter

_NO_TIME = "Accepted; no meaning offline."


@dataclass(frozen=True, slots=True, kw_only=True)
class AmclParameters:
    """Parameters of Adaptive Monte Carlo Localization; names, units and defaults are those of amcl in ROS Noetic."""

    min_particles: int = parameter(100, "smallest number of particles", minimum=1, maximum=1_000_000)
    max_particles: int = parameter(
        5000, "largest number of particles; so many are drawn at a start", minimum=1, maximum=1_000_000
    )
    kld_err: float = parameter(
        0.01, "allowed error between the true distribution and that of the particles", minimum=1e-6, maximum=1.0
    )
    kld_z: float = parameter(
        0.99, "upper quantile of the normal distribution for kld_err; amcl takes this number as the quantile itself, so 0.99 asks for fewer particles than 99 % confidence (2.33) would",
        minimum=0.0, maximum=10.0,
    )  # fmt: skip
    update_min_d: float = parameter(
        0.2, "a scan is used after this much motion along x or y of the odometry frame", unit="m", minimum=0.0
    )
    update_min_a: float = parameter(math.pi / 6, "a scan is used after this much turning", unit="rad", minimum=0.0)
    resample_interval: int = parameter(
        2, "particles are drawn anew at every n-th scan used", unit="scans", minimum=1, maximum=1000
    )
    selective_resampling: bool = parameter(
        False, "draw anew only where the effective number of particles is at most half of them"
    )
    recovery_alpha_slow: float = parameter(
        0.001, "decay of the slow average of the particles' likelihood; 0 with recovery_alpha_fast draws no random particles",
        minimum=0.0, maximum=1.0,
    )  # fmt: skip
    recovery_alpha_fast: float = parameter(
        0.1, "decay of the fast average; where it falls below the slow one, random particles are drawn",
        minimum=0.0, maximum=1.0,
    )  # fmt: skip
    initial_pose_x: float = parameter(0.0, "where the robot starts", unit="m", minimum=-1e6, maximum=1e6)
    initial_pose_y: float = parameter(0.0, "where the robot starts", unit="m", minimum=-1e6, maximum=1e6)
    initial_pose_a: float = parameter(0.0, "where the robot starts", unit="rad", minimum=-1e3, maximum=1e3)
    initial_cov_xx: float = parameter(0.25, "variance of the start", unit="m^2", minimum=0.0, maximum=1e6)
    initial_cov_yy: float = parameter(0.25, "variance of the start", unit="m^2", minimum=0.0, maximum=1e6)
    initial_cov_aa: float = parameter(
        (math.pi / 12) ** 2, "variance of the start", unit="rad^2", minimum=0.0, maximum=1e3
    )
    odom_model_type: str = parameter(
        "diff", "how odometry errs: diff and omni take what the formulas mean as a variance for a standard deviation, as amcl always did; the corrected ones take its root",
        choices=("diff", "omni", "diff-corrected", "omni-corrected"),
    )  # fmt: skip
    odom_alpha1: float = parameter(0.2, "noise of rotation by rotation", minimum=0.0, maximum=1e3)
    odom_alpha2: float = parameter(0.2, "noise of rotation by translation", minimum=0.0, maximum=1e3)
    odom_alpha3: float = parameter(0.2, "noise of translation by translation", minimum=0.0, maximum=1e3)
    odom_alpha4: float = parameter(0.2, "noise of translation by rotation", minimum=0.0, maximum=1e3)
    odom_alpha5: float = parameter(0.2, "noise sideways by translation (omni models only)", minimum=0.0, maximum=1e3)
    laser_model_type: str = parameter(
        "likelihood_field", "how readings are judged", choices=("likelihood_field", "likelihood_field_prob", "beam")
    )
    laser_min_range: float = parameter(
        -1.0, "readings up to it count as no return; negative: the scanner's own", unit="m", maximum=1e6
    )
    laser_max_range: float = parameter(
        -1.0, "readings from it on count as no return; negative: the scanner's own", unit="m", maximum=1e6
    )
    laser_max_beams: int = parameter(
        30, "how many beams of a scan are used, evenly spaced", unit="beams", minimum=2, maximum=100_000
    )
    laser_z_hit: float = parameter(0.95, "weight of the hit in the mixture", minimum=0.0, maximum=1.0)
    laser_z_short: float = parameter(
        0.1, "weight of what is closer than the map says (beam model only)", minimum=0.0, maximum=1.0
    )
    laser_z_max: float = parameter(0.05, "weight of no return (beam model only)", minimum=0.0, maximum=1.0)
    laser_z_rand: float = parameter(0.05, "weight of a random reading", minimum=0.0, maximum=1.0)
    laser_sigma_hit: float = parameter(0.2, "standard deviation of a hit", unit="m", minimum=1e-3, maximum=1e3)
    laser_lambda_short: float = parameter(
        0.1, "decay of what is closer than the map says (beam model only)", unit="1/m", minimum=0.0, maximum=1e3
    )
    laser_likelihood_max_dist: float = parameter(
        2.0, "distances to obstacles are computed up to here (likelihood field models)", unit="m",
        minimum=0.0, maximum=100.0,
    )  # fmt: skip
    do_beamskip: bool = parameter(
        False, "likelihood_field_prob: leave out beams that most particles cannot explain, once they have converged"
    )
    beam_skip_distance: float = parameter(
        0.5, "a particle explains a beam that ends this close to an obstacle", unit="m", minimum=0.0, maximum=100.0
    )
    beam_skip_threshold: float = parameter(
        0.3, "a beam is left out unless more than this share of the particles explain it", minimum=0.0, maximum=1.0
    )
    beam_skip_error_threshold: float = parameter(
        0.9, "if this share of the beams would be left out, all are used: the particles are wrong, not the map",
        minimum=0.0, maximum=1.0,
    )  # fmt: skip
    first_map_only: bool = parameter(False, "use the first map and ignore later ones")
    odom_frame_id: str = parameter("odom", "frame of the odometry")
    base_frame_id: str = parameter("base_link", "frame of the robot")
    global_frame_id: str = parameter("map", "frame of the map")
    use_map_topic: bool = parameter(False, "Accepted; the map is the one given.", effective=False)
    transform_tolerance: float = parameter(0.1, _NO_TIME, unit="s", effective=False)
    tf_broadcast: bool = parameter(True, _NO_TIME, effective=False)
    tf_reverse: bool = parameter(False, _NO_TIME, effective=False)
    gui_publish_rate: float = parameter(-1.0, _NO_TIME, unit="Hz", effective=False)
    save_pose_rate: float = parameter(0.5, _NO_TIME, unit="Hz", effective=False)
    bag_scan_period: float = parameter(-1.0, _NO_TIME, unit="s", effective=False)
    force_update_after_initialpose: bool = parameter(
        False, "Accepted; the first scan after a given pose is always used.", effective=False
    )
    force_update_after_set_map: bool = parameter(
        False, "Accepted; the first scan after a new map is always used.", effective=False
    )
    std_warn_level_x: float = parameter(0.2, _NO_TIME, unit="m", effective=False)
    std_warn_level_y: float = parameter(0.2, _NO_TIME, unit="m", effective=False)
    std_warn_level_yaw: float = parameter(0.1, _NO_TIME, unit="rad", effective=False)
    restore_defaults: bool = parameter(False, _NO_TIME, effective=False)
    # slamcli's own
    refine: bool = parameter(
        True, "lay the scan on the walls from the mean of the particles, and tell that pose; false: the mean itself, as amcl",
        name="slamcli.refine", extension=True,
    )  # fmt: skip
    refine_beams: int = parameter(
        120, "how many beams of a scan are laid on the walls, evenly spaced", name="slamcli.refine_beams", unit="beams",
        minimum=2, maximum=100_000, extension=True,
    )  # fmt: skip
    wall_depth: float = parameter(
        0.0, "how deep in the cells of a wall its surface is, for slamcli.refine: 0 at their face (maps that were drawn, and the simulator's), 0.5 in their middle (maps made from scans)",
        name="slamcli.wall_depth", unit="cells", minimum=0.0, maximum=0.5, extension=True,
    )  # fmt: skip
    refine_min_d: float = parameter(
        0.05, "a scan is laid on the walls, also between those that are used, after this much motion along x or y",
        name="slamcli.refine_min_d", unit="m", minimum=0.0, extension=True,
    )  # fmt: skip
    refine_min_a: float = parameter(
        0.05, "likewise, after this much turning", name="slamcli.refine_min_a", unit="rad", minimum=0.0, extension=True
    )
    deskew: bool = parameter(
        True, "put beams to where the moving robot was when each was measured, where scans tell their time_increment",
        name="slamcli.deskew", extension=True,
    )  # fmt: skip
    proposals: str = parameter(
        "scan", "where scattered and random particles come from: uniform over the free cells, as amcl, drawn when the mean weight falls; or scan, near the poses that explain the scan best, drawn when it fits worse than before and better elsewhere (cf. mixture MCL, Thrun et al. 2001)",
        name="slamcli.proposals", choices=("scan", "uniform"), extension=True,
    )  # fmt: skip
    proposal_candidates: int = parameter(
        50_000, "how many poses over the whole map are tried with slamcli.proposals=scan", name="slamcli.proposal_candidates",
        unit="poses", minimum=100, maximum=10_000_000, extension=True,
    )  # fmt: skip

    def __post_init__(self) -> None:
        if self.min_particles > self.max_particles:
            raise ConfigError(f"min_particles={self.min_particles} is more than max_particles={self.max_particles}")

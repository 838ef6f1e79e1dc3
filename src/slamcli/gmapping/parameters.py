# SPDX-License-Identifier: MIT
"""Every parameter of ROS slam_gmapping under its name, and slamcli's own, declared once."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class GmappingParameters:
    """Parameters of the particle filter; native names, units and defaults are those of ROS slam_gmapping."""

    throttle_scans: int = parameter(1, "use one of every n scans", unit="scans", minimum=1)
    base_frame: str = parameter("base_link", "frame of the robot")
    map_frame: str = parameter("map", "frame of the map")
    odom_frame: str = parameter("odom", "frame of the odometry")
    transform_publish_period: float = parameter(0.05, "period of the map -> odom broadcast", unit="s", effective=False)
    tf_delay: float = parameter(0.05, "how far the broadcast is dated into the future", unit="s", effective=False)
    map_update_interval: float = parameter(
        5.0, "period of the map as it goes (live); that of a whole recording is drawn at its end", unit="s", minimum=0.0
    )
    maxRange: float = parameter(
        None,
        "readings at or over it are no return; default: the scanner's range_max - 0.01",
        kind=float,
        unit="m",
        minimum=0.0,
    )
    maxUrange: float = parameter(
        None, "beams are cut here (free space up to it, no hit); default: maxRange", kind=float, unit="m", minimum=0.0
    )
    sigma: float = parameter(0.05, "kernel of the scan-match score exp(-d^2 / sigma)", unit="m^2", minimum=1e-9)
    kernelSize: int = parameter(
        1, "half window in which a beam looks for a hit cell", unit="cells", minimum=0, maximum=10
    )
    lstep: float = parameter(0.05, "first translation step of the hill climb", unit="m", minimum=1e-6)
    astep: float = parameter(0.05, "first rotation step of the hill climb", unit="rad", minimum=1e-6)
    iterations: int = parameter(5, "how often the hill climb halves its steps", unit="halvings", minimum=0, maximum=30)
    lsigma: float = parameter(0.075, "kernel of the beam likelihood -d^2 / lsigma", unit="m^2", minimum=1e-9)
    ogain: float = parameter(3.0, "smoothing of the weights: exp((w - w_max) / (ogain * particles))", minimum=1e-9)
    lskip: int = parameter(0, "beams skipped between two that are matched", unit="beams", minimum=0)
    minimumScore: float = parameter(
        0.0,
        "a match with a score at or below it falls back on odometry; a score is at most the number of matched beams",
        unit="beams",
        minimum=0.0,
    )
    srr: float = parameter(0.1, "odometry noise: translation per translation", minimum=0.0)
    srt: float = parameter(0.2, "odometry noise: rotation per translation", unit="rad/m", minimum=0.0)
    str_: float = parameter(0.1, "odometry noise: translation per rotation", name="str", unit="m/rad", minimum=0.0)
    stt: float = parameter(0.2, "odometry noise: rotation per rotation", minimum=0.0)
    linearUpdate: float = parameter(1.0, "a scan is processed after this much translation", unit="m", minimum=0.0)
    angularUpdate: float = parameter(0.5, "a scan is processed after this much rotation", unit="rad", minimum=0.0)
    temporalUpdate: float = parameter(
        -1.0, "a scan is processed after this much time; negative: never for that reason", unit="s"
    )
    resampleThreshold: float = parameter(
        0.5, "resample when Neff falls below this share of the particles", minimum=0.0, maximum=1.0
    )
    particles: int = parameter(30, "number of particles", minimum=1, maximum=10000)
    xmin: float = parameter(-100.0, "initial extent; the map grows by itself", unit="m")
    ymin: float = parameter(-100.0, "initial extent; the map grows by itself", unit="m")
    xmax: float = parameter(100.0, "initial extent; the map grows by itself", unit="m")
    ymax: float = parameter(100.0, "initial extent; the map grows by itself", unit="m")
    delta: float = parameter(0.05, "size of a cell", unit="m", minimum=1e-3, maximum=10.0)
    occ_thresh: float = parameter(0.25, "a cell whose share of hits is above it is occupied", minimum=0.0, maximum=1.0)
    llsamplerange: float = parameter(
        0.01, "translation range of the samples of the improved proposal", unit="m", minimum=0.0
    )
    llsamplestep: float = parameter(
        0.01, "translation step of the samples of the improved proposal", unit="m", minimum=1e-6
    )
    lasamplerange: float = parameter(
        0.005, "rotation range of the samples of the improved proposal", unit="rad", minimum=0.0
    )
    lasamplestep: float = parameter(
        0.005, "rotation step of the samples of the improved proposal", unit="rad", minimum=1e-6
    )
    # slamcli's own
    proposal: str = parameter(
        "scanmatch",
        "scanmatch: motion sample, then hill climb (ROS gmapping); improved: Gaussian around the optimum (T-RO 2007)",
        choices=("scanmatch", "improved"),
        extension=True,
    )
    time_offset: str = parameter(
        "auto",
        "odometry clock minus laser clock, added to a scan's stamp to look up its odometry: auto estimates it, or a number",
        unit="s",
        choices=("auto", "NUMBER"),
        extension=True,
    )
    scan_odometry: bool = parameter(
        True,
        "align every scan with the ones before it and use that as odometry; false: the wheels alone, as ROS gmapping",
        extension=True,
    )
    free_check: bool = parameter(
        False,
        "a beam counts only if the cell before its hit is no obstacle: tells inside from outside of walls (in ROS gmapping a no-op)",
        extension=True,
    )
    adaptive_particles: str = parameter(
        "none",
        "number of particles after a resampling: none keeps it, kld follows the spread (Fox, IJRR 2003)",
        choices=("none", "kld"),
        extension=True,
    )
    min_particles: int = parameter(
        10, "smallest number of particles with adaptive_particles=kld", minimum=1, extension=True
    )
    kld_err: float = parameter(
        0.05,
        "allowed error of the particle distribution with adaptive_particles=kld",
        minimum=1e-6,
        maximum=1.0,
        extension=True,
    )
    kld_z: float = parameter(2.33, "upper quantile of the normal distribution for kld_err", minimum=0.0, extension=True)
    match: str = parameter(
        "surface", "hillclimb: the greedy ascent alone, as ROS gmapping; surface: two of its halvings, then a Gauss-Newton alignment with the walls",
        choices=("surface", "hillclimb"), extension=True,
    )  # fmt: skip
    scan_odometry_noise: float = parameter(
        0.2,
        "factor on srr, srt, str and stt while scan_odometry is on: scans place the robot better than wheels",
        minimum=0.0,
        extension=True,
    )
    deskew: bool = parameter(
        True,
        "put beams to where the moving robot was when each was measured, where scans tell their time_increment",
        extension=True,
    )
    map_scans: str = parameter(
        "moved", "scans in the final map: moved draws one every 0.2 m or 0.1 rad; processed those that the filter took, as ROS gmapping; all",
        choices=("moved", "processed", "all"), extension=True,
    )  # fmt: skip

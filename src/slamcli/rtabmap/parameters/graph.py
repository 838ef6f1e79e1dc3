# SPDX-License-Identifier: MIT
"""``Optimizer``, ``g2o`` and ``GTSAM``: the graph and bundle adjustment."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.rtabmap.parameters.declaring import choice, count, length, number, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimizerGroup:
    """``Optimizer``."""

    strategy: int = choice(
        "Strategy", 2, "library that optimises the graph; GTSAM here whichever is named", {0: "TORO", 1: "g2o", 2: "GTSAM", 3: "Ceres"},
        effective=False,
    )  # fmt: skip
    iterations: int = count("Iterations", 20, "steps at most", "", 1, 100_000)
    epsilon: float = number("Epsilon", 1e-5, "steps end when one takes less than this off the error", "", 0.0, 1.0)
    variance_ignored: bool = switch("VarianceIgnored", False, "all links count the same; false: by their covariance")
    robust: bool = switch(
        "Robust",
        False,
        "wrong loop closures lose their weight while the graph is optimised; then RGBD/OptimizeMaxError is off",
    )
    priors_ignored: bool = switch("PriorsIgnored", True, "leave poses known from elsewhere out")
    landmarks_ignored: bool = switch("LandmarksIgnored", False, "leave landmarks out")
    gravity_sigma: float = number(
        "GravitySigma", 0.3, "standard deviation of which way is down, where an IMU tells; 0: it does not count", "rad"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class G2oGroup:
    """``g2o``: what of it bundle adjustment takes."""

    solver: int = choice(
        "Solver",
        3,
        "linear solver; slamcli's own here",
        {0: "csparse", 1: "pcg", 2: "cholmod", 3: "Eigen"},
        effective=False,
    )
    optimizer: int = choice(
        "Optimizer",
        0,
        "Levenberg-Marquardt here whichever is named",
        {0: "Levenberg", 1: "GaussNewton"},
        effective=False,
    )
    pixel_variance: float = number(
        "PixelVariance",
        1.0,
        "variance of a key point in bundle adjustment; here that of its octave",
        "px^2",
        1e-6,
        1e6,
        effective=False,
    )
    robust_kernel_delta: float = number(
        "RobustKernelDelta",
        8.0,
        "chi square from which a key point weighs less in bundle adjustment; here that of 95 %",
        effective=False,
    )
    baseline: float = length(
        "Baseline",
        0.075,
        "depth counts in bundle adjustment as if from a stereo camera of this baseline; 0: not at all",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GtsamGroup:
    """``GTSAM``."""

    optimizer: int = choice("Optimizer", 1, "how steps are made", {0: "Levenberg", 1: "GaussNewton", 2: "Dogleg"})
    incremental: bool = switch("Incremental", False, "optimise by increments (iSAM2)")
    inc_relinearize_threshold: float = number(
        "IncRelinearizeThreshold", 0.01, "change from which a pose is linearised anew (iSAM2)", "m, rad", 1e-9, 1e3
    )
    inc_relinearize_skip: int = count("IncRelinearizeSkip", 1, "only at every this many updates (iSAM2)", "", 1)

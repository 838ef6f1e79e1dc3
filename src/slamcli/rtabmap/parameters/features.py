# SPDX-License-Identifier: MIT
"""``Stereo``, ``GFTT``, ``ORB``, ``FAST`` and what other key points take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.parameters import parameter
from slamcli.rtabmap.parameters.declaring import choice, count, number, switch


def _of_stereo_flow(name: str, default: Any) -> Any:
    return parameter(
        default, "of optical flow between both images; here windows are compared", name=name, effective=False
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoGroup:
    """``Stereo``: where a key point of the left image is in the right one."""

    win_width: int = count("WinWidth", 15, "width of the compared window", "px", 3, 1000)
    win_height: int = count("WinHeight", 3, "height of the compared window", "px", 3, 1000)
    iterations: int = _of_stereo_flow("Iterations", 30)
    max_level: int = _of_stereo_flow("MaxLevel", 5)
    min_disparity: float = number("MinDisparity", 0.5, "smaller disparities are dropped", "px", 0.0, 1e5)
    max_disparity: float = number("MaxDisparity", 128.0, "larger disparities are dropped", "px", 1.0, 1e5)
    optical_flow: bool = switch(
        "OpticalFlow",
        True,
        "follow key points by optical flow, or compare windows along the row; here windows, whatever it says",
        effective=False,
    )
    ssd: bool = switch("SSD", True, "windows are compared by squares of differences; false: by their amounts")
    eps: float = _of_stereo_flow("Eps", 0.01)
    use_min_eigen_vals: bool = _of_stereo_flow("UseMinEigenVals", True)
    min_eig_threshold: float = _of_stereo_flow("MinEigThreshold", 1e-4)
    error_threshold: float = _of_stereo_flow("ErrorThreshold", 50.0)
    gpu: bool = switch("Gpu", False, "optical flow on a GPU; here on the processor", effective=False)
    dense_strategy: int = choice(
        "DenseStrategy",
        0,
        "depth of every pixel of a stereo pair by",
        {0: "block matching", 1: "semi-global matching, which fills more and takes twice as long"},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GfttGroup:
    """``GFTT``: good features to track."""

    quality_level: float = number(
        "QualityLevel", 0.001, "corners need this share of the best one's quality", "", 1e-6, 1.0
    )
    min_distance: float = number("MinDistance", 7.0, "corners are this far apart", "px", 0.0, 1e4)
    block_size: int = count("BlockSize", 3, "window in which a corner is judged", "px", 2, 101)
    use_harris_detector: bool = switch("UseHarrisDetector", False, "Harris' measure; false: the least eigenvalue")
    k: float = number("K", 0.04, "parameter of Harris' measure", "", 0.0, 0.25)
    gpu: bool = switch("Gpu", False, "corners on a GPU; here on the processor", effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbGroup:
    """``ORB``."""

    scale_factor: float = number(
        "ScaleFactor", 2.0, "ratio of the sizes of two levels of the image pyramid", "", 1.01, 10.0
    )
    n_levels: int = count("NLevels", 3, "levels of the image pyramid", "levels", 1, 32)
    edge_threshold: int = count("EdgeThreshold", 19, "border without key points", "px", 1, 1000)
    first_level: int = count("FirstLevel", 0, "level that has the image's own size", "", 0, 31)
    wta_k: int = parameter(2, "points compared for one element of a descriptor", name="WTA_K", choices=("2", "3", "4"))
    score_type: int = choice("ScoreType", 0, "key points are ranked by", {0: "Harris", 1: "FAST"})
    patch_size: int = count("PatchSize", 31, "patch of a descriptor", "px", 5, 255)
    gpu: bool = switch("Gpu", False, "on a GPU; here on the processor", effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class FastGroup:
    """``FAST``: of ORB-OCTREE, or with ORB's ``ScoreType`` 1."""

    threshold: int = count(
        "Threshold", 20, "how much brighter or darker than its centre a corner's circle must be", "grey levels", 1, 254
    )
    nonmax_suppression: bool = switch(
        "NonmaxSuppression", True, "of neighbouring corners only the best (FAST/FREAK, FAST/BRIEF)", effective=False
    )
    gpu: bool = switch("Gpu", False, "on a GPU; here on the processor", effective=False)
    gpu_keypoints_ratio: float = number("GpuKeypointsRatio", 0.05, "room for corners on a GPU", effective=False)
    min_threshold: int = count(
        "MinThreshold", 7, "the same in cells where the threshold finds none", "grey levels", 1, 254
    )
    max_threshold: int = count(
        "MaxThreshold", 200, "largest threshold of adaptive FAST (FAST/FREAK, FAST/BRIEF)", effective=False
    )
    grid_rows: int = count("GridRows", 0, "rows of adaptive FAST (FAST/FREAK, FAST/BRIEF)", effective=False)
    grid_cols: int = count("GridCols", 0, "columns of adaptive FAST (FAST/FREAK, FAST/BRIEF)", effective=False)
    cv: int = count("CV", 0, "implementation of FAST: one here", effective=False)


def _of_others(name: str, default: Any, whose: str) -> Any:
    return parameter(default, f"of {whose} key points, which are not available here", name=name, effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class BriefGroup:
    """``BRIEF``."""

    bytes: int = _of_others("Bytes", 32, "BRIEF")


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfGroup:
    """``SURF``."""

    extended: bool = _of_others("Extended", False, "SURF")
    hessian_threshold: float = _of_others("HessianThreshold", 500.0, "SURF")
    octaves: int = _of_others("Octaves", 4, "SURF")
    octave_layers: int = _of_others("OctaveLayers", 2, "SURF")
    upright: bool = _of_others("Upright", False, "SURF")
    gpu_version: bool = _of_others("GpuVersion", False, "SURF")
    gpu_keypoints_ratio: float = _of_others("GpuKeypointsRatio", 0.01, "SURF")


@dataclass(frozen=True, slots=True, kw_only=True)
class SiftGroup:
    """``SIFT``."""

    n_octave_layers: int = _of_others("NOctaveLayers", 3, "SIFT")
    contrast_threshold: float = _of_others("ContrastThreshold", 0.04, "SIFT")
    edge_threshold: float = _of_others("EdgeThreshold", 10.0, "SIFT")
    sigma: float = _of_others("Sigma", 1.6, "SIFT")
    precise_upscale: bool = _of_others("PreciseUpscale", False, "SIFT")
    root_sift: bool = _of_others("RootSIFT", False, "SIFT")
    gpu: bool = _of_others("Gpu", False, "SIFT")
    gaussian_threshold: float = _of_others("GaussianThreshold", 2.0, "SIFT")
    max_gaussian_threshold: float = _of_others("MaxGaussianThreshold", 0.0, "SIFT")
    upscale: bool = _of_others("Upscale", False, "SIFT")

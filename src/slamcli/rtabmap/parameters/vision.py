# SPDX-License-Identifier: MIT
"""``Kp``, ``Vis`` and ``Reg``: words of the dictionary, and transforms from images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.parameters import parameter
from slamcli.rtabmap.parameters.declaring import choice, count, length, number, region, share, switch, text

FEATURES = {8: "GFTT/ORB", 10: "ORB-OCTREE", 2: "ORB", 6: "GFTT/BRIEF by ORB's pairs"}
NOT_HERE = {
    0: "SURF", 1: "SIFT", 3: "FAST/FREAK", 4: "FAST/BRIEF", 5: "GFTT/FREAK", 7: "BRISK", 9: "KAZE",
    11: "SuperPoint", 12: "SURF/FREAK", 13: "GFTT/DAISY", 14: "SURF/DAISY", 15: "PyDetector",
}  # fmt: skip
"""Key points whose descriptors are no 32 bytes, need OpenCV's contributed modules or a network."""
WHOLE_IMAGE = "0.0 0.0 0.0 0.0"


@dataclass(frozen=True, slots=True, kw_only=True)
class KpGroup:
    """``Kp``: key points that become words."""

    nn_strategy: int = choice(
        "NNStrategy", 1, "search of the nearest word; 0 and 3 compare with all, 1 and 2 with those that an index finds",
        {0: "linear", 1: "kd-trees", 2: "LSH", 3: "brute force"}, {4: "brute force on a GPU"},
    )  # fmt: skip
    incremental_dictionary: bool = switch(
        "IncrementalDictionary", True, "new words are added; false: the dictionary is fixed"
    )
    incremental_flann: bool = switch(
        "IncrementalFlann", True, "add words to the search index without rebuilding it", effective=False
    )
    flann_rebalancing_factor: float = number(
        "FlannRebalancingFactor", 2.0, "growth after which the search index is rebuilt", effective=False
    )
    byte_to_float: bool = switch(
        "ByteToFloat", False, "search binary descriptors as numbers by byte; here as bits", effective=False
    )
    max_depth: float = length("MaxDepth", 0.0, "key points farther away are dropped; 0: none")
    min_depth: float = length("MinDepth", 0.0, "key points nearer are dropped")
    max_features: int = count(
        "MaxFeatures",
        500,
        "key points of an image that become words; 0: all, -1: none, images are not looked at",
        "points",
        -1,
    )
    ssc: bool = switch("SSC", False, "spread key points evenly (suppression via square covering)")
    bad_sign_ratio: float = share(
        "BadSignRatio", 0.5, "an image with fewer words than this share of the average is bad: no loops, no rehearsal"
    )
    nndr_ratio: float = share(
        "NndrRatio",
        0.8,
        "a descriptor is the nearest word's, if that is nearer than this share of the second's distance",
    )
    detector_strategy: int = choice("DetectorStrategy", 10, "key points and descriptors of words", FEATURES, NOT_HERE)
    tf_idf_likelihood_used: bool = switch(
        "TfIdfLikelihoodUsed", True, "weigh words by how rare they are; false: count common ones"
    )
    parallelized: bool = switch(
        "Parallelized", True, "dictionary and nodes in threads; --jobs says how many", effective=False
    )
    roi_ratios: str = text("RoiRatios", WHOLE_IMAGE, "shares of the image without key points: left, right, top, bottom")
    dictionary_path: str = text("DictionaryPath", "", "file of the fixed dictionary: a .db, or RTAB-Map's text file")
    new_words_compared_together: bool = switch(
        "NewWordsComparedTogether", True, "new words of one image are compared with each other too"
    )
    flann_index_saved: bool = switch(
        "FlannIndexSaved", False, "store the search index in the database", effective=False
    )
    serialize_with_checksum: bool = switch(
        "SerializeWithChecksum", True, "checksum of a stored search index", effective=False
    )
    sub_pix_win_size: int = count("SubPixWinSize", 3, "half a window in which corners are refined", "px", 1, 100)
    sub_pix_iterations: int = count("SubPixIterations", 0, "steps of refining corners; 0: they are not", "", 0, 1000)
    sub_pix_eps: float = number("SubPixEps", 0.02, "steps of refining corners end when one is shorter", "px", 0.0, 1.0)
    grid_rows: int = count("GridRows", 1, "rows of cells that get equally many key points", "", 1, 1000)
    grid_cols: int = count("GridCols", 1, "columns of cells that get equally many key points", "", 1, 1000)

    def __post_init__(self) -> None:
        """Refuse a text that is no region."""
        self.roi  # noqa: B018

    @property
    def roi(self) -> tuple[float, float, float, float]:
        """`roi_ratios` as numbers: left, right, top, bottom."""
        return region("Kp/RoiRatios", self.roi_ratios)


def _of_flow(name: str, default: Any) -> Any:
    return parameter(
        default, "of matches by optical flow (Vis/CorType 1), which are not available here", name=name, effective=False
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class VisGroup:
    """``Vis``: key points that are matched for a transform."""

    estimation_type: int = choice(
        "EstimationType",
        1,
        "transform of two images from",
        {0: "3D to 3D", 1: "3D to 2D (PnP)", 2: "2D to 2D (epipolar)"},
    )
    inlier_distance: float = length("InlierDistance", 0.1, "points of matches may be this far apart (3D to 3D)", 1e-6)
    refine_iterations: int = count("RefineIterations", 5, "refinements of the transform (3D to 3D)", "", 0, 1000)
    pnp_reproj_error: float = number(
        "PnPReprojError", 2.0, "points of matches may fall this far from their key points", "px", 1e-3, 1000.0
    )
    pnp_flags: int = choice(
        "PnPFlags",
        0,
        "solver of a sample in RANSAC; P3P here whichever is named",
        {0: "iterative", 1: "EPnP", 2: "P3P"},
        effective=False,
    )
    pnp_refine_iterations: int = count(
        "PnPRefineIterations",
        0,
        "refinements of the pose with its inliers; here it is refined until it stays",
        "",
        0,
        1000,
        effective=False,
    )
    pnp_variance_median_ratio: int = count(
        "PnPVarianceMedianRatio",
        4,
        "the variance is that of the 1/N nearest of the matches' points in depth",
        "",
        2,
        1000,
    )
    pnp_max_variance: float = number(
        "PnPMaxVariance", 0.0, "larger variance of the matches' points refuses the transform; 0: none does", "m^2"
    )
    pnp_sampling_policy: int = choice(
        "PnPSamplingPolicy",
        1,
        "samples over several cameras; there is one here",
        {0: "auto", 1: "any", 2: "homogeneous"},
        effective=False,
    )
    pnp_split_linear_cov_components: bool = switch(
        "PnPSplitLinearCovComponents",
        False,
        "variance of x, y and z each, or one for all; here covariances are whole",
        effective=False,
    )
    epipolar_geometry_var: float = number(
        "EpipolarGeometryVar", 0.1, "largest variance of a transform (2D to 2D)", "m^2"
    )
    min_inliers: int = count("MinInliers", 20, "inliers that a transform needs", "points", 1)
    mean_inliers_distance: float = length(
        "MeanInliersDistance", 0.0, "inliers farther away than this on average refuse the transform; 0: none do"
    )
    min_inliers_distribution: float = number(
        "MinInliersDistribution", 0.0, "inliers spread less over the image (second eigenvalue of pixels by width) refuse the transform; 0: none do",
        maximum=1.0,
    )  # fmt: skip
    iterations: int = count("Iterations", 300, "samples of RANSAC at most", "", 1, 1_000_000)
    feature_type: int = choice("FeatureType", 10, "key points and descriptors that are matched", FEATURES, NOT_HERE)
    max_features: int = count("MaxFeatures", 1000, "key points per image; 0: all", "points")
    ssc: bool = switch("SSC", False, "spread key points evenly (suppression via square covering)")
    max_depth: float = length("MaxDepth", 0.0, "key points farther away are dropped; 0: none")
    min_depth: float = length("MinDepth", 0.0, "key points nearer are dropped")
    depth_as_mask: bool = switch("DepthAsMask", False, "look for key points only where depth is known")
    depth_mask_floor_thr: float = length(
        "DepthMaskFloorThr", 0.0, "no key points lower than this above the base frame's floor; 0: anywhere"
    )
    roi_ratios: str = text("RoiRatios", WHOLE_IMAGE, "shares of the image without key points: left, right, top, bottom")
    sub_pix_win_size: int = count("SubPixWinSize", 3, "half a window in which corners are refined", "px", 1, 100)
    sub_pix_iterations: int = count("SubPixIterations", 0, "steps of refining corners; 0: they are not", "", 0, 1000)
    sub_pix_eps: float = number("SubPixEps", 0.02, "steps of refining corners end when one is shorter", "px", 0.0, 1.0)
    grid_rows: int = count("GridRows", 1, "rows of cells that get equally many key points", "", 1, 1000)
    grid_cols: int = count("GridCols", 1, "columns of cells that get equally many key points", "", 1, 1000)
    cor_type: int = choice(
        "CorType", 0, "matches of two images from", {0: "descriptors"}, {1: "optical flow"}, effective=False
    )
    cor_nn_type: int = choice(
        "CorNNType", 1, "search of matches; all but 5 are exact with the ratio test",
        {0: "linear", 1: "kd-trees", 2: "LSH", 3: "brute force", 5: "mutual nearest"},
        {4: "brute force on a GPU", 6: "SuperGlue", 7: "GMS"},
    )  # fmt: skip
    cor_nndr: float = share("CorNNDR", 0.8, "a match is nearer than this share of the second nearest's distance")
    cor_guess_win_size: int = count(
        "CorGuessWinSize",
        40,
        "with a guess matches are looked for this far around projected points; 0: everywhere",
        "px",
        0,
        100_000,
    )
    cor_guess_match_to_projection: bool = switch(
        "CorGuessMatchToProjection",
        False,
        "each key point looks for projected points; here always the other way round",
        effective=False,
    )
    cor_flow_win_size: int = _of_flow("CorFlowWinSize", 16)
    cor_flow_iterations: int = _of_flow("CorFlowIterations", 30)
    cor_flow_eps: float = _of_flow("CorFlowEps", 0.01)
    cor_flow_max_level: int = _of_flow("CorFlowMaxLevel", 3)
    cor_flow_use_min_eigen_vals: bool = _of_flow("CorFlowUseMinEigenVals", True)
    cor_flow_min_eig_threshold: float = _of_flow("CorFlowMinEigThreshold", 1e-4)
    cor_flow_error_threshold: float = _of_flow("CorFlowErrorThreshold", 20.0)
    cor_flow_gpu: bool = _of_flow("CorFlowGpu", False)
    bundle_adjustment: int = choice(
        "BundleAdjustment",
        1,
        "adjust pose and points of a transform",
        {0: "no", 1: "yes", 2: "yes (cvsba)", 3: "yes (Ceres)"},
    )

    def __post_init__(self) -> None:
        """Refuse a text that is no region."""
        self.roi  # noqa: B018

    @property
    def roi(self) -> tuple[float, float, float, float]:
        """`roi_ratios` as numbers: left, right, top, bottom."""
        return region("Vis/RoiRatios", self.roi_ratios)


@dataclass(frozen=True, slots=True, kw_only=True)
class RegGroup:
    """``Reg``."""

    repeat_once: bool = switch(
        "RepeatOnce", True, "register a second time from the first result, where there was no guess"
    )
    strategy: int = choice(
        "Strategy", 0, "transforms between nodes come from", {0: "images", 1: "scans", 2: "images, then scans"}
    )
    force_3dof: bool = switch("Force3DoF", False, "poses lie in the plane: x, y and yaw")

# SPDX-License-Identifier: MIT
"""``Odom``, ``OdomF2M`` and ``Icp``: own odometry from images or scans, and matching of scans."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.rtabmap.parameters.declaring import choice, count, length, number, share, switch, text


@dataclass(frozen=True, slots=True, kw_only=True)
class OdomGroup:
    """``Odom``."""

    strategy: int = choice(
        "Strategy", 0, "odometry against", {0: "a local map (F2M)", 1: "the last keyframe (F2F)"},
        {
            2: "Fovis", 3: "viso2", 4: "DVO-SLAM", 5: "ORB_SLAM (--algo orbslam3 is it)", 6: "OKVIS", 7: "LOAM",
            8: "MSCKF_VIO", 9: "VINS-Fusion", 10: "OpenVINS", 11: "FLOAM", 12: "Open3D", 13: "cuVSLAM",
        },
    )  # fmt: skip
    reset_countdown: int = count(
        "ResetCountdown",
        10,
        "images in a row without odometry after which it begins anew, in a map of its own until a closure joins both; 0: never (RTAB-Map's default)",
        "frames",
    )
    holonomic: bool = switch("Holonomic", True, "the robot can move sideways; false: y follows from x and yaw")
    fill_info_data: bool = switch("FillInfoData", True, "publish which key points were used", effective=False)
    image_buffer_size: int = count(
        "ImageBufferSize", 1, "images that wait while one is worked on; here none is lost", effective=False
    )
    filtering_strategy: int = choice(
        "FilteringStrategy", 0, "smoothing of odometry", {0: "none", 1: "Kalman filter", 2: "particle filter"}
    )
    particle_size: int = count("ParticleSize", 400, "particles of the filter", "", 1, 1_000_000)
    particle_noise_t: float = number("ParticleNoiseT", 0.002, "noise of x, y, z of the particle filter", "m", 1e-9, 1e3)
    particle_lambda_t: float = number(
        "ParticleLambdaT", 100.0, "how sharply particles are weighed by x, y, z", "", 1e-9
    )
    particle_noise_r: float = number(
        "ParticleNoiseR", 0.002, "noise of roll, pitch, yaw of the particle filter", "rad", 1e-9, 1e3
    )
    particle_lambda_r: float = number(
        "ParticleLambdaR", 100.0, "how sharply particles are weighed by roll, pitch, yaw", "", 1e-9
    )
    kalman_process_noise: float = number(
        "KalmanProcessNoise", 0.001, "covariance of the motion in the Kalman filter", "", 1e-12, 1e6
    )
    kalman_measurement_noise: float = number(
        "KalmanMeasurementNoise", 0.01, "covariance of a measurement in the Kalman filter", "", 1e-12, 1e6
    )
    guess_motion: bool = switch("GuessMotion", True, "guess the next motion from the last one")
    guess_smoothing_delay: float = number(
        "GuessSmoothingDelay", 0.0, "the last motion is an average over this time; 0: the last alone", "s"
    )
    key_frame_thr: float = share(
        "KeyFrameThr", 0.3, "a frame whose inliers fall below this share of its features becomes a keyframe"
    )
    vis_key_frame_thr: int = count("VisKeyFrameThr", 150, "or below this number", "points")
    scan_key_frame_thr: float = share(
        "ScanKeyFrameThr", 0.9, "a scan whose matched points fall below this share of them becomes a keyframe"
    )
    image_decimation: int = count("ImageDecimation", 1, "images are made smaller by this for odometry", "", 1, 64)
    align_with_ground: bool = switch(
        "AlignWithGround",
        False,
        "level the first pose by the ground; here an IMU or, of cameras held anyhow, the finished map tells what is level",
        effective=False,
    )
    deskewing: bool = switch("Deskewing", True, "points of a sweep are moved to where they were at its stamp")


@dataclass(frozen=True, slots=True, kw_only=True)
class OdomF2mGroup:
    """``OdomF2M``."""

    max_size: int = count(
        "MaxSize", 2000, "points of the local map at most (images); 0: of the last keyframe", "points"
    )
    max_new_features: int = count(
        "MaxNewFeatures", 0, "points that a keyframe adds at most, by response; 0: any", "points"
    )
    init_depth_factor: float = number(
        "InitDepthFactor",
        0.05,
        "a key point without depth begins at this times the focal length; here it does not join the local map",
        "m/px",
        1e-6,
        1e3,
        effective=False,
    )
    floor_threshold: float = number(
        "FloorThreshold", 0.0, "only points higher above the base frame are tracked; 0: all", "m", -1e6, 1e6
    )
    scan_max_size: int = count("ScanMaxSize", 2000, "points of the local map at most (scans)", "points", 1)
    scan_subtract_radius: float = length(
        "ScanSubtractRadius", 0.05, "points this near to the local map's are not added; 0: all are"
    )
    scan_subtract_angle: float = number(
        "ScanSubtractAngle", 45.0, "unless their normals differ by more; 0: any angle", "deg", 0.0, 180.0
    )
    scan_range: float = length("ScanRange", 0.0, "points of the local map farther away are dropped; 0: the oldest are")
    valid_depth_ratio: float = share(
        "ValidDepthRatio",
        0.75,
        "key points without depth are added if this share of a frame's has depth; here they never are",
        effective=False,
    )
    bundle_adjustment: int = choice(
        "BundleAdjustment", 1, "adjust the local map", {0: "no", 1: "yes", 2: "yes (cvsba)", 3: "yes (Ceres)"}
    )
    bundle_adjustment_max_frames: int = count(
        "BundleAdjustmentMaxFrames", 10, "keyframes that are adjusted; 0: all of the local map", "frames"
    )
    bundle_adjustment_min_motion: float = number(
        "BundleAdjustmentMinMotion",
        0.0,
        "a keyframe needs key points that moved by this on average; 0: it does not",
        "px",
    )
    bundle_adjustment_max_key_frames_per_feature: int = count(
        "BundleAdjustmentMaxKeyFramesPerFeature",
        0,
        "views of a point that count at most; 0: all",
        "frames",
    )
    bundle_update_feature_map_on_all_frames: bool = switch(
        "BundleUpdateFeatureMapOnAllFrames",
        False,
        "points are adjusted on every frame; here on keyframes",
        effective=False,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class IcpGroup:
    """``Icp``."""

    strategy: int = choice(
        "Strategy", 1, "how points are matched (small_gicp here)", {0: "all within reach (PCL)", 1: "trimmed (libpointmatcher)"},
        {2: "CCCoreLib"},
    )  # fmt: skip
    max_translation: float = length("MaxTranslation", 0.2, "a transform that differs more from its guess is refused")
    max_rotation: float = number("MaxRotation", 0.78, "or turns by more", "rad", maximum=6.283185307179586)
    voxel_size: float = length("VoxelSize", 0.05, "scans are thinned to one point per voxel; 0: not")
    downsampling_step: int = count("DownsamplingStep", 1, "before that every this many points are taken", "points", 1)
    range_min: float = length("RangeMin", 0.0, "nearer points are dropped; 0: none")
    range_max: float = length("RangeMax", 0.0, "farther points are dropped; 0: none")
    max_correspondence_distance: float = length(
        "MaxCorrespondenceDistance", 0.1, "points up to this far apart are matched", 1e-4
    )
    reciprocal_correspondences: bool = switch(
        "ReciprocalCorrespondences", True, "points count as matched if each is the other's nearest"
    )
    iterations: int = count("Iterations", 30, "steps at most", "", 1, 10_000)
    epsilon: float = number(
        "Epsilon",
        0.0,
        "steps end when one changes the transform by less; 0: a default of the solver",
        "m, rad",
        0.0,
        1.0,
    )
    correspondence_ratio: float = share("CorrespondenceRatio", 0.1, "share of matched points that a transform needs")
    force_4dof: bool = switch("Force4DoF", False, "scans are matched in x, y, z and yaw only")
    filters_enabled: int = choice(
        "FiltersEnabled", 3, "scans are filtered on the side", {0: "none", 1: "from", 2: "to", 3: "both"}
    )
    point_to_plane: bool = switch("PointToPlane", True, "distances from points to planes; false: to points")
    point_to_plane_k: int = count("PointToPlaneK", 5, "neighbours of which a normal is made", "points", 0, 10_000)
    point_to_plane_radius: float = length(
        "PointToPlaneRadius", 0.0, "normals are made of neighbours within this; 0: of PointToPlaneK"
    )
    point_to_plane_ground_normals_up: float = share(
        "PointToPlaneGroundNormalsUp", 0.0, "normals that point down by more than this are turned up; 0: none"
    )
    point_to_plane_min_complexity: float = share(
        "PointToPlaneMinComplexity",
        0.02,
        "a scan with less structure (0 a straight corridor, 1 equal all round) is no case for planes alone",
    )
    point_to_plane_low_complexity_strategy: int = choice(
        "PointToPlaneLowComplexityStrategy",
        1,
        "what then",
        {0: "refuse", 1: "correct only along the sure axes", 2: "accept"},
    )
    outlier_ratio: float = share("OutlierRatio", 0.85, "share of the nearest matches that is kept (Icp/Strategy 1)")
    debug_export_format: str = text(
        "DebugExportFormat", "", "write the scans of each match for debugging", effective=False
    )
    pm_config: str = text("PMConfig", "", "settings file of libpointmatcher, which is not here", effective=False)
    pm_matcher_knn: int = count(
        "PMMatcherKnn", 1, "neighbours that a point is matched with (libpointmatcher)", effective=False
    )
    pm_matcher_epsilon: float = number(
        "PMMatcherEpsilon", 0.0, "approximation of neighbours (libpointmatcher); here exact", effective=False
    )
    pm_matcher_intensity: bool = switch(
        "PMMatcherIntensity",
        False,
        "the neighbour of the most similar intensity is taken (libpointmatcher)",
        effective=False,
    )
    cc_sampling_limit: int = count(
        "CCSamplingLimit", 50000, "points at most (CCCoreLib, which is not here)", effective=False
    )
    cc_filter_out_farthest_points: bool = switch(
        "CCFilterOutFarthestPoints",
        False,
        "farthest points do not count (CCCoreLib, which is not here)",
        effective=False,
    )
    cc_max_final_rms: float = number(
        "CCMaxFinalRMS", 0.2, "largest error in the end (CCCoreLib, which is not here)", effective=False
    )

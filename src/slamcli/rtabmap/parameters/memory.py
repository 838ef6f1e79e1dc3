# SPDX-License-Identifier: MIT
"""``Rtabmap`` and ``Mem``: when nodes are made, what is remembered and for how long."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter
from slamcli.rtabmap.parameters.declaring import absent, choice, count, length, number, share, switch, text


@dataclass(frozen=True, slots=True, kw_only=True)
class RtabmapGroup:
    """``Rtabmap``."""

    publish_stats: bool = switch("PublishStats", True, "publish statistics", effective=False)
    publish_last_signature: bool = switch("PublishLastSignature", True, "publish the newest node", effective=False)
    publish_pdf: bool = switch("PublishPdf", True, "publish the posterior of the loop hypotheses", effective=False)
    publish_likelihood: bool = switch("PublishLikelihood", True, "publish the likelihood", effective=False)
    publish_ram_usage: bool = switch("PublishRAMUsage", False, "publish how much memory is used", effective=False)
    compute_rmse: bool = switch(
        "ComputeRMSE", True, "compare with ground truth in the database: slamcli evaluate does", effective=False
    )
    save_wm_state: bool = switch(
        "SaveWMState", False, "store with each node's statistics which nodes were in working memory"
    )
    time_thr: float = number(
        "TimeThr",
        0.0,
        "longest time that an update may take, as modelled, before nodes go to long-term memory; 0: no bound",
        "ms",
    )
    memory_thr: int = count(
        "MemoryThr", 0, "nodes in working memory at most, before some go to long-term memory; 0: no bound", "nodes"
    )
    detection_rate: float = number(
        "DetectionRate", 1.0, "how often a node may be made; 0: from each input", "Hz", maximum=1000.0
    )
    image_buffer_size: int = count(
        "ImageBufferSize", 1, "inputs that wait while one is worked on; here none waits", effective=False
    )
    create_intermediate_nodes: bool = switch(
        "CreateIntermediateNodes",
        False,
        "nodes without images between two detections; here every frame has its pose without them",
        effective=False,
    )
    working_directory: str = text(
        "WorkingDirectory", "", "folder of the database: --output and --database name it", effective=False
    )
    max_retrieved: int = count("MaxRetrieved", 2, "nodes fetched from long-term memory per update", "nodes")
    max_republished: int = count("MaxRepublished", 2, "nodes published again when a viewer asks", effective=False)
    statistic_logs_buffered_in_ram: bool = switch(
        "StatisticLogsBufferedInRAM",
        True,
        "keep statistics in memory before they are written to log files",
        effective=False,
    )
    statistic_logged: bool = switch(
        "StatisticLogged", False, "write log files; steps.csv has the figures", effective=False
    )
    statistic_logged_headers: bool = switch("StatisticLoggedHeaders", True, "head lines in log files", effective=False)
    start_new_map_on_loop_closure: bool = switch(
        "StartNewMapOnLoopClosure", False, "a new session keeps nothing until it closes a loop with an earlier one"
    )
    start_new_map_on_good_signature: bool = switch(
        "StartNewMapOnGoodSignature", False, "a new session begins with the first image that has enough features"
    )
    images_already_rectified: bool = switch(
        "ImagesAlreadyRectified",
        True,
        "images are undistorted: the calibration tells, so that this is not asked",
        effective=False,
    )
    rectify_only_features: bool = switch(
        "RectifyOnlyFeatures", False, "undistort key points instead of whole images; here images are", effective=False
    )
    loop_thr: float = share("LoopThr", 0.11, "probability from which a loop hypothesis is verified")
    loop_ratio: float = number(
        "LoopRatio", 0.0, "a hypothesis must also exceed this share of the one before; 0: it need not", maximum=10.0
    )
    loop_gps: bool = switch(
        "LoopGPS", True, "with GPS only places near the fix are candidates; fixes are not used here", effective=False
    )
    virtual_place_likelihood_ratio: int = choice(
        "VirtualPlaceLikelihoodRatio",
        0,
        "likelihood of a new place",
        {0: "mean / deviation", 1: "deviation / (maximum - mean)"},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MemGroup:
    """``Mem``."""

    rehearsal_similarity: float = share(
        "RehearsalSimilarity", 0.6, "share of common words from which two nodes in a row are merged into one"
    )
    image_kept: bool = switch(
        "ImageKept", False, "keep images uncompressed in memory; here they stay in the database", effective=False
    )
    bin_data_kept: bool = switch("BinDataKept", True, "keep images and scans in the database")
    raw_descriptors_kept: bool = switch(
        "RawDescriptorsKept", True, "keep all key points in the database, not only those that are words"
    )
    load_visual_local_features_on_init: bool = switch(
        "LoadVisualLocalFeaturesOnInit",
        True,
        "read all features when a database is opened, not when they are needed",
        effective=False,
    )
    map_labels_added: bool = switch("MapLabelsAdded", True, "label the first node of each session map0, map1 ...")
    save_depth_16_format: bool = switch("SaveDepth16Format", False, "store depth in whole millimetres (at most 65.5 m)")
    not_linked_nodes_kept: bool = switch(
        "NotLinkedNodesKept",
        True,
        "keep nodes that were merged away; here those stay in the database, and a standing robot makes none",
        effective=False,
    )
    intermediate_node_data_kept: bool = switch(
        "IntermediateNodeDataKept",
        False,
        "keep images and scans of intermediate nodes; here there are none",
        effective=False,
    )
    image_compression_format: str = parameter(
        ".jpg", "how colour images are stored", name="ImageCompressionFormat", choices=(".jpg", ".png")
    )
    depth_compression_format: str = parameter(
        ".rvl", "how 16 bit depth images are stored; those in metres always as .png", name="DepthCompressionFormat",
        choices=(".rvl", ".png"),
    )  # fmt: skip
    stm_size: int = count("STMSize", 10, "nodes in short-term memory: no loops are looked for among them", "nodes", 1)
    incremental_memory: bool = switch("IncrementalMemory", True, "map; false: the map is fixed and only localised in")
    localization_read_only: bool = switch(
        "LocalizationReadOnly",
        False,
        "open the database for reading only when localising; here a copy is worked on, so that it always stays as it is",
        effective=False,
    )
    localization_data_saved: bool = absent("LocalizationDataSaved", "store the nodes of a localisation too")
    reduce_graph: bool = switch("ReduceGraph", False, "drop a node that closed a loop: its links go to the other one")
    recent_wm_ratio: float = share(
        "RecentWmRatio", 0.2, "share of working memory after the last loop closure that is not transferred"
    )
    transfer_sorting_by_weight_id: bool = switch(
        "TransferSortingByWeightId", False, "transfer by weight, then by number; false: by weight, then by last use"
    )
    rehearsal_id_updated_to_new_one: bool = switch(
        "RehearsalIdUpdatedToNewOne", False, "of two merged nodes the newer stays; false: the older"
    )
    rehearsal_weight_ignored_while_moving: bool = switch(
        "RehearsalWeightIgnoredWhileMoving", False, "merging counts no weight while the robot moves"
    )
    generate_ids: bool = switch(
        "GenerateIds", True, "number nodes from 1; false: as their images, which have no numbers", effective=False
    )
    bad_signatures_ignored: bool = switch(
        "BadSignaturesIgnored", False, "make no node of an image with too few features"
    )
    init_wm_with_all_nodes: bool = switch(
        "InitWMWithAllNodes", False, "all nodes of a database begin in working memory; false: those that ended in it"
    )
    depth_as_mask: bool = switch("DepthAsMask", True, "look for key points only where depth is known (Kp)")
    depth_mask_floor_thr: float = length(
        "DepthMaskFloorThr", 0.0, "no key points lower than this above the base frame's floor (Kp); 0: anywhere"
    )
    stereo_from_motion: bool = absent(
        "StereoFromMotion", "triangulate key points without depth from the odometry's motion"
    )
    image_pre_decimation: int = count(
        "ImagePreDecimation", 1, "images are made smaller by this before key points are found", "", 1, 64
    )
    image_post_decimation: int = count(
        "ImagePostDecimation",
        1,
        "images are made smaller by this before they are stored; here they are stored whole",
        "",
        1,
        64,
        effective=False,
    )
    compression_parallelized: bool = switch(
        "CompressionParallelized", True, "compress in threads; --jobs says how many", effective=False
    )
    laser_scan_downsample_step_size: int = count(
        "LaserScanDownsampleStepSize", 1, "every this many points of a scan are taken", "points", 1
    )
    laser_scan_voxel_size: float = length("LaserScanVoxelSize", 0.0, "scans are thinned to one point per voxel; 0: not")
    laser_scan_normal_k: int = count(
        "LaserScanNormalK", 0, "normals kept with scans; here they are made where scans are matched (Icp/PointToPlaneK)",
        "points", effective=False,
    )  # fmt: skip
    laser_scan_normal_radius: float = length(
        "LaserScanNormalRadius", 0.0, "normals kept with scans; here they are made where scans are matched (Icp/PointToPlaneRadius)",
        effective=False,
    )  # fmt: skip
    use_odom_features: bool = switch(
        "UseOdomFeatures", True, "take the features of own visual odometry instead of finding them again"
    )
    use_odom_gravity: bool = switch("UseOdomGravity", False, "which way is down comes from odometry instead of the IMU")
    cov_off_diag_ignored: bool = switch(
        "CovOffDiagIgnored", False, "only the diagonal of odometry's covariance counts (RTAB-Map: true)"
    )
    global_descriptor_strategy: int = choice(
        "GlobalDescriptorStrategy",
        0,
        "one descriptor of the whole image",
        {0: "none"},
        {1: "PyDescriptor"},
        effective=False,
    )
    rotate_images_upside_up: bool = absent(
        "RotateImagesUpsideUp", "turn images so that up is up, by the camera's mount"
    )

#!/usr/bin/env bash
# Makes everything in this folder again (20 s): sample_data/make.sh [OUT]. The same versions give the same bytes.
set -euo pipefail
out=${1:-$(dirname "$0")}

common=(--seed 1 --set laser.resolution=0.001)

# Main sample: ROS 1, 158 s, 102 m through furnished rooms and back.
slamcli generate office "$out/office.bag" "${common[@]}" --compression bz2 --set truth.rate=10 \
    --truth "$out/office.truth.tum" --map-out "$out/office.map.yaml"

# Two rounds of a 130 m loop, MCAP with zstd.
slamcli generate loop_corridor "$out/loop_corridor.mcap" "${common[@]}" --compression zstd \
    --set laser.rate=5 --set laser.sweep=0.0133 --set odometry.rate=10 --set truth.rate=5 \
    --truth "$out/loop_corridor.truth.tum" --map-out "$out/loop_corridor.map.yaml"

# People, IMU, wide scanner, MCAP with zstd.
slamcli generate warehouse "$out/warehouse.mcap" "${common[@]}" --compression zstd --duration 120 --people 3 --imu \
    --set laser.rate=5 --set laser.sweep=0.02 --set laser.beams=271 --set imu.rate=50 --set truth.rate=5 \
    --truth "$out/warehouse.truth.tum" --map-out "$out/warehouse.map.yaml"

# Short range, all around, ROS 2 folder (SQLite).
slamcli generate cluttered_room "$out/cluttered_room" "${common[@]}" --duration 60 --format rosbag2-sqlite3 \
    --set odometry.rate=10 --set truth.rate=5 \
    --truth "$out/cluttered_room.truth.tum" --map-out "$out/cluttered_room.map.yaml"

# RGB-D camera and IMU about a desk, JPEG and PNG, MCAP with zstd.
slamcli generate visual_desk "$out/desk_rgbd.mcap" --seed 1 --compression zstd --camera rgbd-inertial --duration 3 \
    --image-size 320x240 --rate 10 --compressed --set camera.noise=1 --set depth.noise=0.0006 --set depth.step=0.0052 \
    --set truth.rate=50 --truth "$out/desk_rgbd.truth.tum"

rm -f "$out"/*.run.json  # what they say of the settings stands above; their times differ from run to run

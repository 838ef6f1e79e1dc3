# SPDX-License-Identifier: MIT
"""How long writing and reading a node of RTAB-Map's database takes, and what memory it needs.

Nodes have a textured image of 640 x 480, depth in whole millimetres with a few holes, 1,000 key points and 500 new words. Times are CPU time
of the caller's thread, medians; with `--jobs 2` the rest is done on another thread.

    python benchmarks/databases.py --nodes 200
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "rtabmap"))
import database_worlds as worlds

from slamcli.rtabmap.database import Database
from slamcli.rtabmap.signature import NodeImages
from slamcli.vision.pinhole import Pinhole


def view(seed: int) -> NodeImages:
    """Return smooth texture with some noise before a slanted wall."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:480, :640]
    coarse = np.kron(rng.integers(0, 200, (30, 40, 3)), np.ones((16, 16, 1)))
    colour = (coarse + rng.integers(0, 24, (480, 640, 1))).astype(np.uint8)
    depth = (
        np.where(rng.random((480, 640)) < 0.05, 0, 1500 + rows + columns // 4 + rng.integers(0, 4, (480, 640))) / 1000.0
    )
    camera = Pinhole(fx=525.0, fy=525.0, cx=319.5, cy=239.5, width=640, height=480)
    return NodeImages(colour=colour, camera=camera, T_base_camera=worlds.OPTICAL, depth=depth.astype(np.float32))


def median_ms(times: list[float]) -> str:
    return f"{1e3 * np.median(times):7.2f} ms"


def write(path: Path, nodes: int, jobs: int, images: list[NodeImages]) -> None:
    times = []
    with Database.create(path, "", jobs=jobs, overwrite=True) as database:
        for node_id in range(1, nodes + 1):
            signature = worlds.signature(node_id, count=1000)
            begin = time.thread_time()
            database.add_node(signature, weight=0, images=images[node_id % len(images)])
            if node_id > 1:
                database.add_links([worlds.link(node_id - 1, node_id)])
            database.add_words(np.arange(500) + 1000 * node_id, signature.features.descriptors[:500])
            database.commit()
            times.append(time.thread_time() - begin)
    print(f"jobs {jobs}: writing a node {median_ms(times)}, file {path.stat().st_size / nodes / 1e3:.0f} kB a node")


def read(path: Path) -> None:
    with Database.read(path) as database:
        ids = database.nodes().ids.tolist()
        for name, question in (
            ("signature", database.read_signature),
            ("images", database.read_images),
            ("links of one", database.links),
        ):
            times = []
            for node_id in ids:
                begin = time.thread_time()
                question(node_id)
                times.append(time.thread_time() - begin)
            print(f"reading {name:12} {median_ms(times)}")
        for name, whole in (("nodes", database.nodes), ("links", database.links), ("words", database.words)):
            begin = time.thread_time()
            whole()
            print(f"reading all {name:8} {median_ms([time.thread_time() - begin])}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=200)
    nodes = parser.parse_args().nodes
    images = [view(seed) for seed in range(4)]
    with tempfile.TemporaryDirectory() as folder:
        for jobs in (1, 2):
            write(Path(folder) / "a.db", nodes, jobs, images)
        read(Path(folder) / "a.db")
    resident = int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0])
    print(f"memory {resident / 1024:.0f} MB")


if __name__ == "__main__":
    main()

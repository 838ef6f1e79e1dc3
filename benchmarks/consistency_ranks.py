# SPDX-License-Identifier: MIT
"""How well figures without ground truth rank results: Spearman's correlation with the true error, over finished comparisons.

slamcli compare REC --result good=a --result bad=b ... --ref TRUTH -o cmp
python benchmarks/consistency_ranks.py cmp/compare.json other/compare.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from slamcli.evaluation.figure_catalogue import CONSISTENCY

TRUE = ("relations.trans.mean", "ate.rmse")


def correlation(document: dict, key: str, better: str) -> float:
    """Return Spearman's rank correlation of a figure with the true error, 1 if it ranks alike, NaN where it is not in four results."""
    pairs = []
    for entry in document["results"]:
        error = next((entry["figures"][name] for name in TRUE if name in entry["figures"]), None)
        if error is not None and key in entry["figures"]:
            pairs.append((error, entry["figures"][key]))
    if len(pairs) < 4:
        return float("nan")
    errors, values = np.array(pairs).T
    if np.ptp(values) == 0 or np.ptp(errors) == 0:
        return float("nan")
    return float(spearmanr(errors, values if better != "higher" else -values).statistic)


def main(paths: list[str]) -> None:
    """Print a row for each figure, a column for each comparison."""
    documents = {Path(path).parent.name: json.loads(Path(path).read_text()) for path in paths}
    print("| figure | " + " | ".join(documents) + " | mean |")
    print("|---|" + "---:|" * (len(documents) + 1))
    for figure in CONSISTENCY:
        if figure.better == "neither":
            continue
        found = [correlation(document, figure.key, figure.better) for document in documents.values()]
        known = [value for value in found if np.isfinite(value)]
        cells = [
            "–" if not np.isfinite(value) else f"{value:.2f}" for value in [*found, np.mean(known) if known else np.nan]
        ]
        print(f"| `{figure.key}` | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main(sys.argv[1:])

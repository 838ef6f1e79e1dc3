# SPDX-License-Identifier: MIT
"""Vocabularies of ORB descriptors: DBoW2's text, DBoW3's YAML, and slamcli's own file.

`read_vocabulary` reads any of them, packed or not; `load_vocabulary` gives the one that slamcli brings along where no file
is named.
"""

from slamcli.formats.vocabularies.own import write_vocabulary
from slamcli.formats.vocabularies.reading import load_vocabulary, read_vocabulary

__all__ = ["load_vocabulary", "read_vocabulary", "write_vocabulary"]

# SPDX-License-Identifier: MIT
"""What tiers that see know of places beforehand, a vocabulary and an atlas, and where the atlas goes in the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.formats.atlas_files import read_atlas, write_atlas
from slamcli.formats.vocabularies import load_vocabulary
from slamcli.mapper import MappingResult, Tier
from slamcli.outputs import check_file
from slamcli.pipelines.vocabulary import TrainingRequest, descriptors_of
from slamcli.runtime import RunLog
from slamcli.vision.visual_atlas import VisualAtlas
from slamcli.vision.vocabulary import Vocabulary
from slamcli.vision.vocabulary_training import TrainingSettings, train_vocabulary

_OWN, _RECORDING = ("auto", "own"), "recording"
_TRAINING_IMAGES = 150


@dataclass(frozen=True, slots=True, kw_only=True)
class AtlasChoices:
    """Which atlas and vocabulary the user names."""

    load: Path | None = None
    """Atlas to go on from."""
    save: Path | None = None
    """Where else the atlas goes; it always lies in the folder, as ``atlas.npz``."""
    localise_only: bool = False
    """Whether the loaded maps stay as they are."""
    vocabulary: str | None = None
    """A file, ``own``, or ``recording``: trained from it beforehand. None: as the parameters say."""

    @property
    def files(self) -> tuple[Path, ...]:
        """What is read besides the recording."""
        return () if self.load is None else (self.load,)

    def check(self, tier: Tier) -> None:
        """Raise before long work what would fail after it.

        Raises
        ------
        UsageError
            If the tier has no use for what is named, options contradict each other, or the atlas cannot be written.
        """
        named = {"--load-atlas": self.load, "--save-atlas": self.save, "--vocabulary": self.vocabulary}
        used = [option for option, value in named.items() if value]
        if tier.remembers:
            if used:
                raise UsageError(f"{used[0]}: {tier.name} keeps maps and words in a database (--database)")
            return
        used += ["--localise-only"] if self.localise_only else []
        if used and "images" not in tier.roles:
            raise UsageError(f"{used[0]}: {tier.name} does not see; --algo orbslam3 does")
        if self.localise_only and self.load is None:
            raise UsageError("--localise-only: name the atlas to localise in with --load-atlas")
        if self.save is not None:
            check_file(self.save)

    def read_atlas(self, log: RunLog) -> VisualAtlas | None:
        """Return the atlas to go on from; None if none is named.

        Raises
        ------
        FormatError
            If the file is no atlas of slamcli.
        UsageError
            If there is no map in it to localise in.
        """
        if self.load is None:
            return None
        with log.stage("load atlas"):
            atlas = read_atlas(self.load)
        if self.localise_only and not atlas.maps:
            raise UsageError(f"--localise-only: {self.load} holds no map")
        return atlas

    def write_atlas(self, result: MappingResult) -> None:
        """Write the atlas of a result to where the user wants it besides the folder."""
        if self.save is not None and result.atlas is not None:
            write_atlas(result.atlas, self.save)

    def find_vocabulary(self, parameters: Any, inputs: Sequence[Path], topic: str, log: RunLog) -> Vocabulary:
        """Return the vocabulary that the user or the tier's parameter ``slamcli.vocabulary`` names.

        Parameters
        ----------
        inputs, topic
            The recording and the topic of its main camera, to learn from where ``recording`` is named.

        Raises
        ------
        InputError
            If the file is no vocabulary, or the recording's images hold too few features.
        """
        named = self.vocabulary or parameters.slamcli.vocabulary or _OWN[0]
        if named in _OWN:
            return load_vocabulary()
        if named != _RECORDING:
            with log.stage("load vocabulary"):
                return load_vocabulary(named)
        request = TrainingRequest(
            sources=tuple(inputs), settings=TrainingSettings(), max_images=_TRAINING_IMAGES, topic=topic,
            num_features=parameters.extractor.num_features,
        )  # fmt: skip
        with log.stage("train vocabulary"):
            images = [descriptors for source in inputs for descriptors in descriptors_of(source, request)]
            return train_vocabulary(images, request.settings)

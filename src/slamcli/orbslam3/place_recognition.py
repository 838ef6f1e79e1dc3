# SPDX-License-Identifier: MIT
"""Whether a keyframe shows a place that some map knows already, and how the two lie to one another.

C. Campos et al., "ORB-SLAM3", IEEE T-RO 37(6), 2021, doi:10.1109/TRO.2021.3075644, section VI-A: candidates by bags of words, matches,
RANSAC, guided matching, optimisation, more guided matching, verification in three keyframes that share points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.orbslam3.place_index import Place, PlaceIndex
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.region_matching import match_region, project_region, region_around
from slamcli.orbslam3.similarities import apply, as_similarity, inverse
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.vision.similarity_optimisation import optimise_similarity
from slamcli.vision.similarity_ransac import SidedPoints, estimate_similarity

Floats = NDArray[np.float64]
_STRICT, _LOOSE = 50, 75
"""Bits: TH_LOW, and 1.5 times that while the similarity is rough."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceMatch:
    """A keyframe that sees a region of a map again, or of another map."""

    keyframe: int
    """That sees it."""
    place: Place
    """Keyframe of the region that most resembles it."""
    S_camera_other: Floats
    """float64 (4, 4), takes points of the region's map to the keyframe's camera, in the keyframe's map's units."""
    points: Ids
    """(F,), point of the region that each feature of the keyframe shows, or -1."""
    verified: int
    """Other keyframes that see the region there too."""


@dataclass(slots=True)
class _Pending:
    """A match that waits for more keyframes to agree."""

    match: PlaceMatch
    T_camera_map: Floats
    """Where the keyframe was when it was matched: what follows is taken from there on."""
    misses: int = 0


class PlaceRecognition:
    """Asks for each new keyframe whether its place is known."""

    def __init__(self, index: PlaceIndex, settings: PlaceSettings, counts: Counter[str]) -> None:
        self._index, self._settings, self._counts = index, settings, counts
        self._pending: dict[str, _Pending] = {}

    def use(self, settings: PlaceSettings) -> None:
        """Go on with other settings."""
        self._settings = settings

    def forget(self) -> None:
        """Drop what waits for more keyframes: the maps were changed."""
        self._pending.clear()

    def look(self, maps: Sequence[SparseMap], keyframe: int) -> tuple[PlaceMatch | None, PlaceMatch | None]:
        """Return the place of another map, and the place of its own map, that the newest map's keyframe surely shows.

        The keyframe must be in the index.
        """
        number = len(maps) - 1
        merge, loop = self._follow("merge", maps, keyframe), self._follow("loop", maps, keyframe)
        if len(maps[number].living_keyframes) < self._settings.least_keyframes:
            return merge, None
        if merge is None or loop is None:
            own, others = self._index.candidates(maps, Place(number, keyframe), limit=self._settings.num_candidates)
            merge = merge or self._search("merge", maps, keyframe, others)
            loop = loop or self._search("loop", maps, keyframe, own)
        return merge, loop

    def elsewhere(self, maps: Sequence[SparseMap], keyframe: int) -> PlaceMatch | None:
        """Return the place of another map that a keyframe of the newest surely shows, however few keyframes that has."""
        self._pending.clear()
        _, others = self._index.candidates(maps, Place(len(maps) - 1, keyframe), limit=self._settings.num_candidates)
        found = self._search("merge", maps, keyframe, others)
        self._pending.clear()
        return found

    def remaining(self, maps: Sequence[SparseMap]) -> tuple[PlaceMatch | None, PlaceMatch | None]:
        """Return what still waits for more keyframes though no more will come, if at least one other keyframe agrees."""
        return self._settle("merge", maps), self._settle("loop", maps)

    def _settle(self, kind: str, maps: Sequence[SparseMap]) -> PlaceMatch | None:
        """Return a match that waits, found anew on the maps as they are now."""
        pending = self._pending.pop(kind, None)
        if pending is None or not maps[-1].keyframe_alive[pending.match.keyframe]:
            return None
        keyframe, place = pending.match.keyframe, pending.match.place
        other = maps[place.map_number]
        together = other is maps[-1] and place.keyframe in other.covisible(keyframe)[0]
        if together or not other.keyframe_alive[place.keyframe]:
            return None
        S = maps[-1].T_camera_map[keyframe] @ inverse(pending.T_camera_map) @ pending.match.S_camera_other
        region = region_around(other, place.keyframe, self._settings.region_size)
        found = self._refine(maps, keyframe, place, S, region)
        return found if found is not None and found.verified else None

    def _search(
        self, kind: str, maps: Sequence[SparseMap], keyframe: int, candidates: list[Place]
    ) -> PlaceMatch | None:
        """Return the best match with a candidate if three neighbours agree; let it wait if fewer do."""
        if kind in self._pending:
            return None
        best: PlaceMatch | None = None
        for place in candidates:
            found = self._compare(maps, keyframe, place)
            if found is not None and (best is None or _merit(found) > _merit(best)):
                best = found
        if best is None:
            return None
        self._counts[f"{kind} candidates that fit"] += 1
        if best.verified >= self._settings.num_verified:
            return best
        self._pending[kind] = _Pending(best, maps[-1].T_camera_map[keyframe].copy())
        return None

    def _compare(self, maps: Sequence[SparseMap], keyframe: int, place: Place) -> PlaceMatch | None:
        """Return the match of a keyframe with the region around a candidate, with the number of neighbours that agree."""
        settings, sparse_map, other = self._settings, maps[-1], maps[place.map_number]
        region = region_around(other, place.keyframe, settings.region_size)
        matches = match_region(sparse_map, keyframe, other, region)
        if len(matches.features) < settings.least_words:
            return None
        ids = sparse_map.seen[keyframe, matches.features]
        first = _side(sparse_map, keyframe, ids, matches.features)
        second = _seen_from(other, matches.best, matches.points, matches.sigmas)
        ahead = second.points_camera[:, 2] > 0
        if np.count_nonzero(ahead) < settings.least_sampled:
            return None
        try:
            sampled = estimate_similarity(
                _rows(first, ahead), _rows(second, ahead), sparse_map.camera, fix_scale=settings.fix_scale,
                seed=settings.seed + keyframe, min_inliers=settings.least_sampled,
            )  # fmt: skip
        except EstimationError:
            return None
        S_camera_other = sampled.S_1_2.matrix @ other.T_camera_map[matches.best]
        return self._refine(maps, keyframe, Place(place.map_number, matches.best), S_camera_other, region)

    def _refine(
        self, maps: Sequence[SparseMap], keyframe: int, place: Place, S_camera_other: Floats, region: Ids
    ) -> PlaceMatch | None:
        """Return the match that guided matching and optimisation make of a rough similarity."""
        settings, sparse_map, other = self._settings, maps[-1], maps[place.map_number]
        around = np.unique(np.concatenate([region, region_around(other, place.keyframe, 2 * settings.region_size)]))
        ids = other.points_of(around)
        search = (sparse_map, keyframe, other, ids)
        points = project_region(*search, S_camera_other, radius=8.0, max_distance=_LOOSE)
        if np.count_nonzero(points >= 0) < settings.least_projected:
            return None
        refined, agreeing = optimised(sparse_map, keyframe, other, place.keyframe, points, S_camera_other, settings)
        if agreeing < settings.least_optimised:
            return None
        points = project_region(*search, refined, radius=5.0, max_distance=_STRICT)
        if np.count_nonzero(points >= 0) < settings.least_wide:
            return None
        verified = self._verify(sparse_map, keyframe, other, ids, refined)
        return PlaceMatch(keyframe=keyframe, place=place, S_camera_other=refined, points=points, verified=verified)

    def _verify(self, sparse_map: SparseMap, keyframe: int, other: SparseMap, ids: Ids, S_camera_other: Floats) -> int:
        """Return how many neighbours of a keyframe find the region where the similarity puts it, three at most."""
        neighbours, _ = sparse_map.covisible(keyframe)
        T_map_camera = inverse(sparse_map.T_camera_map[keyframe])
        agreeing = 0
        for k in neighbours[:10].tolist():
            S_neighbour_other = sparse_map.T_camera_map[k] @ T_map_camera @ S_camera_other
            points = project_region(sparse_map, k, other, ids, S_neighbour_other, radius=5.0, max_distance=_STRICT)
            agreeing += int(np.count_nonzero(points >= 0) >= self._settings.least_in_neighbour)
            if agreeing == self._settings.num_verified:
                break
        return agreeing

    def _follow(self, kind: str, maps: Sequence[SparseMap], keyframe: int) -> PlaceMatch | None:
        """Return the match that waits, moved to a new keyframe, once enough keyframes have agreed."""
        pending = self._pending.get(kind)
        if pending is None:
            return None
        found = self._again(maps, keyframe, pending)
        if found is None:
            pending.misses += 1
            if pending.misses > self._settings.most_misses:
                del self._pending[kind]
            return None
        if found.verified >= self._settings.num_verified:
            del self._pending[kind]
            return found
        self._pending[kind] = _Pending(found, maps[-1].T_camera_map[keyframe].copy())
        return None

    def _again(self, maps: Sequence[SparseMap], keyframe: int, pending: _Pending) -> PlaceMatch | None:
        """Return the match of a later keyframe with the same region: 30 points, 50 that agree, 100 points (section VI-A)."""
        settings, sparse_map, match = self._settings, maps[-1], pending.match
        other = maps[match.place.map_number]
        if not other.keyframe_alive[match.place.keyframe]:
            return None
        if other is sparse_map and match.place.keyframe in sparse_map.covisible(keyframe)[0]:
            return None  # they have grown together without help
        ids = other.points_of(region_around(other, match.place.keyframe, 2 * settings.region_size))
        S = sparse_map.T_camera_map[keyframe] @ inverse(pending.T_camera_map) @ match.S_camera_other
        search = (sparse_map, keyframe, other, ids)
        points = project_region(*search, S, radius=8.0, max_distance=_LOOSE)
        if np.count_nonzero(points >= 0) < 30:
            return None
        refined, agreeing = optimised(sparse_map, keyframe, other, match.place.keyframe, points, S, settings)
        if agreeing < 50:
            return None
        points = project_region(*search, refined, radius=5.0, max_distance=_STRICT)
        if np.count_nonzero(points >= 0) < 100:
            return None
        return replace(match, keyframe=keyframe, S_camera_other=refined, points=points, verified=match.verified + 1)


def optimised(
    sparse_map: SparseMap,
    keyframe: int,
    other: SparseMap,
    beside: int,
    points: Ids,
    S_camera_other: Floats,
    settings: PlaceSettings,
) -> tuple[Floats, int]:
    """Return the similarity of least reprojection error in both images, and how many matches agree with it.

    Parameters
    ----------
    beside
        Keyframe of `other` in whose image the points are judged too.
    points
        (F,), point of `other` that each feature of the keyframe shows, or -1; those whose feature sees a point of its own count.
    """
    own = sparse_map.seen[keyframe, : sparse_map.counts[keyframe]]
    features = np.flatnonzero((points >= 0) & (own >= 0))
    T_beside = other.T_camera_map[beside]
    first = _side(sparse_map, keyframe, own[features], features)
    second = _seen_from(other, beside, points[features], first.sigmas)
    ahead = (second.points_camera[:, 2] > 0) & (first.points_camera[:, 2] > 0)
    first, second = _rows(first, ahead), _rows(second, ahead)
    start = as_similarity(S_camera_other @ inverse(T_beside))
    try:
        found = optimise_similarity(
            start, first, second, sparse_map.camera, fix_scale=settings.fix_scale, min_inliers=settings.least_optimised
        )
    except EstimationError:
        return S_camera_other, 0
    return found.S_1_2.matrix @ T_beside, found.num_inliers


def _merit(match: PlaceMatch) -> tuple[int, int]:
    return match.verified, int(np.count_nonzero(match.points >= 0))


def _side(sparse_map: SparseMap, keyframe: int, ids: Ids, features: Ids) -> SidedPoints:
    """Return points (N,) as a keyframe's features (N,) see them."""
    return SidedPoints(
        points_camera=apply(sparse_map.T_camera_map[keyframe], sparse_map.positions[ids]),
        pixels=sparse_map.pixels[keyframe, features],
        sigmas=sparse_map.sigmas[keyframe, features],
    )


def _seen_from(sparse_map: SparseMap, keyframe: int, ids: Ids, sigmas: Floats) -> SidedPoints:
    """Return points (N,) where a keyframe should see them: its feature if it sees one, else where it projects to."""
    camera_points = apply(sparse_map.T_camera_map[keyframe], sparse_map.positions[ids])
    ahead = camera_points[:, 2] > 0
    pixels = np.full((len(ids), 2), np.nan)
    pixels[ahead] = sparse_map.camera.project(camera_points[ahead])
    count = sparse_map.counts[keyframe]
    feature_of = np.full(sparse_map.num_points, -1, dtype=np.int64)
    seen = sparse_map.seen[keyframe, :count]
    feature_of[seen[seen >= 0]] = np.flatnonzero(seen >= 0)
    at = feature_of[ids]
    pixels[at >= 0] = sparse_map.pixels[keyframe, at[at >= 0]]
    sigmas = np.where(at >= 0, sparse_map.sigmas[keyframe, np.maximum(at, 0)], sigmas)
    return SidedPoints(points_camera=camera_points, pixels=pixels, sigmas=sigmas)


def _rows(side: SidedPoints, chosen: NDArray[np.bool_]) -> SidedPoints:
    return SidedPoints(points_camera=side.points_camera[chosen], pixels=side.pixels[chosen], sigmas=side.sigmas[chosen])

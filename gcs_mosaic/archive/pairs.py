"""Stage 5: the registration of pairs of frames, each made once, whatever becomes of its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.engine import Engine
from gcs_mosaic.archive.features import SeenFrame, whole_features
from gcs_mosaic.archive.frame_kinds import FrameKind
from gcs_mosaic.archive.retrieval import Described
from gcs_mosaic.archive.tasks import Made, Parts, StageTask, task
from gcs_mosaic.stitch.arrays import AnyPairsNx2, Matrix3x3, Points32Nx2, PointsNx2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration
from gcs_mosaic.stitch.registration.registration import register
from gcs_mosaic.stitch.registration.settings import RegistrationSettings

FIRSTS = 4  # frames whose pairs make one task: some 64 pairs that share frames
FEWEST_FEATURES = 2**16  # from which indices take four bytes

Pair = tuple[int, int]


@dataclass(frozen=True, slots=True)
class KnownPairs:
    """Where the comparisons lie: by pair of frames the artefact that holds it, and whether they were registered."""

    found: dict[Pair, tuple[str, bool]]

    def others(self) -> dict[int, dict[int, bool]]:
        """By frame all others that it was compared with, and whether they were registered."""
        found: dict[int, dict[int, bool]] = {}
        for (a, b), (_, registered) in self.found.items():
            found.setdefault(a, {})[b] = registered
            found.setdefault(b, {})[a] = registered
        return found


@dataclass(frozen=True, slots=True)
class StoredRegistration:
    """A registration without what follows from the features: indices (m, 2) of inliers and (k, 2) of all matches, and the places
    (p, 2) of patches."""

    features: AnyPairsNx2
    tentative: AnyPairsNx2
    patches_a: Points32Nx2
    patches_b: Points32Nx2
    displaced_a: Points32Nx2
    displaced_b: Points32Nx2
    b_from_a: Matrix3x3
    independent_inliers: int
    evidence: float
    beyond: float

    def whole(self, a: Features, b: Features) -> Registration:
        """The registration of these frames."""
        return Registration(
            pixels_a=np.concatenate([_pixels(a, self.features[:, 0]), self.patches_a]),
            pixels_b=np.concatenate([_pixels(b, self.features[:, 1]), self.patches_b]),
            features=self.features.astype(np.intp),
            b_from_a=self.b_from_a,
            independent_inliers=self.independent_inliers,
            evidence=self.evidence,
            displaced_a=self.displaced_a.astype(np.float64),
            displaced_b=self.displaced_b.astype(np.float64),
            tentative=self.tentative.astype(np.intp),
            beyond=self.beyond,
        )


def _pixels(frame: Features, features: AnyPairsNx2) -> PointsNx2:
    return np.asarray(frame.points[features].astype(np.float64))


def registered(
    engine: Engine,
    frames: Sequence[SeenFrame],
    kinds: Sequence[FrameKind],
    pairs: Sequence[Pair],
    settings: RegistrationSettings,
) -> KnownPairs:
    """All pairs, compared. A pair whose task kills workers is left out: its frames have others."""
    described = [(one.key, kind.dead_as_taken) for one, kind in zip(frames, kinds, strict=True)]

    def of(some: Sequence[Pair]) -> StageTask:
        return task(pair_group, tuple((described[a], described[b]) for a, b in some), settings)

    groups: dict[int, list[Pair]] = {}
    for pair in pairs:
        groups.setdefault(pair[0] // FIRSTS, []).append(pair)
    known, left = dict[Pair, tuple[str, bool]](), list[Pair]()
    tasks = [of(group) for group in groups.values()]
    for group, one, outcome in zip(groups.values(), tasks, engine.run("pairs", tasks), strict=True):
        if isinstance(outcome, Made):
            known |= {pair: (one.key, is_one) for pair, is_one in zip(group, outcome.summary, strict=True)}
        else:
            left += group
    alone = [of([pair]) for pair in left]
    for pair, one, outcome in zip(left, alone, engine.run("pairs, one by one", alone) if left else [], strict=True):
        known |= {pair: (one.key, outcome.summary[0])} if isinstance(outcome, Made) else {}
    return KnownPairs(known)


def pair_group(
    artefacts: Artefacts, pairs: tuple[tuple[Described, Described], ...], settings: RegistrationSettings
) -> Parts:
    """The registrations of some pairs; what the frames show besides is judged once more when they are placed."""
    found = {}
    for a, b in pairs:
        one = _likeliest(register(whole_features(artefacts, *a), whole_features(artefacts, *b), settings))
        found[a[0], b[0]] = one.reason if isinstance(one, NotRegistered) else _stored(one)
    return {"summary": [not isinstance(one, str) for one in found.values()], "found": found}


def _likeliest(found: Registration | NotRegistered) -> Registration | NotRegistered:
    """What the frames themselves bear out (text burnt into both may agree better); else what other frames may bear out yet."""
    if isinstance(found, NotRegistered) and found.contradicted is not None:
        return found.contradicted
    return found


def _stored(found: Registration) -> StoredRegistration:
    return StoredRegistration(
        features=_small(found.features),
        tentative=_small(found.tentative),
        patches_a=found.pixels_a[len(found.features) :].astype(np.float32),
        patches_b=found.pixels_b[len(found.features) :].astype(np.float32),
        displaced_a=found.displaced_a.astype(np.float32),
        displaced_b=found.displaced_b.astype(np.float32),
        b_from_a=found.b_from_a,
        independent_inliers=found.independent_inliers,
        evidence=found.evidence,
        beyond=found.beyond,
    )


def _small(indices: AnyPairsNx2) -> AnyPairsNx2:
    return indices.astype(np.uint16 if indices.max(initial=0) < FEWEST_FEATURES else np.uint32)

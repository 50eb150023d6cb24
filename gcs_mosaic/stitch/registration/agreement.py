"""Agreement of pixels: whether two frames look alike as pictures under a proposed homography.

Keypoints propose how two frames overlap; woods, snow and thermal ground leave few that match again, so that they cannot prove
it. The pictures can: their coarse textures are laid on each other and correlated (zero-mean normalised cross-correlation). What
chance gives is measured on the same two pictures, at all other shifts of one over the other: rows, noise and smooth ground widen
that distribution as they should, and ground that repeats itself shows a second peak (peak-to-sidelobe ratio: Bolme et al., CVPR
2010). A proposal that is some pixels off is drawn to the peak, then refined by ECC (Evangelidis and Psarakis, IEEE PAMI 30(10),
2008). Nothing is learnt from other pairs, so that a pair is judged alike wherever and whenever it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.special import log_ndtr

from gcs_mosaic.stitch.arrays import FloatImage, Matrix3x3, PointsNx2, Vector2
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.features.texture import coarse, full_from_picture
from gcs_mosaic.stitch.registration.homography import mapped

REACH = 64  # px of the coarse texture, a quarter of its width: shifts compared, so that what repeats itself is found
DRAWN = 32  # px of it by which a proposal may be off
NEAR = 8  # px around a peak that belong to it
LEAST_OVERLAP = 1500  # px, a thirtieth of a coarse texture: less shows too little to tell
LEAST_COMMON = 0.1  # of a picture, where it is sought at all shifts: by less than that chance finds as much
COMPARABLE = 0.5  # of the overlap: shifts that leave less are not compared
# px of a coarse texture that vary together, by its blur. Frames that share more than chance gives have more in common at other
# shifts too, never less than this.
LEAST_TOGETHER = 30.0
ECC_STEPS = 40
ECC_TOLERANCE = 1e-4
OPTIMISM = 2.0  # standard deviations by which refinement raises what chance gives
PROMISING = (
    4.0  # standard deviations of a peak below which no refinement is tried; of 190 that proved right the least had 4.4
)
MOST = 12.0  # decades; more is not to be told from a tail that is only known to three
# px of the coarse texture around a match that look alike because it matches: what the frames show besides is beyond.
AROUND_A_MATCH = 6.0
# What lies between matches of one object belongs to it, up to so many px: a car park's row, not a field between two trees.
BETWEEN_MATCHES = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (25, 25))
FINEST = 2.0  # px of the texture, sigma: what keypoints of the usual size are made of
# What stands still in the picture - a sensor's pattern, a burnt-in display - agrees at zero motion whatever the ground does.
# px of the coarse texture, of the corner that moves most; and the correlation of a hover: 0.6 and less between frames of
# different cold fields that share a pattern, 0.97 when hovering over them.
STILL = 2.0
SAME_GROUND = 0.85


@dataclass(frozen=True, slots=True)
class Agreement:
    """Two pictures laid on each other at b_from_a (3x3, full resolution), as refined.

    correlation: of their textures, -1 to 1, over `pixels` of the coarse texture; runner_up: the largest at another shift;
    together: pixels that vary together by chance; evidence: -log10 of the chance that it is so large, or that another shift is
    the right one if what differs there are single crowns and stones; alone: the same if it is as much as varies together, which
    on a grid of plants or blocks is a whole one.
    """

    b_from_a: Matrix3x3
    correlation: float
    pixels: int
    runner_up: float
    together: float
    evidence: float
    alone: float


@dataclass(frozen=True)
class _Peak:
    shift: Vector2  # px of the coarse texture, of b
    deviations: float  # above what other shifts give
    correlation: float
    runner_up: float
    pixels: float
    together: float


class PixelPair:
    """Two frames as pictures, for several proposals."""

    def __init__(self, a: Features, b: Features) -> None:
        self._a, self._b = _Side(a), _Side(b)

    @property
    def known(self) -> bool:
        """Whether both frames have pictures."""
        return self._a.known and self._b.known

    def agreement(self, b_from_a: Matrix3x3) -> Agreement | None:
        """How well the textures agree around this homography (full resolution); None if they do no better than chance."""
        proposed = self._coarse_from_full(b_from_a)
        first = self._peak(proposed)
        if first is None or first.deviations < PROMISING:
            return None
        refined = self._refined(_shifted(proposed, first.shift))
        found = None if refined is None else self._peak(refined)
        if refined is None or found is None or np.abs(found.shift).max() > 1:
            return None
        if found.correlation < SAME_GROUND and self._is_still(refined):
            return None
        tries = 1 + math.pi * float(np.hypot(*first.shift)) ** 2 / LEAST_TOGETHER  # shifts as near as this one
        chance = -(log_ndtr(-(found.deviations - OPTIMISM)) / math.log(10)) - math.log10(tries)
        return Agreement(
            b_from_a=self._full_from_coarse(refined),
            correlation=found.correlation,
            pixels=int(found.pixels),
            runner_up=found.runner_up,
            together=found.together,
            evidence=float(min(chance, _log_odds_of_peak(found, LEAST_TOGETHER), MOST)),
            alone=_log_odds_of_peak(found, found.together),
        )

    def best_shifts(self) -> list[Matrix3x3]:
        """Where one picture looks most like the other if neither is turned, and if one is turned round: b_from_a (3x3, full
        resolution), found by correlation at all shifts that leave a tenth of it in common."""
        found = [self._best_shift(turn) for turn in (np.eye(3), self._a.turned_round)]
        return [self._full_from_coarse(coarse_from_coarse) for coarse_from_coarse in found]

    def _best_shift(self, turn: Matrix3x3) -> Matrix3x3:
        """The homography between coarse textures that turns a so, and then shifts it to where they agree best."""
        a, b, flipped = self._a, self._b, slice(None, None, -1 if turn[0, 0] < 0 else 1)
        room = cv2.getOptimalDFTSize(a.shape[0] + b.shape[0]), cv2.getOptimalDFTSize(a.shape[1] + b.shape[1])
        products, common = (
            _products(_spectrum(of_b, room), of_a[flipped, flipped], room)
            for of_a, of_b in ((a.image * a.mask, b.image * b.mask), (a.mask, b.mask))
        )
        enough = common >= LEAST_COMMON * float(b.mask.sum())
        best = np.where(enough, products / np.sqrt(common.clip(1)), -np.inf).argmax()
        row, column = np.unravel_index(best, products.shape)
        down, across = (
            int(at) - side if at >= of_b else int(at)
            for at, side, of_b in zip((row, column), room, b.shape, strict=True)
        )
        return _shifted(turn, np.array([across, down], np.float64))

    def evidence_beyond(self, found: Agreement, matched: PointsNx2) -> float:
        """Evidence (decades) of the pixels that are not around these pixels (n, 2) of a: two different places may have one
        object in common, but not what surrounds it."""
        laid, mask = self._laid(self._coarse_from_full(found.b_from_a))
        mask = mask * self._b.mask
        around = mapped(np.linalg.inv(self._b.full_from_coarse) @ found.b_from_a, matched)
        matching = np.zeros(mask.shape, np.uint8)
        for x, y in around[np.isfinite(around).all(axis=1)].clip(-1e4, 1e4).round().astype(int).tolist():
            cv2.circle(matching, (x, y), round(AROUND_A_MATCH), 1, cv2.FILLED)
        mask[cv2.morphologyEx(matching, cv2.MORPH_CLOSE, BETWEEN_MATCHES) > 0] = 0.0
        correlation, pixels = _correlation(laid, self._b.image, mask)
        deviations = correlation * math.sqrt(pixels / found.together) - OPTIMISM
        return float(min(-log_ndtr(-deviations) / math.log(10), MOST)) if pixels else 0.0

    def finest(self, found: Agreement) -> float:
        """Correlation of the finest details of the textures: of what is left of them without what is wider than some px."""
        one, other = (self._a.details, self._b.details)
        full_a, full_b = (full_from_picture(side.width, side.height, side.details.shape) for side in (self._a, self._b))
        b_from_a = np.linalg.inv(full_b) @ found.b_from_a @ full_a
        laid, mask = _laid(one, np.ones_like(one), b_from_a, other.shape)
        return _correlation(laid, other, mask)[0]

    def _is_still(self, b_from_a: Matrix3x3) -> bool:
        height, width = self._a.shape
        corners = np.array([[0.0, 0.0], [width, 0], [0, height], [width, height]])
        return self._a.shape == self._b.shape and bool(np.abs(mapped(b_from_a, corners) - corners).max() < STILL)

    def _coarse_from_full(self, b_from_a: Matrix3x3) -> Matrix3x3:
        return np.asarray(np.linalg.inv(self._b.full_from_coarse) @ b_from_a @ self._a.full_from_coarse)

    def _full_from_coarse(self, b_from_a: Matrix3x3) -> Matrix3x3:
        full = self._b.full_from_coarse @ b_from_a @ np.linalg.inv(self._a.full_from_coarse)
        return np.asarray(full / full[2, 2])

    def _laid(self, b_from_a: Matrix3x3) -> tuple[FloatImage, FloatImage]:
        """Texture a as b sees it, and a mask of where both are seen."""
        return _laid(self._a.image, self._a.mask, b_from_a, self._b.image.shape)

    def _peak(self, b_from_a: Matrix3x3) -> _Peak | None:
        """The best shift of one texture over the other, beside all others."""
        laid, mask = self._laid(b_from_a)
        pixels = float((mask * self._b.mask).sum())
        if pixels < LEAST_OVERLAP:
            return None
        laid = (laid - float((laid * mask).sum() / mask.sum())) * mask
        common = self._shifted_products(self._b.spectrum_of_mask, mask).clip(1)
        products = self._shifted_products(self._b.spectrum, laid) / common
        energy = float((laid * laid).sum() / mask.sum()) * self._b.energy
        correlations = products / math.sqrt(max(energy, 1e-12))
        scores = correlations * np.sqrt(common)
        comparable = common >= COMPARABLE * pixels
        rows, columns = np.ogrid[: scores.shape[0], : scores.shape[1]]
        near = comparable & (np.maximum(abs(rows - REACH), abs(columns - REACH)) <= DRAWN)
        best = np.unravel_index(np.where(near, scores, -np.inf).argmax(), scores.shape)
        shift = np.array([best[1] - REACH, best[0] - REACH], np.float64)
        apart = comparable & ((rows - best[0]) ** 2 + (columns - best[1]) ** 2 >= NEAR**2)
        if apart.sum() < NEAR**2:
            return None
        second = np.unravel_index(np.where(apart, correlations, -np.inf).argmax(), scores.shape)
        elsewhere = scores[apart]
        usual = float(np.median(elsewhere))
        together = max((1.4826 * float(np.median(np.abs(elsewhere - usual)))) ** 2, LEAST_TOGETHER)
        return _Peak(
            shift=shift,
            deviations=(float(scores[best]) - usual) / math.sqrt(together),
            correlation=self._correlation_at(laid, mask, shift),
            runner_up=self._correlation_at(laid, mask, np.array([second[1] - REACH, second[0] - REACH], np.float64)),
            pixels=float(common[best]),
            together=together,
        )

    def _correlation_at(self, laid: FloatImage, mask: FloatImage, shift: Vector2) -> float:
        """Of b with texture a laid on it (h, w) and shifted by whole pixels, by what both show there."""
        move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        moved, seen = (
            np.asarray(cv2.warpAffine(one, move, one.shape[::-1], flags=cv2.INTER_NEAREST), np.float32)
            for one in (laid, mask)
        )
        return _correlation(moved, self._b.image, seen * self._b.mask, least=1)[0]

    def _shifted_products(self, spectrum: FloatImage, laid: FloatImage) -> FloatImage:
        """Sum (2 REACH + 1, 2 REACH + 1) of b times a shifted by -REACH to REACH, of which the spectrum of b is known."""
        around = np.roll(_products(spectrum, laid, self._b.padded), (REACH, REACH), (0, 1))[
            : 2 * REACH + 1, : 2 * REACH + 1
        ]
        return np.asarray(around, np.float32)

    def _refined(self, b_from_a: Matrix3x3) -> Matrix3x3 | None:
        """The homography to which ECC converges from this one."""
        criteria = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ECC_STEPS, ECC_TOLERANCE
        try:
            start = np.linalg.inv(b_from_a)
            _, a_from_b = cv2.findTransformECC(
                self._b.image,
                self._a.image,
                (start / start[2, 2]).astype(np.float32),
                cv2.MOTION_HOMOGRAPHY,
                criteria,
                self._a.mask8,
                1,
            )  # fmt: skip
            refined = np.linalg.inv(a_from_b.astype(np.float64))
        except (cv2.error, np.linalg.LinAlgError):  # it says so where it does not converge
            return None
        return np.asarray(refined, np.float64) if np.isfinite(refined).all() else None


class _Side:
    """A frame's coarse texture, and what is made of it once."""

    def __init__(self, frame: Features) -> None:
        self._frame = frame
        self.known = frame.kept_texture is not None
        self.width, self.height = frame.width, frame.height

    @cached_property
    def image(self) -> FloatImage:
        fine = self._frame.texture
        assert fine is not None, "ask whether it is known"
        image = coarse(fine)
        return image - float((image * self.mask).sum() / max(float(self.mask.sum()), 1.0))

    @cached_property
    def details(self) -> FloatImage:
        """The texture without what is wider than `FINEST`."""
        fine = self._frame.texture
        assert fine is not None, "ask whether it is known"
        levels = fine.astype(np.float32)
        return np.asarray(levels - cv2.GaussianBlur(levels, (0, 0), FINEST), np.float32)

    @cached_property
    def shape(self) -> tuple[int, int]:
        """As of `coarse`."""
        assert self._frame.kept_texture is not None, "ask whether it is known"
        height, width = self._frame.kept_texture.shape
        return max(1, height // 2), max(1, width // 2)

    @cached_property
    def mask(self) -> FloatImage:
        """1 where it shows ground, 0 on its dead border, where it holds no picture, and under an overlay."""
        mask, (height, width) = np.ones(self.shape, np.float32), self.shape
        dead = self._frame.dead.scaled(width / self._frame.width)
        mask[: dead.top], mask[height - dead.bottom :] = 0, 0
        mask[:, : dead.left], mask[:, width - dead.right :] = 0, 0
        if self._frame.still is not None:
            mask[self._frame.still.pixels(height, width)] = 0
        if self._frame.area is not None:
            mask[~self._frame.area.pixels(height, width)] = 0
        return mask

    @cached_property
    def mask8(self) -> FloatImage:
        return (self.mask * 255).astype(np.uint8)

    @property
    def turned_round(self) -> Matrix3x3:
        """The picture turned by 180 degrees, (3x3)."""
        height, width = self.shape
        return np.array([[-1.0, 0, width - 1], [0, -1, height - 1], [0, 0, 1]])

    @cached_property
    def energy(self) -> float:
        return float((self.image * self.image * self.mask).sum() / max(float(self.mask.sum()), 1.0))

    @cached_property
    def full_from_coarse(self) -> Matrix3x3:
        return full_from_picture(self._frame.width, self._frame.height, self.shape)

    @cached_property
    def padded(self) -> tuple[int, int]:
        height, width = self.shape
        return cv2.getOptimalDFTSize(height + REACH), cv2.getOptimalDFTSize(width + REACH)

    @cached_property
    def spectrum(self) -> FloatImage:
        return _spectrum(self.image * self.mask, self.padded)

    @cached_property
    def spectrum_of_mask(self) -> FloatImage:
        return _spectrum(self.mask, self.padded)


def _laid(
    image: FloatImage, mask: FloatImage, target_from_image: Matrix3x3, shape: tuple[int, ...]
) -> tuple[FloatImage, FloatImage]:
    """An image, and where it has pixels, on a target of this shape (h, w)."""
    laid = cv2.warpPerspective(image, target_from_image, shape[::-1], flags=cv2.INTER_LINEAR)
    seen = cv2.warpPerspective(mask, target_from_image, shape[::-1], flags=cv2.INTER_LINEAR)
    return np.asarray(laid, np.float32), (seen > 0.99).astype(np.float32)


def _spectrum(image: FloatImage, padded: tuple[int, int]) -> FloatImage:
    room = np.zeros(padded, np.float32)
    room[: image.shape[0], : image.shape[1]] = image
    return np.asarray(cv2.dft(room), dtype=np.float32)


def _products(spectrum: FloatImage, laid: FloatImage, padded: tuple[int, int]) -> FloatImage:
    """Sums, of this size (h, w), of an image of this spectrum times another one that is shifted by all whole numbers of pixels;
    negative shifts come last."""
    found = cv2.mulSpectrums(spectrum, _spectrum(laid, padded), 0, conjB=True)
    found = cv2.dft(found, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT)
    return np.asarray(found, np.float32)


def _shifted(b_from_a: Matrix3x3, shift: Vector2) -> Matrix3x3:
    moved = np.eye(3)
    moved[:2, 2] = shift
    return np.asarray(moved @ b_from_a)


def _correlation(one: FloatImage, other: FloatImage, mask: FloatImage, least: int = LEAST_OVERLAP) -> tuple[float, int]:
    """Correlation of two images (h, w) where the mask is 1, and of how many pixels; 0 if they are too few."""
    pixels = float(mask.sum())
    if pixels < least:
        return 0.0, 0
    one, other = (image - float((image * mask).sum()) / pixels for image in (one, other))
    norm = math.sqrt(float((one * one * mask).sum()) * float((other * other * mask).sum()))
    return float((one * other * mask).sum()) / max(norm, 1e-12), int(pixels)


def _log_odds_of_peak(found: _Peak, together: float) -> float:
    """log10 of how much likelier the peak is the right shift than the best other one: by the difference of two correlations
    over independent pixels (Fisher's transformation), of which so many are one."""
    independent = max(found.pixels / together, 4.0)
    highest, second = (math.atanh(min(max(r, 0.0), 0.99)) for r in (found.correlation, found.runner_up))
    apart = (highest - second) / math.sqrt(2 / (independent - 3))
    return float(-log_ndtr(-apart) / math.log(10))

"""What choosing frames of a recorded video costs beside decoding it: `python -m tests.benchmarks.video [FILE]`.

Without a file, twenty seconds of 1080p over a made ground, a third of it hovering, are encoded first. Times are of computing,
of all threads.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import av
import cv2
import numpy as np

from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.video.extraction import ChosenPicture, extract
from gcs_mosaic.frames.video.film import Film
from tests.frames.video.films import GROUND, MOST_PIXELS, RATE, Image, write_film

SIZE, SECONDS, SPEED = (1920, 1080), 20, 240
X264 = {"preset": "veryfast", "crf": "20"}


def made(folder: Path) -> Path:
    """Flies on for two thirds, then hovers."""
    ground = cv2.resize(GROUND, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    ground = cv2.add(ground, np.random.default_rng(1).integers(0, 25, ground.shape, np.uint8))
    turn = 2 * SECONDS * RATE // 3

    def view(k: int) -> Image:
        left = min(k, turn) * SPEED // RATE
        return np.ascontiguousarray(ground[900 : 900 + SIZE[1], left : left + SIZE[0]])

    return write_film(folder / "FLIGHT.MP4", (view(k) for k in range(SECONDS * RATE)), options=X264)


def decoded(path: Path) -> tuple[int, float]:
    """Pictures, and the seconds that decoding alone takes, with the threads that reading it has."""
    start, film = time.process_time(), Film.open(path, MOST_PIXELS)
    assert isinstance(film, Film), film
    return sum(1 for _ in film.pictures()), time.process_time() - start


def main(words: list[str]) -> None:
    av.logging.set_level(None)
    with tempfile.TemporaryDirectory(prefix="gcs-mosaic-video-") as folder:
        path = Path(words[0]) if words else made(Path(folder))
        pictures, plain_s = decoded(path)
        start = time.process_time()
        chosen = [one for one in extract(path, StreamSettings(), MOST_PIXELS) if isinstance(one, ChosenPicture)]
        whole_s = time.process_time() - start
        print(
            f"{pictures} pictures, {len(chosen)} frames chosen; decoding {plain_s:.2f} s, with choosing {whole_s:.2f} s"
        )
        print(
            f"{whole_s / plain_s:.2f} times the cost of decoding, {pictures / whole_s:.0f} pictures a second of one core"
        )


if __name__ == "__main__":
    main(sys.argv[1:])

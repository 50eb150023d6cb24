"""What painting one frame costs, by stage, beside a plain cv2.warpPerspective of as many pixels.

    python -m tests.benchmarks.painting [FRAME.jpg]

Without a frame, one of 12 MP is made up. CPU time is what counts on a machine that does other things as well.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.blend_maps import LOOK_PIXELS
from gcs_mosaic.render.blend_modes import MODES
from gcs_mosaic.render.compositor import INTERPOLATIONS, CompositorSettings, TileCompositor
from gcs_mosaic.render.display import PLAIN
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.pixels import frame_picture, piece
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.tile_grid import TILE_SIZE
from gcs_mosaic.render.warp import shrunk
from gcs_mosaic.render.warp_grid import frame_lattice
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.store.tiles import TileWriter
from tests.tile_parts import own_level

Image = NDArray[np.uint8]
ROUNDS = 5


def main() -> None:
    image = made_up_frame() if len(sys.argv) < 2 else cv2.imread(sys.argv[1], cv2.IMREAD_COLOR)
    if image is None:
        sys.exit(f"{sys.argv[1]} is not an image that OpenCV reads")
    camera = Camera(image.shape[1], image.shape[0], 1.2, -0.01)
    for blend in MODES:
        print(f"\n{camera.width} x {camera.height}, {blend}")
        report(np.asarray(image, dtype=np.uint8), camera, 1.0, CompositorSettings(blend=blend))
    for interpolation in INTERPOLATIONS:
        for zoom, words in (
            (1.0, "painted pixel for pixel"),
            (1.65, "painted as fine as it gets, 2.7 times the pixels"),
        ):
            print(f"\n{camera.width} x {camera.height}, {interpolation}, {words}")
            report(np.asarray(image, dtype=np.uint8), camera, zoom, CompositorSettings(interpolation=interpolation))


def report(image: Image, camera: Camera, zoom: float, settings: CompositorSettings) -> None:
    """Print wall and CPU milliseconds (the best of a few rounds) and their ratio to the plain warp."""
    frames = [frame(i, camera, zoom) for i in range(ROUNDS + 1)]
    first = frame_warp(frames[0])
    assert first is not None
    tiles = list(first.lattice.tiles())
    look, flag = MODES[settings.blend].look or (lambda *_: None), INTERPOLATIONS[settings.interpolation]
    seen = frame_picture(image, frames[0], "none")
    with (
        TileCompositor(lambda _: image, settings) as canvas,
        tempfile.TemporaryDirectory() as out,
    ):
        changed = canvas.paint(image, frames[0])
        rest = iter(frames[1:])
        writer = TileWriter(Path(out))
        plain = best(lambda: plain_warp(image, len(tiles), flag))
        show("cv2.warpPerspective of as many pixels", plain, plain)
        show("lattice", best(lambda: frame_lattice(frames[0].pose, camera, frames[0].level)), plain)
        show("what the mode looks for", best(lambda: look(shrunk(image, LOOK_PIXELS), (PLAIN, NO_BORDER))), plain)
        show(
            f"warp of {len(tiles)} tiles",
            best(lambda: [piece(first, seen, tile, None, flag, "none") for tile in tiles]),
            plain,
        )
        show("whole frame onto others, with ancestors", best(lambda: canvas.paint(image, next(rest))), plain)
        show(
            f"encoding and writing {len(changed)} tiles", best(lambda: writer.write(changed, canvas.tile_later)), plain
        )
        writer.close()


def frame(order: int, camera: Camera, zoom: float) -> RenderItem:
    pose = Pose(300.0 * order, 90.0 * order, float(np.log(zoom)), 0.3 + 0.02 * order, 0.04, -0.03)
    gain = (1.04, 1.0, 0.97)
    return RenderItem(
        name=str(order), order=order, island=0, pose=pose, camera=camera, gain=gain, level=own_level(pose, camera)
    )


def plain_warp(image: Image, tiles: int, flag: int) -> None:
    """The whole frame resampled once, with a little perspective, to as many pixels."""
    stretch = (tiles * TILE_SIZE**2 / (image.shape[0] * image.shape[1])) ** 0.5
    size = round(image.shape[1] * stretch), round(image.shape[0] * stretch)
    frame_from_picture = np.array([[1 / stretch, 0, 0.3], [0, 1 / stretch, 0.4], [1e-6, 1e-6, 1]])
    cv2.warpPerspective(image, frame_from_picture, size, flags=flag | cv2.WARP_INVERSE_MAP)


def made_up_frame() -> Image:
    rough = np.random.default_rng(1).integers(0, 255, (3000, 4000, 3), dtype=np.uint8)
    return np.asarray(cv2.addWeighted(rough, 0.3, cv2.GaussianBlur(rough, (0, 0), 8), 3.0, -200), dtype=np.uint8)


def best(work: Callable[[], object]) -> tuple[float, float]:
    """Least wall and CPU milliseconds of a few rounds."""
    times = []
    for _ in range(ROUNDS):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - wall, time.process_time() - cpu))
    return min(w for w, _ in times) * 1e3, min(c for _, c in times) * 1e3


def show(what: str, spent: tuple[float, float], plain: tuple[float, float]) -> None:
    print(f"  {what:42} {spent[0]:6.0f} ms wall {spent[1]:6.0f} ms CPU   x {spent[1] / plain[1]:.2f}")


if __name__ == "__main__":
    main()

"""An RTSP server: raw pictures on standard input, H.264 or H.265 on rtsp://127.0.0.1:PORT/camera.

A separate program for a Python with GStreamer's bindings, started by `sitl.stream.camera`; imports nothing of the project.
Prints `serving PORT` once it serves, then the monotonic time of each picture; ends at end of input.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time
from typing import Any

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402

# One slice per picture: x264's sliced threads produce broken output from raw appsrc pictures.
ENCODERS = {
    "h264": "x264enc tune=zerolatency speed-preset=ultrafast threads=1 sliced-threads=false",
    "h265": "x265enc tune=zerolatency speed-preset=ultrafast",
}
PAYLOADERS = {"h264": "rtph264pay", "h265": "rtph265pay"}
BYTES = 3  # per pixel


def main() -> None:
    asked = arguments()
    Gst.init(None)
    sources: list[Any] = []
    server, loop = serving(asked, sources), GLib.MainLoop()
    if not server.attach(None):
        sys.exit(f"port {asked.port} is taken")
    print(f"serving {server.get_bound_port()}", flush=True)
    threading.Thread(target=feed, args=(asked.width * asked.height * BYTES, sources, loop), daemon=True).start()
    loop.run()


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", required=True)
    parser.add_argument("--width", type=int, required=True)
    parser.add_argument("--height", type=int, required=True)
    parser.add_argument("--rate", type=int, required=True, help="pictures a second")
    parser.add_argument("--codec", choices=sorted(ENCODERS), required=True)
    parser.add_argument("--key-every", type=int, required=True, help="pictures from one key frame to the next")
    parser.add_argument("--bitrate", type=int, required=True, help="kbit/s")
    parser.add_argument("--loss", type=float, required=True, help="share of packets that are lost")
    parser.add_argument("--user", default="", help="NAME:PASSWORD that is asked for")
    return parser.parse_args()


def serving(asked: argparse.Namespace, sources: list[Any]) -> Any:
    """The server; the appsrc element is put into `sources` whenever a client connects."""
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(pipeline(asked))
    factory.set_shared(True)
    factory.connect("media-configure", lambda _, media: sources.__setitem__(slice(None), [source_of(media)]))
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(asked.port)
    server.get_mount_points().add_factory("/camera", factory)
    if asked.user:
        protect(server, factory, *asked.user.split(":"))
    return server


def pipeline(asked: argparse.Namespace) -> str:
    shape = f"format=BGR,width={asked.width},height={asked.height},framerate={asked.rate}/1"
    encoder = f"{ENCODERS[asked.codec]} bitrate={asked.bitrate} key-int-max={asked.key_every}"
    payloader = f"{PAYLOADERS[asked.codec]} config-interval=-1 pt=96"
    last = f"{payloader} ! identity name=pay0 drop-probability={asked.loss}" if asked.loss else f"{payloader} name=pay0"
    return (
        f"( appsrc name=camera is-live=true do-timestamp=true format=time caps=video/x-raw,{shape} "
        f"! videoconvert ! video/x-raw,format=I420 ! {encoder} ! {last} )"
    )


def source_of(media: Any) -> Any:
    return media.get_element().get_by_name("camera")


def protect(server: Any, factory: Any, name: str, password: str) -> None:
    """Require a user name and password."""
    auth, token = GstRtspServer.RTSPAuth(), GstRtspServer.RTSPToken()
    token.set_string("media.factory.role", "viewer")
    auth.add_basic(GstRtspServer.RTSPAuth.make_basic(name, password), token)
    server.set_auth(auth)
    permissions = GstRtspServer.RTSPPermissions()
    for right in ("access", "construct"):
        permissions.add_permission_for_role("viewer", f"media.factory.{right}", True)
    factory.set_permissions(permissions)


def feed(size: int, sources: list[Any], loop: Any) -> None:
    """Push every picture from standard input, stamped and reported with its arrival time; without clients it is
    dropped."""
    while len(data := sys.stdin.buffer.read(size)) == size:
        print(time.monotonic(), flush=True)
        for source in list(sources):
            source.emit("push-buffer", Gst.Buffer.new_wrapped(data))
    loop.quit()


if __name__ == "__main__":
    main()

"""Times of a status as its readers take them: by the clock as it is set now, whatever it showed when they were noted."""

from __future__ import annotations

from dataclasses import replace

from gcs_mosaic.even_clock import as_set_now
from gcs_mosaic.messages import LinkReport, SourceReport
from gcs_mosaic.store.status import LastFrame, Status


def by_the_clock(status: Status) -> Status:
    """With the times of what was seen and heard, and since when something is so, as a reader reckons ages."""
    return replace(
        status,
        mavlink=tuple(map(_link, status.mavlink)),
        watch=_source(status.watch),
        last_frame=_last(status.last_frame),
        aircraft=tuple(
            replace(one, source=_source(one.source), last_frame=_last(one.last_frame)) for one in status.aircraft
        ),
        conditions=tuple(
            replace(one, since_utc=as_set_now(one.since_utc) or one.since_utc) for one in status.conditions
        ),
    )


def _link(link: LinkReport) -> LinkReport:
    aircraft = tuple(replace(one, last_heard_utc=as_set_now(one.last_heard_utc)) for one in link.aircraft)
    return replace(link, last_heard_utc=as_set_now(link.last_heard_utc), aircraft=aircraft)


def _source(source: SourceReport | None) -> SourceReport | None:
    if source is None:
        return None
    return replace(
        source,
        since_utc=as_set_now(source.since_utc),
        last_seen_utc=as_set_now(source.last_seen_utc),
        same_since_utc=as_set_now(source.same_since_utc),
    )


def _last(frame: LastFrame | None) -> LastFrame | None:
    return None if frame is None else replace(frame, utc=as_set_now(frame.utc) or frame.utc)

"""Epochs as texts, as datetimes, and with the digits of a file."""

from __future__ import annotations

import datetime
import re
from typing import Tuple

# A whole second, and the fraction beyond it in seconds: files have more digits than a datetime.
Epoch = Tuple[datetime.datetime, float]


def utc_text(when: datetime.datetime) -> str:
    """Returns an epoch as ISO 8601 in UTC. The datetime needs a time zone."""
    if when.tzinfo is None:
        raise ValueError(f"{when!r} has no time zone; write datetime(..., tzinfo=timezone.utc)")
    return when.astimezone(datetime.timezone.utc).replace(tzinfo=None).isoformat() + "Z"


def parse_epoch(text: str, where: str) -> Epoch:
    """Returns the epoch of an ISO 8601 text, by calendar date or day of the year. `where` begins an error's text."""
    found = re.fullmatch(r"(\d{4}-(?:\d\d-\d\d|\d{3}))[T ](\d\d:\d\d:\d\d)(\.\d*)?(?:Z|\+00:00)?", text.strip())
    try:
        if not found:
            raise ValueError
        date, time_of_day, fraction = found.groups()
        date_format = "%Y-%m-%d" if len(date) == len("2026-11-20") else "%Y-%j"
        second = datetime.datetime.strptime(f"{date}T{time_of_day}", date_format + "T%H:%M:%S")
    except ValueError:
        raise ValueError(f"{where}: {text!r} is no epoch like 2026-11-20T00:00:00.000") from None
    return second, 0.0 if fraction in (None, ".") else float(fraction)


def datetime_of(epoch: Epoch) -> datetime.datetime:
    """Returns an epoch in UTC, rounded to microseconds."""
    return epoch[0].replace(tzinfo=datetime.timezone.utc) + datetime.timedelta(seconds=epoch[1])


def seconds_since(origin: Epoch, epoch: Epoch) -> float:
    """Returns the seconds from `origin` to `epoch`, with all their digits."""
    return (epoch[0] - origin[0]).total_seconds() + (epoch[1] - origin[1])

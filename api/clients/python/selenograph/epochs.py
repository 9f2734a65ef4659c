"""Epochs as texts, as datetimes, and with the digits of a file."""

from __future__ import annotations

import datetime
import math
import re
from typing import Tuple, Union

# A whole second, and the fraction beyond it in seconds: files have more digits than a datetime.
Epoch = Tuple[datetime.datetime, float]

# Days on which TAI - UTC has become a second longer, from 11 s on 1973-01-01 (IERS, Bulletin C).
LEAP_DAYS = ("1974-01-01 1975-01-01 1976-01-01 1977-01-01 1978-01-01 1979-01-01 1980-01-01 1981-07-01 1982-07-01 "
             "1983-07-01 1985-07-01 1988-01-01 1990-01-01 1991-01-01 1992-07-01 1993-07-01 1994-07-01 1996-01-01 "
             "1997-07-01 1999-01-01 2006-01-01 2009-01-01 2012-07-01 2015-07-01 2017-01-01").split()
FIRST_EPOCH = "1973-01-01"
TAI_MINUS_UTC_S = 12  # at FIRST_EPOCH
TT_MINUS_TAI_S = 32.184
J2000 = datetime.datetime(2000, 1, 1, 12)


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


def et_of(when: Union[str, datetime.datetime]) -> float:
    """Returns SPICE's Ephemeris Time of a UTC epoch: seconds of TDB since J2000.0, as str2et."""
    second, fraction = parse_epoch(when if isinstance(when, str) else utc_text(when), "epoch")
    date = second.date().isoformat()
    if date < FIRST_EPOCH:
        raise ValueError(f"{when} is before {FIRST_EPOCH}")
    leap_s = TAI_MINUS_UTC_S + sum(day <= date for day in LEAP_DAYS)
    tt_s = (second - J2000).total_seconds() + fraction + leap_s + TT_MINUS_TAI_S
    # TDB - TT by the Earth's eccentric anomaly, with the constants of NAIF's leap seconds kernels: to 30 us.
    anomaly = 6.239996 + 1.99096871e-7 * tt_s
    return tt_s + 1.657e-3 * math.sin(anomaly + 1.671e-2 * math.sin(anomaly))


def datetime_of(epoch: Epoch) -> datetime.datetime:
    """Returns an epoch in UTC, rounded to microseconds."""
    return epoch[0].replace(tzinfo=datetime.timezone.utc) + datetime.timedelta(seconds=epoch[1])


def seconds_since(origin: Epoch, epoch: Epoch) -> float:
    """Returns the seconds from `origin` to `epoch`, with all their digits."""
    return (epoch[0] - origin[0]).total_seconds() + (epoch[1] - origin[1])

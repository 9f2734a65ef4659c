"""Writes SPICE kernels: DAF files by NAIF's "DAF Required Reading", with arrays of SPK and PCK types. Needs NumPy."""

import struct

import numpy as np
from numpy.polynomial import chebyshev

RECORD = 1024  # bytes
FTP_CHECK = b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP"


def write_daf(path, kind, segments, big_endian=False):
    """`segments`: (doubles of the summary, integers of the summary, array of numbers). kind: "SPK" or "PCK"."""
    order = ">" if big_endian else "<"
    integers = len(segments[0][1]) + 2
    first_word = 3 * RECORD // 8 + 1
    summaries, names, words = b"", b"", b""
    for i, (doubles, codes, numbers) in enumerate(segments):
        begin = first_word + len(words) // 8
        words += np.asarray(numbers, order + "f8").tobytes()
        end = first_word + len(words) // 8 - 1
        summary = struct.pack(f"{order}2d{integers}i", *doubles, *codes, begin, end)
        summaries += summary.ljust(-(-len(summary) // 8) * 8, b"\0")
        names += f"segment {i}".encode().ljust(-(-len(summary) // 8) * 8)
    head = struct.pack(f"{order}8sII60sIII8s", f"DAF/{kind}".encode().ljust(8), 2, integers, b"test".ljust(60), 2, 2,
                       first_word + len(words) // 8, b"BIG-IEEE" if big_endian else b"LTL-IEEE")
    head = head.ljust(699, b"\0") + FTP_CHECK
    control = struct.pack(f"{order}3d", 0, 0, len(segments))
    with open(path, "wb") as file:
        for record in (head, control + summaries, names):
            assert len(record) <= RECORD
            file.write(record.ljust(RECORD, b"\0"))
        file.write(words)
    return path


def chebyshev_numbers(function, begin_s, end_s, records, degree, with_rates=False):
    """The array of types 2 and 3: polynomials through the values of a function of time with three components."""
    length = (end_s - begin_s) / records
    numbers = []
    for i in range(records):
        middle = begin_s + (i + 0.5) * length
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        values = np.array([function(middle + 0.5 * length * x) for x in nodes])
        coefficients = chebyshev.chebfit(nodes, values, degree).T
        numbers += [middle, 0.5 * length, *coefficients.ravel()]
        if with_rates:
            rates = np.array([chebyshev.chebder(c) for c in coefficients]) * 2 / length
            numbers += [*np.pad(rates, ((0, 0), (0, 1))).ravel()]
    size = 2 + 3 * (degree + 1) * (2 if with_rates else 1)
    return numbers + [begin_s, length, size, records]


def spk_chebyshev(target, center, function, begin_s, end_s, records=4, degree=9, kind=2, frame=1):
    """A segment of type 2 or 3 of positions in km."""
    numbers = chebyshev_numbers(function, begin_s, end_s, records, degree, kind == 3)
    return (begin_s, end_s), (target, center, frame, kind), numbers


def spk_states(target, center, states, times_s, kind, degree, frame=1):
    """A segment of type 8, 9, 12 or 13. `degree`: of Lagrange's polynomials; of Hermite's the number of nodes less one."""
    if kind in (8, 12):
        after = [times_s[0], times_s[1] - times_s[0]]
    else:
        after = [*times_s, *times_s[99:-1:100]]
    return ((times_s[0], times_s[-1]), (target, center, frame, kind),
            [*np.ravel(states), *after, degree, len(times_s)])


def pck_moon(angles, begin_s, end_s, code=31008):
    """A segment of the Moon's orientation: a function of time that gives phi, delta, w in radians."""
    return (begin_s, end_s), (code, 1, 2), chebyshev_numbers(angles, begin_s, end_s, 4, 5)

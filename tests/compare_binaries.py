#!/usr/bin/env python3
"""Renders the same requests with two binaries and compares every byte of the answers.

    tests/compare_binaries.py BASE NEW [--requests N] [--only TEXT] [--list] [--folder DIR] [--any-version]

The requests (tests/comparison_requests.py) run over sample terrain that BASE writes. Each binary runs as one service with a cache folder of its
own. Arrays are compared by name, type, shape and bytes, JSON member by member. The text of a PNG, TIFF or EXR file is left out:
its metadata is that of the npz file. Other words in a text for readers (TEXTS) are listed and do not fail.

Exit status: 0 if nothing differs, 1 if something does (the request and the first pixel that differs are printed), 2 if it could not run.
"""

import argparse
import io
import json
import os
import re
import shutil
import struct
import sys
import tempfile
import zipfile
import zlib

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "service"))

import comparison_requests
import harness

# Texts for readers: they may be worded anew.
TEXTS = re.compile(r"/reflectance/normalisation|/solar_irradiance/(source|band)|/warnings/\d+|/title|/detail|/errors/\d+/detail")
# What follows from the version; left out with --any-version.
VERSIONS = {"/software/version", "/content_hash"}
# Headers that say something of the answer; the rest is about the connection or the time.
HEADERS = ("Content-Type", "ETag", "Vary", "Retry-After", "Selenograph-Product", "Selenograph-Shape", "Selenograph-Dtype")


class Differences(list):
    def __init__(self):
        self.words = []


def brief(value):
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 160 else text[:157] + "..."


def compare_json(base, new, differences, pointer=""):
    if isinstance(base, dict) and isinstance(new, dict):
        if list(base) != list(new):
            differences.append(f"{pointer or '/'}: members {list(base)} against {list(new)}")
        for name in base.keys() & new.keys():
            compare_json(base[name], new[name], differences, f"{pointer}/{name}")
    elif isinstance(base, list) and isinstance(new, list) and len(base) == len(new):
        for index, pair in enumerate(zip(base, new)):
            compare_json(*pair, differences, f"{pointer}/{index}")
    elif type(base) is not type(new) or base != new:
        text = TEXTS.fullmatch(pointer) and isinstance(base, str) and isinstance(new, str)
        (differences.words if text else differences).append(f"{pointer}: {brief(base)} against {brief(new)}")


def compare_arrays(name, base, new, differences):
    if base.dtype != new.dtype or base.shape != new.shape:
        differences.append(f"{name}: {base.dtype} {base.shape} against {new.dtype} {new.shape}")
        return
    if base.tobytes() == new.tobytes():
        return
    as_bytes = [np.ascontiguousarray(a).view(np.uint8).reshape(*a.shape, a.dtype.itemsize) for a in (base, new)]
    differ = (as_bytes[0] != as_bytes[1]).any(axis=-1)
    first = tuple(int(i) for i in np.argwhere(differ)[0])
    pixels = differ.any(axis=-1) if differ.ndim == 3 else differ
    differences.append(f"{name}: {int(pixels.sum())} of {pixels.size} pixels differ, the first at row, column "
                       f"{first}: {base[first]!r} against {new[first]!r}")


def compare_npz(base, new, differences):
    archives = [zipfile.ZipFile(io.BytesIO(body)) for body in (base, new)]
    names = [archive.namelist() for archive in archives]
    if names[0] != names[1]:
        differences.append(f"arrays {names[0]} against {names[1]}")
    for name in names[0]:
        if name not in names[1]:
            continue
        contents = [archive.read(name) for archive in archives]
        if name == "meta.json":
            compare_json(*map(json.loads, contents), differences)
        else:
            compare_arrays(name.removesuffix(".npy"), *(np.load(io.BytesIO(c)) for c in contents), differences)


def png_without_text(body):
    """Header and pixels; what else a PNG file holds is text."""
    at, kept, pixels = 8, [], b""
    while at < len(body):
        length, kind = struct.unpack_from(">I4s", body, at)
        data = body[at + 8:at + 8 + length]
        if kind == b"IDAT":
            pixels += data
        elif kind not in (b"tEXt", b"iTXt", b"zTXt"):
            kept.append((kind, data))
        at += 12 + length
    return kept, zlib.decompress(pixels)


def tiff_without_text(body):
    """Tags but texts and places in the file, and the strips or tiles as they are."""
    sizes = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 9: 4, 10: 8, 11: 4, 12: 8, 16: 8}
    order = "<" if body[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", body, 4)
    (count,) = struct.unpack_from(order + "H", body, at)
    tags = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, number = struct.unpack_from(order + "HHI", body, entry)
        size = sizes[kind] * number
        start = entry + 8 if size <= 4 else struct.unpack_from(order + "I", body, entry + 8)[0]
        tags[tag] = (kind, body[start:start + size])

    def numbers(tag):
        kind, data = tags[tag]
        return struct.unpack(order + str(len(data) // sizes[kind]) + {3: "H", 4: "I"}[kind], data)

    offsets, lengths = (273, 279) if 273 in tags else (324, 325)
    pieces = [body[o:o + n] for o, n in zip(numbers(offsets), numbers(lengths))]
    return {tag: value for tag, value in tags.items() if value[0] != 2 and tag not in (273, 324)}, pieces


def exr_without_text(body):
    """Attributes but strings, and the pixels behind the table of their places."""
    at, kept, lines = 8, [], 0
    while body[at]:
        name, kind = body[at:].split(b"\0", 2)[:2]
        at += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<I", body, at)
        data = body[at + 4:at + 4 + size]
        at += 4 + size
        if kind != b"string":
            kept.append((name, kind, data))
    (first,) = struct.unpack_from("<Q", body, at + 1)
    return kept, body[first:]


WITHOUT_TEXT = {"image/png": png_without_text, "image/tiff": tiff_without_text, "image/x-exr": exr_without_text}


def compare(base, new, any_version):
    """What differs between two answers (status, headers, body)."""
    differences = Differences()
    if base[0] != new[0]:
        differences.append(f"status {base[0]} against {new[0]}: {new[2][:300]!r}")
        return differences
    for name in HEADERS:
        if base[1][name] != new[1][name] and not (any_version and name == "ETag"):
            differences.append(f"{name}: {base[1][name]} against {new[1][name]}")
    kind = base[1]["Content-Type"]
    if kind == "application/x-npz":
        compare_npz(base[2], new[2], differences)
    elif kind in ("application/json", "application/problem+json"):
        compare_json(json.loads(base[2]), json.loads(new[2]), differences)
    elif base[2] != new[2]:
        if kind not in WITHOUT_TEXT:
            at = next((i for i, pair in enumerate(zip(base[2], new[2])) if pair[0] != pair[1]), "the end")
            differences.append(f"{len(base[2])} bytes against {len(new[2])}, the first that differs at {at}")
        elif WITHOUT_TEXT[kind](base[2]) != WITHOUT_TEXT[kind](new[2]):
            differences.append("pixels or attributes of the file")
        else:
            differences.words.append("texts in the file")
    if any_version:
        differences[:] = [d for d in differences if d.split(":")[0] not in VERSIONS]
    return differences


def what(answer):
    status, headers, body = answer
    if headers["Content-Type"] != "application/x-npz":
        return f"status {status}, {len(body)} bytes"
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        return f"{len(body)} bytes, {json.loads(archive.read('meta.json'))['hit_fraction']:.0%} of the pixels hit"


def run(options):
    services = []
    for name, binary in (("base", options.base), ("new", options.new)):
        cache = harness.path("cache-" + name)
        if name == "new":
            shutil.rmtree(cache, ignore_errors=True)
        services.append(harness.Service("--assets-dir", harness.path("assets"), cache=cache, binary=binary))
    requests = comparison_requests.all_requests(services[0], options.requests)
    if options.only:
        requests = [r for r in requests if options.only in r.name]
    failed, worded = [], {}
    for request in requests:
        if options.list:
            print(request.name)
            continue
        answers = [request.ask(service) for service in services]
        differences = compare(*answers, options.any_version)
        for words in differences.words:
            worded.setdefault(words, request.name)
        if request.status and answers[0][0] != request.status:
            differences.append(f"status {answers[0][0]} of BASE, not {request.status}: {answers[0][2][:300]!r}")
        print(f"{request.name}: {'DIFFERS' if differences else 'same'}, {what(answers[0])}", flush=True)
        for difference in differences[:8]:
            print("   ", difference)
        if differences:
            failed.append(request.name)
    for service in services:
        service.stop()
    for words, name in worded.items():
        print(f"worded differently, first in {name}: {words}")
    if not options.list:
        print(f"{len(requests) - len(failed)} of {len(requests)} answers are the same", *(["; not", ", ".join(failed)] if failed else []))
    return 1 if failed else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", metavar="BASE", type=os.path.abspath)
    parser.add_argument("new", metavar="NEW", type=os.path.abspath)
    parser.add_argument("--requests", type=int, default=0, metavar="N", help="N of them; more than there are: random ones follow")
    parser.add_argument("--only", metavar="TEXT", help="requests with TEXT in their name")
    parser.add_argument("--list", action="store_true", help="print the requests' names")
    parser.add_argument("--folder", metavar="DIR", help="keep terrain and BASE's cache there for the next run")
    parser.add_argument("--any-version", action="store_true", help="leave out version, content hash and ETag")
    options = parser.parse_args()
    folder = os.path.abspath(options.folder) if options.folder else tempfile.mkdtemp(prefix="selenograph-compare-")
    harness.use(folder)
    try:
        comparison_requests.write_files(options.base)
        return run(options)
    finally:
        harness.stop_all()
        if not options.folder:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (OSError, RuntimeError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)

"""The command line: render, watch, manifest and coco."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple

import numpy as np

from .answers import Answer, Frame
from .calls import warnings_of
from .camera import Camera
from .client import Client
from .coco import write_coco
from .errors import Refused
from .frame_order import answers_in_order
from .kernels import Kernels
from .moon import lat_lon_of
from .sun import Sun
from .trajectory import NEED_SUN, Trajectory

MEDIA_TYPES = {".npz": "application/x-npz", ".npy": "application/x-npy", ".png": "image/png", ".tif": "image/tiff",
               ".tiff": "image/tiff", ".exr": "image/x-exr"}
DEFAULT_URL = "http://127.0.0.1:8080"
MIN_SHOWN_MS = 0.1  # stages below this time are not printed


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Runs the program with these arguments (default: those of the process) and returns its exit status."""
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except BrokenPipeError:
        # The reader of standard output has left. This is an OSError, too, and must be caught before those.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (Refused, OSError, ValueError) as error:
        print(f"selenograph: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python3 -m selenograph",
                                     description="Ask a selenograph service for frames.")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--url", default=os.environ.get("SELENOGRAPH_URL", DEFAULT_URL),
                        help="address of the service (default: SELENOGRAPH_URL, else %(default)s)")
    common.add_argument("--token", default=os.environ.get("SELENOGRAPH_TOKEN"),
                        help="bearer token (default: SELENOGRAPH_TOKEN)")
    common.add_argument("--timeout-s", type=float, default=60.0, help="time limit of a frame (default: %(default)s)")
    commands = parser.add_subparsers(required=True, metavar="command")
    _add_render(commands, common)
    _add_watch(commands, common)
    _add_manifest(commands)
    _add_coco(commands)
    return parser


def _add_render(commands: Any, common: argparse.ArgumentParser) -> None:
    render = commands.add_parser("render", parents=[common], help="Render one request to a file")
    render.add_argument("request", help="JSON file as for POST /v1/frames; -: standard input")
    render.add_argument("output", help="frame to write: " + " ".join(MEDIA_TYPES))
    render.set_defaults(run=_render)


def _add_watch(commands: Any, common: argparse.ArgumentParser) -> None:
    watch = commands.add_parser("watch", parents=[common], help="Render a frame for each pose of a trajectory")
    _add_trajectory(watch)
    watch.add_argument("--out", required=True, metavar="DIR", help="folder for the frames, 00000.npz and so on")
    watch.add_argument("--format", default="npz", choices=[suffix[1:] for suffix in MEDIA_TYPES],
                       help="format of the files (default: %(default)s)")
    watch.add_argument("--in-flight", type=int, default=2, help="number of requests in flight (default: %(default)s)")
    watch.add_argument("--ahead", type=int, default=4, help="poses sent in advance (default: %(default)s)")
    watch.set_defaults(run=_watch)


def _add_manifest(commands: Any) -> None:
    manifest = commands.add_parser("manifest", help="Write a trajectory as a manifest for `selenograph batch`")
    _add_trajectory(manifest)
    manifest.add_argument("-o", "--output", default="-", help="JSON Lines file to write (default: standard output)")
    manifest.set_defaults(run=_manifest, format="npz")


def _add_coco(commands: Any) -> None:
    coco = commands.add_parser("coco", help="Write the labels of a campaign's frames as a COCO document")
    coco.add_argument("folder", metavar="DIR", help="folder of `selenograph batch`: NAME.npz, or in tars")
    coco.add_argument("-o", "--output", required=True, metavar="FILE", help="JSON file to write")
    coco.add_argument("--manifest", metavar="FILE", help="the campaign's manifest: an image's id is its line number "
                      "there (default: images are counted)")
    coco.set_defaults(run=_coco)


def _add_trajectory(parser: argparse.ArgumentParser) -> None:
    """Adds the options of a trajectory and of the request that its frames have in common."""
    parser.add_argument("trajectory", help=".csv (Trajectory.from_csv lists its columns), a CCSDS OEM as text (KVN), or "
                       "a SPICE SPK, .bsp")
    parser.add_argument("--kernel", action="append", default=[], metavar="FILE", help="another SPICE kernel, for an SPK "
                       "or an OEM in ICRF: a planetary ephemeris, a binary PCK of the Moon's orientation; repeatable")
    parser.add_argument("--spacecraft", type=int, metavar="CODE", help="NAIF's code of the spacecraft in an SPK")
    parser.add_argument("--start", metavar="UTC", help="first epoch of an SPK's poses, with --stop and --step-s")
    parser.add_argument("--stop", metavar="UTC", help="last epoch")
    parser.add_argument("--aem", help="CCSDS AEM as text: the attitudes of an OEM's or an SPK's positions")
    parser.add_argument("--up-azimuth-deg", type=float, default=0.0,
                       help="azimuth that is up in the image, without AEM: the camera looks at nadir "
                       "(default: 0)")
    parser.add_argument("--request", help="JSON file with what all frames have in common; its pose is not used "
                       "(default: a camera of 512 x 512 pixels and 50 degrees, the Sun of the epoch)")
    parser.add_argument("--step-s", type=float, help="time between frames (default: the trajectory's own times)")


def _render(options: argparse.Namespace) -> None:
    media_type = _media_type(options.output)
    with Client(options.url, options.token, options.timeout_s) as client:
        answer = client.encoded(_read_request(options.request), media_type)
    _write(options.output, answer)
    print(f"{options.output}: {len(answer.content)} bytes; ms: {_stages(answer.timing)}", flush=True)
    _print_warnings(options.output, answer)


def _watch(options: argparse.Namespace) -> None:
    trajectory, times = _read_times(options)
    requests = trajectory.requests(_common_request(options, trajectory), times)
    os.makedirs(options.out, exist_ok=True)
    media_type = MEDIA_TYPES["." + options.format]
    with Client(options.url, options.token, options.timeout_s) as client:
        answers = answers_in_order(requests, options.in_flight, options.ahead,
                                   lambda request: client.encoded(request, media_type))
        for i, (time_s, answer) in enumerate(zip(times, answers)):
            path = os.path.join(options.out, f"{i:05d}.{options.format}")
            _write(path, answer)
            print(f"{path}  t = {time_s:.3f} s  ms: {_stages(answer.timing)}", flush=True)
            _print_warnings(path, answer)


def _manifest(options: argparse.Namespace) -> None:
    trajectory, times = _read_times(options)
    lines = "".join(json.dumps(request) + "\n"
                    for request in trajectory.requests(_common_request(options, trajectory), times))
    if options.output == "-":
        sys.stdout.write(lines)
        sys.stdout.flush()
        return
    with open(options.output, "w", encoding="utf-8") as file:
        file.write(lines)


def _coco(options: argparse.Namespace) -> None:
    tally = write_coco(options.folder, options.output, options.manifest)
    print(f"{options.output}: {tally.annotations} annotations of {tally.images} frames", flush=True)
    if tally.left_out:
        print(f"{tally.left_out} frames are left out: their requests have no \"labels\": true, or several cameras"
              + (", or they are not in the manifest" if options.manifest else ""), flush=True)


def _read_times(options: argparse.Namespace) -> Tuple[Trajectory, np.ndarray]:
    """Returns the trajectory and the times of its frames."""
    trajectory = _read_trajectory(options)
    return trajectory, trajectory.times_s if options.step_s is None else _steps(trajectory.times_s, options.step_s)


def _read_trajectory(options: argparse.Namespace) -> Trajectory:
    if options.trajectory.lower().endswith(".csv"):
        return Trajectory.from_csv(options.trajectory)
    azimuth_deg = None if options.aem else options.up_azimuth_deg
    if options.trajectory.lower().endswith(".bsp"):
        if None in (options.spacecraft, options.start, options.stop, options.step_s):
            raise ValueError("an SPK needs --spacecraft, --start, --stop and --step-s")
        kernels = Kernels(options.trajectory, *options.kernel)
        return Trajectory.from_spk(kernels, options.spacecraft, start=options.start, stop=options.stop,
                                   step_s=options.step_s, aem=options.aem, up_azimuth_deg=azimuth_deg)
    trajectory = Trajectory.from_ccsds(options.trajectory, options.aem, up_azimuth_deg=azimuth_deg)
    return trajectory.in_moon_frame(Kernels(*options.kernel)) if options.kernel else trajectory


def _common_request(options: argparse.Namespace, trajectory: Trajectory) -> Dict[str, Any]:
    """Returns the members that all frames have in common."""
    request = _read_request(options.request) if options.request else {
        "camera": Camera.pinhole(width=512, height=512, fov_deg=50),
        "products": ["image"] if options.format == "png" else ["radiance"]}
    request.pop("pose", None)
    needs_sun = set(request.get("products", ["radiance"])) & NEED_SUN
    if needs_sun and "sun" not in request and trajectory.start is None:
        lat_deg, lon_deg = lat_lon_of(trajectory.position_m(float(trajectory.times_s[0])))
        request["sun"] = Sun.local(lat_deg=lat_deg, lon_deg=lon_deg, azimuth_deg=90, elevation_deg=30)
        print("no Sun is given, by a request's \"sun\" or by epochs (column utc): it stands in the east, 30 degrees "
              "high, at the first pose", file=sys.stderr)
    return request


def _steps(times_s: np.ndarray, step_s: float) -> np.ndarray:
    """Returns times in steps, from the first time to the last."""
    if not 0 < step_s < math.inf:
        raise ValueError(f"--step-s is {step_s:g}; seconds above 0 are needed")
    first = float(times_s[0])
    last = float(times_s[-1])
    # Round generously: 0.3 / 0.1 is an ulp below 3, and 3 * 0.1 an ulp above 0.3; seconds since an epoch have fewer
    # digits yet.
    count = math.floor((last - first) / step_s + 1e-4) + 1
    return np.minimum(first + step_s * np.arange(count), last)


def _media_type(path: str) -> str:
    suffix = os.path.splitext(path)[1].lower()
    if suffix not in MEDIA_TYPES:
        raise ValueError(f"{path}: the suffix says the format; there are {' '.join(MEDIA_TYPES)}")
    return MEDIA_TYPES[suffix]


def _read_request(path: str) -> Dict[str, Any]:
    # Duplicate standard input, so that closing the file leaves it open.
    with (open(path, encoding="utf-8") if path != "-" else os.fdopen(os.dup(0), encoding="utf-8")) as file:
        try:
            request = json.load(file)
        except ValueError as error:
            raise ValueError(f"{path}: no JSON: {error}") from None
    if not isinstance(request, dict):
        raise ValueError(f"{path}: a JSON object is needed")
    return request


def _write(path: str, answer: Answer) -> None:
    """Writes the whole file, or nothing."""
    if answer.media_type == MEDIA_TYPES[".npz"]:
        # Read the frame: an answer that a proxy has cut off raises ConnectionError here.
        Frame(answer)
    partial_path = f"{path}.{os.getpid()}.part"
    try:
        with open(partial_path, "wb") as file:
            file.write(answer.content)
        os.replace(partial_path, path)
    except BaseException:
        if os.path.exists(partial_path):
            os.unlink(partial_path)
        raise


def _stages(timing: Mapping[str, float]) -> str:
    return ", ".join(f"{stage} {ms:.1f}" for stage, ms in timing.items() if ms >= MIN_SHOWN_MS) or "nothing above 0.1"


def _print_warnings(path: str, answer: Answer) -> None:
    """Prints the service's warnings of a frame."""
    texts = warnings_of(answer.headers)
    missing = answer.headers.get("Selenograph-Missing-Fraction")
    if missing:
        texts.append(f"{100 * float(missing):.3g} % of the pixels look at the Moon where there is no data")
    for text in texts:
        print(f"{path}: warning: {text}", file=sys.stderr)

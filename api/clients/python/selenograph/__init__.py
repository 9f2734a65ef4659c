"""Client of selenograph, the service that renders camera frames of the Moon.

    import selenograph
    from selenograph import Camera, Client, Pose, Sun

    with Client("http://127.0.0.1:8080") as moon:
        frame = moon.frame({
            "camera": Camera.pinhole(width=1024, height=1024, fov_deg=50),
            "pose": Pose.nadir(lat_deg=-6.5, lon_deg=40.0, height_m=30000),
            "sun": Sun.local(lat_deg=-6.5, lon_deg=40.0, azimuth_deg=90, elevation_deg=15),
            "products": ["radiance", "range"],
        })
    print(frame["radiance"].max(), frame.meta["lod_error_px"], frame.timing["visibility"])

A request is the JSON of POST /v1/frames as a dict; `Camera`, `Pose` and `Sun` are dicts that make its parts. Units and
frames: metres, degrees, MOON_ME, camera axes as in OpenCV (+x right, +y down, +z boresight). Pixel (0, 0) is the centre
of the top-left pixel. conventions.md in api/clients has a drawing.

This folder is the whole client: it can be copied beside a script. It needs Python 3.9 and NumPy. As a program:

    python3 -m selenograph render request.json frame.npz
    python3 -m selenograph watch trajectory.csv --out frames
    python3 -m selenograph manifest trajectory.csv -o trajectory.jsonl
    python3 -m selenograph coco frames -o coco.json
"""

from .answers import Answer, Frame, Scan
from .async_client import AsyncClient
from .camera import Camera
from .client import Client
from .coco import coco_of, write_coco
from .errors import FrameWarning, Refused
from .kernels import Kernels
from .link import Arrival, Link
from .pose import Pose
from .sun import Sun
from .trajectory import Trajectory
from .version import __version__  # noqa: F401
from .view_sampling import random_views

# Export these names, too, without making them part of `from selenograph import *`.
from .calls import POINTS_AT_ONCE, ROWS_AT_ONCE  # noqa: F401
from .ccsds import FRAMES  # noqa: F401
from .client import REASONS  # noqa: F401
from .command_line import DEFAULT_URL, MEDIA_TYPES, main  # noqa: F401
from .frame_order import MAX_AHEAD as MOST_AHEAD  # noqa: F401
from .moon import INERTIAL, MOON_RADIUS_M  # noqa: F401
from .region import REGION_DEG  # noqa: F401
from .request_types import Request  # noqa: F401
from .rotations import DIRECTIONS, Vector  # noqa: F401
from .trajectory import NEED_SUN  # noqa: F401

__all__ = ["Answer", "Arrival", "AsyncClient", "Camera", "Client", "Frame", "FrameWarning", "Kernels", "Link", "Pose",
           "Refused", "Scan", "Sun", "Trajectory", "coco_of", "random_views", "write_coco"]

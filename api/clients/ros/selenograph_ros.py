"""From a camera's pose to the members of Image and CameraInfo, for selenograph_ros2_node.py.

Needs the package selenograph (../python) and NumPy, and nothing of ROS.
"""

import datetime
import json

import numpy as np
import selenograph

ENCODINGS = {"uint8": "mono8", "uint16": "mono16", "float32": "32FC", "float64": "64FC"}


def pose_of(message):
    """A request's "pose" of a geometry_msgs/Pose, whose orientation turns the child's vectors into the parent's."""
    p, q = message.position, message.orientation
    return selenograph.Pose.from_quaternion([q.x, q.y, q.z, q.w], order="xyzw", direction="moon_from_camera",
                                            position_m=[p.x, p.y, p.z])


def request_of(message, seconds, nanoseconds, request):
    """The request for a PoseStamped of a time stamp; of the Sun at that time where the request has none."""
    full = {**request, "pose": pose_of(message.pose)}
    if "sun" not in full:
        start = datetime.datetime(1970, 1, 1) + datetime.timedelta(seconds=seconds)
        full["sun"] = {"utc": start.strftime("%Y-%m-%dT%H:%M:%S") + ".%09dZ" % nanoseconds}
    return full


def image_members(array):
    """A product as the members of a sensor_msgs/Image but its header; "data" are bytes."""
    channels = array.shape[2] if array.ndim == 3 else 1
    encoding = ENCODINGS[array.dtype.name]
    return {"height": array.shape[0], "width": array.shape[1],
            "encoding": encoding if encoding.startswith("mono") else encoding + str(channels),
            "is_bigendian": 0, "step": array.shape[1] * channels * array.itemsize,
            "data": np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()}


def members_without_message(camera):
    """Members of a camera that no distortion model of a CameraInfo has."""
    lens = camera.get("distortion") or {}
    terms = [f"distortion.{name}" for name in ("s1", "s2", "s3", "s4", "tau_x_deg", "tau_y_deg") if lens.get(name)]
    return ["cahvor"] * ("cahvor" in camera) + terms


def camera_info_members(camera):
    """The resolved camera of a frame's metadata as the members of a sensor_msgs/CameraInfo but its header, by the names
    of ROS 2."""
    lens = camera.get("distortion") or {}
    fisheye = camera["model"] == "fisheye"
    unfit = members_without_message(camera)
    if unfit:
        raise ValueError(f"CameraInfo has no model for the camera's {unfit[0]}")
    rational = lens.get("model") == "opencv"
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")[:8 if rational else 5]
    fx, fy, cx, cy = (float(camera[name]) for name in ("fx", "fy", "cx", "cy"))
    return {"height": camera["height"], "width": camera["width"],
            "distortion_model": "equidistant" if fisheye else "rational_polynomial" if rational else "plumb_bob",
            "d": [float(lens.get(name, 0.0)) for name in names],
            "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]}


def unfit_member(request):
    """What makes arrays that Image doesn't have, or that CameraInfo isn't of; None without."""
    truth = request.get("truth") or {}
    camera = request.get("camera") or {}
    wrong = {**{f"camera.{name}": True for name in members_without_message(camera)},
             "cameras": "cameras" in request, "truth.region": "region" in truth,
             "truth.every_px": truth.get("every_px", 1) != 1,
             "truth.distance_type": truth.get("distance_type") == "float16"}
    return next((name for name, is_wrong in wrong.items() if is_wrong), None)


class Renderer:
    """Frames for a node. parameter(name, default) gives a parameter of it; one without a default has to be set.
    error(text) logs."""

    def __init__(self, parameter, error):
        self.error = error
        path = parameter("request")
        with open(path, encoding="utf-8") as file:
            self.request = json.load(file)
        unfit = unfit_member(self.request)
        if unfit:
            raise ValueError(f"{path}: an Image and its CameraInfo are the whole view of one camera; leave out {unfit}")
        self.request.pop("pose", None)
        self.product = parameter("product", "image")
        self.request["products"] = [self.product]
        if self.product in ("depth", "range"):  # 32FC1, as a depth image by REP 118
            self.request["truth"] = {"distance_type": "float32", **(self.request.get("truth") or {})}
        self.moon_frame = parameter("moon_frame", "moon_me")
        self.camera_frame = parameter("camera_frame", "camera_optical")
        self.queue_size = parameter("queue_size", 10)
        self.client = selenograph.Client(parameter("url"), parameter("token", "") or None, parameter("timeout_s", 10.0))

    def members(self, message, seconds, nanoseconds):
        """(Image's, CameraInfo's) members for a PoseStamped of a time stamp; None, and an error, where there is no
        frame."""
        if message.header.frame_id != self.moon_frame:
            self.error(f"pose in frame {message.header.frame_id!r}, not {self.moon_frame!r}")
            return None
        try:
            frame = self.client.frame(request_of(message, seconds, nanoseconds, self.request))
            return image_members(frame[self.product]), camera_info_members(frame.meta["request"]["camera"])
        except (selenograph.Refused, OSError, ValueError, LookupError) as error:
            self.error(f"no image of the pose at {seconds}.{nanoseconds:09d}: {error}")
            return None

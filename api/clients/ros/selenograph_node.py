#!/usr/bin/env python3
"""ROS 1 node: a camera whose images selenograph renders.

    rosrun ... selenograph_node.py _url:=http://127.0.0.1:8080 _request:=/path/request.json pose:=/truth/camera_pose

Subscribes `pose` (geometry_msgs/PoseStamped): where the camera is in MOON_ME, in metres from the Moon's centre, and the
orientation of its optical frame (+x right, +y down, +z boresight) there. header.frame_id must be ~moon_frame. For each
pose it publishes `image_raw` (sensor_msgs/Image) and `camera_info` (sensor_msgs/CameraInfo) with the pose's time stamp
and the frame ~camera_frame. A pose that the service refuses is logged as an error, with the members at fault, and has
no image.

Parameters: ~url; ~token (""); ~timeout_s (10); ~request, a file with a frame's request as JSON, of which the pose is
left out (a Sun must be there, or the time stamps must be UTC: without "sun" it stands where it does at the stamp);
~product ("image": mono8 or mono16; or any other, e.g. "radiance" and "range": 32FC1, 64FC1); ~moon_frame ("moon_me");
~camera_frame ("camera_optical"); ~queue_size (10): poses that wait while a frame is rendered, then the oldest is lost.

Needs python3-rospy, python3-sensor-msgs, python3-geometry-msgs (Debian 12) and selenograph.py (../python) in
PYTHONPATH. Run in Debian 12's ROS by ../tests/clients_test.py; not run in ROS Noetic or with roslaunch.
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


def request_of(message, request):
    """The request for a PoseStamped; of the Sun at its time stamp where the request has none."""
    full = {**request, "pose": pose_of(message.pose)}
    if "sun" not in full:
        start = datetime.datetime(1970, 1, 1) + datetime.timedelta(seconds=message.header.stamp.secs)
        full["sun"] = {"utc": start.strftime("%Y-%m-%dT%H:%M:%S") + ".%09dZ" % message.header.stamp.nsecs}
    return full


def fill_image(message, array):
    """A product into a sensor_msgs/Image."""
    channels = array.shape[2] if array.ndim == 3 else 1
    encoding = ENCODINGS[array.dtype.name]
    message.height, message.width = array.shape[:2]
    message.encoding = encoding if encoding.startswith("mono") else encoding + str(channels)
    message.is_bigendian = 0
    message.step = array.shape[1] * channels * array.itemsize
    message.data = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes()


def fill_camera_info(message, camera):
    """The resolved camera of a frame's metadata into a sensor_msgs/CameraInfo."""
    lens = camera.get("distortion") or {}
    fisheye = camera["model"] == "fisheye"
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    fx, fy, cx, cy = (camera[name] for name in ("fx", "fy", "cx", "cy"))
    message.height, message.width = camera["height"], camera["width"]
    message.distortion_model = "equidistant" if fisheye else "plumb_bob"
    message.D = [lens.get(name, 0.0) for name in names]
    message.K = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    message.R = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    message.P = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]


class Node:
    def __init__(self, rospy, messages):
        self.rospy, self.messages = rospy, messages
        with open(rospy.get_param("~request"), encoding="utf-8") as file:
            self.request = json.load(file)
        self.request.pop("pose", None)
        self.product = rospy.get_param("~product", "image")
        self.request["products"] = [self.product]
        self.moon_frame = rospy.get_param("~moon_frame", "moon_me")
        self.camera_frame = rospy.get_param("~camera_frame", "camera_optical")
        self.client = selenograph.Client(rospy.get_param("~url"), rospy.get_param("~token", "") or None,
                                         rospy.get_param("~timeout_s", 10.0))
        queue_size = rospy.get_param("~queue_size", 10)
        self.images = rospy.Publisher("image_raw", messages.Image, queue_size=queue_size)
        self.infos = rospy.Publisher("camera_info", messages.CameraInfo, queue_size=queue_size)
        rospy.Subscriber("pose", messages.PoseStamped, self.render, queue_size=queue_size, tcp_nodelay=True)

    def render(self, message):
        if message.header.frame_id != self.moon_frame:
            self.rospy.logerr("pose in frame %r, not %r", message.header.frame_id, self.moon_frame)
            return
        try:
            frame = self.client.frame(request_of(message, self.request))
        except (selenograph.Refused, OSError, ValueError) as error:
            self.rospy.logerr("no image of the pose at %s: %s", message.header.stamp, error)
            return
        image, info = self.messages.Image(), self.messages.CameraInfo()
        fill_image(image, frame[self.product])
        fill_camera_info(info, frame.meta["request"]["camera"])
        for answer in (image, info):
            answer.header.stamp, answer.header.frame_id = message.header.stamp, self.camera_frame
        self.infos.publish(info)
        self.images.publish(image)


def main():
    import types

    import geometry_msgs.msg
    import rospy
    import sensor_msgs.msg

    rospy.init_node("selenograph")
    Node(rospy, types.SimpleNamespace(Image=sensor_msgs.msg.Image, CameraInfo=sensor_msgs.msg.CameraInfo,
                                      PoseStamped=geometry_msgs.msg.PoseStamped))
    rospy.spin()


if __name__ == "__main__":
    main()

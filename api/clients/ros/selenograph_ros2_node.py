#!/usr/bin/env python3
"""ROS 2 node: a camera whose images selenograph renders.

    python3 selenograph_ros2_node.py --ros-args -p url:=http://127.0.0.1:8080 -p request:=/path/request.json \\
      -r pose:=/truth/camera_pose

Subscribes `pose` (geometry_msgs/PoseStamped): the camera's position in MOON_ME, in metres from the Moon's centre, and
the orientation of its optical frame (+x right, +y down, +z boresight) there. header.frame_id must be moon_frame. For each
pose it publishes `image_raw` (sensor_msgs/Image) and `camera_info` (sensor_msgs/CameraInfo) with the pose's time stamp
and the frame camera_frame. A pose that the service refuses is logged as an error, with the members at fault, and has no
image. The quality of service is reliable, with a depth of queue_size.

Parameters, read once at the start, with their types (timeout_s:=20.0): url; token (""); timeout_s (10.0); request, a
file with a frame's request as JSON, whose pose is ignored (it needs a Sun, or the time stamps must be UTC: without "sun"
the Sun is computed for the stamp), and which has no "cameras", and in "truth" no region, every_px or float16; product
("image": mono8 or mono16; "depth", along the boresight: a depth image by REP 118, and "range", along each pixel's ray:
32FC1, in metres, or 64FC1 with the request's "truth": {"distance_type": "float64"}; or any other product); moon_frame
("moon_me"); camera_frame ("camera_optical"); queue_size (10): poses that wait while a frame is rendered; the oldest is
dropped beyond it. A depth image comes from a second node, on a topic that REP 118 calls image: -p product:=depth
-r __node:=depth -r image_raw:=depth/image -r camera_info:=depth/camera_info.

Needs rclpy, sensor_msgs and geometry_msgs of a ROS 2, selenograph_ros.py beside it and the package selenograph
(../python) in PYTHONPATH. README.md says for which ROS 2 this was written and how it is tested.
"""

import array

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from selenograph_ros import Renderer
from sensor_msgs.msg import CameraInfo, Image


class SelenographNode(Node):
    def __init__(self):
        super().__init__("selenograph")
        self.renderer = Renderer(self.parameter, self.get_logger().error)
        queue_size = self.renderer.queue_size
        self.images = self.create_publisher(Image, "image_raw", queue_size)
        self.infos = self.create_publisher(CameraInfo, "camera_info", queue_size)
        self.poses = self.create_subscription(PoseStamped, "pose", self.render, queue_size)

    def parameter(self, name, default=None):
        value = self.declare_parameter(name, "" if default is None else default).value
        if default is None and not value:
            raise ValueError(f"the parameter {name} is not set: --ros-args -p {name}:=...")
        return value

    def render(self, message):
        stamp = message.header.stamp
        members = self.renderer.members(message, stamp.sec, stamp.nanosec)
        if members is None:
            return
        # An array is taken as it is; of bytes, rclpy would look at each.
        image = Image(**{**members[0], "data": array.array("B", members[0]["data"])})
        info = CameraInfo(**members[1])
        for answer in (image, info):
            answer.header.stamp, answer.header.frame_id = stamp, self.renderer.camera_frame
        self.infos.publish(info)
        self.images.publish(image)


def main():
    rclpy.init()
    node = SelenographNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()

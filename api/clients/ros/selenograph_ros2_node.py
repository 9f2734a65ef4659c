#!/usr/bin/env python3
"""ROS 2 node: a camera whose images selenograph renders, as selenograph_node.py is of ROS 1.

    python3 selenograph_ros2_node.py --ros-args -p url:=http://127.0.0.1:8080 -p request:=/path/request.json \\
      -r pose:=/truth/camera_pose

Topics, frames and parameters are those of selenograph_node.py, which describes them: `pose` comes in, `image_raw` and
`camera_info` go out with its time stamp; the quality of service is reliable, with a depth of queue_size. A depth image
(32FC1, REP 118) is -p product:=depth, or range, of a second node (-r __node:=depth -r image_raw:=depth/image_raw).
Parameters are read once, at the start, and keep their type: timeout_s:=20.0.

Needs rclpy, sensor_msgs and geometry_msgs of a ROS 2, selenograph_ros.py beside it and selenograph.py (../python) in
PYTHONPATH. Debian has no ROS 2: ../tests/adapters_test.py runs this node with stand-ins for rclpy and its messages; within
ROS 2 itself it was not run.
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

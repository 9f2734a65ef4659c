#!/usr/bin/env python3
"""ROS 1 node: a camera whose images selenograph renders.

    rosrun ... selenograph_node.py _url:=http://127.0.0.1:8080 _request:=/path/request.json pose:=/truth/camera_pose

Subscribes `pose` (geometry_msgs/PoseStamped): where the camera is in MOON_ME, in metres from the Moon's centre, and the
orientation of its optical frame (+x right, +y down, +z boresight) there. header.frame_id must be ~moon_frame. For each
pose it publishes `image_raw` (sensor_msgs/Image) and `camera_info` (sensor_msgs/CameraInfo) with the pose's time stamp
and the frame ~camera_frame. A pose that the service refuses is logged as an error, with the members at fault, and has
no image.

Parameters: ~url; ~token (""); ~timeout_s (10); ~request, a file with a frame's request as JSON, of which the pose is
left out (a Sun must be there, or the time stamps must be UTC: without "sun" it stands where it does at the stamp), and
which has no "cameras", and in "truth" no region, every_px or float16;
~product ("image": mono8 or mono16; "depth" or "range": 32FC1, in metres, a depth image by REP 118, or 64FC1 with the
request's "truth": {"distance_type": "float64"}; or any other); ~moon_frame ("moon_me"); ~camera_frame
("camera_optical"); ~queue_size (10): poses that wait while a frame is rendered, then the oldest is lost.

Needs python3-rospy, python3-sensor-msgs, python3-geometry-msgs (Debian 12), selenograph_ros.py beside it and
selenograph.py (../python) in PYTHONPATH. Run in Debian 12's ROS by ../tests/adapters_test.py; not run in ROS Noetic or with
roslaunch.
"""

import geometry_msgs.msg
import rospy
import sensor_msgs.msg
from selenograph_ros import Renderer


def parameter(name, *default):
    return rospy.get_param("~" + name, *default)


class Node:
    def __init__(self):
        self.renderer = Renderer(parameter, rospy.logerr)
        queue_size = self.renderer.queue_size
        self.images = rospy.Publisher("image_raw", sensor_msgs.msg.Image, queue_size=queue_size)
        self.infos = rospy.Publisher("camera_info", sensor_msgs.msg.CameraInfo, queue_size=queue_size)
        rospy.Subscriber("pose", geometry_msgs.msg.PoseStamped, self.render, queue_size=queue_size, tcp_nodelay=True)

    def render(self, message):
        stamp = message.header.stamp
        members = self.renderer.members(message, stamp.secs, stamp.nsecs)
        if members is None:
            return
        image = sensor_msgs.msg.Image(**members[0])
        info = sensor_msgs.msg.CameraInfo(**{name.upper() if name in ("d", "k", "r", "p") else name: value
                                             for name, value in members[1].items()})
        for answer in (image, info):
            answer.header.stamp, answer.header.frame_id = stamp, self.renderer.camera_frame
        self.infos.publish(info)
        self.images.publish(image)


def main():
    rospy.init_node("selenograph")
    Node()
    rospy.spin()


if __name__ == "__main__":
    main()

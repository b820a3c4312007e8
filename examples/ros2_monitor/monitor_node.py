"""A ROS 2 node that monitors a gripper while it runs.

THIS EXAMPLE WAS NOT RUN HERE: there was no ROS 2. It is written for rclpy of ROS 2 Jazzy.

    python3 monitor_node.py

It reads the topics /gripper/force and /gripper/grasped (std_msgs/Float64), samples both at a fixed period, and publishes the name of
a formula on /mishandle/violated (std_msgs/String) as soon as the formula is certain to be violated. The latest message of each topic
is held until the next. Samples begin when both topics have had a message.
"""

import math

import rclpy
from mishandle import OnlineMonitor
from rclpy.node import Node
from std_msgs.msg import Float64, String

PERIOD = 0.01
TOPICS = {"force": "/gripper/force", "grasped": "/gripper/grasped"}
FORMULAS = {
    "grasp": "eventually[0:2s](grasped >= 1)",
    "force": "always(eventually[0:50ms](force <= 20))",
}


class MonitorNode(Node):
    def __init__(self):
        super().__init__("mishandle_monitor")
        self.monitor = OnlineMonitor(list(FORMULAS.values()), list(TOPICS), period=PERIOD)
        self.latest = {}
        self.known = set()
        self.publisher = self.create_publisher(String, "/mishandle/violated", 10)
        for name, topic in TOPICS.items():
            self.create_subscription(Float64, topic, lambda message, name=name: self.hold(name, message), 10)
        self.create_timer(PERIOD, self.sample)

    def hold(self, name, message):
        if math.isfinite(message.data):
            self.latest[name] = message.data
        else:
            self.get_logger().error(f"{name} is {message.data}; the value before is held")

    def sample(self):
        if len(self.latest) < len(TOPICS):
            return
        self.monitor.push(self.latest)
        for index, name in enumerate(FORMULAS):
            verdict = self.monitor.verdict(index)
            if verdict is None or name in self.known:
                continue
            self.known.add(name)
            seconds = (len(self.monitor) - 1) * PERIOD
            self.get_logger().info(f"{seconds:.2f} s: {name} is {'satisfied' if verdict else 'violated'}")
            if not verdict:
                self.publisher.publish(String(data=name))


def main():
    rclpy.init()
    node = MonitorNode()
    try:
        rclpy.spin(node)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()

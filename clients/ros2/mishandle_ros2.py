"""SKELETON, NOT RUN: serves a simulation behind ROS 2 (Gazebo by ros_gz) to Mishandle.

No ROS 2 was installed where this file was written: only its syntax was checked. It shows the four things that such a
client must do, with the services of ros_gz: reset the world, apply a scenario, advance the clock by one control step
while the world is paused otherwise, and read the signals from topics. Adapt the part above the line, and check the
result with `mishandle init --check`.

    ros2 run ros_gz_bridge parameter_bridge /clock@rosgraph_msgs/msg/Clock[gz.msgs.Clock \
        /world/default/control@ros_gz_interfaces/srv/ControlWorld
    mishandle falsify --command 'python3 mishandle_ros2.py' --controller policy.onnx
"""

import pathlib
import sys

import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from ros_gz_interfaces.srv import ControlWorld
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "python"))
from mishandle_simulator import serve  # noqa: E402

DT, STEPS = 0.02, 500  # s, control steps
PHYSICS_STEP = 0.001  # s, of the world file
WORLD = "default"
# Topic, type of its messages, and the number in a message, for each signal.
SIGNALS = {
    "height": ("/odom", Odometry, lambda message: message.pose.pose.position.z),
    "speed": ("/odom", Odometry, lambda message: message.twist.twist.linear.x),
}
OBSERVATION = ["height", "speed"]
ACTION_TOPIC = "/thrust"
HELLO = {
    "name": "gazebo",
    "version": "1.0",
    "control_dt": DT,
    "steps": STEPS,
    "axes": [{"name": "wind", "unit": "m/s", "low": -3.0, "high": 3.0, "nominal": 0.0, "kind": "model"}],
    "signals": [{"name": "height", "unit": "m"}, {"name": "speed", "unit": "m/s"}],
    "formulas": [{"name": "stays_up", "text": "always[2s:10s](height >= 0.5)"}],
    # Topics arrive when they arrive. State true only after `mishandle init --check` agrees.
    "deterministic": False,
    "policy": {
        "observation": [{"name": "height", "unit": "m"}, {"name": "speed", "unit": "m/s"}],
        "action": [{"name": "thrust", "unit": "N"}],
        "action_limit": 1.0,
    },
}


def prepare(node):
    node.wind = node.create_publisher(Float64, "/wind", 1)


def apply(node, scenario):
    """Sets the axes of a scenario: parameters, poses or plugins of your world."""
    node.wind.publish(Float64(data=float(scenario["wind"])))


# ---- Nothing below this line depends on the robot ----


class World(Node):
    def __init__(self):
        super().__init__("mishandle")
        self.now, self.last = 0.0, {}
        self.control = self.create_client(ControlWorld, f"/world/{WORLD}/control")
        self.action = self.create_publisher(Float64, ACTION_TOPIC, 1)
        self.create_subscription(Clock, "/clock", self.on_clock, qos_profile_sensor_data)
        for name, (topic, kind, number) in SIGNALS.items():
            keep = lambda message, name=name, number=number: self.last.__setitem__(name, number(message))
            self.create_subscription(kind, topic, keep, qos_profile_sensor_data)
        prepare(self)
        if not self.control.wait_for_service(timeout_sec=30.0):
            raise RuntimeError(f"no service /world/{WORLD}/control; is the bridge running?")

    def on_clock(self, message):
        self.now = message.clock.sec + 1e-9 * message.clock.nanosec

    def call(self, **control):
        request = ControlWorld.Request()
        request.world_control.pause = True
        for name, value in control.items():
            setattr(request.world_control, name, value)
        future = self.control.call_async(request)
        rclpy.spin_until_future_complete(self, future, timeout_sec=5.0)
        if future.result() is None or not future.result().success:
            raise RuntimeError("the world did not take a control request")

    def wait(self, is_done, what):
        """Handles messages until something is true. Mishandle's own time limit comes later."""
        for _ in range(5000):
            if is_done():
                return
            rclpy.spin_once(self, timeout_sec=0.001)
        raise RuntimeError(f"waited in vain for {what}")

    def advance(self, duration):
        until = self.now + duration
        self.call(multi_step=round(duration / PHYSICS_STEP))
        self.wait(lambda: self.now >= until - 0.5 * PHYSICS_STEP, f"the clock to reach {until} s")

    def state(self):
        self.wait(lambda: len(self.last) == len(SIGNALS), f"messages for {sorted(set(SIGNALS) - set(self.last))}")
        return {"signals": [self.last[name] for name in SIGNALS], "observation": [self.last[name] for name in OBSERVATION]}

    def reset(self, scenario, seed):
        everything = ControlWorld.Request().world_control.reset
        everything.all = True
        self.call(reset=everything, seed=seed % 2**32)
        self.last.clear()
        self.now = 0.0
        apply(self, scenario)
        self.advance(PHYSICS_STEP)  # so that every topic has a message of this episode
        return self.state()

    def step(self, action):
        self.action.publish(Float64(data=float(action[0])))
        self.advance(DT)
        return self.state()


if __name__ == "__main__":
    rclpy.init()
    world = World()
    serve(HELLO, reset=world.reset, step=world.step)
    rclpy.shutdown()

"""Where the camera points, by the robot's odometry or by the flow of the scene."""

from math import atan, cos, sin

from followerd.geometry import Camera, Pose2, wrap_angle
from followerd.messages import Box
from followerd.perception.flow import Halves, scene_flow


class Head:
    """Pan and tilt, rad, left and up; without odometry from an arbitrary zero."""

    def __init__(self) -> None:
        self.pan = self.tilt = 0.0
        self.advance = 0.0  # m since the last image, along the optical axis
        self._ego: Pose2 | None = None
        self._yaw = 0.0  # rad, of the camera in `base`, when the last image was taken
        self._scene: Halves | None = None

    def move(self, camera: Camera, ego: Pose2 | None, scene: Halves, person: Box | None) -> None:
        """To the next image, a grey one; `person` (px) stood there in the last one."""
        last, self._scene = self._scene, scene
        before, self._ego = self._ego, ego
        turned, self._yaw = wrap_angle(camera.yaw - self._yaw), camera.yaw
        self.advance = 0.0
        if ego is not None:
            if before is None:
                self.pan = wrap_angle(ego.theta + camera.yaw)
            else:
                moved = ~before @ ego
                self.pan += moved.theta + turned  # of the robot, of the camera on it
                self.advance = cos(camera.yaw) * moved.x + sin(camera.yaw) * moved.y
            self.tilt = camera.elevation
        elif last is not None:
            flow = scene_flow(last, scene, person)
            if flow is not None:  # the camera turns left when the scene moves right
                self.pan += atan(flow.u / camera.fx)
                self.tilt += atan(flow.v / camera.fy)

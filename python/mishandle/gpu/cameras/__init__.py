"""Images of cameras by ray casting on a GPU, for policies that see."""

from mishandle.gpu.cameras.renderer import wp
from mishandle.gpu.cameras.task_cameras import CAMERAS, Cameras

__all__ = ["CAMERAS", "Cameras", "wp"]

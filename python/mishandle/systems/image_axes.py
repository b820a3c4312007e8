"""Axes of what an environment's cameras see: the images in its observation."""

import json
from collections.abc import Sequence
from typing import Any

from mishandle.errors import InvalidTypeError, InvalidValueError
from mishandle.scenarios.arguments import check_period, check_steps
from mishandle.scenarios.axes import Axis, FaultParameter, ResetOption
from mishandle.scenarios.images import ImageSettings, images_of
from mishandle.systems.environments import (
    control_period, episode_steps, spec_name, states_control_dt
)

OF_IMAGES = ("occlusion", "image")
"""Factors of any image."""

OF_SCENES = ("camera", "light", "background", "object", "distractors")
"""Factors that change what cameras take, which only the simulator of a scene can draw. The others
act between environment and policy."""

CAMERA_FAULTS = "faults-camera"
"""The space of faults of cameras, which have no severity."""

SEVERITIES = range(1, 6)
"""Severities of a factor."""


def sight(
    environment: Any, *, spaces: str | Sequence[str] = ("image-3", CAMERA_FAULTS),
    steps: int | None = None, control_dt: float | None = None
) -> list[Axis]:
    """Returns the axes of the images in the observation of an environment.

    Each array of bytes of the shape (height, width, 3) in the observation counts as a camera. The
    axes act between the environment and the policy, as :func:`faults` do: a space such as
    ``"image-3"`` corrupts images (noise, blur, brightness, colors, compression, black rows) with a
    severity from 1 to 5, ``"occlusion-3"`` puts a patch on the lens, and ``"faults-camera"``
    freezes, drops, exchanges or delays images. At their nominal values they change no byte.
    ``docs/reference/sight.md`` lists the axes.

    Parameters
    ----------
    environment
        A Gymnasium environment or vector environment.
    spaces : str or sequence of str
        Factors with a severity, and ``"faults-camera"``. ``"camera-3"``, ``"light-3"``,
        ``"background-3"``, ``"object-3"`` and ``"distractors-3"`` change the scene. Only
        environments that draw it again have them, such as ``TaskEnv(task, cameras=["over"])``.
    steps, control_dt
        As for :func:`faults`.

    Examples
    --------
    >>> from mishandle import TaskEnv
    >>> env = TaskEnv("point-reaching", cameras=["over"])
    >>> [axis.name for axis in sight(env, spaces=["light-3", "image-3"])][:2]
    ['lamp_x', 'lamp_y']
    """
    if not (hasattr(environment, "reset") and hasattr(environment, "step")):
        raise InvalidTypeError(
            f"a {type(environment).__name__} is not a Gymnasium environment, so it has no images "
            "in an observation"
        )
    names = [spaces] if isinstance(spaces, str) else list(spaces)
    known = [*_spaces(OF_SCENES), *_spaces(OF_IMAGES), CAMERA_FAULTS]
    for name in names:
        if name not in known:
            raise InvalidValueError(
                f"there is no space of sight {name!r}; the spaces are {', '.join(known)}"
            )
    check_steps(steps)
    check_period(control_dt)
    # What a sub-environment states holds for a vector environment of it.
    one = next(iter(getattr(environment, "envs", None) or ()), environment)
    space = getattr(environment, "single_observation_space", None) or environment.observation_space
    images = images_of(space)
    if not images:
        raise InvalidValueError(
            f"the observation of {spec_name(one)} has no image, an array of bytes (uint8) of the "
            "shape (height, width, 3)"
        )
    twice = next(
        (image.name for image in images if [each.name for each in images].count(image.name) > 1),
        None
    )
    if twice is not None:
        raise InvalidValueError(
            f"two images of the observation of {spec_name(one)} have the name {twice!r}; rename "
            "one of them"
        )
    of_scene = getattr(one.unwrapped, "sight_axes", ())
    missing = [
        name for name in names
        if name in _spaces(OF_SCENES) and name not in {space for space, _ in of_scene}
    ]
    if missing:
        raise InvalidValueError(
            f"{', '.join(missing)} would change the scene, which {spec_name(one)} does not draw "
            f"for Mishandle; its images have the spaces {', '.join(_spaces(OF_IMAGES))} and "
            f"{CAMERA_FAULTS}"
        )
    if control_dt is None and not states_control_dt(one):
        raise InvalidValueError(
            f"the times of camera faults are in seconds, but {spec_name(one)} does not state the "
            "duration of a control step (attribute `dt`); pass it as control_dt, in seconds"
        )
    settings = ImageSettings(
        images, steps=episode_steps(one, steps),
        control_dt=control_period(one) if control_dt is None else float(control_dt)
    )
    scene = [
        Axis.from_document(axis, ResetOption(f"sight.{axis['name']}")) for name, axis in of_scene
        if name in names and name in _spaces(OF_SCENES)
    ]
    return scene + [
        Axis.from_document(axis, FaultParameter(settings))
        for name, axis in json.loads(settings.native().axes) if name in names
    ]


def _spaces(factors: Sequence[str]) -> list[str]:
    return [f"{factor}-{severity}" for factor in factors for severity in SEVERITIES]

"""Scenes of environments with a MuJoCo model, for the 3-D replays of pages."""

import json
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

_KINDS = {
    0: "plane", 1: "mesh", 2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box",
    7: "mesh"
}
"""Names of MuJoCo's types of shapes. A height field is drawn as a mesh; other types are left
out."""

_HEIGHT_FIELD, _MESH = 1, 7
_FREE, _SLIDE = 0, 2

_OBJECTS = 2
"""Largest number of objects with a path."""

_UNSET = (0.5, 0.5, 0.5, 1.0)
"""The color of a shape that states none."""


def has_model(environment: Any) -> bool:
    """Returns whether an environment has MuJoCo's ``model`` and ``data``, as those of Gymnasium."""
    mujoco = sys.modules.get("mujoco")
    return (
        mujoco is not None
        and isinstance(getattr(environment, "model", None), mujoco.MjModel)
        and isinstance(getattr(environment, "data", None), mujoco.MjData)
    )


class Motion:
    """Poses of the bodies in one simulation, while it runs."""

    def __init__(self) -> None:
        self._scene = ""
        self._copy: Any = None
        self._poses: dict[int, NDArray[np.float64]] = {}
        self._error: Exception | None = None

    def add(self, sample: int, environment: Any) -> None:
        """Notes the poses of a sample."""
        # The simulation continues, so that an error here is not one of the system.
        if self._error is None and sample not in self._poses:
            try:
                self._poses[sample] = self._read(environment)
            except Exception as error:
                self._error = error

    def _read(self, environment: Any) -> NDArray[np.float64]:
        model, data = environment.model, environment.data
        mujoco = sys.modules["mujoco"]
        if self._copy is None:
            self._scene, self._copy = scene(model), mujoco.MjData(model)
        # The poses in the data are those before the last physics step, and must not be changed.
        copy = self._copy
        copy.qpos[:] = data.qpos
        copy.mocap_pos[:], copy.mocap_quat[:] = data.mocap_pos, data.mocap_quat
        mujoco.mj_kinematics(model, copy)
        return np.hstack([copy.xpos[1:], copy.xquat[1:]]).ravel()

    def taken(self) -> tuple[str, NDArray[np.float64]]:
        """Returns the scene and the poses of each sample. Raises the exception of a failed one."""
        if self._error is not None:
            raise self._error
        poses = [self._poses[sample] for sample in sorted(self._poses)]
        return self._scene, np.array(poses) if poses else np.zeros((0, 0))


class Mover:
    """Notes the poses of the next simulation of a system with the attribute ``motion``, as the
    extension module asks for it."""

    def __init__(self, system: Any) -> None:
        self._system = system

    def begin(self) -> None:
        """Asks for the poses of the next simulation."""
        self._system.motion = Motion()

    def take(self) -> tuple[str, NDArray[np.float64]]:
        """Returns the scene and the poses."""
        motion, self._system.motion = self._system.motion, None
        found: tuple[str, NDArray[np.float64]] = motion.taken()
        return found


def scene(model: Any) -> str:
    """Returns the bodies and shapes of a model as the extension module reads them."""
    meshes: dict[tuple[int, int], Any] = {}
    shapes = []
    for geom in range(model.ngeom):
        kind, data = int(model.geom_type[geom]), int(model.geom_dataid[geom])
        if kind not in _KINDS:
            continue
        mesh = None
        if kind in (_HEIGHT_FIELD, _MESH):
            if (kind, data) not in meshes:
                meshes[kind, data] = _mesh(model, data) if kind == _MESH else _field(model, data)
            mesh = list(meshes).index((kind, data))
        shapes.append({**_shape(model, "geom", geom), "mesh": mesh})
    for site in range(model.nsite):
        if int(model.site_type[site]) in _KINDS:
            shapes.append({**_shape(model, "site", site), "mesh": None})
    return json.dumps({
        "bodies": [model.body(body).name for body in range(model.nbody)], **_robot(model),
        "shapes": shapes, "meshes": list(meshes.values())
    })


def _robot(model: Any) -> dict[str, Any]:
    """Returns the bodies of the robot, which is the first tree of bodies with joints, whether it
    moves about, and the bodies with a path: its base or its tip, and objects."""
    roots: list[int] = list(dict.fromkeys(model.body_rootid[model.jnt_bodyid].tolist()))
    if not roots:
        return {"robot": [], "is_mobile": False, "traced": []}
    root = roots[0]
    robot = [body for body in range(1, model.nbody) if model.body_rootid[body] == root]
    own = np.flatnonzero(model.jnt_bodyid == root)
    is_mobile = any(
        model.jnt_type[joint] == _FREE
        or (model.jnt_type[joint] == _SLIDE and not model.jnt_limited[joint])
        for joint in own
    )
    # A body comes after its parent.
    joints = [0] * model.nbody
    for body in robot:
        joints[body] = joints[model.body_parentid[body]] + int(model.body_jntnum[body])
    first = root if is_mobile else max(robot, key=lambda body: joints[body])
    return {
        "robot": robot, "is_mobile": is_mobile, "traced": [first, *roots[1 : 1 + _OBJECTS]]
    }


def _shape(model: Any, element: str, index: int) -> dict[str, Any]:
    """Returns a geom or a site."""
    def value(name: str) -> Any:
        return getattr(model, f"{element}_{name}")[index].tolist()

    color, material = value("rgba"), value("matid")
    # As in MuJoCo, the color of a shape wins over that of its material if it states one.
    if material >= 0 and tuple(color) == _UNSET:
        color = model.mat_rgba[material].tolist()
    return {
        "is_site": element == "site", "body": value("bodyid"), "kind": _KINDS[value("type")],
        "size": value("size"), "position": value("pos"), "quaternion": value("quat"),
        "color": color, "group": value("group")
    }


def _mesh(model: Any, index: int) -> tuple[list[float], list[int]]:
    """Returns vertices and triangles of a mesh."""
    first, count = model.mesh_vertadr[index], model.mesh_vertnum[index]
    face, faces = model.mesh_faceadr[index], model.mesh_facenum[index]
    vertices, triangles = model.mesh_vert[first : first + count], model.mesh_face
    return vertices.ravel().tolist(), triangles[face : face + faces].ravel().tolist()


def _field(model: Any, index: int) -> tuple[list[float], list[int]]:
    """Returns vertices and triangles of the surface of a height field."""
    rows, columns = int(model.hfield_nrow[index]), int(model.hfield_ncol[index])
    x, y, z, _ = model.hfield_size[index]
    first = model.hfield_adr[index]
    heights = z * model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    grid = np.meshgrid(np.linspace(-x, x, columns), np.linspace(-y, y, rows))
    vertices = np.stack([*grid, heights], axis=-1)
    low = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()[:, None]
    cells = low + np.array([0, 1, columns + 1, 0, columns + 1, columns])
    return vertices.ravel().tolist(), cells.ravel().tolist()

"""Thousands of MuJoCo worlds on an NVIDIA GPU, stepped by MuJoCo Warp. The commands use it for
``-k screening.device=gpu`` and ``-k train.device=gpu``.

Its results are close to those of MuJoCo C, but not the same bits. It proposes simulations; MuJoCo C
repeats those that count.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mishandle.gpu.extra import load

if TYPE_CHECKING:
    from numpy.typing import NDArray

wp, mujoco, mjw, kernels, probes, servo_rule = load(
    "mujoco", "mujoco_warp", "mishandle.gpu.kernels", "mishandle.gpu.probe", "mishandle.gpu.servos"
)

MUJOCO_VERSION = "3.17.0"
"""Version of MuJoCo, in C and Warp, that the tasks were made for."""

DEVICE_VARIABLE = "MISHANDLE_GPU_DEVICE"
"""Environment variable with the device, such as ``cuda:1``. ``cpu`` runs the kernels on the CPU,
which is slow, for tests."""

CONSTRAINT_ROWS = 192
"""Constraint rows per world. Two stacked cubes between fingers need up to 150."""

FLEX_CONSTRAINT_ROWS = 1024
"""Constraint rows per world of a model with a cloth."""

CONTACTS = 64
"""Contacts per world, on average: the worlds share one buffer."""

FLEX_CONTACTS = 256
"""Contacts per world of a model with a cloth."""

CCD_TOLERANCE = 1e-6
"""Smallest tolerance of the collider of convex shapes: that of MuJoCo."""

GRAVITY = "opt.gravity"

UNUSED_FIELDS = {"actuator_length0", "bvh_aabb", "dof_M0", "dof_length"}
"""Fields of MuJoCo's model that the physics step of MuJoCo Warp does not read: lengths that only
the compiler uses, boxes of its collision tree, and scales for sleeping bodies and for models with a
soft inertia."""

STAGED_ROWS = 1024
"""Rows whose fields are copied to the GPU at a time."""

UNFINISHED = -1.0
"""Status of the first row while a control step runs."""

CPU_LOCK = threading.Lock()
"""Held while kernels run on the CPU: they are not made for several threads."""


def step(model: Any, data: Any, set_controls: Callable[[], None]) -> None:
    """Advances all worlds by one physics step, as ``mujoco_warp.step`` with the integrator
    ``implicitfast``. ``set_controls`` is called when the mass matrix and the bias torques are those
    of the state.

    ``mujoco_warp.step`` 3.17.0 makes the constraints before it computes the velocities of the
    bodies. The bias of a weld then comes from the velocities of the previous step, which are those
    of another state after a reset. MuJoCo C uses the current ones. Tendons, sensors and sleeping
    bodies are left out: :func:`compile_model` rejects models with tendons.
    """
    mjw.fwd_kinematics(model, data)
    mjw.crb(model, data)
    mjw.collision(model, data)
    mjw.com_vel(model, data)
    mjw.make_constraint(model, data)
    mjw.transmission(model, data)
    mjw.fwd_velocity(model, data)
    set_controls()
    mjw.fwd_actuation(model, data)
    mjw.fwd_acceleration(model, data, factorize=True)
    mjw.solve(model, data)
    mjw.implicit(model, data)


def compile_model(source: str | bytes, timestep: float) -> Any:
    """Compiles an MJCF document, or loads a compiled model (MJB), for MuJoCo Warp."""
    for package, module in (("mujoco", mujoco), ("mujoco-warp", mjw)):
        if (found := module.__version__) != MUJOCO_VERSION:
            raise RuntimeError(
                f"expected the package {package} {MUJOCO_VERSION}, found {found}; pip install "
                "'.[gpu]' in a clone of Mishandle"
            )
    if isinstance(source, str):
        model = mujoco.MjModel.from_xml_string(source)
    else:
        model = mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": source})
    if model.ntendon > 0 or model.opt.integrator != mujoco.mjtIntegrator.mjINT_IMPLICITFAST:
        raise RuntimeError(
            "the device gpu needs a model without tendons and with the integrator implicitfast; in "
            "a target file, that is `integrator = \"implicitfast\"` in [model]"
        )
    model.opt.timestep = timestep
    # Without this flag, MuJoCo Warp finds 4 instead of 8 contacts between two boxes.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    # MuJoCo Warp has no midphase and refuses the flag, which changes no contact in MuJoCo C.
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    return model


def attribute(model: Any, name: str) -> Any:
    """Returns a field of a model of MuJoCo C or Warp by its name, such as ``opt.gravity``."""
    return functools.reduce(getattr, name.split("."), model)


def _floats(array: Any) -> Any:
    """Returns a view of an array of vectors or matrices as ``[rows, numbers]``."""
    rows = array.shape[0]
    numbers = array.size * wp.types.type_size(array.dtype) // max(rows, 1)
    return wp.array(ptr=array.ptr, dtype=float, shape=(rows, numbers), device=array.device)


def find_device(name: str | None) -> Any:
    """Returns a device of Warp by its name, or the one of the environment variable, or the default
    GPU."""
    name = name or os.environ.get(DEVICE_VARIABLE)
    if not name:
        if not wp.is_cuda_available():
            raise RuntimeError("found no NVIDIA GPU with a working driver; use MuJoCo C")
        name = "cuda"
    try:
        return wp.get_device(name)
    except ValueError:
        known = ", ".join(str(device) for device in wp.get_devices())
        raise RuntimeError(
            f"found no device {name!r} of {DEVICE_VARIABLE}; expected one of {known}"
        ) from None


class _Announcement:
    """Says on stderr that kernels are compiled, if that takes longer than three seconds."""

    def __enter__(self) -> None:
        text = (
            "GPU: compiling kernels; the first run takes about a minute, and later runs find them "
            "in a cache"
        )
        self._timer = threading.Timer(3.0, lambda: print(text, file=sys.stderr, flush=True))
        self._timer.daemon = True
        self._timer.start()

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()


class WarpBatch:
    """Worlds of one model, one per row, that MuJoCo Warp steps together.

    Arguments: the model (MJCF or MJB), the physics step (s), the number of worlds, the number of
    physics steps per control step, the servos of the first actuators (rows with the columns
    ``servos.COLUMNS``), the bodies that ``forces`` push, the fields of the model that
    :meth:`write_fields` replaces, such as ``geom_friction`` or ``opt.gravity``, and the device. A
    probe, with the keys ``probe.KEYS``, measures forces and motion over the physics steps; without
    one, nothing is measured.
    """

    def __init__(
        self, model: str | bytes, timestep: float, rows: int, substeps: int,
        servos: Sequence[Sequence[float]], pushed: Sequence[int] = (), fields: Sequence[str] = (),
        device: str | None = None, constraint_rows: int | None = None,
        probe: Mapping[str, Any] | None = None
    ) -> None:
        self._device = find_device(device)
        self._rows, self._substeps = rows, substeps
        with _Announcement(), wp.ScopedDevice(self._device):
            loaded = compile_model(model, timestep)
            self._put_model(loaded, fields)
            self._allocate(loaded, servos, pushed, constraint_rows, probe)
            self._record()

    def _put_model(self, model: Any, fields: Sequence[str]) -> None:
        """Makes the model of MuJoCo Warp, whose varying fields have one row per world."""
        if "dof_damping" in fields and np.any(model.actuator_damping):
            # MuJoCo Warp adds it to the damping of the joints.
            raise RuntimeError(
                "cannot vary dof_damping of a model with damped actuators between worlds; use "
                "MuJoCo C"
            )
        known = {field.name: field.type for field in dataclasses.fields(mjw.Model)}
        varying: dict[str, int] = {}
        self._fields_size = 0
        for name in fields:
            size = int(np.size(attribute(model, name)))
            if size > 0 and name not in UNUSED_FIELDS:
                if name != GRAVITY and getattr(known.get(name), "shape", (0,))[0] != "*":
                    # With a cloth, masses change flexedge_invweight0, which MuJoCo Warp shares
                    # between worlds.
                    raise RuntimeError(
                        f"cannot vary {name} of this model between worlds; use MuJoCo C"
                    )
                varying[name] = self._fields_size
            self._fields_size += size
        rows = self._rows
        self._model = mjw.put_model(model, {name: rows for name in varying if name != GRAVITY})
        if GRAVITY in varying:
            gravity = np.tile(model.opt.gravity, (rows, 1))
            self._model.opt.gravity = wp.array(gravity, dtype=wp.vec3)
            self._model.opt.gravity._is_batched = True
        # Numbers of 32 bits never reach the tolerances of some scenes.
        self._model.opt.ccd_tolerance.fill_(max(model.opt.ccd_tolerance, CCD_TOLERANCE))
        self._model.opt.warn_overflow = 0
        self._field_parts = [
            (offset, _floats(attribute(self._model, name))) for name, offset in varying.items()
        ]
        shape, is_cuda = (min(rows, STAGED_ROWS), self._fields_size), self._device.is_cuda
        self._host_fields = wp.zeros(shape, dtype=wp.float64, device="cpu", pinned=is_cuda)
        self._fields = wp.zeros(shape, dtype=wp.float64) if is_cuda else self._host_fields

    def _allocate(
        self, model: Any, servos: Sequence[Sequence[float]], pushed: Sequence[int],
        constraint_rows: int | None, probe: Mapping[str, Any] | None
    ) -> None:
        rows, is_cuda = self._rows, self._device.is_cuda
        has_flex = model.nflex > 0
        self.data = mjw.make_data(
            model, nworld=rows, nconmax=FLEX_CONTACTS if has_flex else CONTACTS,
            njmax=constraint_rows or (FLEX_CONSTRAINT_ROWS if has_flex else CONSTRAINT_ROWS)
        )
        data = self.data
        self._servos = wp.array(
            np.array(servos).reshape(-1, len(servo_rule.COLUMNS)), dtype=wp.float64
        )
        self._pushed = wp.array(list(pushed), dtype=int)
        self._status = wp.zeros(rows, dtype=int)
        self._parts = [
            _floats(part)
            for part in (
                data.qpos,
                data.qvel,
                data.xpos,
                data.xquat,
                data.site_xpos,
                data.site_xmat,
                data.xanchor,
                data.xaxis,
            )
        ]
        self._probe = None if probe is None else probes.WarpProbe(probe, model, self._model, data)
        if self._probe is not None:
            self._parts.append(self._probe.readings)
        self._output_size = sum(part.shape[1] for part in self._parts) + 1
        sizes = {
            "inputs": model.nu,
            "active": model.neq,
            "mocap": 7 * model.nmocap,
            "forces": 3 * self._substeps if pushed else 0,
            "outputs": self._output_size,
        }
        self._host: dict[str, Any] = {}
        self._there: dict[str, Any] = {}
        for buffer, size in sizes.items():
            kind = {"active": wp.uint8, "outputs": wp.float32}.get(buffer, wp.float64)
            self._host[buffer] = wp.zeros((rows, size), dtype=kind, device="cpu", pinned=is_cuda)
            # On the CPU, the kernels read and write the host's buffers.
            self._there[buffer] = (
                wp.zeros((rows, size), dtype=kind) if is_cuda else self._host[buffer]
            )
        self._allocate_states(model)

    def _allocate_states(self, model: Any) -> None:
        specification = int(mujoco.mjtState.mjSTATE_INTEGRATION)
        offsets, self._state_size = {}, 0
        for bit in range(int(mujoco.mjtState.mjNSTATE)):
            if specification & (1 << bit):
                offsets[1 << bit] = self._state_size
                self._state_size += mujoco.mj_stateSize(model, 1 << bit)
        assert self._state_size == mujoco.mj_stateSize(model, specification)
        states, data = mujoco.mjtState, self.data
        parts = {
            states.mjSTATE_QPOS: data.qpos,
            states.mjSTATE_QVEL: data.qvel,
            states.mjSTATE_ACT: data.act,
            states.mjSTATE_WARMSTART: data.qacc_warmstart,
            states.mjSTATE_CTRL: data.ctrl,
            states.mjSTATE_XFRC_APPLIED: data.xfrc_applied,
            states.mjSTATE_MOCAP_POS: data.mocap_pos,
            states.mjSTATE_MOCAP_QUAT: data.mocap_quat,
        }
        self._state_parts = [
            (offsets[int(kind)], _floats(part)) for kind, part in parts.items() if part.size > 0
        ]
        self._active_offset = offsets[int(states.mjSTATE_EQ_ACTIVE)]
        shape, is_cuda = (self._rows, self._state_size), self._device.is_cuda
        self._host_states = wp.zeros(shape, dtype=wp.float64, device="cpu", pinned=is_cuda)
        self._host_rows = wp.zeros(self._rows, dtype=int, device="cpu", pinned=is_cuda)
        self._states = wp.zeros(shape, dtype=wp.float64) if is_cuda else self._host_states
        self._indices = wp.zeros(self._rows, dtype=int) if is_cuda else self._host_rows

    def _record(self) -> None:
        """Records the control step as a CUDA graph, after a first run that compiles the kernels."""
        self._stream: Any = None
        self._graph: Any = None
        if not self._device.is_cuda:
            self._control_step()
            return
        self._stream = wp.Stream(self._device)
        with wp.ScopedStream(self._stream):
            self._control_step()
            wp.synchronize_stream(self._stream)
            # Other threads may use the device meanwhile.
            with wp.ScopedCapture(stream=self._stream, force_module_load=False) as capture:
                self._control_step()
            self._graph = capture.graph

    def _control_step(self) -> None:
        data, rows, there = self.data, self._rows, self._there
        if self._device.is_cuda:
            for name in ("inputs", "active", "mocap", "forces"):
                if there[name].size > 0:
                    wp.copy(there[name], self._host[name])
        self._status.zero_()
        data.overflow.zero_()
        if there["active"].size > 0:
            wp.launch(
                kernels.set_bools, data.eq_active.shape, inputs=[there["active"]],
                outputs=[data.eq_active]
            )
        if there["mocap"].size > 0:
            for pose, offset, size in ((data.mocap_pos, 0, 3), (data.mocap_quat, 3, 4)):
                view = _floats(pose)
                wp.launch(
                    kernels.to_float, view.shape, inputs=[there["mocap"], 7, offset, size],
                    outputs=[view]
                )
        servos = self._servos.shape[0]
        if data.ctrl.shape[1] > servos:
            others = (rows, data.ctrl.shape[1] - servos)
            wp.launch(
                kernels.set_controls, others, inputs=[there["inputs"], servos], outputs=[data.ctrl]
            )
        for substep in range(self._substeps):
            if self._pushed.size > 0:
                force = wp.array(
                    ptr=data.xfrc_applied.ptr, dtype=float, shape=(*data.xfrc_applied.shape, 6),
                    device=self._device
                )
                dim = (rows, self._pushed.size, 3)
                wp.launch(
                    kernels.set_forces, dim, inputs=[there["forces"], substep, self._pushed],
                    outputs=[force]
                )
            if self._probe is not None:
                self._probe.before_step(substep)
            self.physics_step()
            if self._probe is not None:
                self._probe.after_step(substep)
            wp.launch(
                kernels.watch, rows, inputs=[data.qpos, data.qvel, data.overflow],
                outputs=[self._status]
            )
        # The poses of the step belong to its start.
        mjw.kinematics(self._model, data)
        offset = 0
        for part in self._parts:
            if part.size > 0:
                wp.launch(
                    kernels.copy_columns, part.shape, inputs=[part, offset],
                    outputs=[there["outputs"]]
                )
            offset += part.shape[1]
        wp.launch(
            kernels.write_status, rows, inputs=[self._status, offset], outputs=[there["outputs"]]
        )
        if self._device.is_cuda:
            wp.copy(self._host["outputs"], there["outputs"])

    def physics_step(self) -> None:
        """Launches the kernels of a physics step."""
        step(self._model, self.data, self._set_servos)

    def _set_servos(self) -> None:
        model, data, servos = self._model, self.data, self._servos
        if servos.shape[0] == 0:
            return
        inputs = [
            servos.shape[0], model.opt.timestep, servos, self._there["inputs"], data.qpos,
            data.qvel, data.qfrc_passive
        ]
        inputs += [
            data.qfrc_bias, model.dof_damping, data.M, model.M_rowadr, model.M_rownnz,
            model.M_colind
        ]
        inputs += [model.actuator_gainprm, model.actuator_biasprm]
        wp.launch(
            servo_rule.make_kernel(servos.shape[0]), self._rows, inputs=inputs, outputs=[data.ctrl]
        )

    def buffers(self) -> dict[str, tuple[int, int]]:
        """Returns the address and the number of elements of each buffer of the host. All are
        row-major; ``active`` has bytes, ``outputs`` 32-bit numbers, the others 64-bit numbers:

        - ``inputs``: target of each servo, then control of each other actuator
        - ``active``: 1 for each active equality constraint, otherwise 0
        - ``mocap``: position and quaternion of each mocap body
        - ``forces``: force on every pushed body in each physics step, N
        - ``outputs``: qpos, qvel, body positions and quaternions, site positions and rotations,
          joint anchors and axes; with a probe its readings; then 0, 1 if the world has diverged, or
          2 if it had too little memory for contacts or constraints
        """
        return {
            name: (int(buffer.ptr or 0), int(buffer.size)) for name, buffer in self._host.items()
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Returns the buffers as NumPy arrays."""
        return {name: buffer.numpy() for name, buffer in self._host.items()}

    def write_states(self, rows: NDArray[np.int32], states: NDArray[np.float64]) -> None:
        """Replaces the states of some rows by MuJoCo's state vectors (``mjSTATE_INTEGRATION``)."""
        count = len(rows)
        with contextlib.nullcontext() if self._device.is_cuda else CPU_LOCK:
            self._write_states(rows, states, count)

    def _write_states(
        self, rows: NDArray[np.int32], states: NDArray[np.float64], count: int
    ) -> None:
        self._host_rows.numpy()[:count] = rows
        self._host_states.numpy()[:count] = np.reshape(states, (count, self._state_size))
        if self._device.is_cuda:
            wp.copy(self._indices, self._host_rows, count=count, stream=self._stream)
            wp.copy(
                self._states, self._host_states, count=count * self._state_size, stream=self._stream
            )
        for offset, part in self._state_parts:
            self._launch(
                kernels.scatter, (count, part.shape[1]), [self._states, self._indices, offset, part]
            )
        active = self.data.eq_active
        if active.size > 0:
            self._launch(
                kernels.scatter_bools, (count, active.shape[1]),
                [self._states, self._indices, self._active_offset, active]
            )
        if self._device.is_cuda:
            # The next call overwrites the page-locked buffers.
            wp.synchronize_stream(self._stream)

    def write_fields(self, rows: NDArray[np.int32], values: NDArray[np.float64]) -> None:
        """Replaces the varying fields of the models of some rows, one field after another, each
        row-major."""
        values = np.reshape(values, (len(rows), self._fields_size))
        with contextlib.nullcontext() if self._device.is_cuda else CPU_LOCK:
            for first in range(0, len(rows), STAGED_ROWS):
                part = slice(first, first + STAGED_ROWS)
                self._write_fields(rows[part], values[part])

    def _write_fields(self, rows: NDArray[np.int32], values: NDArray[np.float64]) -> None:
        count = len(rows)
        self._host_rows.numpy()[:count] = rows
        self._host_fields.numpy()[:count] = values
        if self._device.is_cuda:
            wp.copy(self._indices, self._host_rows, count=count, stream=self._stream)
            wp.copy(
                self._fields, self._host_fields, count=count * self._fields_size,
                stream=self._stream
            )
        for offset, part in self._field_parts:
            self._launch(
                kernels.scatter, (count, part.shape[1]), [self._fields, self._indices, offset, part]
            )
        if self._device.is_cuda:
            # The next part overwrites the page-locked buffers.
            wp.synchronize_stream(self._stream)

    def read_states(self) -> NDArray[np.float64]:
        """Returns the state vectors of all rows, one after another. The time is 0: the tasks do not
        depend on it."""
        is_cuda = self._device.is_cuda
        with wp.ScopedStream(self._stream) if is_cuda else CPU_LOCK:
            self._states.zero_()
            for offset, part in self._state_parts:
                self._launch(
                    kernels.gather, (self._rows, part.shape[1]), [part, offset, self._states]
                )
            active = self.data.eq_active
            if active.size > 0:
                inputs = [active, self._active_offset, self._states]
                self._launch(kernels.gather_bools, (self._rows, active.shape[1]), inputs)
            states: NDArray[np.float64] = self._states.numpy()
            return states.reshape(-1)

    def _launch(self, kernel: Any, dim: tuple[int, int], inputs: list[Any]) -> None:
        wp.launch(kernel, dim, inputs=inputs, device=self._device, stream=self._stream)

    def start_step(self) -> None:
        """Begins to advance all rows by one control step."""
        self._host["outputs"].numpy()[0, -1] = UNFINISHED
        if self._graph is None:
            with CPU_LOCK, wp.ScopedDevice(self._device):
                self._control_step()
            return
        wp.capture_launch(self._graph, stream=self._stream)

    def finish_step(self) -> None:
        """Waits for the end of the control step, without the interpreter lock."""
        if self._graph is not None:
            wp.synchronize_stream(self._stream)
        # Warp reports no error of a lost device here, and the outputs would be those of the step
        # before.
        if self._host["outputs"].numpy()[0, -1] == UNFINISHED:
            raise RuntimeError("the device did not finish a control step")

    def step(self) -> None:
        """Advances all rows by one control step."""
        self.start_step()
        self.finish_step()

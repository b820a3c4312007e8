"""Tests of the device ``gpu``, with the kernels of MuJoCo Warp on the CPU."""

import csv
import ctypes
import json
import os
import statistics
import subprocess
import sys
import tempfile
import unittest
import unittest.mock
from pathlib import Path

from cases import FolderCase
import numpy as np

os.environ["MISHANDLE_GPU_DEVICE"] = "cpu"
try:
    import mujoco
    import mujoco_warp as mjw
    from mishandle import _native
    from mishandle.gpu import audit, batches, networks, verdicts
except ImportError:
    batches = None

TWO_BOXES = """<mujoco><option integrator="implicitfast"/><worldbody>
<body pos="0 0 0.1"><geom type="box" size="0.1 0.1 0.1"/></body>
<body pos="0 0 0.299" euler="0 0 45"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
</worldbody></mujoco>"""

WELDED = """<mujoco><option integrator="implicitfast"/><worldbody>
<body name="arm"><joint name="hinge" axis="0 0 1"/>
<geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" contype="0" conaffinity="0"/></body>
<body name="held" pos="0.5 0 0"><freejoint/>
<geom type="box" size="0.02 0.02 0.02" contype="0" conaffinity="0"/></body>
</worldbody><equality><weld body1="arm" body2="held"/></equality></mujoco>"""

CHANGEABLE = """<mujoco><option integrator="implicitfast"/><worldbody>
<geom name="floor" type="plane" size="1 1 0.1" friction="0.3"/>
<body name="arm" gravcomp="1" pos="0 0 0.5"><joint name="hinge" axis="0 1 0" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="1" contype="0" conaffinity="0"/>
</body>
<body name="held" pos="0.4 0 0.5"><freejoint/>
<geom type="box" size="0.02 0.02 0.02" mass="0.2" contype="0" conaffinity="0"/></body>
<body name="box" pos="0 0.5 0.0299"><freejoint/>
<geom type="box" size="0.02 0.02 0.03" mass="0.1"/><site pos="0.01 0 0"/></body>
<body name="ball" pos="0 -0.5 0.0299"><freejoint/>
<geom name="ball" type="sphere" size="0.03" mass="0.1"/></body></worldbody>
<contact><pair geom1="floor" geom2="ball" friction="0.4 0.4 0.005 0.0001 0.0001"/></contact>
<equality><weld body1="arm" body2="held" relpose="0.4 0 0 1 0 0 0"/></equality>
<actuator><position joint="hinge" kp="20" kv="1"/></actuator></mujoco>"""

# The robot without contacts.
ARM = (Path(__file__).parents[2] / "crates/world/assets/panda.xml").read_text()
ARM = ARM.replace("<worldbody>", '<option><flag contact="disable"/></option><worldbody>', 1)

DERIVED = [
    "body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "dof_length", "actuator_acc0"
]


def change_geom_friction(model):
    model.geom_friction[:, 0] *= 1.5


def change_pair_friction(model):
    model.pair_friction[:, :2] *= 1.5


def change_mass(model):
    held = model.body("held").id
    model.body_mass[held] *= 2
    model.body_inertia[held] *= 2


def change_damping(model):
    model.dof_damping[0] += 5


def change_gain(model):
    model.actuator_gainprm[0, 0] *= 1.2
    model.actuator_biasprm[0, :3] *= 1.2


def change_size(model):
    box = model.body("box").id
    geom, factor = model.body_geomadr[box], 1.05
    for array in (model.geom_size, model.geom_pos, model.geom_aabb, model.geom_rbound):
        array[geom] *= factor
    model.site_pos[0] *= factor
    model.body_ipos[box] *= factor
    model.body_inertia[box] *= factor * factor


def change_payload(model):
    arm = model.body("arm").id
    own = model.body_mass[arm]
    model.body_mass[arm] += 0.4
    model.body_gravcomp[arm] *= own / (own + 0.4)


def change_gravity(model):
    (x, _, z), (sin, cos) = model.opt.gravity, (np.sin(0.04), np.cos(0.04))
    model.opt.gravity[:] = [cos * x - sin * z, 0, sin * x + cos * z]


def change_weld(model):
    model.eq_data[0, 5] += 0.005


CHANGES = [
    (change_geom_friction, ["geom_friction"]),
    (change_pair_friction, ["pair_friction"]),
    (change_mass, ["body_mass", "body_inertia", *DERIVED]),
    (change_damping, ["dof_damping"]),
    (change_gain, ["actuator_gainprm", "actuator_biasprm"]),
    (
        change_size,
        [
            "geom_size", "geom_pos", "geom_aabb", "geom_rbound", "body_inertia", "body_ipos",
            "site_pos", *DERIVED
        ],
    ),
    (change_payload, ["body_mass", "body_gravcomp", *DERIVED]),
    (change_gravity, ["opt.gravity"]),
    (change_weld, ["eq_data"]),
]


def state_of(model, data):
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    return state


@unittest.skipIf(batches is None, "needs the extra gpu")
class Physics(unittest.TestCase):
    def contacts(self, flag):
        model = batches.compile_model(TWO_BOXES, 0.002)
        if not flag:
            model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
        warp_model, data = mjw.put_model(model), mjw.put_data(model, mujoco.MjData(model))
        batches.step(warp_model, data, lambda: None)
        return int(data.nacon.numpy()[0])

    def test_other_versions_of_the_packages_are_refused(self):
        for package, module in (("mujoco", batches.mujoco), ("mujoco-warp", batches.mjw)):
            with unittest.mock.patch.object(module, "__version__", "3.16.1"):
                with self.assertRaisesRegex(
                    RuntimeError, f"package {package} 3.17.0, found 3.16.1"
                ):
                    batches.compile_model(TWO_BOXES, 0.002)

    def test_all_episodes_have_the_length_of_the_audit(self):
        for task in audit.TASKS:
            simulator = _native.Simulator(task, 1, preset="paper", reward="shaped", threads=1)
            self.assertEqual(simulator.episode_steps, audit.EPISODE_STEPS, task)

    def test_two_boxes_have_as_many_contacts_as_in_mujoco_c(self):
        plain = mujoco.MjModel.from_xml_string(TWO_BOXES)
        data = mujoco.MjData(plain)
        mujoco.mj_forward(plain, data)
        with batches.wp.ScopedDevice("cpu"):
            without, corrected = self.contacts(False), self.contacts(True)
        # The overlap of the two faces is an octagon.
        self.assertEqual((data.ncon, without, corrected), (8, 4, 8))

    def test_a_weld_uses_the_velocities_of_the_present_state(self):
        model = batches.compile_model(WELDED, 1 / 240)
        slow, fast, rotated = mujoco.MjData(model), mujoco.MjData(model), 5.0
        for data, speed in ((slow, 0.0), (fast, rotated)):
            data.qvel[0] = speed
            data.qvel[1:4] = [0.0, 0.5 * speed, 0.0]
            data.qvel[6] = speed
        expected = mujoco.MjData(model)
        mujoco.mj_setState(
            model, expected, state_of(model, fast), mujoco.mjtState.mjSTATE_INTEGRATION
        )
        mujoco.mj_step(model, expected)
        found = {}
        with batches.wp.ScopedDevice("cpu"):
            for name, step in (
                ("corrected", lambda m, d: batches.step(m, d, lambda: None)), ("plain", mjw.step)
            ):
                # The data hold the velocities of another state, as after a reset of the row.
                warp_model, data = mjw.put_model(model), mjw.put_data(model, slow)
                step(warp_model, data)
                for target, value in (
                    (data.qpos, fast.qpos), (data.qvel, fast.qvel),
                    (data.qacc_warmstart, 0 * fast.qvel)
                ):
                    target.assign(np.array([value], dtype=np.float32))
                step(warp_model, data)
                found[name] = np.abs(data.qvel.numpy()[0] - expected.qvel).max()
        self.assertLess(found["corrected"], 1e-4)
        self.assertGreater(found["plain"], 100 * found["corrected"])

    def test_servos_brake_as_in_mujoco_c(self):
        """Random states of the arm near its velocity limits: the kernel and a second implementation
        give the same controls."""
        model = batches.compile_model(ARM, 1 / 480)
        servos = [[i, i, 2.175 if i < 4 else 2.61, 87 if i < 4 else 12] for i in range(7)]
        random, rows = np.random.default_rng(0), 64
        batch = batches.WarpBatch(ARM, 1 / 480, rows, 1, servos, device="cpu")
        data, states, targets = mujoco.MjData(model), [], []
        limits = np.array(servos)[:, 2]
        for _ in range(rows):
            mujoco.mj_resetData(model, data)
            data.qpos[:7] = random.uniform(*model.jnt_range[:7].T)
            directions = random.choice([-1, 1], 7)
            data.qvel[:7] = limits * directions * random.uniform(0.9, 1, 7)
            states.append(state_of(model, data))
            targets.append(data.qpos[:7] + directions)
        batch.write_states(np.arange(rows, dtype=np.int32), np.array(states))
        batch.arrays()["inputs"][:, :7] = targets
        batch.step()
        found, braking = batch.data.ctrl.numpy()[:, :7], 0
        for row in range(rows):
            mujoco.mj_setState(model, data, states[row], mujoco.mjtState.mjSTATE_INTEGRATION)
            mujoco.mj_step1(model, data)
            expected = batches.servo_rule.find_controls(np.array(servos), targets[row], model, data)
            q = data.qpos[:7].copy()
            braking += np.abs(
                expected - q - np.clip(targets[row] - q, -limits / 5, limits / 5)
            ).max() > 1e-6
            self.assertLess(np.abs(found[row] - expected).max(), 2e-4)
            # No joint that moves freely exceeds its limit.
            data.ctrl[:7] = expected
            mujoco.mj_step2(model, data)
            self.assertLess((np.abs(data.qvel[:7]) / limits).max(), 1.02)
        self.assertGreater(braking, rows // 16)

    def test_an_overflow_is_the_status_of_its_row_and_lasts_one_control_step(self):
        model = mujoco.MjModel.from_xml_string(TWO_BOXES)
        batch = batches.WarpBatch(TWO_BOXES, 0.002, 2, 3, [], device="cpu", constraint_rows=8)
        data = mujoco.MjData(model)
        touching = state_of(model, data)
        data.qpos[2] = 2.0
        flying = state_of(model, data)
        batch.write_states(np.array([0, 1], dtype=np.int32), np.array([touching, flying]))
        batch.step()
        self.assertEqual(list(batch.arrays()["outputs"][:, -1]), [2.0, 0.0])
        batch.write_states(np.array([0], dtype=np.int32), np.array([flying]))
        batch.step()
        self.assertEqual(list(batch.arrays()["outputs"][:, -1]), [0.0, 0.0])

    def test_a_divergence_is_the_status_of_its_row(self):
        model = mujoco.MjModel.from_xml_string(TWO_BOXES)
        batch = batches.WarpBatch(TWO_BOXES, 0.002, 2, 3, [], device="cpu")
        data = mujoco.MjData(model)
        data.qpos[2] = 2.0
        flying = state_of(model, data)
        data.qvel[0] = np.nan
        batch.write_states(
            np.array([0, 1], dtype=np.int32), np.array([state_of(model, data), flying])
        )
        batch.step()
        self.assertEqual(list(batch.arrays()["outputs"][:, -1]), [1.0, 0.0])

    def test_an_unknown_device_is_an_error_that_names_the_known_ones(self):
        with self.assertRaisesRegex(
            RuntimeError, "no device 'tpu' of MISHANDLE_GPU_DEVICE; expected one of cpu"
        ):
            batches.find_device("tpu")

    def test_a_device_that_does_not_finish_a_step_is_an_error(self):
        batch = batches.WarpBatch(TWO_BOXES, 0.002, 2, 3, [], device="cpu")
        batch.step()
        batch._control_step = lambda: None
        with self.assertRaisesRegex(RuntimeError, "did not finish"):
            batch.step()

    def one_step(self, models, fields, force):
        """Takes one physics step of CHANGEABLE in MuJoCo Warp and C, with one row per model.
        Returns the velocities of both.

        Everything moves, touches something or is welded.
        """
        rows, pushed = len(models), [models[0].body("held").id]
        batch = batches.WarpBatch(
            CHANGEABLE, 1 / 240, rows, 1, [[0, 0, 50, 1e9]], pushed, fields, device="cpu"
        )
        data = mujoco.MjData(models[0])
        data.qpos[0], data.qvel[0] = 0.1, 0.5
        for body in ("box", "ball"):
            data.qvel[models[0].joint(models[0].body(body).jntadr[0]).dofadr[0]] = 0.3
        states = np.tile(state_of(models[0], data), (rows, 1))
        batch.write_states(np.arange(rows, dtype=np.int32), states)
        # The first row keeps the constants of the document.
        values = [
            np.concatenate([batches.attribute(model, name).ravel() for name in fields])
            for model in models[1:]
        ]
        batch.write_fields(np.arange(1, rows, dtype=np.int32), np.array(values))
        buffers = batch.arrays()
        buffers["inputs"][:], buffers["active"][:], buffers["forces"][:] = 0.12, 1, force
        batch.step()
        nq, nv = models[0].nq, models[0].nv
        expected = np.zeros((rows, nv))
        for row, model in enumerate(models):
            data = mujoco.MjData(model)
            mujoco.mj_setState(model, data, states[row], mujoco.mjtState.mjSTATE_INTEGRATION)
            data.ctrl[0] = 0.12
            data.xfrc_applied[pushed, :3] = force
            mujoco.mj_step(model, data)
            expected[row] = data.qvel
        return buffers["outputs"][:, nq : nq + nv], expected

    def test_one_step_of_changed_worlds_agrees_with_changed_models_of_mujoco_c(self):
        for change, fields in CHANGES:
            models = [batches.compile_model(CHANGEABLE, 1 / 240) for _ in range(3)]
            for model in models[1:]:
                change(model)
            change(models[2])
            if "body_invweight0" in fields:
                for model in models[1:]:
                    mujoco.mj_setConst(model, mujoco.MjData(model))
            found, expected = self.one_step(models, fields, [0.0, 0.0, 0.0])
            with self.subTest(change=change.__name__):
                # The velocities reach 0.5, and 32-bit numbers have 3e-8 there.
                self.assertLess(np.abs(found - expected).max(), 1e-5)
                # Otherwise a world without its constants would pass.
                for row in (1, 2):
                    self.assertGreater(np.abs(expected[row] - expected[row - 1]).max(), 1e-3)

    def test_a_push_accelerates_a_body_as_in_mujoco_c(self):
        models = [batches.compile_model(CHANGEABLE, 1 / 240) for _ in range(2)]
        found, expected = self.one_step(models, ["eq_data"], [1.0, -2.0, 0.5])
        _, without = self.one_step(models, ["eq_data"], [0.0, 0.0, 0.0])
        self.assertLess(np.abs(found - expected).max(), 1e-5)
        self.assertGreater(np.abs(expected - without).max(), 1e-2)

    def test_fields_that_worlds_share_are_an_error(self):
        with self.assertRaisesRegex(RuntimeError, "cannot vary geom_type.*use MuJoCo C"):
            batches.WarpBatch(TWO_BOXES, 0.002, 2, 3, [], [], ["geom_type"], device="cpu")


AUDIT = """
import json, sys
from mishandle.gpu import audit, batches
# Kernels without optimization compile in about half of the time.
batches.wp.config.optimization_level = 0
states, episodes, tolerance = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
space, formula = sys.argv[4:6]
compile_model = batches.compile_model
def compile_exactly(*arguments):
    model = compile_model(*arguments)
    model.opt.tolerance = min(model.opt.tolerance, tolerance)
    return model
batches.compile_model = compile_exactly
settings = {"states": states, "episodes": episodes, "space": space, "formula": formula}
found = {task: audit.audit(task, **settings) for task in sys.argv[6:]}
parts = lambda result: [result.states, result.overflows, result.differences]
print(json.dumps({task: parts(result) for task, result in found.items()}))
"""


@unittest.skipIf(batches is None, "needs the extra gpu")
class OneStep(unittest.TestCase):
    """One physics step of MuJoCo Warp against one of MuJoCo C, from states of episodes."""

    # Bounds of the 99 % quantile and of the maximum of the largest difference of a position, and
    # the same of a velocity. They are about five times those of 1,000 states. 32-bit numbers have
    # 6e-8.
    BOUNDS = {
        "point-reaching": ((1.1e-6, 1.2e-6), (5e-6, 9e-6)),
        "cube-stacking": ((3.3e-5, 1.3e-4), (1.7e-2, 6e-2)),
        "ball-balancing": ((2.8e-6, 1.3e-5), (6.5e-4, 3.4e-3)),
        "ball-catching": ((2.9e-5, 2e-4), (2.8e-2, 6e-1)),
        "ball-pushing": ((1.1e-6, 1.1e-5), (1.3e-4, 5e-3)),
        # In single states the arm differs by much more than in 99 % of them.
        "door-opening": ((1.7e-6, 1e-4), (3.8e-4, 5e-2)),
        # A bound of the maximum would say nothing: in some states the colliders of the engines find
        # other contacts between cylinder and box, and then a velocity differs by up to 5 m/s. So
        # the peg's are those of the 80 % quantile.
        "peg-in-hole": ((1.9e-5, None), (1.3e-2, None)),
        "cloth-placing": ((2.9e-5, 5e-5), (7e-3, 1.2e-2)),
    }

    # The 99 % quantile of forces and of the motion of the arm, each divided by 1 plus its value.
    MANNER_BOUNDS = {
        "cube-stacking": (2e-4, 2e-5),
        "peg-in-hole": (2e-3, 2e-3),
        "door-opening": (1e-2, 3e-3),
        "ball-balancing": (2e-3, 3e-5),
    }

    @classmethod
    def setUpClass(cls):
        # Several processes, because most of the time is compilation, on one core. A step of the
        # cloth is slow, so it has fewer states.
        rigid = [task for task in cls.BOUNDS if task != "cloth-placing"]
        cls.processes = [
            cls.start("starts", rigid, 200, 10),
            # At the cloth's own tolerance of 1e-3, each engine stops elsewhere.
            cls.start("starts", ["cloth-placing"], 20, 2, tolerance=1e-5)
        ]
        cls.loose = cls.start("starts", ["cloth-placing"], 20, 2)
        cls.changed = cls.start(
            "starts+dynamics+events", ["ball-balancing", "cube-stacking"], 100, 10
        )
        cls.manner = cls.start("starts", list(cls.MANNER_BOUNDS), 200, 10, formula="careful")

    @classmethod
    def start(cls, space, tasks, states, episodes, formula="success", tolerance=1.0):
        numbers = [str(number) for number in (states, episodes, tolerance)]
        command = [sys.executable, "-c", AUDIT, *numbers, space, formula, *tasks]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def found(self, processes):
        """Returns the number of states, of overflows, and the differences of each task."""
        found = {}
        for process in processes:
            output, errors = process.communicate()
            self.assertEqual(process.returncode, 0, errors)
            found.update(json.loads(output))
        return found

    def test_one_step_from_states_of_episodes_agrees_with_mujoco_c(self):
        found = self.found(self.processes)
        self.assertEqual(set(found), set(audit.TASKS))
        for task, (states, _, _) in found.items():
            self.assertEqual(states, 20 if task == "cloth-placing" else 200, task)
        self.check(found)

    def test_the_solver_of_the_cloth_stops_no_earlier_than_that_of_mujoco_c(self):
        # MuJoCo C is off by 0.022 m/s in the worst of these states, and by 0.005 m/s in the median.
        found = self.found([self.loose])
        _, _, differences = found["cloth-placing"]
        early, early_c = (differences[name] for name in ("early", "early C"))
        self.assertLess(max(early), max(early_c))
        self.assertLess(statistics.median(early), statistics.median(early_c))

    def test_one_step_with_changed_constants_and_events_agrees_with_mujoco_c(self):
        found = self.found([self.changed])
        self.assertEqual([states for states, _, _ in found.values()], [100, 100])
        self.check(found)

    def test_forces_and_motion_of_one_step_agree_with_mujoco_c(self):
        found = self.found([self.manner])
        self.assertEqual(set(found), set(self.MANNER_BOUNDS))
        self.check(found)
        for task, (_, _, differences) in found.items():
            # Many states have contacts.
            self.assertGreater(sum(force > 1 for force in differences["force"]), 20, task)
            for name, bound in zip(("forces", "motion"), self.MANNER_BOUNDS[task]):
                with self.subTest(task=task, quantity=name):
                    self.assertLess(np.quantile(differences[name], 0.99), bound)

    def check(self, found):
        for task, (_, overflows, differences) in found.items():
            self.assertEqual(overflows, 0, task)
            for name, (bound, largest) in zip(("qpos", "qvel"), self.BOUNDS[task]):
                with self.subTest(task=task, quantity=name):
                    self.assertLess(
                        np.quantile(differences[name], 0.8 if largest is None else 0.99), bound
                    )
                    if largest is not None:
                        self.assertLess(max(differences[name]), largest)


@unittest.skipIf(batches is None, "needs the extra gpu")
class Networks(unittest.TestCase):
    ACTIVATIONS = {
        "elu": (lambda x: np.where(x > 0, x, np.expm1(x)), lambda y: np.where(y > 0, 1, y + 1)),
        "tanh": (np.tanh, lambda y: 1 - y * y),
        "relu": (lambda x: np.maximum(x, 0), lambda y: np.where(y > 0, 1, 0)),
        "leaky_relu": (lambda x: np.where(x > 0, x, 0.01 * x), lambda y: np.where(y > 0, 1, 0.01)),
    }

    def check(self, sizes, activation, rows):
        """Compares both passes with the same ones of NumPy in 64 bits."""
        network = networks.WarpNetwork(sizes, activation, rows)
        floats = ctypes.POINTER(ctypes.c_float)
        buffers = {
            name: np.ctypeslib.as_array(ctypes.cast(address, floats), (length,))
            for name, (address, length) in network.buffers().items()
        }
        random = np.random.default_rng(0)
        for name, scale in (("parameters", 0.2), ("inputs", 1.0), ("output_gradient", 1 / rows)):
            buffers[name][:] = scale * random.normal(size=buffers[name].size)
        network.forward()
        network.backward()

        y, derivative = self.ACTIVATIONS[activation]
        parameters = buffers["parameters"].astype(np.float64)
        values, weights, offset = [buffers["inputs"].reshape(rows, -1).astype(np.float64)], [], 0
        for layer, (inputs, outputs) in enumerate(zip(sizes[:-1], sizes[1:])):
            weight = parameters[offset : offset + inputs * outputs].reshape(outputs, inputs)
            offset += inputs * outputs
            z = values[-1] @ weight.T + parameters[offset : offset + outputs]
            offset += outputs
            weights.append(weight)
            values.append(z if layer == len(sizes) - 2 else y(z))
        np.testing.assert_allclose(buffers["outputs"].reshape(rows, -1), values[-1], atol=1e-5)
        gradient, expected = buffers["output_gradient"].reshape(rows, -1).astype(np.float64), []
        for layer in reversed(range(len(weights))):
            expected = [(gradient.T @ values[layer]).ravel(), gradient.sum(axis=0), *expected]
            gradient = (gradient @ weights[layer]) * derivative(values[layer])
        np.testing.assert_allclose(
            buffers["parameter_gradient"], np.concatenate(expected), atol=1e-6
        )

    def test_both_passes_agree_with_numpy(self):
        # Sizes below, at and above those of the tiles, and more rows than one tile for each part.
        for sizes, activation, rows in (
            ((30, 128, 128, 9), "elu", 1100),
            ((30, 64, 32, 1), "tanh", 8),
            ((5, 33, 7), "relu", 65),
            ((40, 20, 3), "leaky_relu", 130),
        ):
            with self.subTest(sizes=sizes, activation=activation, rows=rows):
                self.check(sizes, activation, rows)


@unittest.skipIf(batches is None, "needs the extra gpu")
class Training(FolderCase):
    SETTINGS = """
        rollout_steps = 8
        minibatch_size = 100
        run.total_steps = {steps}
        run.validation_episodes = 4
        episodes.environments = 32
    """

    def train(self, name, steps, *options, task="cube-stacking", settings=SETTINGS):
        path = self.folder / f"{name}-{steps}.toml"
        path.write_text(settings.format(steps=steps))
        files = self.folder / name
        outputs = ["--out", f"{files}.safetensors", "--csv", f"{files}.csv", "--json"]
        command = ["train", task, "--settings", path, *outputs, *options]
        result = subprocess.run(
            [sys.executable, "-c", verdicts.COMMAND, *command], capture_output=True, text=True
        )
        self.assertEqual(result.returncode, 0, result.stderr)
        with open(f"{files}.csv") as file:
            return json.loads(result.stdout), list(csv.DictReader(file))

    def test_a_training_run_is_close_to_that_of_the_cpu_and_can_be_resumed(self):
        _, expected = self.train("cpu", 512)
        self.train("gpu", 256, "-k", "train.device=gpu")
        document, found = self.train("gpu", 512, "-k", "train.device=gpu", "--resume")
        self.assertEqual(document["device"], "gpu")
        for column in ("kl", "entropy", "validation_return"):
            numbers = [float(rows[-1][column]) for rows in (found, expected)]
            np.testing.assert_allclose(*numbers, rtol=1e-2, err_msg=column)

    def test_contact_forces_cost_about_as_much_as_on_the_cpu(self):
        # One rollout of a controller that brings the peg to the block.
        settings = self.SETTINGS.replace(
            "rollout_steps = 8",
            "rollout_steps = 100\nrewards.contact_force = 1\npolicy.hidden = [128, 128]"
        )
        settings = settings.replace("environments = 32", "environments = 8")
        costs = []
        for device in ("cpu", "gpu"):
            options = ("-k", f"train.device={device}", "--from", "ppo")
            _, rows = self.train(device, 800, *options, task="peg-in-hole", settings=settings)
            costs.append(float(rows[0]["reward_contact_force"]))
        self.assertLess(costs[0], -0.1)
        # Impacts amplify rounding: the means of 800 control steps differ by 4 %.
        np.testing.assert_allclose(costs[1], costs[0], rtol=0.15)


@unittest.skipIf(batches is None, "needs the extra gpu")
class Commands(unittest.TestCase):
    def run_command(self, *arguments):
        subject = ["point-reaching", "--controller", "ppo", "--action-noise", "1", "--json"]
        if arguments[0] == "simulate":
            return json.loads(verdicts.command(arguments[0], *subject, *arguments[1:]))
        with tempfile.TemporaryDirectory() as folder:
            out = ["--out", f"{folder}/run.sqlite"]
            found = json.loads(verdicts.command(arguments[0], *subject, *arguments[1:], *out))
            if arguments[0] == "falsify":
                replayed = verdicts.command("replay", f"{folder}/run.sqlite", "--json")
                self.assertEqual(json.loads(replayed)["differences"], [])
            return found

    def test_mujoco_c_has_the_robustness_of_each_counterexample_of_falsify(self):
        options = (
            "--search random --trials 3 --budget 8 --seed 3 -k report.repeats=0 "
            "-k screening.device=gpu -k screening.rows=24 "
            "-k screening.confirm=0.1"
        )
        found = self.run_command("falsify", *options.split())
        self.assertEqual(found["screening"]["device"], "gpu")
        falsified = [trial for trial in found["trials"] if trial["falsified"]]
        self.assertGreater(len(falsified), 0)
        self.assertEqual(found["screening"]["reasons"]["violated"]["violations"], len(falsified))
        for trial in falsified:
            at = ",".join(f"{name}={value!r}" for name, value in trial["scenario"].items())
            again = self.run_command("simulate", "--at", at, "--seed", trial["seed"])
            self.assertEqual(again["robustness"], trial["minimum_robustness"])

    def test_mujoco_warp_and_mujoco_c_agree_on_most_simulations_with_changed_constants_and_events(
        self
    ):
        options = (
            "--space starts+dynamics+events --simulations 100 -k risk.method=monte-carlo --seed 3 "
            "--formula"
        )
        formula = "always[285:300](finger_target_distance <= 0.03)"
        found = self.run_command(
            "risk", *options.split(), formula, "-k", "screening.device=gpu", "-k",
            "screening.rows=100", "-k", "screening.confirm=1"
        )
        screening, failures = found["screening"], found["screening"]["findings"]["failure"]
        self.assertEqual((screening["simulations"], screening["without_verdict"]), (100, 0))
        self.assertGreater(screening["flagged"], 10)
        self.assertGreater(screening["audit_sample"], 10)
        refuted = screening["flagged"] - failures["flagged"]
        self.assertLessEqual(refuted + failures["audit_sample"], 3)

    def test_evaluate_finds_the_same_success_rate_as_mujoco_c_if_that_repeats_everything(self):
        options = ["--episodes", "20", "--seed", "4"]
        found = self.run_command(
            "evaluate", *options, "-k", "screening.device=gpu", "-k", "screening.rows=20", "-k",
            "screening.confirm=1"
        )
        expected = self.run_command("evaluate", *options)
        self.assertAlmostEqual(
            found["success_rate"]["value"], expected["success_rate"]["value"], places=12
        )
        # A screening leaves careful success out.
        corners = expected["corners"]
        corners = {
            name: value for name, value in corners.items()
            if not name.startswith("careful") and name != "center_carefully_succeeds"
        }
        corners["points"] = [
            {name: value for name, value in point.items() if "careful" not in name}
            for point in corners["points"]
        ]
        self.assertEqual(found["corners"], corners)


CART_POLE = """<mujoco><option timestep="0.005" integrator="INTEGRATOR"/><worldbody>
<body name="cart"><joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
<geom type="box" size="0.15 0.1 0.06" mass="1"/>
<body name="pole"><joint name="hinge" axis="0 1 0" damping="0.002"/>
<geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1"/>
<site name="tip" pos="0 0 0.6"/></body></body>
<body name="goal" mocap="true"><geom size="0.01" contype="0" conaffinity="0"/></body></worldbody>
<actuator>
<general joint="slide" ctrllimited="true" ctrlrange="-8 8" dyntype="filter" dynprm="0.02"/>
</actuator></mujoco>"""

CART_POLE_FILE = """
format = 1
name = "cart-pole"
model.file = "cart-pole.xml"
control = { period = 0.02, steps = 100 }
start = { hinge = "tilt" }
observation = { state = "[*qpos('slide') - body_pos('goal')[0], *qvel('slide'), \
*qpos('hinge'), *qvel('hinge')]" }
policy = { expression = "dot([1, 2, 25, 4], state)", action = "action" }
signals = { angle = "abs(qpos('hinge'))[0]", height = "site_pos('tip')[2]" }
formulas = { upright = "always(angle <= 0.2) and always(height >= 0.3)" }

[axes]
tilt = { range = [-0.3, 0.3], unit = "rad" }
pole = { kind = "model", range = [0.5, 4], scale = "body_mass('pole')" }
gust = { kind = "event", body = "pole", time = [0, 1], duration = [0.05, 0.2], x = [-2, 2] }
move = { kind = "event", jump = "goal", time = [0, 1], x = [-0.5, 0.5] }
"""


@unittest.skipIf(batches is None, "needs the extra gpu")
class RobotsInFiles(FolderCase):
    def risk(self, integrator):
        (self.folder / "cart-pole.xml").write_text(CART_POLE.replace("INTEGRATOR", integrator))
        path = self.folder / "cart-pole.toml"
        path.write_text(CART_POLE_FILE)
        question = (
            "--space starts+dynamics+events --simulations 100 -k risk.method=monte-carlo "
            "--seed 3 --json"
        )
        screening = "-k screening.device=gpu -k screening.rows=40 -k screening.confirm=1"
        screening += f" --out {self.folder}/run.sqlite"
        return json.loads(verdicts.command("risk", path, *question.split(), *screening.split()))

    def test_mujoco_warp_and_mujoco_c_agree_on_most_simulations(self):
        found = self.risk("implicitfast")["screening"]
        failures = found["findings"]["failure"]
        self.assertEqual((found["simulations"], found["without_verdict"]), (100, 0))
        self.assertGreater(found["flagged"], 10)
        self.assertGreater(found["audit_sample"], 10)
        refuted = found["flagged"] - failures["flagged"]
        self.assertLessEqual(refuted + failures["audit_sample"], 2)

    def test_another_integrator_is_an_error_that_names_its_key(self):
        with self.assertRaisesRegex(RuntimeError, r"`integrator = \"implicitfast\"` in \[model\]"):
            self.risk("Euler")


class WithoutTheExtra(unittest.TestCase):
    def test_the_error_says_what_to_install(self):
        code = "import sys; sys.modules['warp'] = None; import mishandle.gpu.batches"
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertIn("pip install '.[gpu]' in a clone", result.stderr)

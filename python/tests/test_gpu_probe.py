"""Tests of the measurements of the device ``gpu``, with the kernels of MuJoCo Warp on the CPU."""

import os
import unittest

import numpy as np

os.environ["MISHANDLE_GPU_DEVICE"] = "cpu"
try:
    import mujoco
    from mishandle.gpu import audit, batches, probe as probes
except ImportError:
    batches = None

FINGERS, ARM, OBJECT, GROUND, FIXTURE = range(5)
FIXTURE_FORCE, GROUND_FORCE, SELF_FORCE, OBJECT_FORCE, ARM_OBJECT_FORCE, TOUCH_FORCE = range(6)
FORCES = 6

# A floor, a post, the stand of an arm of two links whose last one is a finger, and an object.
SCENE = """<mujoco><compiler angle="radian"/>
<option integrator="implicitfast" cone="{cone}"/><worldbody>
<geom type="plane" size="2 2 0.1"/>
<geom type="box" pos="0.75 0 0.1" size="0.05 0.05 0.1"/>
<geom type="box" pos="0.25 0 0.1" size="0.05 0.05 0.1"/>
<body name="arm" pos="0 0 0.35"><joint name="first" axis="0 1 0" range="-3 1.5"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
<body name="hand" pos="0.4 0 0"><joint name="second" axis="0 1 0" range="-3 2.5"/>
<geom type="capsule" fromto="0.1 0 0 0.3 0 0" size="0.02" mass="0.3"/>
<site name="tool" pos="0.3 0 0.01"/></body></body>
<body name="object" pos="0.5 0 0.05"><freejoint/>
<geom type="box" size="0.05 0.05 0.05" mass="0.5"/></body></worldbody>
<equality><weld body1="hand" body2="object" relpose="0.372 0 0 1 0 0 0" active="false"/></equality>
<actuator><position joint="first" kp="200" kv="10" forcerange="-40 40"/>
<position joint="second" kp="100" kv="5"/></actuator></mujoco>"""

# A ball of 2 kg that rests on the arm, a plate that is fixed.
WEIGHT = """<mujoco><option integrator="implicitfast" cone="{cone}"/><worldbody>
<body name="arm"><geom type="box" size="0.2 0.2 0.05"/><site name="tool"/></body>
<body name="object" pos="0 0 0.1"><freejoint/>
<geom type="sphere" size="0.05" mass="2" condim="{condim}"/></body>
</worldbody></mujoco>"""

CONES = ("pyramidal", "elliptic")


def pairs():
    """Returns the forces of each pair of parts as bits, written by hand: robot and fixture, and so
    on."""
    robot, held = (FINGERS, ARM), []
    for holds in (False, True):
        bits = np.zeros((5, 5), dtype=int)
        for first in range(5):
            for second in range(5):
                pair = {first, second}
                touches = pair & set(robot) or (holds and OBJECT in pair)
                if touches and FIXTURE in pair:
                    bits[first, second] |= 1 << FIXTURE_FORCE
                if touches and GROUND in pair:
                    bits[first, second] |= 1 << GROUND_FORCE
                if pair <= set(robot):
                    bits[first, second] |= 1 << SELF_FORCE
                if pair & set(robot) and OBJECT in pair:
                    bits[first, second] |= 1 << OBJECT_FORCE
                if pair == {ARM, OBJECT}:
                    bits[first, second] |= 1 << ARM_OBJECT_FORCE
                if pair & set(robot) and not (holds and OBJECT in pair):
                    bits[first, second] |= 1 << TOUCH_FORCE
        held.append(bits.ravel().tolist())
    return held


@unittest.skipIf(batches is None, "needs the extra gpu")
class Readings(unittest.TestCase):
    def probe(self, model, geoms, weld, joints):
        return {
            "geoms": geoms,
            "flexes": [],
            "pairs": pairs(),
            "weld": weld,
            "body": int(model.site_bodyid[0]),
            "site": 0,
            "joints": joints,
        }

    def test_a_resting_ball_presses_with_its_weight(self):
        for cone in CONES:
            for condim in (1, 3, 4, 6):
                document = WEIGHT.format(cone=cone, condim=condim)
                model = batches.compile_model(document, 1 / 240)
                data = mujoco.MjData(model)
                for _ in range(2000):
                    mujoco.mj_step(model, data)
                state = np.zeros(mujoco.mj_stateSize(model, audit.STATE))
                mujoco.mj_getState(model, data, state, audit.STATE)
                probe = self.probe(model, [ARM, OBJECT], -1, [])
                batch = batches.WarpBatch(document, 1 / 240, 3, 5, [], probe=probe, device="cpu")
                batch.write_states(np.arange(3, dtype=np.int32), np.tile(state, (3, 1)))
                for _ in range(2):
                    # The second control step starts again at 0.
                    batch.step()
                    readings = batch.arrays()["outputs"][:, -probes.READINGS - 1 : -1]
                    expected = np.zeros(2 * FORCES)
                    expected[[OBJECT_FORCE, ARM_OBJECT_FORCE, TOUCH_FORCE]] = 2 * 9.81
                    expected[FORCES:] = 5 * expected[:FORCES]
                    np.testing.assert_allclose(
                        readings[:, : 2 * FORCES], np.tile(expected, (3, 1)), rtol=1e-4,
                        err_msg=f"{cone} {condim}"
                    )

    def states(self, model, rows):
        """Returns random states of the arm in which it may touch anything."""
        random, data, states = np.random.default_rng(3), mujoco.MjData(model), []
        while len(states) < rows:
            mujoco.mj_resetData(model, data)
            data.qpos[:2] = random.uniform([-0.3, -1], [1.2, 1.5])
            if random.random() < 0.02:
                # The first link touches the stand.
                data.qpos[0] = random.uniform(0.372, 0.385)
            data.qvel[:2] = random.normal(size=2)
            mujoco.mj_kinematics(model, data)
            if len(states) % 2 == 0:
                # The hand holds the object.
                hand = data.body("hand")
                data.qpos[2:5], data.qpos[5:] = (
                    hand.xpos + 0.372 * hand.xmat.reshape(3, 3)[:, 0], hand.xquat
                )
            else:
                data.qpos[2:5] = random.uniform([0.3, -0.02, 0.048], [0.8, 0.02, 0.5])
                data.qvel[2:5] = random.normal(size=3) * 0.2
            mujoco.mj_forward(model, data)
            # Deep overlaps have forces of an explosion.
            if data.ncon and data.contact.dist.min() > -0.004:
                state = np.zeros(mujoco.mj_stateSize(model, audit.STATE))
                mujoco.mj_getState(model, data, state, audit.STATE)
                states.append(state)
        return np.array(states)

    def readings(self, cone, substeps, rows):
        """Returns the readings of a control step from random states of MuJoCo Warp and of MuJoCo
        C."""
        document = SCENE.format(cone=cone)
        model = batches.compile_model(document, 1 / 480)
        geoms = [GROUND, FIXTURE, ARM, ARM, FINGERS, OBJECT]
        joints = [[0, 0, 0, -3, 1.5, 2, 10, 40], [1, 1, 1, -3, 2.5, 3, 20, 30]]
        servos = [[0, 0, 2, 40], [1, 1, 3, 100]]
        probe = self.probe(model, geoms, 0, joints)
        arguments = {"model": document, "timestep": 1 / 480, "servos": servos, "probe": probe}
        batch = batches.WarpBatch(**arguments, rows=rows, substeps=substeps, device="cpu")
        states, inputs = self.states(model, rows), batch.arrays()
        inputs["inputs"][:] = states[:, 1:3] + np.random.default_rng(4).uniform(
            -0.5, 0.5, (rows, 2)
        )
        inputs["active"][::2] = 1
        batch.write_states(np.arange(rows, dtype=np.int32), states)
        batch.step()
        physics, expected = audit.CpuPhysics(arguments), []
        for row in range(rows):
            physics.start(states[row], {**inputs, "fields": np.zeros((rows, 0))}, row)
            for substep in range(substeps):
                physics.step(inputs, row, substep)
            expected.append(physics.readings)
        self.assertTrue(np.all(inputs["outputs"][:, -1] == 0))
        return inputs["outputs"][:, -probes.READINGS - 1 : -1].astype(float), np.array(expected)

    def test_readings_of_random_states_are_those_of_mujoco_c(self):
        for cone in CONES:
            for substeps in (1, 4):
                found, expected = self.readings(cone, substeps, 400)
                # Every force occurs.
                touches = (expected[:, :FORCES] > 1).sum(axis=0)
                self.assertGreaterEqual(touches.min(), 10, touches)
                difference = np.abs(found - expected) / (1 + np.abs(expected))
                # About five times those of these states, and 32-bit numbers have 6e-8.
                self.assertLess(np.quantile(difference[:, : 2 * FORCES], 0.99), 3e-4)
                self.assertLess(difference[:, : 2 * FORCES].max(), 5e-3)
                self.assertLess(difference[:, 2 * FORCES :].max(), 3e-4)

    def test_a_probe_changes_no_bit_of_the_rest_of_an_output_row(self):
        document = SCENE.format(cone="elliptic")
        model, outputs = batches.compile_model(document, 1 / 480), []
        states = self.states(model, 10)
        for probe in (None, self.probe(model, [GROUND, FIXTURE, ARM, ARM, FINGERS, OBJECT], 0, [])):
            batch = batches.WarpBatch(document, 1 / 480, 10, 4, [], probe=probe, device="cpu")
            batch.write_states(np.arange(10, dtype=np.int32), states)
            batch.step()
            outputs.append(batch.arrays()["outputs"])
        without, measured = outputs
        np.testing.assert_array_equal(
            np.delete(measured, np.s_[-probes.READINGS - 1 : -1], axis=1), without
        )

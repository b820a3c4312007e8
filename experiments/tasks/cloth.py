"""What each choice in the cloth's model costs and gives, on one scripted placing.

    mishandle tasks cloth-placing --mjcf cloth.xml
    python experiments/tasks/cloth.py cloth.xml

The arm carries the cloth over a table, lowers it, lets go and waits; only the model's options differ. `us` is processor
time for a physics step in the last second, with the cloth at rest on the table; `steps/s` are control steps of 1/60 s
at that cost; `stretch` is the largest of any edge at any control step; `sinks` how far a vertex's sphere is in the
table's top at most; `rest` when the cloth's root mean square speed falls below 0.05 m/s for good, after letting go.
"""

import sys
import time

import mujoco
import numpy as np

CONTROL_DT = 1 / 60
START = np.array([0, 0, 0, -1, 0, 1, 0.5, 0.0001, 0.0001])
REACH = np.array([0.435] * 4 + [0.522] * 3 + [0.002] * 2)
TABLE = np.array([0.55, 0.15])
RELEASE, END = 108, 300

SOFT = 'solref="0.0085 1" solimp="0.95 0.95 0.001"'


def edges(solref, impedance):
    return (SOFT, f'solref="{solref} 1" solimp="{impedance} {impedance} 0.001"')


OURS = 'solver="CG" tolerance="1e-5" jacobian="sparse"'
VERTEX = 'contype="4"'
VARIANTS = {
    "ours: CG, tolerance 1e-5, 4 substeps": (4, []),
    "CG, tolerance 1e-8 (MuJoCo's)": (4, [(OURS, 'solver="CG" jacobian="sparse"')]),
    "CG, 10 iterations": (4, [(OURS, OURS + ' iterations="10"')]),
    "Newton (MuJoCo's)": (4, [(OURS, 'jacobian="sparse"')]),
    "Newton, dense Jacobian": (4, [(OURS, 'jacobian="dense"')]),
    "Newton, elliptic cone": (4, [(OURS, 'jacobian="sparse" cone="elliptic"')]),
    "Euler integrator": (4, [(OURS, OURS + ' integrator="Euler"')]),
    "discrete integrator": (4, [(OURS, OURS + ' integrator="discrete"')]),
    "2 substeps, edges half as fast": (2, [edges(0.0167, 0.95)]),
    "8 substeps, the same edges": (8, []),
    "8 substeps, edges twice as fast": (8, [edges(0.0042, 0.95)]),
    "edges of impedance 0.9": (4, [edges(0.0085, 0.9)]),
    "edges of impedance 0.99": (4, [edges(0.0085, 0.99)]),
    "vertices touch each other": (
        4,
        [('conaffinity="9"', 'conaffinity="13"'), ('conaffinity="8"/>', 'conaffinity="12"/>')],
    ),
    "triangles touch the table": (
        4,
        [
            ('<contact contype="0" conaffinity="0"/>', '<contact contype="4" conaffinity="8" selfcollide="none"/>'),
            (VERTEX, 'contype="0"'),
            ('conaffinity="9"/>', 'conaffinity="0"/>'),
            ('conaffinity="8"/>', 'conaffinity="0"/>'),
        ],
    ),
}


def posture(model, point):
    """Joint angles with the grasp point there, from the start posture, by damped least squares."""
    data, site = mujoco.MjData(model), model.site("grasp").id
    data.qpos[:9] = START
    jacobian = np.zeros((3, model.nv))
    for _ in range(200):
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        j = jacobian[:, :7]
        error = point - data.site_xpos[site]
        data.qpos[:7] += 0.5 * j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(3), error)
    return np.append(data.qpos[:7], START[7:])


def measure(document, substeps, changes):
    for old, new in changes:
        assert old in document, old
        document = document.replace(old, new)
    model = mujoco.MjModel.from_xml_string(document)
    model.opt.timestep = CONTROL_DT / substeps
    data = mujoco.MjData(model)
    data.qpos[:9] = START
    data.mocap_pos[0, :2] = TABLE
    above, low = (posture(model, np.append(TABLE, z)) for z in (0.72, 0.47))
    bodies = model.flex_vertbodyid
    pairs, lengths = model.flex_edge, model.flexedge_length0
    stretch = sinks = rest = 0.0
    cost = 0.0
    for step in range(END):
        lead = min(1.0, max(0.0, (step - 40) / 60))
        target = above if step < 40 else (1 - lead) * above + lead * low
        if step >= RELEASE:
            data.eq_active[1:] = 0
            target = np.append(target[:7], [0.04, 0.04])
        begin = time.process_time()
        for _ in range(substeps):
            data.ctrl[:9] = data.qpos[:9] + np.clip(target - data.qpos[:9], -REACH, REACH)
            mujoco.mj_step(model, data)
        if step >= END - 60:
            cost += time.process_time() - begin
        mujoco.mj_kinematics(model, data)
        vertices = data.xpos[bodies]
        stretch = max(stretch, (np.linalg.norm(np.diff(vertices[pairs], axis=1)[:, 0], axis=1) / lengths).max() - 1)
        on_top = np.abs(vertices[:, :2] - TABLE).max(axis=1) < 0.135
        sinks = max(sinks, (0.405 - vertices[on_top, 2]).max(initial=0))
        first = model.body_dofadr[bodies[0]]
        speed = np.sqrt((data.qvel[first:] ** 2).sum() / len(bodies))
        if step >= RELEASE and speed > 0.05:
            rest = (step + 1 - RELEASE) * CONTROL_DT
    us = 1e6 * cost / 60 / substeps
    over = ((np.abs(vertices[:, :2] - TABLE).max(axis=1) <= 0.15) & (vertices[:, 2] >= 0.4)).mean()
    off = np.linalg.norm(vertices.mean(axis=0)[:2] - TABLE)
    return us, 1e6 / (us * substeps), stretch, 1e3 * sinks, rest, over, off


def main():
    document = open(sys.argv[1]).read()
    print(f'{"":36} {"us":>6} {"steps/s":>8} {"stretch":>8} {"sinks mm":>9} {"rest s":>7} {"over":>5} {"off m":>6}')
    for name, (substeps, changes) in VARIANTS.items():
        us, rate, stretch, sinks, rest, over, off = measure(document, substeps, changes)
        figures = f"{us:6.0f} {rate:8.0f} {stretch:8.1%} {sinks:9.1f} {rest:7.2f} {over:5.2f} {off:6.3f}"
        print(f"{name:36} {figures}", flush=True)


main()

"""A swing of the shipped serial arm in MuJoCo, without dry friction; writes serial_arm_mujoco.json.

    pkm export serial_arm --format mjcf --out serial_arm.xml
    python make_serial_arm.py serial_arm.xml

Run with Python 3 and mujoco 3 or later. The arm starts at rest, its drives pushing with constant efforts; the rule is Runge-Kutta of order
four at 0.1 ms, whose error is far below what the test asks for (half the step changes positions by less than 1e-10 rad).
"""

import json
import pathlib
import sys

import mujoco
import numpy as np

START = [0.2, 0.3, -0.4, 0.5, -0.3, 0.1]
TAU = [4.0, -60.0, 10.0, 1.5, -2.0, 0.3]


def swing(path, step):
    model = mujoco.MjModel.from_xml_path(path)
    model.opt.timestep = step
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.dof_frictionloss[:] = 0
    data = mujoco.MjData(model)
    data.qpos[:] = START
    out = [data.qpos.copy()]
    for _ in range(5):
        for _ in range(round(0.1 / step)):
            data.qfrc_applied[:] = TAU
            mujoco.mj_step(model, data)
        out.append(data.qpos.copy())
    return np.array(out)


def main():
    q, finer = swing(sys.argv[1], 1e-4), swing(sys.argv[1], 5e-5)
    print("half the step changes", np.abs(q - finer).max(), "moves", np.abs(q[-1] - q[0]))
    out = {"mujoco": mujoco.__version__, "start": START, "tau": TAU, "every_s": 0.1, "q": finer.tolist()}
    pathlib.Path(__file__).with_name("serial_arm_mujoco.json").write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""Identify the log of a folder with one tool, as its documentation does it: peer_drivers.py TOOL FOLDER.

It runs in the environment of the tool, so this module needs numpy alone. A driver loads its tool, yields, identifies
the log, and yields a function of positions, velocities and accelerations (N, J) that gives its torques (N, J); again if
it identifies it several times. record.json gets the seconds, answers.npz what the tool says of the questions and of
other motion.
"""

import importlib.metadata
import json
import os
import pickle
import shutil
import sys
import time
from pathlib import Path

import numpy as np

#: Of pumaid and figaroh; the median counts.
REPEATS = 3


def pumaid(folder):
    """`pumaid identify` on a CSV log; what the first run loads, the ones that are timed need not load."""
    from pumaid import read_model
    from pumaid.cli import group
    from pumaid.exports.formulas import Formulas
    from pumaid.io.recipe import read_recipe

    recipe, model = folder / "recipe.yaml", folder / "model.json"
    words = ["identify", str(folder / "pumaid"), "--recipe", str(recipe), "-o", str(model)]
    gain = np.load(folder / "questions.npz")["gain"]

    def torque(position, velocity, acceleration):
        found = Formulas.of(read_model(model), read_recipe(recipe))
        slow = found.predicted(position, velocity) if velocity.any() else found.weight(position)
        return (slow + found.inertia(position, velocity, acceleration)) / gain

    for number in range(1 + REPEATS):
        shutil.rmtree(folder / "results", ignore_errors=True)
        group.main(words, standalone_mode=False)
        yield torque if number else None


def figaroh(folder):
    """A subclass that loads the log, then `solve` with weights, as documented.

    Its base class smooths the positions and differentiates them; a second at either end, where its filters are not
    settled, is left out. Least squares for the base parameters of the rigid bodies, friction, rotors' inertia and joint
    offsets. The function by which its UR10 example differentiates gives velocities half a sample late.
    """
    from figaroh.identification.base_identification import BaseIdentification
    from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced
    from figaroh.tools.robot import load_robot

    log = np.load(folder / "log.npz")

    class Arm(BaseIdentification):
        def load_trajectory_data(self, data_source=None):
            motion = {"positions": log["position"], "velocities": None, "accelerations": None}
            return motion | {"timestamps": log["time"].reshape(-1, 1), "torques": log["torque"]}

    def torque(*motion):
        whole = build_regressor_basic(arm.robot, *motion, arm.identif_config)
        base = build_regressor_reduced(whole, arm._idx_eliminated)[:, arm._base_indices]
        return (base @ arm.phi_base).reshape(motion[0].shape[1], -1).T

    second = round(1.0 / np.diff(log["time"]).mean())
    for number in range(1 + REPEATS):
        arm = Arm(load_robot(str(folder / "arm.urdf"), load_by_urdf=True), str(folder / "figaroh.yaml"))
        settings = arm.identif_config
        joints = [arm.model.joints[arm.model.getJointId(name)] for name in settings["active_joints"]]
        settings["act_idxq"], settings["act_idxv"] = [one.idx_q for one in joints], [one.idx_v for one in joints]
        arm.initialize(truncate=(second, len(log["time"]) - second))
        arm.solve(plotting=False, wls=True)
        yield torque if number else None


def aurt(folder):
    """`aurt calibrate`, by the function that the command calls; the arm's symbolic model is made before."""
    from aurt import api
    from aurt.caching import PersistentPickleCache

    log = np.load(folder / "log.npz")
    kinds = {"actual_q": log["position"], "actual_qd": log["velocity"], "actual_current": log["torque"]}
    unused = ("target_q", "target_qd", "target_qdd", "target_current", "target_moment")  # its reader asks for them
    kinds |= dict.fromkeys(unused, 0.0 * log["position"])
    n = log["position"].shape[1]
    header = " ".join(["timestamp", *(f"{kind}_{j}" for kind in kinds for j in range(n))])
    table = np.column_stack([log["time"], *kinds.values()])
    np.savetxt(folder / "aurt.csv", table, fmt="%.9g", header=header, comments="")
    os.chdir(folder)
    api.compile_rbd("arm.csv", "rigid_body_dynamics", False, PersistentPickleCache("cache"))
    api.compile_rd("rigid_body_dynamics", "none", [1], "robot_dynamics", PersistentPickleCache("cache"))
    yield None
    api.calibrate("robot_dynamics", "aurt.csv", [0.0, 0.0, -9.80665], "parameters.csv", "calibrated", False)
    found = pickle.loads((folder / "calibrated").read_bytes())

    def torque(position, velocity, acceleration):
        states = np.stack([position.T, velocity.T, acceleration.T], axis=1).reshape(3 * n, -1)
        rows = [found.robot_dynamics.observation_matrix_joint(j, states) @ found.parameters for j in range(n)]
        return np.stack(rows, axis=1)

    yield torque


#: mujoco.sysid: rows of a window (half a second: over two the least squares end far from the truth); of a joint: what
#: is fitted, least and most.
WINDOW, OF_JOINTS = 62, {"armature": (0.02, 20.0), "damping": (0.0, 40.0), "frictionloss": (0.01, 40.0)}


def mujoco(folder):
    """mujoco.sysid as its notebook fits a robot arm: motors' torques in, positions out, rolled out anew.

    The log is cut into windows, each with a start of its own ("one or more sequences"): an arm that is driven by
    torques alone drifts away from any longer log. Fit are what gravity and friction need (centres of mass, damping,
    dry friction) and the rotors' inertia, without which no rollout follows; masses and tensors stay as they are.
    """
    import mujoco
    from mujoco import sysid

    yield None
    spec = mujoco.MjSpec.from_file(str(folder / "arm.xml"))
    model, parameters = spec.compile(), sysid.ParameterDict()

    def of_joint(name, kind):
        def put(target, parameter):
            value = parameter.value[0]  # damping is a polynomial by now
            setattr(target.joint(name), kind, [value, 0.0, 0.0] if kind == "damping" else value)

        start = max(float(getattr(model.joint(name), kind)[0]), 0.5)
        return sysid.Parameter(f"{name}_{kind}", start, *OF_JOINTS[kind], modifier=put)

    def of_link(name):
        def put(target, parameter):
            target.body(name).ipos[:2] = parameter.value

        start = model.body(name).ipos[:2].copy()  # across its joint's axis
        return sysid.Parameter(f"{name}_centre", start, start - 0.5, start + 0.5, modifier=put)

    for j in range(model.njnt):
        if j:  # the first link turns about the vertical: no joint carries its weight
            parameters.add(of_link(model.body(model.jnt_bodyid[j]).name))
        for kind in OF_JOINTS:
            parameters.add(of_joint(model.joint(j).name, kind))
    log = np.load(folder / "log.npz")
    time, torques, position, velocity = (log[name] for name in ("time", "torque", "position", "velocity"))
    pieces = [slice(start, start + WINDOW) for start in range(0, len(time) - WINDOW + 1, WINDOW)]
    since = [time[piece] - time[piece.start] for piece in pieces]
    sensors = np.concatenate([position, velocity], axis=1)
    begun = [sysid.create_initial_state(model, position[piece.start], velocity[piece.start]) for piece in pieces]
    windows = list(zip(since, pieces, strict=True))
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        [f"window_{number}" for number in range(len(pieces))],
        begun,
        [sysid.TimeSeries.from_control_names(t, torques[piece], model) for t, piece in windows],
        [sysid.TimeSeries.from_names(t, sensors[piece, : model.njnt], model) for t, piece in windows],
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    found, _ = sysid.optimize(initial_params=parameters, residual_fn=residual, verbose=False)
    fitted = sysid.apply_param_modifiers(found, spec)

    def torque(position, velocity, acceleration):
        data, out = mujoco.MjData(fitted), np.empty_like(position)
        for row in range(len(position)):
            data.qpos[:], data.qvel[:] = position[row], velocity[row]
            mujoco.mj_forward(fitted, data)
            mujoco.mj_mulM(fitted, data, out[row], acceleration[row])
            out[row] += data.qfrc_bias
        return out + np.sign(velocity) * fitted.dof_frictionloss + velocity * fitted.dof_damping

    yield torque


def clocks():
    """Seconds of the wall's clock, and of processors that this process and its children took."""
    return time.perf_counter(), sum(os.times()[:4])


def main():
    """Run one driver."""
    tool, folder = sys.argv[1], Path(sys.argv[2]).resolve()
    marks = [clocks()]
    for given in {"pumaid": pumaid, "figaroh": figaroh, "aurt": aurt, "mujoco": mujoco}[tool](folder):
        torque = given
        marks.append(clocks())
        peak = Path("/proc/self/status").read_text(encoding="utf-8").split("VmHWM:")[1].split()[0]
    asked, other = np.load(folder / "questions.npz"), np.load(folder / "other.npz")
    states = [(asked["position"], factor * asked["velocity"], 0.0 * asked["velocity"]) for factor in (0.0, 1.0)]
    states.append((other["position"], other["velocity"], other["acceleration"]))
    np.savez(
        folder / "answers.npz",
        **dict(zip(("gravity", "whole", "other"), (torque(*one) for one in states), strict=True)),
    )
    versions = " ".join(f"{name} {importlib.metadata.version(name)}" for name in (tool, "numpy"))
    wall, processor = np.median(np.diff(marks[1:], axis=0), axis=0).tolist()
    record = {"versions": versions, "seconds": wall, "processor": processor, "start-up": marks[1][0] - marks[0][0]}
    (folder / "record.json").write_text(json.dumps(record | {"peak MiB": int(peak) // 1024}), encoding="utf-8")


if __name__ == "__main__":  # aurt starts processes of its own
    main()

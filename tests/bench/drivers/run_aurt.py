"""`aurt calibrate` on a log, by the function that the command calls, with the model that compile_aurt.py left."""

import os
import pickle

from stopwatch import GRAVITY, Stopwatch

watch = Stopwatch()
import numpy as np  # noqa: E402
from aurt import api  # noqa: E402

watch.loaded()
folder = watch.folder.resolve()
watch.folder = folder
os.chdir(folder / "aurt")  # its cache is looked for in the folder in which the model was made
down = [0.0, 0.0, -GRAVITY]
log, values, model = (str(folder / name) for name in ("aurt.csv", "aurt_parameters.csv", "aurt_model"))
api.calibrate("robot_dynamics", log, down, values, model, False)
watch.done("aurt", "sympy", "numpy")

with open(model, "rb") as stream:  # noqa: PTH123
    calibrated = pickle.load(stream)


def torque(position, velocity):
    """(N, J) N m of the calibrated model."""
    n = position.shape[1]
    states = np.zeros((3 * n, len(position)))
    states[0::3], states[1::3] = position.T, velocity.T
    rows = [calibrated.robot_dynamics.observation_matrix_joint(j, states) @ calibrated.parameters for j in range(n)]
    return np.stack(rows, axis=1)


asked = watch.questions()
answers = torque(asked["position"], 0.0 * asked["velocity"]), torque(asked["position"], asked["velocity"])
watch.answer(*answers)

"""figaroh's identification as its tutorial and its UR10 example do it: a subclass that loads the log, then `solve`.

Least squares for the base parameters of the rigid bodies, friction, rotors' inertia and joint offsets.
"""

from stopwatch import Stopwatch

watch = Stopwatch()
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from figaroh.identification.base_identification import BaseIdentification  # noqa: E402
from figaroh.identification.identification_tools import (  # noqa: E402
    calculate_first_second_order_differentiation,
)
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced  # noqa: E402
from figaroh.tools.robot import load_robot  # noqa: E402

watch.loaded()


class Arm(BaseIdentification):
    """The arm of the benchmark; every step but the loading is figaroh's own."""

    def load_trajectory_data(self, data_source=None):
        """Positions and torques of the log, differentiated as in figaroh's UR10 example."""
        frame = pd.read_csv(watch.folder / "figaroh.csv")
        n = self.model.nv
        positions = frame[[f"q{j}" for j in range(n)]].to_numpy()
        torques = frame[[f"tau{j + 1}" for j in range(n)]].to_numpy()
        kept, velocities, accelerations = calculate_first_second_order_differentiation(
            self.model, positions, self.identif_config
        )
        return {
            "timestamps": frame["t"].to_numpy()[: len(kept)].reshape(-1, 1),
            "positions": kept,
            "velocities": velocities,
            "accelerations": accelerations,
            "torques": torques[: len(kept)],
        }


robot = load_robot(str(watch.folder / "arm.urdf"), load_by_urdf=True)
arm = Arm(robot, str(watch.folder / "figaroh.yaml"))
settings = arm.identif_config
active = [arm.model.joints[arm.model.getJointId(name)] for name in settings["active_joints"]]
settings["act_idxq"], settings["act_idxv"] = [one.idx_q for one in active], [one.idx_v for one in active]
arm.initialize()
arm.solve(plotting=False)
watch.done("figaroh", "pin", "numpy")


def torque(position, velocity):
    """(N, J) N m by the base parameters, as figaroh predicts held-out data."""
    whole = build_regressor_basic(arm.robot, position, velocity, np.zeros_like(velocity), arm.identif_config)
    base = build_regressor_reduced(whole, arm._idx_eliminated)[:, arm._base_indices]
    return (base @ arm.phi_base).reshape(position.shape[1], -1).T


asked = watch.questions()
watch.answer(torque(asked["position"], 0.0 * asked["velocity"]), torque(asked["position"], asked["velocity"]))

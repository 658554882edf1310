"""mujoco.sysid as its notebook fits a robot arm: motors' torques in, positions out, rolled out anew.

The log is cut into windows, each with a start of its own ("one or more sequences"): an arm that is driven by torques
alone drifts away from any longer log. Fit are what gravity and friction need (centres of mass, damping, dry
friction) and the rotors' inertia, without which no rollout follows; masses and tensors stay as the model has them.
"""

from stopwatch import Stopwatch

watch = Stopwatch()
import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from mujoco import sysid  # noqa: E402

watch.loaded()

#: Rows of a window: two seconds.
WINDOW = 250
#: Of a joint: what is fitted, least and most.
OF_JOINTS = {"armature": (0.02, 20.0), "damping": (0.0, 40.0), "frictionloss": (0.01, 40.0)}


def of_joint(name, kind):
    """A parameter of a joint that begins with what the model says."""
    low, high = OF_JOINTS[kind]
    start = max(float(getattr(model.joint(name), kind)[0]), 0.5)

    def put(target, parameter):
        joint, value = target.joint(name), parameter.value[0]
        setattr(joint, kind, [value, 0.0, 0.0] if kind == "damping" else value)  # damping is a polynomial by now

    return sysid.Parameter(f"{name}_{kind}", start, low, high, modifier=put)


def of_link(name):
    """Where a link's centre of mass lies across its joint's axis: with its mass, what the joint feels of it."""
    start = model.body(name).ipos[:2].copy()

    def put(target, parameter):
        target.body(name).ipos[:2] = parameter.value

    return sysid.Parameter(f"{name}_centre", start, start - 0.5, start + 0.5, modifier=put)


spec = mujoco.MjSpec.from_file(str(watch.folder / "arm.xml"))
model = spec.compile()
joints = [model.joint(j).name for j in range(model.njnt)]
parameters = sysid.ParameterDict()
for j, name in enumerate(joints):
    if j:  # the first link turns about the vertical: no joint carries its weight
        parameters.add(of_link(model.body(model.jnt_bodyid[j]).name))
    for kind in OF_JOINTS:
        parameters.add(of_joint(name, kind))

log = np.load(watch.folder / "mujoco.npz")
times, control, sensors = log["times"], log["control"], log["sensors"]
starts = range(0, len(times) - WINDOW + 1, WINDOW)
n = len(joints)
pieces = [slice(start, start + WINDOW) for start in starts]
sequences = sysid.ModelSequences(
    "arm",
    spec,
    [f"window_{number}" for number in range(len(pieces))],
    [sysid.create_initial_state(model, sensors[piece.start, :n], sensors[piece.start, n:]) for piece in pieces],
    [sysid.TimeSeries.from_control_names(times[piece] - times[piece.start], control[piece], model) for piece in pieces],
    [sysid.TimeSeries.from_names(times[piece] - times[piece.start], sensors[piece, :n], model) for piece in pieces],
)
residual = sysid.build_residual_fn(models_sequences=[sequences])
found, result = sysid.optimize(initial_params=parameters, residual_fn=residual, verbose=False)
watch.done("mujoco", "numpy")

fitted = sysid.apply_param_modifiers(found, spec)
data = mujoco.MjData(fitted)
asked = watch.questions()
gravity = np.empty_like(asked["position"])
for row, place in enumerate(asked["position"]):
    data.qpos[:], data.qvel[:] = place, 0.0
    mujoco.mj_forward(fitted, data)
    gravity[row] = data.qfrc_bias
speed = asked["velocity"]
watch.answer(gravity, gravity + np.sign(speed) * fitted.dof_frictionloss + speed * fitted.dof_damping)

"""A plan made with a forbidden box, driven by the virtual robot in closed loop, keeps clear of it in every sample."""

from command import run

from pumaid.design.collision import Collision
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import expand
from pumaid.io.recipe import read_recipe, shipped_recipes

#: A ceiling above the hinge, which the outstretched arm would strike.
SAFETY = """
safety:
  tool: [0.3, 0, 0]
  boxes: [{name: ceiling, min: [-1, -1, 0.4], max: [1, 1, 0.5]}]
  capsules: [{link: 2, start: [0.15, 0, 0], end: [0.15, 0, 0], radius: 0.03}]
"""


def test_a_safe_plan_keeps_clear(tmp_path):
    """No measured posture, in a run or on the way to one, is nearer than the margin; without the box some are."""
    recipe = shipped_recipes()["pendulum2"].read_text(encoding="utf-8").replace("safety: {floor: null}", "")
    least = {}
    for name, text in (("safe", recipe + SAFETY), ("free", recipe)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "recipe.yaml").write_text(text, encoding="utf-8")
        run("plan", folder / "recipe.yaml", "--minutes", "3")
        run("simulate", folder / "recipe.yaml", "--plan", folder / "plan.yaml", "-o", folder / "logs")
        robot = read_recipe(tmp_path / "safe" / "recipe.yaml")
        collision, logs = (
            Collision(robot),
            [log for path in expand([folder / "logs"]) for log in LogReader(path, robot)],
        )
        least[name] = min(float(collision.distances(q).min()) for log in logs for q in log.position)
    # Encoders and the controller's way over its target are far below a millimetre.
    assert least["safe"] > 0.02 - 1e-3
    assert least["free"] < 0.0

"""What commands refuse: wrong usage with exit code 2, bad input with 3, in words, and nothing is written or printed."""

import pytest
from command import run

MODEL = "results/model.json"
#: What is typed beside a fitted arm -> the slug of the error or a word of the usage message.
BAD_INPUT = {
    "effects coulom": "error[unknown-effect]: there is no effect 'coulom'\n  fix: did you mean coulomb?",
    "identify nowhere": "no-such-log",
    **dict.fromkeys(("identify logs --recipe nothing.yaml", "plan nothing", "simulate ur9"), "recipe-not-found"),
    "identify logs --recipe puma560": "column-missing",
    "identify logs -o /proc/model.json": "cannot-write",
    "identify logs --add ripple@": "effect-joint",
    "identify logs --add @2": "unknown-effect",
    "identify logs --add stribek@2": "did you mean stribeck?",
    "identify logs --heldout session_99.csv": "heldout-nothing",
    "identify logs --add stribeck@2:velocity=1,velocity=2": "effect-shape",
    f"diagnose {MODEL} logs --suspect voltz": "voltz",
    f"diagnose {MODEL} logs --plan plan.yaml": "file-exists",
    f"report {MODEL} no_such_logs": "no-such-log",
    "export none.json --format c": "file-not-readable",
    "export recipe.yaml --format c": "file-damaged",
    f"export {MODEL} --format c --recipe ur5e": "model-other-recipe",
    f"export {MODEL} --format urdf --torque-constants 1,2,3": "torque-constants",
    f"export {MODEL} --format json -o {MODEL} --force": "file-exists",
    "plan --minutes 0.1 -o p.yaml": "--minutes",
    "plan --payload=-1,0,0,0 -o p.yaml": "-1.00 kg",
    "plan --payload=1e300,1e300,0,0 -o p.yaml": "plan-impossible",
    "plan --minutes nan -o p.yaml": "nan minutes",
    "plan --minutes 1e-9 -o p.yaml": "plan-too-short",
    "plan --check nothing.yaml": "nothing.yaml",
    "plan --check .": "file-not-readable",
    "plan --prior nothing.json -o p.yaml": "nothing.json",
    f"plan stanford --prior {MODEL} -o p.yaml": "model-other-recipe",
    "plan --prior recipe.yaml -o p.yaml": "file-damaged",
    "plan --format urscript -o p.script": "program-other-robot",
    "plan": "--force",
    "simulate --plan none.yaml": "none.yaml",
    "simulate --hide stribeck@2:a=1e308 -o new": "hide-wrong",
}
MISUSE = {
    **dict.fromkeys(
        ["identify logs --results=", "identify logs --heldout=", "identify logs -o=", f"report {MODEL} --recipe="],
        "The path is empty",
    ),
    "efects": "Did you mean 'effects'?",
    "effects --jsn": "--jsn",
    "effects a b": "argument",
    "identify": "LOGS",
    f"diagnose {MODEL} logs --picture misfit.gif": ".png",
    "segment logs --picture runs.gif": ".png",
    "report --format gif": "'png', 'svg', 'pdf'",
    f"report {MODEL} logs --json -o -": "standard output",
    f"export {MODEL} --format c -o -": "Two files",
    f"export {MODEL} --format json -o - --json": "--json",
    f"export {MODEL} --format c --torque-constants 1,2": "ampere",
    f"export {MODEL} --format fortran": "fortran",
    f"export {MODEL}": "--format",
    "init puma650": "puma560",
    "init": "--urdf FILE",
    "init ur3e --joints 3": "--joints",
    "init blank --joints 0": "0",
    "init ur5e --urdf arm.urdf": "two recipes",
    "init --urdf arm.urdf --joints 3": "two recipes",
    "init ur5e --tip tool0": "--urdf",
    "init --base l1": "--urdf",
    "plan --check p.yaml --minutes 5": "--check",
    "plan --payload a,b,c,d": "valid float",
    "plan --payload 10": "not 4",
    "plan --format gcode": "urscript",
}


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [(line, 3, said) for line, said in BAD_INPUT.items()] + [(line, 2, said) for line, said in MISUSE.items()],
    ids=[*BAD_INPUT, *MISUSE],
)
def test_is_refused_in_words(fitted, monkeypatch, line, code, said):
    """One message on standard error says what is wrong or what would do."""
    monkeypatch.chdir(fitted)
    before = sorted(fitted.rglob("*"))
    done = run(*line.split(), code=code)
    assert done.stderr.count("error[") == (code == 3) and done.stdout == ""
    words = "\n".join(line.strip("│ ") for line in done.stderr.splitlines())
    assert said in done.stderr or said in " ".join(words.split())
    assert sorted(fitted.rglob("*")) == before

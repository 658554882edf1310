"""Learned curves: what they find of a friction that was hidden, how smooth they are, and where they end."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import PENDULUM, dataset, drawn, experiment

from pumaid.cli.additions import added
from pumaid.dataset import Dataset, Run
from pumaid.diagnosis.compare import compare
from pumaid.diagnosis.diagnose import diagnose
from pumaid.diagnosis.learned_curves import offer
from pumaid.diagnosis.records import read_diagnosis, write_diagnosis
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.effect_spec import EffectTerm, option_text, terms_of
from pumaid.effects import Samples, catalogue
from pumaid.errors import ModelError
from pumaid.estimate import Estimate
from pumaid.estimation.curves import learned
from pumaid.estimation.estimate import identify
from pumaid.estimation.fit import Projector
from pumaid.estimation.gls import fit_bins
from pumaid.joint_bins import joint_bins
from pumaid.model import Model
from pumaid.reporting.diagnosis import finding_sentences, headline
from pumaid.reporting.page import parameters
from pumaid.results.documents import read_model, write_model
from pumaid.robot import EffectChoice, read_choice

PLACES = np.linspace(-1.8, 1.8, 73)


def worn(q):
    """A patch that rubs (A)."""
    return 0.15 * np.exp(-0.5 * ((q - 0.4) / 0.2) ** 2)


def snag(q):
    """A hose that is taut beyond a position (A)."""
    return 0.12 * np.maximum(q - 0.3, 0.0)


def grease(q):
    """Viscous friction that varies with position, A s/rad."""
    return 0.1 * np.cos(2.0 * q - 0.5)


#: Words of a choice -> the curve, and what multiplies it by direction and velocity.
HIDDEN = {
    "of=position,odd=true": (worn, lambda s, v: s),
    "of=position,odd=false": (snag, lambda s, v: 1.0),
    "of=position,odd=true,times=speed": (grease, lambda s, v: v),
    "harmonic": (lambda q: 0.1 * np.cos(q), lambda s, v: s),
}
FORMS = [words for words in HIDDEN if words != "harmonic"]


def with_hidden(words: str, *, seed: int) -> Dataset:
    """Runs of a pendulum, its second joint with a current that no law of the catalogue has."""
    curve, factor = HIDDEN[words]

    def added(one: Run) -> Run:
        b, s, v = one.bins, float(one.direction), one.bins.velocity
        more = curve(b.position[:, 1]) * factor(s, v) if one.joint == 2 else 0.0
        return replace(one, bins=replace(b, current=b.current + more))

    plain = dataset(drawn(PENDULUM, seed), experiment(PENDULUM, seed=seed, repeats=2), seed=seed)
    return replace(plain, runs=tuple(map(added, plain.runs)))


def current(estimate: Estimate, q=PLACES, *, speed: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """The curve less its mean over these places, moving forward, and its standard errors (A)."""
    position, velocity = np.zeros((len(q), 2)), np.zeros((len(q), 2))
    position[:, 1], velocity[:, 1] = q, speed
    samples = Samples(2, position, velocity, direction=np.ones(len(q)))
    columns = terms_of(estimate.effects)[0].linear(PENDULUM, samples)
    columns = columns - columns.mean(axis=0)
    numbers = [n for n, name in enumerate(estimate.names) if name.startswith("curve.")]
    errors = np.sqrt(np.einsum("ij,jk,ik->i", columns, estimate.covariance[np.ix_(numbers, numbers)], columns))
    return columns @ estimate.solution[numbers], errors


@pytest.fixture(scope="module")
def spot() -> Estimate:
    """A worn spot, found without a word on what it depends on."""
    return identify(with_hidden("of=position,odd=true", seed=81), PENDULUM, effects=[EffectChoice("curve", 2)])


@pytest.mark.parametrize("words", FORMS)
def test_a_curve_is_what_was_hidden(words):
    """Of the course that was hidden; its errors hold it; and the form is chosen by the data alone."""
    data = with_hidden(words, seed=82)
    asked, free = (
        identify(data, PENDULUM, effects=[read_choice(f"curve@2{w}", PENDULUM, "")]) for w in (f":{words}", "")
    )
    curve, factor = HIDDEN[words]
    truth = curve(PLACES) * factor(1.0, 0.6)
    found, errors = current(asked)
    off = found - (truth - truth.mean())
    assert np.sqrt(np.mean(off**2)) < 0.1 * truth.std()
    assert np.mean(np.abs(off) < 2.0 * errors) > 0.85
    assert option_text("curve", 2, free.effects[0].shape) == f"curve@2:{words}"
    without = identify(data, PENDULUM)
    floor = asked.joint(2).noise_floor
    assert asked.joint(2).rmse < 1.05 * floor < 1.2 * floor < without.joint(2).rmse


def test_smoothness_is_that_of_the_largest_likelihood():
    """The likelihood of contrasts that the model's other columns do not touch, from their whole covariance."""
    runs = [one for one in with_hidden("of=position,odd=true", seed=81).runs if one.joint == 2]
    fitted = fit_bins(Model.of_runs(PENDULUM, runs), joint_bins(PENDULUM, runs, most=12, is_settled=False))
    term, evidence = learned(Projector(fitted), EffectTerm(catalogue()["curve"], 2, {"of": 0.0, "odd": 1.0}))
    row = fitted.by_bin[2]
    basis, size, _ = np.linalg.svd(row.jacobian[:, row.jacobian.any(axis=0)])
    contrasts = basis[:, np.count_nonzero(size > 1e-9 * size[0]) :].T
    white = contrasts @ row.noise.whiten(row.bins, term.linear(PENDULUM, row.bins.samples))
    left, slope = contrasts @ row.noise.whiten(row.bins, row.bins.current), np.sqrt(row.bins.mean_square)

    def likelihood(share: float, straight: float = slope) -> tuple[float, float]:
        wide = np.eye(len(left)) + (white * np.append(straight, np.full(white.shape[1] - 1, share)) ** 2) @ white.T
        variance = float(left @ np.linalg.solve(wide, left)) / len(left)
        return -len(left) * np.log(variance) - np.linalg.slogdet(wide)[1], np.sqrt(variance)

    shares = np.geomspace(1e-4, 1.0, 60)
    best = max(shares, key=lambda share: likelihood(share)[0])
    assert term.shape["spread"] == pytest.approx(best * likelihood(best)[1], rel=0.3)
    wide = (white * np.append(slope, np.full(white.shape[1] - 1, best)) ** 2) @ white.T
    freedom = np.trace(np.linalg.solve(np.eye(len(left)) + wide, wide))
    more = -len(left) * np.log(likelihood(best)[1] ** 2 / likelihood(0.0, 0.0)[1] ** 2)
    assert evidence == pytest.approx(more - (freedom + 1.0) * np.log(len(runs)), rel=0.02) and evidence > 100.0


def test_a_table_has_a_row_of_its_size(spot):
    """Not one a coefficient; effective degrees of freedom are fewer than coefficients and more than a line's."""
    rows = {value.name: value for value in spot.values if value.name.startswith("curve")}
    assert set(rows) == {"curve.j2.rms", "curve.j2.edf"}
    assert 4.0 < rows["curve.j2.edf"].value < 34.0
    truth = np.sqrt(np.mean(worn(np.linspace(-2.0, 2.0, 401)) ** 2))
    assert rows["curve.j2.rms"].std_error < 0.1 * truth


def test_a_report_draws_it_with_its_band(spot):
    """Degrees where asked for; the band has the course that was hidden nearly everywhere."""
    (drawing,) = parameters(SimpleNamespace(estimate=spot, robot=PENDULUM, units="deg"))["figures"]
    axes = drawing.figure.axes[0]
    x, y = axes.lines[0].get_xydata().T
    band = axes.collections[0].get_paths()[0].get_extents()
    truth = worn(np.deg2rad(x)) - worn(np.deg2rad(x)).mean()
    assert "s f(q)" in drawing.title and axes.get_xlabel() == "position (deg)"
    assert np.sqrt(np.mean((y - truth) ** 2)) < 0.1 * truth.std()
    assert band.y0 < y.min() < truth.max() < band.y1 < 1.2 * truth.max()


def test_a_model_file_has_words_and_predicts_the_same(spot, tmp_path):
    """What a file says of a curve can be read by people; reading it back loses nothing."""
    write_model(tmp_path / "model.json", spot)
    text = (tmp_path / "model.json").read_text(encoding="utf-8")
    assert '"of": "position"' in text and '"odd": true' in text
    again = read_model(tmp_path / "model.json")
    assert again.effects == spot.effects
    assert np.array_equal(current(again)[0], current(spot)[0])


def test_beyond_its_runs_a_curve_is_held_and_that_is_told(spot):
    """Where no run went it stays as it was at the end; a run there is flagged."""
    ends = spot.effects[0].shape
    found, _ = current(spot, np.array([ends["high"], ends["high"] + 0.5, ends["high"] + 5.0]))
    assert np.ptp(found) < 1e-12
    data = with_hidden("of=position,odd=true", seed=83)
    far = [replace(one, bins=replace(one.bins, position=one.bins.position * 1.3)) for one in data.runs]
    scores = compare(spot, replace(data, runs=tuple(far)), PENDULUM).of_joint(2)
    assert all("beyond the range" in score.reason for score in scores)
    assert not any(score.undetermined for score in compare(spot, data, PENDULUM).of_joint(2))


def test_what_does_not_vary_has_no_curve():
    """Without a thermometer there is no curve of temperature, and it says so."""
    data = with_hidden("of=position,odd=true", seed=81)
    with pytest.raises(ModelError, match="temperature hardly varies"):
        identify(data, PENDULUM, effects=[read_choice("curve@2:of=temperature", PENDULUM, "--add")])
    with pytest.raises(ModelError, match="'heat'") as refused:
        read_choice("curve@2:of=heat", PENDULUM, "--add")
    assert "of=temperature" in refused.value.mend


def judged(words: str, *, seed: int) -> Dataset:
    """Runs of the second joint alone, every sixth kept for judging."""
    runs = [one for one in with_hidden(words, seed=seed).runs if one.joint == 2]
    return Dataset([replace(one, heldout=n % 6 == 5) for n, one in enumerate(runs)])


def test_diagnose_offers_a_curve_and_names_what_stood_in_for_it(tmp_path):
    """Viscous friction that varies with position passed for friction that does; the forecast is what comes."""
    data = judged("of=position,odd=true,times=speed", seed=84)
    before = identify(data, PENDULUM)
    told = diagnose(before, data, PENDULUM)
    joint, (finding,) = told.joints[1], told.findings
    assert (finding.effect, finding.joint, finding.verdict) == ("curve", 2, "add")
    assert finding.command.endswith("--add curve@2:of=position,odd=true,times=speed") and len(finding.knots) > 10
    assert joint.verdict == "unexplained" and joint.unexplained.form == "v f(q)"
    assert [one.effect for one in joint.candidates if one.verdict == "stand_in"] == ["position_friction"]
    assert "a learned curve does at joint 2" in headline(told, PENDULUM)
    assert "with the form v f(q)" in " ".join(finding_sentences(finding, told, PENDULUM))
    write_diagnosis(tmp_path / "diagnosis.json", told)
    again = read_diagnosis(tmp_path / "diagnosis.json").findings[0]
    assert again.shape == finding.shape and '"times": "speed"' in (tmp_path / "diagnosis.json").read_text()
    last, after = added(
        told,
        before,
        data,
        robot=PENDULUM,
        model=tmp_path / "model.json",
        again=lambda model: replace(told, findings=()),
        tell=lambda text: None,
    )
    assert [one.effect for one in last.applied] == ["curve"]
    assert after.joint(2).heldout == pytest.approx(finding.rmse_heldout_after, rel=0.05)
    assert after.joint(2).heldout < 1.1 * after.joint(2).noise_floor < 0.6 * before.joint(2).heldout


def test_a_curve_displaces_no_law_that_explains_as_much():
    """Friction with the cosine of position is that, not a curve."""
    data = judged("harmonic", seed=84)
    search = Stepwise(Model.of_runs(PENDULUM, data.runs), [one for one in data.runs if not one.heldout])
    search.run()
    assert [item.key[0] for item in search.accepted] == ["position_friction"]
    assert offer(search, 2, is_unexplained=True) is None

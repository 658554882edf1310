"""Forecasts against slow and obvious oracles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pumaid.records import Motion
from pumaid.robot import Joint, Robot
from pumaid.simulation import Noise, draw, table1
from pumaid.simulation.forecast import forecast, gravity_names, jacobian, run_moments
from pumaid.simulation.recursion import gravity_current

PUMA = table1.puma560()


def test_jacobian_is_the_slope_of_the_recursion():
    """Central differences of the paper's recursion give the same slopes."""
    robot = Robot(
        "mixed",
        tuple(
            Joint(k, f"j{k}", kind, alpha=1.0 * k, a=0.2)
            for k, kind in enumerate(("revolute", "prismatic", "revolute", "revolute"), start=1)
        ),
    )
    known = draw(robot, 2).constants
    position = np.random.default_rng(1).uniform(-1, 1, (5, 4))
    found = jacobian(robot, known, position)
    names = gravity_names(robot)
    for name, field, place in (
        ("gravity.l3.y", "y", 2),
        ("gravity.l2.mass", "mass", 1),
        ("gain_ratio.2.3", "ratio", 1),
    ):
        sides = []
        for step in (-1e-4, 1e-4):
            moved = getattr(known, field).copy()
            moved[place] += step
            sides.append(gravity_current(robot, replace(known, **{field: moved}), position))
        assert found[:, :, names.index(name)] == pytest.approx((sides[1] - sides[0]) / 2e-4, abs=1e-8)


def test_run_moments_are_those_of_the_whole_covariance():
    """The closed form is the information of all samples under their full covariance matrix, within 3 %."""
    noise = Noise(np.array([0.05]), level_share=0.3, correlation_time=0.04)
    rate, seconds = 100.0, 8.0
    count = int(rate * seconds)
    q = np.linspace(-1.5, 2.0, count)
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) / rate
    covariance = 0.05**2 * (0.7 * np.exp(-lag / 0.04) + 0.3)
    parts = np.column_stack([np.cos(q), np.sin(q), np.ones(count)])
    wanted = np.linalg.inv(parts.T @ np.linalg.solve(covariance, parts))
    found = np.linalg.inv(run_moments((-1.5, 2.0), seconds, noise, joint=1, rate=rate))
    assert np.diag(found) == pytest.approx(np.diag(wanted), rel=0.03)


def test_paper_experiment_leaves_the_last_ratio_in_the_dark():
    """With the paper's postures the ratio of joints 5 and 6 of its PUMA has an error above 1, all others below 0.1."""
    names = [
        name for name in gravity_names(PUMA.robot) if name not in ("gravity.l1.x", "gravity.l1.y", "gain_ratio.1.2")
    ]
    found = forecast(PUMA, table1.experiment().motions, names=names).std_errors()
    assert found["gain_ratio.5.6"] > 1.0
    assert max(found[f"gain_ratio.{k}.{k + 1}"] for k in (2, 3, 4)) < 0.1


def test_parameters_without_runs_are_left_out():
    """Runs of joint 6 alone promise its own parameters and no others."""
    hold = (0.0, -1.5, 0.0, 0.0, 0.0, 0.0)
    motions = [Motion(6, hold, -2.0 * way, 2.0 * way, speed) for way in (1, -1) for speed in (0.5, 1.0)]
    found = forecast(PUMA, motions, names=gravity_names(PUMA.robot)).std_errors()
    friction = {f"{kind}.j6.{side}" for kind in ("coulomb", "viscous") for side in ("plus", "minus")}
    assert set(found) == {"gravity.l6.x", "gravity.l6.y"} | friction


def test_what_one_speed_cannot_tell_apart_is_left_out():
    """At a single speed Coulomb and viscous friction are one number, so neither is promised."""
    hold = (0.0, -1.5, 0.0, 0.0, 0.0, 0.0)
    found = forecast(PUMA, [Motion(6, hold, -2.0, 2.0, 0.5)], names=["gravity.l6.x", "gravity.l6.y"]).std_errors()
    assert set(found) == {"gravity.l6.x", "gravity.l6.y"}


def test_held_out_motions_promise_nothing():
    """Motions for judging are no part of the fit."""
    motions = [replace(motion, purpose="heldout") for motion in table1.experiment().motions]
    assert forecast(PUMA, motions, names=gravity_names(PUMA.robot)).std_errors() == {}

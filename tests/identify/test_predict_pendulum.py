"""The swing-up of a real pendulum, predicted by a fit of two other logs of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from commands import run

from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.identify.predict import Prediction, PredictionQuestion, predict, question_of

PENDULUM = Path(__file__).parents[2] / "measured" / "pendulum"
LAW = "energy_lqr"
SEEDS = 8


class Machine(NamedTuple):
    """The fitted machine.

    Attributes:
        question: Its law beside the log of the swing-up.
        complete: Its prediction.
    """

    question: PredictionQuestion
    complete: Prediction


@pytest.fixture(scope="module")
def machine() -> Machine:
    """The machine as identified from two logs, and its prediction of the third one."""
    experiment = Experiment.load(PENDULUM / "swing_up.toml").changed(laws=[LAW])
    system = experiment.nominal.system
    log = read_log(PENDULUM / "energy_shaping_cmd.parquet", system, experiment.file.log)
    noise_log = read_log(PENDULUM / "sac_cmd.parquet", system, experiment.file.log)
    question = question_of(experiment, LAW, log, noise_log)
    return Machine(question, predict(question, SEEDS))


def numbers(prediction: Prediction) -> dict[str, np.ndarray]:
    """Required numbers of the predicted runs by their short words."""
    return {item.label: item.predicted for item in prediction.quantities if item.required}


def changed(machine: Machine, path: str, value: float) -> dict[str, np.ndarray]:
    """Required numbers of the machine with another number."""
    experiment = machine.question.experiment.changed({path: value})
    return numbers(predict(machine.question._replace(experiment=experiment), SEEDS))


def with_noise(machine: Machine, noise: float) -> dict[str, np.ndarray]:
    """Required numbers of the machine whose velocity has another noise [rad/s].

    Its sensor is that of another log: the file has none.
    """
    experiment = machine.question.experiment
    loop = experiment.loop
    assert loop is not None
    quiet = experiment.changed(loop=loop.changed("sensor", "pivot rate", noise=noise))
    return numbers(predict(machine.question._replace(experiment=quiet), SEEDS))


# Values of an independent least squares, of the same logs.
INDEPENDENT = {"pivot friction": 0.141, "pivot damping": 0.0115, "pivot bias": -0.0154}


@pytest.mark.slow
def test_two_logs_give_the_numbers_of_an_independent_fit(tmp_path: Path) -> None:
    shutil.copytree(PENDULUM, tmp_path, dirs_exist_ok=True)
    logs = tmp_path / "sac_cmd.parquet", tmp_path / "ilqrb_cmd.parquet"
    case = tmp_path / "fit.toml"
    assert run("identify", logs[0], case, "--also", logs[1], "--out", tmp_path) == cli.DONE
    document = json.loads((tmp_path / "identification_fit_sac_cmd.json").read_text("utf-8"))
    fitted = {row["name"]: row["value"] for row in document["parameters"]}
    assert {name: fitted[name] for name in INDEPENDENT} == pytest.approx(INDEPENDENT, rel=0.1)


def test_the_experiment_s_law_reproduces_each_logged_command(machine: Machine) -> None:
    """Up to the digits of the log; a command stands a row after its states."""
    finding = machine.question.law_on_log
    assert finding is not None
    assert finding.first is None
    assert finding.rows == 1
    assert finding.largest < 5e-4


def test_each_seed_swings_up_as_the_machine_did(machine: Machine) -> None:
    predicted = numbers(machine.complete)
    assert np.isfinite(predicted["reaches"]).all()
    assert np.median(predicted["reaches"]) == pytest.approx(4.44, rel=0.05)
    assert predicted["swings"].tolist() == [4.0] * SEEDS


def test_the_measured_swing_up_lies_within_the_spread(machine: Machine) -> None:
    items = {item.label: item for item in machine.complete.quantities}
    assert items["reaches"].measured == pytest.approx(4.44, abs=0.01)
    assert items["swings"].measured == 4
    assert items["reaches"].contains(items["reaches"].measured)
    assert machine.complete.misfits.min() < 0.2


def test_without_friction_a_swing_less_is_enough(machine: Machine) -> None:
    smooth = changed(machine, "edit.pivot.friction", 0.0)
    assert np.median(smooth["swings"]) == 3
    assert np.median(smooth["reaches"]) < numbers(machine.complete)["reaches"].min()


def test_the_noise_of_the_velocity_starts_the_swing_up(machine: Machine) -> None:
    """Less noise never overcomes the dry friction at rest."""
    assert np.isinf(with_noise(machine, 0.01)["reaches"]).all()


def test_delay_and_zero_of_the_encoder_do_not_decide(machine: Machine) -> None:
    low = numbers(machine.complete)["reaches"].min()
    high = numbers(machine.complete)["reaches"].max()
    for path in ("computing.delay", "sensor.pivot.bias"):
        assert low <= np.median(changed(machine, path, 0.0)["reaches"]) <= high

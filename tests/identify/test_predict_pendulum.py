"""The swing-up of a real pendulum, predicted by a fit of two other logs of it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from commands import Screen, run

from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.identify.predict import Prediction, PredictionQuestion, predict, question_of

PENDULUM = Path(__file__).parents[2] / "measured" / "pendulum"
LAW = "energy_lqr"
SEEDS = 16


class Machine(NamedTuple):
    """The fitted machine.

    Attributes:
        fit: Fitted values by name.
        question: Its law beside the log of the swing-up.
        complete: Its prediction.
    """

    fit: Mapping[str, float]
    question: PredictionQuestion
    complete: Prediction


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    """Fit the machine to two logs, and predict the third one."""
    folder = tmp_path_factory.mktemp("pendulum")
    shutil.copytree(PENDULUM, folder, dirs_exist_ok=True)
    logs = folder / "sac_cmd.parquet", folder / "ilqrb_cmd.parquet"
    fit = folder / "fit.toml"
    assert run("identify", logs[0], fit, "--also", logs[1], "--out", folder) == cli.DONE
    document = json.loads((folder / "identification_fit_sac_cmd.json").read_text("utf-8"))

    # The case of the swing-up extends the fit.
    (folder / "identify_fit_sac_cmd.toml").replace(folder / "identified.toml")
    experiment = Experiment.load(folder / "swing_up.toml").changed(laws=[LAW])
    system = experiment.nominal.system
    log = read_log(folder / "energy_shaping_cmd.parquet", system, experiment.file.log)
    noise_log = read_log(logs[0], system, experiment.file.log)
    question = question_of(experiment, LAW, log, noise_log)
    values = {row["name"]: row["value"] for row in document["parameters"]}
    return Machine(values, question, predict(question, SEEDS))


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


@pytest.mark.parametrize(("name", "value"), INDEPENDENT.items())
def test_two_logs_give_the_numbers_of_an_independent_fit(
    name: str, value: float, machine: Machine
) -> None:
    assert machine.fit[name] == pytest.approx(value, rel=0.1)


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
    assert machine.complete.misfits.min() < 0.1


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


def test_the_answer_is_one_screen(machine: Machine, capsys: Screen, tmp_path: Path) -> None:
    """The command, as users call it, in one screen."""
    case = machine.question.experiment.path
    log = case.parent / "energy_shaping_cmd.parquet"
    noise = case.parent / "sac_cmd.parquet"
    code = run("predict", log, case, "--law", LAW, "--noise-from", noise, "--out", tmp_path)
    # Its last peak and its final error lie outside the spread.
    assert code == cli.DIFFERS
    text = capsys.readouterr().out
    assert "Law: reproduces the logged command" in text
    (path,) = tmp_path.glob("predict_*.json")
    # Results of another law have another name.
    assert path.stem.endswith(f"_{LAW}")
    assert path.with_suffix(".png").is_file()

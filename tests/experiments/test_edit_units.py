"""Edits of joints and inputs whose numbers have a unit."""

from __future__ import annotations

from pathlib import Path

import pytest
from case_texts import short_run, short_step

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.edits import InputEdit
from grosmc_mj.studies.sweep.family import family_of

CART = short_run("cart_pendulum", '"pole angle" = "5 deg"', "0.1 s")


def read(folder: Path, text: str) -> Experiment:
    path = folder / "mine.toml"
    path.write_text(CART + text, encoding="utf-8")
    return Experiment.load(path)


@pytest.mark.parametrize(
    ("joint", "quantity", "written", "number"),
    [
        ("hinge", "friction", '"500 mN m"', 0.5),
        ("hinge", "damping", '"0.1 N m s/rad"', 0.1),
        ("hinge", "armature", '"2e-3 kg m^2"', 2e-3),
        ("slider", "friction", '"0.5 kN"', 500.0),
        ("slider", "damping", '"3 N s/m"', 3.0),
        ("slider", "armature", '"200 g"', 0.2),
        ("slider", "friction", "0.5", 0.5),
        ("hinge", "damping", "2", 2.0),
    ],
)
def test_a_joints_number_may_have_a_unit_and_is_in_si_without_one(
    tmp_path, joint, quantity, written, number
) -> None:
    experiment = read(tmp_path, f'[[edit]]\njoint = "{joint}"\n{quantity} = {written}\n')
    (edit,) = experiment.edits
    assert getattr(edit, quantity) == pytest.approx(number)


@pytest.mark.parametrize("gear", ['"300 mN m/A"', '"0.3 N m/A"', "0.3"])
def test_a_gear_may_have_a_unit(tmp_path, gear) -> None:
    text = short_step() + f'[[edit]]\ninput = "current"\ngear = {gear}\n'
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    (edit,) = Experiment.load(path).edits
    assert isinstance(edit, InputEdit)
    assert edit.gear == pytest.approx(0.3)


def test_the_gear_of_a_force_has_no_unit(tmp_path) -> None:
    """The force of one newton of the input is a number of newtons, whatever the other joints."""
    (edit,) = read(tmp_path, '[[edit]]\ninput = "force"\ngear = 1.5\n').edits
    assert edit == InputEdit("force", 1.5)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ('joint = "hinge"\nfriction = "0.5 N"', "edit 1: friction: .* to N m"),
        ('joint = "slider"\nfriction = "0.5 N m"', "edit 1: friction: .* to N:"),
        ('joint = "hinge"\ndamping = "lots"', 'edit 1: damping: "lots" is no number'),
        ('joint = "hinge"\ndamping = true', "edit 1: damping: True must be a number"),
        ('joint = "slidr"\nfriction = "0.5 N"', "unknown joint 'slidr': did you mean 'slider'"),
        ('input = "force"\ngear = "2 N m"', "edit 1: gear: "),
        ('input = "force"\ngear = "2 N m/N"', "edit 1: gear: .* must be a number without a unit"),
    ],
)
def test_a_unit_that_does_not_fit_is_refused_in_one_line(tmp_path, edit, words) -> None:
    with pytest.raises(GrosmcError, match=words):
        read(tmp_path, f"[[edit]]\n{edit}\n").plant("physics")


@pytest.mark.parametrize(
    "spread",
    [
        '["10 mN m", "30 mN m"]',
        "[0.01, 0.03]",
        '{ distribution = "uniform", least = "10 mN m", most = "30 mN m" }',
    ],
)
def test_an_uncertain_number_of_a_joint_may_have_a_unit(tmp_path, spread) -> None:
    number = f'number = "edit.hinge.friction"\nvalues = {spread}'
    text = f'[[uncertain]]\n{number}\nnominal = "20 mN m"\n'
    experiment = read(tmp_path, text)
    (number,) = family_of(experiment.file, experiment).quantities
    assert number.distribution.support == pytest.approx((0.01, 0.03))
    assert number.nominal == pytest.approx(0.02)

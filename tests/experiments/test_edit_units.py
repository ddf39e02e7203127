"""Edits of joints and inputs whose numbers have a unit."""

from __future__ import annotations

from typing import Any

import pytest
from cases import case

from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.mechanics.physics.edits import InputEdit
from grosmc_mj.studies.sweep.family import family_of

CART = "cart_pendulum"
# The equations have no damping.
PHYSICS = {"compare": ["physics"]}


@pytest.mark.parametrize(
    ("joint", "quantity", "written", "number"),
    [
        ("hinge", "friction", "500 mN m", 0.5),
        ("hinge", "damping", "0.1 N m s/rad", 0.1),
        ("hinge", "armature", "2e-3 kg m^2", 2e-3),
        ("slider", "friction", "0.5 kN", 500.0),
        ("slider", "damping", "3 N s/m", 3.0),
        ("slider", "armature", "200 g", 0.2),
        ("slider", "friction", 0.5, 0.5),
        ("hinge", "damping", 2, 2.0),
    ],
)
def test_a_joints_number_may_have_a_unit_and_is_in_si_without_one(
    joint: str, quantity: str, written: str | float, number: float
) -> None:
    (edit,) = case(CART, plant=PHYSICS, edit={"joint": joint, quantity: written}).edits
    assert getattr(edit, quantity) == pytest.approx(number)


@pytest.mark.parametrize(
    ("system", "edit", "expected"),
    [
        ("servo", {"input": "current", "gear": "300 mN m/A"}, InputEdit("current", 0.3)),
        ("servo", {"input": "current", "gear": 0.3}, InputEdit("current", 0.3)),
        # The force of one newton of the input is a number of newtons, whatever the other joints.
        (CART, {"input": "force", "gear": 1.5}, InputEdit("force", 1.5)),
    ],
)
def test_a_gear_may_have_a_unit(system: str, edit: dict[str, Any], expected: InputEdit) -> None:
    assert case(system, plant=PHYSICS, edit=edit).edits == (expected,)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ({"joint": "hinge", "friction": "0.5 N"}, "edit 1: friction: .* to N m"),
        ({"joint": "slider", "friction": "0.5 N m"}, "edit 1: friction: .* to N:"),
        ({"joint": "hinge", "damping": "lots"}, 'edit 1: damping: "lots" is no number'),
        ({"joint": "hinge", "damping": True}, "edit 1: damping: True must be a number"),
        (
            {"joint": "slidr", "friction": "0.5 N"},
            "unknown joint 'slidr': did you mean 'slider'",
        ),
        (
            {"input": "force", "gear": "2 N m/N"},
            "edit 1: gear: .* must be a number without a unit",
        ),
    ],
)
def test_a_unit_that_does_not_fit_is_refused_in_one_line(edit: dict[str, Any], words: str) -> None:
    with pytest.raises(GrosmcError, match=words):
        case(CART, edit=edit)


@pytest.mark.parametrize(
    "spread",
    [
        ["10 mN m", "30 mN m"],
        [0.01, 0.03],
        {"distribution": "uniform", "least": "10 mN m", "most": "30 mN m"},
    ],
)
def test_an_uncertain_number_of_a_joint_may_have_a_unit(spread: Any) -> None:
    number = {"number": "edit.hinge.friction", "values": spread, "nominal": "20 mN m"}
    experiment = case(CART, uncertain=number)
    (quantity,) = family_of(experiment.file, experiment).quantities
    assert quantity.distribution.support == pytest.approx((0.01, 0.03))
    assert quantity.nominal == pytest.approx(0.02)

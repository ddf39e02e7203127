"""Rungs of a ladder: each part of a machine stands on one."""

from __future__ import annotations

from dataclasses import fields

from grosmc_mj import Experiment
from grosmc_mj.ground.fields import checked
from grosmc_mj.mechanics.machine import Stop
from grosmc_mj.studies.ladder.rungs import rungs_of


@checked()
class Bumper(Stop):
    """A stop of a kind that no ladder has heard of."""

    kind = "bumper"
    effect = ""


def test_part_of_a_new_kind_has_a_rung_of_its_own_above_all_others() -> None:
    machine = Experiment.load("servo/machine")
    (stop,) = [part for part in machine.parts if isinstance(part, Stop)]
    bumper = Bumper(**{item.name: getattr(stop, item.name) for item in fields(stop)})
    others = [edit for edit in machine.edits if edit is not stop]

    climbing, alone = rungs_of(machine.changed(edits=(*others, bumper)))
    assert climbing[-1].name == alone[-1].name == "bumper"
    assert alone[-1].parts == (bumper,)
    assert "stops" not in [rung.name for rung in climbing]

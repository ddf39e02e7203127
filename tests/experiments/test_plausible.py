"""Numbers that are allowed and probably a slip are warned of; the package's own cases have none."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from grosmc_mj.cli.entry import main
from grosmc_mj.errors import ImplausibleWarning
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files

CASE = """
[plant]
system = "servo"
[run]
start = {{ "rotor angle" = "{angle}" }}
duration = "0.1 s"
[[controller]]
law = "lqr"
[[requirement]]
stays_within = "1e9 rad"
{more}
"""


@pytest.mark.parametrize(
    ("angle", "more", "line"),
    [
        ("1e6 rad", "", "start: rotor angle = 1e+06 rad is implausible; usual: 0 to 10000 rad"),
        (
            "0.1 rad", '[[edit]]\nbody = "rotor"\nmass_scale = 1733',
            "edit of 'rotor': mass_scale = 1733 is implausible; usual: 0.01 to 100",
        ),
        (
            "0.1 rad",
            '[[motor]]\ninput = "current"\nadded = false\nconstant = "7.68e-3 N m/A"\n'
            'resistance = "2.6 ohm"\nratio = 70\nvoltage = "24 kV"',
            "motor of 'current': voltage = 24000 V is implausible; usual: 0.001 to 1000 V",
        ),
        (
            "0.1 rad", '[[sensor]]\nof = "rotor angle"\nresolution = "1e30 deg"',
            "sensor of 'rotor angle': resolution = 1.74533e+28 rad is implausible; usual: "
            "1e-09 to 10000 rad",
        ),
        (
            "0.1 rad", '[[sensor]]\nof = "rotor angle"\ndelay = "1e-300 ms"',
            "sensor of 'rotor angle': delay = 1e-303 s is implausible; usual: 1e-07 to 1e+06 s",
        ),
    ],
)  # fmt: skip
def test_an_implausible_number_is_a_warning(
    tmp_path: Path, angle: str, more: str, line: str
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(CASE.format(angle=angle, more=more), encoding="utf-8")
    with pytest.warns(ImplausibleWarning) as caught:
        Experiment.load(file)
    assert [str(item.message) for item in caught] == [f"{file}: {line}"]


def test_the_command_line_says_it_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    more = '[[edit]]\nbody = "rotor"\nmass_scale = 1733'
    file.write_text(CASE.format(angle="0.1 rad", more=more), encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["list", str(file)])
    assert capsys.readouterr().err == (
        f"grosmc-mj: {file}: edit of 'rotor': mass_scale = 1733 is implausible; usual: 0.01 to "
        "100\n"
    )


@pytest.mark.slow
def test_every_shipped_case_can_be_prepared_and_is_plausible() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in shipped_files().values():
            assert Experiment.load(path).limits, f"{path} requires nothing"

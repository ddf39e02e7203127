"""Small campaigns that tests share: their laws are compiled once."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import cases
import pytest

from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.specification import Specification
from grosmc_mj.studies.campaign.work import part_runner

Tables = list[dict[str, Any]]

RUN = {"duration": "50 ms", "control_period": "1 ms"}
LQR: Tables = [{"law": "lqr"}]
# Two laws that are designed in no time.
PAIR: Tables = [*LQR, {"law": "lqr", "name": "stiff", "Q": [4, 1]}]
LAWS: Tables = [*LQR, {"law": "grosmc"}]
# Of the first eight runs of seed 5, two keep the first under LQR and all under GROSMC.
LIMITS: Tables = [
    {"deviation_below": "3 mrad", "input_below": "10 A"},
    {"of": ["grosmc"], "sliding_below": "0.02 A s"},
]
PUSH = {"body": "rotor", "torque": ["0 N m", "1 N m", "0 N m"], "label": "load"}
LOAD = {**PUSH, "profile": "pulse", "start": "20 ms", "stop": "30 ms"}
HUM = {
    "body": "rotor",
    "torque": ["0 N m", "0.1 N m", "0 N m"],
    "label": "hum",
    "profile": "sine",
    "frequency": "1 Hz",
    "onset": "20 ms",
}
# A servo's computer, sensor, estimator and actuator, and laws of which one predicts.
LOOP: dict[str, Any] = {
    "computing": {"delay": "1 ms", "missed": 0.05},
    "sensor": [{"of": "rotor angle", "resolution": "0.1 mrad", "noise": "0.1 mrad"}],
    "estimator": [{"of": "rotor speed", "law": "eso", "bandwidth": "100 rad/s"}],
    "actuator": [{"of": "current", "limit": "4 A", "lag": "1 ms"}],
    "laws": [*LQR, {"law": "lqr", "name": "predicting", "predict": True}],
}
# Friction of a servo's shaft.
LUGRE = {
    "joint": "shaft",
    "coulomb": "0.05 N m",
    "static": "0.07 N m",
    "stiffness": "27 N m/rad",
    "damping": "0.24 N m s/rad",
}
# A servo as it is built: its gear, friction, stops, motor and a wall.
MACHINE: dict[str, Any] = {
    "run": {"timestep": "0.25 ms"},
    "transmission": {
        "joint": "shaft",
        "inertia": "0.01 kg m^2",
        "stiffness": "500 N m/rad",
        "damping": "0.2 N m s/rad",
        "backlash": "1 mrad",
    },
    "lugre": LUGRE,
    "stop": {"joint": "shaft", "low": "-1 rad", "high": "1 rad", "restitution": 0.3},
    "motor": {"input": "current", "constant": "7.68 mN m/A", "resistance": "2.6 ohm", "ratio": 10},
    "wall": {"body": "rotor", "radius": "1 cm", "point": ["0 m", "0 m", "-1 m"]},
}


def uncertain(number: str, *values: Any, **more: Any) -> dict[str, Any]:
    """An uncertain number between two values, or of the distribution that one table tells."""
    spread = values[0] if len(values) == 1 else [*values]
    return {"number": number, "values": spread, **more}


MASS = uncertain("edit.rotor.mass_scale", 1, 3)
AMPLITUDE = uncertain("disturbance.load.scale", -1, 1, name="load amplitude", nominal=0)
BOTH = [MASS, AMPLITUDE]
BETWEEN_BOTH = {"between": ["rotor mass scale", "load amplitude"], "coefficient": 0.5}


def deviation_below(limit: str) -> Tables:
    """A requirement on the deviation from the optimum."""
    return [{"deviation_below": limit}]


def part(
    *uncertain: dict[str, Any], system: str = "servo", laws: Tables = LQR, **tables: Any
) -> str:
    """The text of a system's case of 50 ms under LQR, with uncertain numbers and no load."""
    run = {**RUN, **tables.pop("run", {})}
    return cases.text(system, uncertain=[*uncertain], run=run, controller=laws, **tables)


def servo(
    *uncertain: dict[str, Any], laws: Tables = LAWS, limits: Tables = LIMITS, **tables: Any
) -> str:
    """The text of a servo's case: a pulse from 20 ms to 30 ms, and some hum besides."""
    tables = {"disturbance": [LOAD, HUM], "requirement": limits, **tables}
    return part(*(uncertain or BOTH), laws=laws, **tables)


def plain(*uncertain: dict[str, Any], **tables: Any) -> str:
    """The text of a servo's case under LQR, of which nothing is required."""
    return servo(*uncertain, laws=LQR, limits=[], **tables)


def pair(*uncertain: dict[str, Any], limit: str = "3 mrad", **tables: Any) -> str:
    """The text of a servo's case under two LQRs."""
    return servo(*uncertain, laws=PAIR, limits=deviation_below(limit), **tables)


def specification(text: str, **options: Any) -> Specification:
    """A question about a case file that lies nowhere: 8 runs in parts of 4 by default."""
    defaults = {"name": "small", "text": text, "folder": ".", "runs": 8, "shard": 4}
    return Specification(**defaults | options)


@cache
def campaign(text: str, **options: Any) -> Campaign:
    """A campaign, designed once for all tests."""
    return Campaign.of(specification(text, **options))


FALL = [
    uncertain("run.start.pole angle", "-80 deg", "80 deg"),
    uncertain("run.start.pole rate", "-10 rad/s", "10 rad/s"),
]


def falling_pendulum(limit: str = "1 rad") -> str:
    """The text of a pendulum's case of 0.3 s under a law that is not defined everywhere."""
    limits = deviation_below(limit)
    tables: Any = {"run": {"duration": "0.3 s"}, "requirement": limits}
    return part(*FALL, system="cart_pendulum", laws=[{"law": "fl-lqr"}], **tables)


def falling() -> Campaign:
    """Sixteen pendulums, of which some fall out of the region where their law is defined."""
    return campaign(falling_pendulum(), runs=16, shard=16)


def begun(declared: Campaign, path: Path) -> Folder:
    """A folder with a manifest, and no parts yet."""
    folder = Folder(path)
    folder.begin(declared, resume=False)
    return folder


def kept(declared: Campaign, path: Path) -> Folder:
    """A campaign run to its end, part by part in this process, and its folder."""
    folder = begun(declared, path)
    run_part = part_runner(declared, folder, 0)
    for index in range(declared.specification.shards):
        run_part(index)
    return folder


def bits(folder: Folder) -> list[bytes]:
    """The bytes of the first two parts, as far as they are there."""
    return [part.read_bytes() for part in (folder.part(0), folder.part(1)) if part.exists()]


def refusal(of: Any, *arguments: Any, **more: Any) -> str:
    """The one line of an error of the package's own."""
    with pytest.raises(GrosmcError) as error:
        of(*arguments, **more)
    assert "\n" not in str(error.value)
    return str(error.value)

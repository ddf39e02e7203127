"""Small campaigns that the tests of campaigns share: their laws are compiled once."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import run as run

from grosmc_mj.errors import GrosmcError
from grosmc_mj.sweep.campaign import Campaign, Specification
from grosmc_mj.sweep.store import Folder, checksum, shards_of

PLANT = """
[plant]
system = "{system}"
[run]
duration = "{duration} s"
control_period = "1 ms"
start = {start}
"""
PUSH = '[[disturbance]]\nbody = "rotor"\ntorque = ["0 N m", "1 N m", "0 N m"]\nlabel = "load"\n'
LOAD = f"""
{PUSH}
profile = "pulse"
start = "0.02 s"
stop = "0.03 s"
[[disturbance]]
body = "rotor"
torque = ["0 N m", "0.1 N m", "0 N m"]
profile = "sine"
frequency = "1 Hz"
onset = "0.02 s"
label = "hum"
"""
LQR = '[[controller]]\nlaw = "lqr"\n'
# Two laws that are designed in no time.
PAIR = f'{LQR}{LQR}name = "stiff"\nQ = [4, 1]\n'
GROSMC = '[[controller]]\nlaw = "grosmc"\n'
LAWS = LQR + GROSMC
# Of the first eight runs of seed 5, two keep the first under LQR and all under GROSMC.
LIMITS = """
[[requirement]]
deviation_below = "3 mrad"
input_below = "10 A"
[[requirement]]
of = ["grosmc"]
sliding_below = "0.02 A s"
"""
DEVIATION = '[[requirement]]\ndeviation_below = "3 mrad"\n'
INERTIA = '[[uncertain]]\nbody = "rotor"\nmass_scale = [1, 3]\n'
AMPLITUDE = '[[uncertain]]\ndisturbance = "load"\namplitude = [-1, 1]\n'
FALL = """
[[uncertain]]
start = "pole angle"
value = ["-80 deg", "80 deg"]
[[uncertain]]
start = "pole rate"
value = ["-10 rad/s", "10 rad/s"]
"""
# The two numbers of which most tests are.
BOTH = INERTIA + AMPLITUDE
CORRELATED = """
[[correlation]]
between = ["rotor mass scale", "load amplitude"]
coefficient = 0.5
"""

# A servo as it is built: what moves it, what stops it, what hangs on it.
MACHINE = """timestep = "0.25 ms"
[[transmission]]
joint = "shaft"
inertia = "0.01 kg m^2"
stiffness = "500 N m/rad"
damping = "0.2 N m s/rad"
backlash = "1 mrad"
[[lugre]]
joint = "shaft"
coulomb = "0.05 N m"
static = "0.07 N m"
stiffness = "27 N m/rad"
damping = "0.24 N m s/rad"
[[stop]]
joint = "shaft"
low = "-1 rad"
high = "1 rad"
restitution = 0.3
[[motor]]
input = "current"
constant = "7.68 mN m/A"
resistance = "2.6 ohm"
ratio = 10
[[swinging_load]]
body = "rotor"
mass = "0.1 kg"
length = "20 cm"
at = ["10 cm", "0 m", "0 m"]
[[wall]]
body = "rotor"
radius = "1 cm"
point = ["0 m", "0 m", "-1 m"]
[[controller]]
law = "lqr"
[[requirement]]
deviation_below = "10 mrad"
"""
# A servo's loop: what is measured, computed and put out.
LOOP = """
[computing]
delay = "1 ms"
missed = 0.05
[[sensor]]
of = "rotor angle"
resolution = "0.1 mrad"
noise = "0.1 mrad"
[[estimator]]
of = "rotor speed"
law = "eso"
bandwidth = "100 rad/s"
[[actuator]]
of = "current"
limit = "4 A"
lag = "1 ms"
[[controller]]
law = "lqr"
[[controller]]
name = "predicting"
law = "lqr"
predict = true
"""


def standing(tables: str, parts: str, system: str = "servo") -> str:
    """The text of a case file of nothing but parts, laws and requirements that stand in it."""
    return PLANT.format(system=system, duration=0.05, start="{}") + parts + tables


def case(
    system: str, uncertain: str, *, duration: float = 0.05, start: str = "{}", laws: str = LAWS,
    disturbances: str = "", limits: str = "",
) -> str:  # fmt: skip
    head = PLANT.format(system=system, duration=duration, start=start)
    return head + disturbances + uncertain + laws + limits


def servo(uncertain: str = BOTH, *, laws: str = LAWS, limits: str = LIMITS) -> str:
    """The text of a servo's case file: a pulse from 20 ms to 30 ms, and some hum besides."""
    return case("servo", uncertain, laws=laws, disturbances=LOAD, limits=limits)


def plain(tables: str = BOTH) -> str:
    return servo(tables, laws=LQR, limits="")


def pair(uncertain: str = BOTH) -> str:
    return servo(uncertain, laws=PAIR, limits=DEVIATION)


def uncertain(*lines: str) -> str:
    """One [[uncertain]]."""
    return "\n".join(["[[uncertain]]", *lines, ""])


def of(kind: str, name: str, *numbers: str) -> str:
    """One [[uncertain]] of a part by its name."""
    return uncertain(f'{kind} = "{name}"', *numbers)


def specification(text: str, **options: Any) -> Specification:
    """A question about a case file that lies nowhere: 8 runs in parts of 4 by default."""
    own = {"name": "small", "text": text, "folder": ".", "runs": 8, "shard": 4}
    return Specification(**own | options)


@cache
def campaign(text: str, **options: Any) -> Campaign:
    """A campaign, designed once for all tests."""
    return Campaign.of(specification(text, **options))


def falling() -> Campaign:
    """Sixteen pendulums, of which some fall out of the region where their law is defined."""
    laws = '[[controller]]\nlaw = "fl-lqr"\n'
    limits = '[[requirement]]\ndeviation_below = "1 rad"\n'
    text = case("cart_pendulum", FALL, laws=laws, limits=limits, duration=0.3)
    return campaign(text, runs=16, shard=16)


def kept(declared: Campaign, path: Path) -> Folder:
    """A campaign run to its end, part by part in this process, and its folder."""
    folder = begun(declared, path)
    run = shards_of(declared, folder, 0)
    for index in range(declared.specification.shards):
        run(index)
    return folder


def bits(folder: Folder) -> list[bytes]:
    """The first two parts, as far as they are there."""
    return [folder.part(index).read_bytes() for index in range(2) if folder.part(index).exists()]


def begun(declared: Campaign, path: Path) -> Folder:
    """A folder with a manifest, and no parts yet."""
    folder = Folder(path)
    folder.begin(declared, resume=False)
    return folder


def replaced(table: pa.Table, column: str, row: int, value: Any) -> pa.Table:
    """A part's rows with another value in one place."""
    values, kind = table[column].to_pylist(), table.field(column).type
    values[row] = value
    place = table.column_names.index(column)
    return table.set_column(place, table.field(column), pa.array(values, kind))


def forged(file: Path, table: pa.Table, **changed: Any) -> None:
    """Write other rows as a part, with a checksum that is theirs."""
    notes = {**json.loads(pq.read_schema(file).metadata[b"grosmc_mj"]), **changed}
    del notes["sha256"]
    notes["sha256"] = checksum(table, notes)
    pq.write_table(table.replace_schema_metadata({b"grosmc_mj": json.dumps(notes)}), file)


def refusal(of: Any, *arguments: Any, **more: Any) -> str:
    """The one line of an error of the package's own."""
    with pytest.raises(GrosmcError) as error:
        of(*arguments, **more)
    assert "\n" not in str(error.value)
    return str(error.value)

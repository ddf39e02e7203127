"""The tables and keys of a case file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    PrivateAttr,
    create_model,
    model_validator,
)

from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.former_keys import uncertain_today
from grosmc_mj.experiments.file.part_tables import PartTable
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, PART_KINDS
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import unknown_name, value_text
from grosmc_mj.ground.units import (
    Metres,
    PositiveSeconds,
    Seconds,
    Table,
    Three,
    is_number,
)


def file_name(name: str) -> str:
    """Return a name that folders and files may have: results are kept under it.

    Raises:
        ValueError: If files cannot have this name.
    """
    valid = name.isprintable() and "/" not in name and name not in {".", ".."}
    if not valid or len(name) > 100:
        raise ValueError(
            f"{value_text(name)} must be a name for files: no slash, no dots alone, printable, 100 "
            "characters at most"
        )
    return name


class PlantTable(Table):
    """``[plant]``: the controlled plant; one of ``system``, ``model`` and ``plant``.

    Attributes:
        system: A system of the package.
        model: An MJCF file beside the case file, or ``package:path`` of one in an installed
            package, which is read and not imported: a robot of the user's own.
        plant: ``module:name`` of an analytic plant, a plant in MuJoCo or a robot, or of a
            function without arguments that makes one.
        joints: Joints of a robot; all by default.
        actuators: Actuators of a robot, one for each joint; all by default.
        at: States of the operating point, by name with their units: the other states and the
            inputs that let the plant rest there are solved for. Runs start there, outputs are held
            there, and laws on the linearization are designed there.
        compare: Plants to run on; all by default.
    """

    system: str | None = None
    model: str | None = None
    plant: str | None = None
    joints: list[str] | None = None
    actuators: list[str] | None = None
    at: dict[str, Any] | None = None
    compare: list[Literal["printed", "corrected", "physics"]] | None = Field(None, min_length=1)

    @model_validator(mode="after")
    def _one_of_three(self) -> PlantTable:
        sources = [name for name in ("system", "model", "plant") if getattr(self, name) is not None]
        if len(sources) != 1:
            raise ValueError(f"give one of system, model and plant, not {sources or 'none'}")
        if self.model is None and (self.joints or self.actuators):
            raise ValueError("joints and actuators are for a model")
        if self.system is not None and self.at is not None:
            raise ValueError("at is for a plant or a model: the package's systems have their own")
        return self


class DesignTable(Table):
    """``[design]``: the plant that laws are designed for, if it is another one.

    Attributes:
        plant: ``module:name`` of an analytic plant with the same states and inputs, or of a
            function without arguments that makes one.
    """

    plant: str


class RunTable(Table):
    """``[run]``: start, duration and sampling.

    Attributes:
        start: States at t = 0 by name, with their units; the others are zero.
        duration: Duration of a run [s].
        control_period: Time between two samples of the laws [s]; 1 ms, or the timestep if that is
            longer.
        timestep: Physics timestep [s]; 1 ms, or that of a user's own model.
        integrator: MuJoCo's integrator; RK4, or that of a user's own model.
        engine: ``native`` compiles the laws; ``python`` runs any callable.
    """

    start: dict[str, Any] = {}
    duration: PositiveSeconds
    control_period: PositiveSeconds | None = None
    timestep: PositiveSeconds | None = None
    integrator: Literal["Euler", "RK4", "implicit", "implicitfast"] | None = None
    engine: Literal["native", "python"] = "native"


_SECONDS: Any = Seconds
_SECONDS_OR_NONE = _SECONDS | None


def _key_of(kind: type[Requirement]) -> tuple[Any, Any]:
    """Type and default of the key of a kind of requirement, by the quantity that it limits."""
    if not kind.quantity:
        return bool, False
    if kind.quantity == "s":
        return _SECONDS_OR_NONE, None
    if kind.quantity == "1":
        return float | None, None
    if kind.quantity == "formula":
        return str | None, None
    # A number with a unit that the laws know.
    return Any, None


_KEYS_OF_KINDS: dict[str, Any] = {kind.key: _key_of(kind) for kind in KINDS}
# The word is a keyword of Python's, and so no name of a class's attribute.
_KEYS_OF_KINDS["from"] = (_SECONDS, 0.0)
_Limits = create_model("_Limits", __base__=Table, **_KEYS_OF_KINDS)
_OPTIONS = frozenset(option for kind in KINDS for option in kind.options)


class RequirementTable(_Limits):
    """``[[requirement]]``: limits that runs must keep, each in the unit of its quantity.

    Its further keys are those of the kinds in ``grosmc_mj.experiments.requirements``.

    Attributes:
        of: Controllers that must keep it; all by default.
        on: Plants on which they must keep it; physics by default, or all where there is none.
        state: State or output that ``stays_within``, ``rms_below``, ``final_error_below``,
            ``reaches_within``, ``swings_below``, ``last_peak_below`` and ``recovers_within`` are
            about: of a state its magnitude, of an output its error; the error of all outputs by
            default.
        band: Half width of the band of ``settles_within``; by default 2 % of the error at the
            start, which must not be zero. Where a sensor's steps are coarse, three of them. Of
            ``reaches_within``, ``swings_below``, ``last_peak_below`` and ``recovers_within``,
            which have no default.
        periodic: Whether an angle counts modulo a turn, so that -pi is as good as pi, in these
            three, ``stays_within``, ``rms_below`` and ``final_error_below``.
        after: Instant from which on ``stays_within``, ``rms_below`` and ``always`` hold [s].
        above: Lower bound of ``signal``, which has ``from`` and ``to``, too.
        below: Upper bound of ``signal``.
        from: Instant from which on the bounds of ``signal`` hold [s].
        to: Instant up to which the bounds of ``signal`` hold [s]; the end of a run by default.
    """

    of: list[str] | None = Field(None, min_length=1)
    on: list[Literal["printed", "corrected", "physics"]] | None = Field(None, min_length=1)
    state: str | None = None
    band: Any = None
    periodic: bool = False
    after: Seconds = 0.0
    above: Any = None
    below: Any = None
    to: Seconds | None = None

    @model_validator(mode="after")
    def _option_of_something(self) -> RequirementTable:
        """Refuse a key that no requirement of the table reads."""
        for option in sorted(_OPTIONS & self.model_fields_set):
            readers = [kind.key for kind in KINDS if option in kind.options]
            if all(getattr(self, key) is None for key in readers):
                raise ValueError(f"{option} is for {' or '.join(readers)}, which is not there")
        if self.after < 0:
            raise ValueError(f"after {self.after:g} s must not be negative")
        return self


class ClaimTable(RequirementTable):
    """``[[claim]]``: a statement of the chapter as limits for runs.

    No verdict on a run depends on it: ``study ladder`` tells on which rung it falls.

    Attributes:
        id: Identifier of the statement, as ``grosmc-mj claims`` lists them.
        under: Condition of the statement: the nominal plant, the system's ``case1`` or
            ``case2``, or the file's own edits and disturbances, ``under load``.
    """

    id: str
    under: Literal["nominal", "case1", "case2", "under load"] = "nominal"


def _weight(value: Any) -> Any:
    """Refuse anything but a number, numbers by name, a diagonal or the rows of a matrix."""
    if isinstance(value, dict) and value and all(map(is_number, value.values())):
        return value
    rows = value if isinstance(value, list) else [value]
    for row in rows:
        entries = row if isinstance(row, list) else [row]
        if not all(map(is_number, entries)):
            raise ValueError(
                f"{value_text(value)} must be a number, numbers by name such as {{ angle = 1 }}, a "
                "list of numbers or a list of rows"
            )
    return value


def _all_fit(value: Any, fits: Callable[[Any], bool]) -> bool:
    """Whether all members of a list, or all values of a table by name, fit."""
    members = list(value.values()) if isinstance(value, dict) else value
    return isinstance(members, list) and all(map(fits, members))


def _bounds(value: Any) -> Any:
    """Refuse anything but positive numbers, in a list or by name."""
    if _all_fit(value, lambda number: is_number(number) and 0 < number < math.inf):
        return value
    raise ValueError(
        f"{value_text(value)} must be positive bounds, in a list or by name such as {{ angle = 1 }}"
    )


def _formulas(value: Any) -> Any:
    """Refuse anything but texts, in a list or by name."""
    if _all_fit(value, lambda text: isinstance(text, str)):
        return value
    members = [value]
    if isinstance(value, dict):
        members = list(value.values())
    elif isinstance(value, list):
        members = value
    for member in members:
        if is_number(member):
            raise ValueError(
                f'{value_text(value)} must be formulas in quotes: write "{member}" for {member}'
            )
    raise ValueError(
        f'{value_text(value)} must be formulas, in a list or by name such as {{ angle = "sin(t)" }}'
    )


Formulas = Annotated[Any, BeforeValidator(_formulas)]
Weight = Annotated[Any, BeforeValidator(_weight)]
Bounds = Annotated[Any, BeforeValidator(_bounds)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class OutputsTable(Table):
    """``outputs`` of ``[task]``: the regulated outputs.

    Attributes:
        of: ``plant`` for the plant's own outputs, a name such as ``tip`` where the package has
            further ones, or ``module:name`` of a function that returns expressions in the states.
        formulas: Instead of ``of``, formulas in the states by their names: ``["rotor speed"]``.
        guess: A state near which the outputs determine the states, by name; it matters where
            several states have the same outputs.
        unit: Unit of outputs that are no states.
    """

    of: str = "plant"
    formulas: list[str] | None = None
    guess: dict[str, Any] = {}
    unit: str = ""

    @property
    def own(self) -> bool:
        """Whether the outputs are the plant's own."""
        return self.of == "plant" and self.formulas is None


class TaskTable(Table):
    """``[task]``: outputs, reference and weights that the laws are designed for.

    Attributes:
        name: Name of the laws of this task together in results; the system's name by default.
        outputs: The regulated outputs.
        reference: y_r(t) of each output, a formula in t in seconds, in the output's unit, in a list
            or by the outputs' names; or a list of one ``module:name`` of a reference with its
            parameters.
        sign: 1 for the error y - y_r, -1 for y_r - y.
        Q: Weight of the error state: numbers by the names of its entries, as ``grosmc-mj list``
            prints them, and 0 for those that are left out; or a matrix, or its diagonal.
        R: Weight of the input: a number, numbers by name, a matrix or its diagonal.
        region: Region in which the premises are checked: bounds of |z1|, |z2| ..., each in its
            unit, as a list or by name; by default the region that the gains are declared for, or
            that the run spans.
        slope: L of the super-twisting law, in the unit of s per second squared.
    """

    name: str = ""
    outputs: OutputsTable = OutputsTable()
    reference: Formulas = None
    sign: Literal[1, -1] = 1
    Q: Weight = None
    R: Weight = None
    region: Bounds = None
    slope: Positive | None = None


class LawTable(Table):
    """``[laws.NAME]``: a law with numbers, which a ``[[controller]]`` may name.

    The law's numbers stand beside these keys.

    Attributes:
        law: A law by its name, or ``module:name`` of a law, of a function that makes a controller
            of the nominal plant, or of a controller.
        switching: Switching law of a sliding mode law.
        surface: ``printed`` or ``discrete``.
        memory: Memory of a user's own law as a run begins: numbers and lists of them, by name.
        predict: Whether the law knows the dead time of its loop, and is given the predicted state
            at the instant when its output arrives.
    """

    model_config = ConfigDict(extra="allow", frozen=True, strict=True)

    law: str
    switching: str = "sign"
    surface: Literal["printed", "discrete"] = "printed"
    memory: dict[str, Any] = {}
    predict: bool | None = None

    @property
    def numbers(self) -> dict[str, Any]:
        """The law's numbers."""
        return dict(self.model_extra or {})


class ControllerTable(LawTable):
    """``[[controller]]``: a law that is run; its keys replace those of its ``[laws.NAME]``.

    Attributes:
        name: Name of the controller; its law by default.
    """

    name: str | None = None

    @property
    def called(self) -> str:
        """Name of the controller."""
        return self.name or self.law.split(":")[-1]


_KINDS = ("uniform", "loguniform", "triangular", "normal", "lognormal")


class DistributionTable(Table):
    """A distribution with its numbers, each with the unit of the quantity.

    Attributes:
        distribution: ``uniform`` and ``loguniform`` from ``least`` to ``most``; ``triangular`` with
            its top at ``mode``; ``normal`` with ``mean`` and ``deviation``; ``lognormal`` with
            ``median`` and ``spread``, the standard deviation of its logarithm. The last two are cut
            off at ``least`` and ``most``, where given.
        least: Smallest value.
        most: Largest value.
        mode: Most likely value.
        mean: Mean, before it is cut off.
        deviation: Standard deviation, before it is cut off.
        median: Median, before it is cut off.
        spread: Standard deviation of the logarithm, a pure number.
    """

    distribution: str
    least: Any = None
    most: Any = None
    mode: Any = None
    mean: Any = None
    deviation: Any = None
    median: Any = None
    spread: Any = None


def _spread(value: Any) -> list[Any] | DistributionTable:
    """Return a range unchanged, and a table as a distribution."""
    if isinstance(value, list) and len(value) == 2:
        return value
    if not isinstance(value, dict):
        raise ValueError(  # noqa: TRY004
            f"{value_text(value)} must be a range [least, most] or a table such as "
            '{ distribution = "normal", mean = 0.1, deviation = 0.02 }'
        )
    for key in value:
        require_known("key", key, DistributionTable.model_fields, error=ValueError)
    kind = value.get("distribution")
    if kind not in _KINDS:
        raise ValueError(unknown_name("distribution", kind, _KINDS))
    return DistributionTable(**value)


# A range, or a table with a distribution and its numbers.
Spread = Annotated[Any, BeforeValidator(_spread)]


class UncertainTable(Table):
    """``[[uncertain]]``: an unknown number of plant, disturbance, start, loop or machine.

    Times of a loop are rounded to whole timesteps.

    Attributes:
        number: Path of the number: ``edit.pole.mass_scale``, ``edit.hinge.damping``,
            ``run.start.pole angle``, ``disturbance.push.scale``, ``computing.delay``,
            ``sensor.pole angle.noise``, ``transmission.slider.backlash``.
        values: A range ``[least, most]``, uniform in between, or a table with a ``distribution``.
        at: Place of an ``added_mass`` in the body's frame [m], (3,); by default that of the file's
            only one, or the origin.
        name: Name of the number in results; NAME and FIELD of its path by default.
        nominal: The value without uncertainty, from which the radius is measured: by default that
            of the file.
    """

    number: str
    values: Spread
    at: Annotated[list[Metres], Three] | None = None
    name: str = ""
    nominal: Any = None

    @model_validator(mode="before")
    @classmethod
    def _refuse_former(cls, table: Any) -> Any:
        """Refuse a table as former versions had it, with the one that takes its place."""
        line = uncertain_today(table)
        if line is not None:
            raise ValueError(line)
        return table

    @property
    def called(self) -> str:
        """Name of the uncertain number."""
        if self.name:
            return self.name
        owner, *words = self.number.split(".")
        if owner == "run":
            return words[-1]
        if owner == "computing":
            words = [owner, *words]
        return " ".join([*words[:-1], words[-1].replace("_", " ")])


class MeasuredTable(Table):
    """``[[measured]]``: a log of the real machine, of which the requirements are asked too.

    Attributes:
        log: Path of the log, from the file's folder.
        law: Controller under which it was made; the file's only one by default.
        start: Instant of the log at which the run begins, from its first sample on [s].
    """

    log: str
    law: str | None = None
    start: Seconds = 0.0


class CorrelationTable(Table):
    """``[[correlation]]``: two uncertain numbers that are not independent.

    Attributes:
        between: Names of the two numbers.
        coefficient: Correlation of the Gaussian copula, from -1 to 1.
    """

    between: Annotated[list[str], Field(min_length=2, max_length=2)]
    coefficient: Annotated[float, Field(gt=-1, lt=1)]


def _table(kind: str) -> PlainValidator:
    """Return the check of the tables of a kind of part."""
    return PlainValidator(PART_KINDS[kind].table)


_AS_WRITTEN = PlainSerializer(PartTable.document)


class _Beginning(Table):
    """Keys of a file that belong to no part of a loop or a machine."""

    name: Annotated[str, AfterValidator(file_name)] = ""
    title: str = ""
    source: str = ""
    plant: PlantTable
    design: DesignTable | None = None
    run: RunTable
    edit: list[Annotated[PartTable, _table("edit"), _AS_WRITTEN]] = []
    disturbance: list[Annotated[PartTable, _table("disturbance"), _AS_WRITTEN]] = []


def _fields_of_parts(kinds: Iterable[str]) -> dict[str, Any]:
    """Return the fields of a table with parts of these kinds: one computer, lists of the others."""
    fields: dict[str, Any] = {}
    for kind in kinds:
        table: Any = Annotated[PartTable, _table(kind), _AS_WRITTEN]
        if kind == "computing":
            fields[kind] = (table | None, None)
        else:
            fields[kind] = (list[table], [])
    return fields


_WithParts = create_model(
    "_WithParts", __base__=_Beginning, **_fields_of_parts((*LOOP_PARTS, *MACHINE_PARTS))
)
_LoopParts = create_model("_LoopParts", __base__=Table, **_fields_of_parts(LOOP_PARTS))


class KnownLoopTable(_LoopParts):
    """``[known_loop]``: the loop that predicting laws take for theirs, if it is another one.

    Attributes:
        computing: The computer between sensors and actuators.
        sensor: Sensors of states.
        estimator: Estimators of the states that are not measured.
        actuator: Actuators of inputs.
    """


class CaseFile(_WithParts):
    """A whole file.

    Attributes:
        name: Name of the case; the file's own by default.
        title: Title for people.
        source: Source of the case, such as a page of the chapter.
        plant: The controlled plant.
        design: The plant that the laws are designed for, if it is another one.
        run: Start, duration and sampling.
        edit: Changes of the true plant that the laws do not know.
        disturbance: Disturbances of bodies, inputs, measured states and rates.
        computing: The computer between sensors and actuators; ideal without it.
        sensor: Sensors of states; a state without one is measured exactly.
        estimator: Estimators of the states that are not measured.
        actuator: Actuators of inputs; an input without one is exact.
        known_loop: Computer, sensors and actuators that laws with ``predict`` take for theirs; the
            true ones by default.
        transmission: Compliance and backlash between a motor and its joint.
        lugre: Bristle friction of joints.
        drive_friction: Friction of the drives of joints, which depends on speed and load.
        stop: Stops at the ends of joints.
        motor: DC motors that stand for the inputs.
        known_motor: Motors that laws take for those whose voltage is their input; the true ones by
            default.
        wall: Walls that bodies can touch.
        task: Outputs, reference and weights that the laws are designed for.
        laws: Laws with their numbers, by name.
        controller: Laws that are run.
        requirement: Limits that they must keep.
        claim: Statements of the chapter about them.
        uncertain: Numbers that a campaign varies; a single run has the nominal values.
        correlation: Pairs of them that vary together.
        log: Time and columns of a log of the machine.
        measured: Logs of the machine that are judged like runs.
    """

    known_loop: KnownLoopTable | None = None
    known_motor: list[Annotated[PartTable, _table("motor"), _AS_WRITTEN]] = []
    task: TaskTable = TaskTable()
    laws: dict[str, LawTable] = {}
    controller: Annotated[list[ControllerTable], Field(min_length=1)]
    requirement: list[RequirementTable] = []
    claim: list[ClaimTable] = []
    uncertain: list[UncertainTable] = []
    correlation: list[CorrelationTable] = []
    log: LogTable | None = None
    measured: list[MeasuredTable] = []
    # Values as they are written, from which the file with another number is read.
    _content: Content = PrivateAttr(default_factory=dict)
    # Names of the files that it extends, by the keys that are theirs.
    _taken_over: dict[str, str] = PrivateAttr(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        """Whether two files have the same tables, however they are written."""
        return isinstance(other, CaseFile) and dict(self) == dict(other)

    @property
    def content(self) -> Content:
        """Values as they are written in the file and in those that it extends."""
        return self._content

    def base_of(self, key: str) -> str:
        """Return the name of the extended file from which an array of tables comes, or nothing."""
        return self._taken_over.get(key, "")

    def law(self, name: str) -> ControllerTable:
        """Return a controller of the file by its name, or else a law by its name.

        Keys that the controller does not have come from the ``[laws.NAME]`` that it names.
        """
        table = ControllerTable(law=name)
        for controller in self.controller:
            if controller.called == name:
                table = controller
                break

        base = self.laws.get(table.law)
        if base is None:
            return table
        keys = {
            **base.model_dump(exclude_unset=True),
            **table.model_dump(exclude_unset=True),
            "law": base.law,
            "name": table.called,
        }
        return ControllerTable.model_validate(keys)

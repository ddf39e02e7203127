"""Loads and changes of the plant that no input matches, in the coordinates of the laws."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.experiments.assumptions.balance import Loads, disturbed_motion
from grosmc_mj.experiments.assumptions.loads import Instants, Load, instants_of, loads_of, some_of
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import design_variant
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError, name_list
from grosmc_mj.ground.units import rate_unit
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.physics.hooks import warnings_counted_only
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.reaching import matrix_vector

# Share of the largest effect on z' up to which all of it is matched: MuJoCo's input matrix comes
# from finite differences, and dry friction answers to a load.
_MATCHED = 1e-3


class Finding(NamedTuple):
    """Part of an effect on z' that no input could make, in one run.

    Attributes:
        subject: What has the effect, in words.
        law: Name of the law of the run.
        coordinates: Identity of its error coordinates.
        value: Largest entry of that part; 0 if the effect is matched.
        unit: Unit of the value.
    """

    subject: str
    law: str
    coordinates: int
    value: float
    unit: str


def unmatched(experiment: Experiment, results: Sequence[RunResult]) -> list[str]:
    """Return a line for each load, and for the change of the plant, that the inputs cannot match.

    The measure is that of the premise "matching": the part of z' that the effect adds beside the
    columns of the true plant's input matrix.

    Args:
        experiment: The experiment.
        results: Its runs on one plant.
    """
    loads = []
    changes = []
    not_told: dict[str, None] = {}
    for result in results:
        if result.controller.design is None or not len(result.trajectory.input):
            continue
        try:
            loads += [_of_load(result, load) for load in loads_of(result)]
            if _changed(experiment):
                changes.append(_of_change(experiment, result))
        except ModelError as error:
            # An edit, such as damping, that MuJoCo's model has and the equations have no term for.
            not_told[
                "whether the inputs match loads and changes of the plant is not told: by its "
                f"equations, {error}"
            ] = None
    return [*_lines([*loads, *changes]), *not_told]


def _changed(experiment: Experiment) -> bool:
    """Whether the true plant is another one than the laws know."""
    nominal = experiment.nominal
    return bool(experiment.edits or nominal.scales or nominal.believed)


def _of_load(result: RunResult, load: Load) -> Finding:
    """Return the unmatched part of a load."""
    plant = _as_the_law_sees(result, result.true)
    loaded, gain = _motion(result, plant, load.at, load.alone)
    free, _ = _motion(result, plant, load.at)
    return _finding(f"the load on {load.of}", result, loaded - free, gain)


def _of_change(experiment: Experiment, result: RunResult) -> Finding:
    """Return the unmatched part of what the true plant has and the laws do not know."""
    run = result.trajectory
    at = instants_of(run, some_of(np.arange(len(run.input))))
    nominal = experiment.nominal.believed or experiment.nominal.plant
    true_rate, gain = _motion(result, _as_the_law_sees(result, result.true), at)
    nominal_rate, _ = _motion(result, _as_the_law_sees(result, nominal), at)
    subject = "the difference of the plant from the one that laws know"
    return _finding(subject, result, true_rate - nominal_rate, gain)


def _as_the_law_sees(result: RunResult, plant: Any) -> Any:
    """Return the rigid plant, as equations where the error of the law is one in symbols."""
    if isinstance(result.controller.designed.error, ErrorCoordinates):
        plant = plant.analytic(design_variant(result.plant))
    return plant.rigid


def _motion(
    result: RunResult,
    plant: Any,
    at: Instants,
    loads: Loads | None = None,
) -> tuple[Array, Array]:
    """Return z' (N, size) of a plant under the inputs of the run, and the input matrix."""
    law = result.controller
    loads = loads or Loads.none(result.trajectory.system, len(at.t))
    with np.errstate(all="ignore"), warnings_counted_only():
        drift, gain = disturbed_motion(law, at.t, at.x, plant, loads, at.u)
    v = at.u
    if isinstance(law.designed.error, StateCoordinates):
        v = at.u - law.parameters.reference.u
    return drift + matrix_vector(gain, v), gain


def _finding(subject: str, result: RunResult, effect: Array, gain: Array) -> Finding:
    """Return the part of an effect (N, size) beside the columns of gains (N, size, m)."""
    law = result.controller
    error = law.designed.error
    matched = Finding(subject, law.name, id(error), 0.0, "")

    # A run that diverges has states at which nothing is a number.
    finite = np.isfinite(effect).all(axis=-1) & np.isfinite(gain).all(axis=(-2, -1))
    if not np.any(finite):
        return matched
    effect = effect[finite]
    gain = gain[finite]
    beside = np.abs(effect - matrix_vector(gain @ np.linalg.pinv(gain), effect)).max(axis=0)
    row = int(beside.argmax())
    if beside[row] <= _MATCHED * np.abs(effect).max():
        return matched
    return matched._replace(value=float(beside[row]), unit=rate_unit(error.units[row]))


def _lines(findings: Iterable[Finding]) -> list[str]:
    """Return a line for each subject and error coordinates in which it is not matched."""
    groups: dict[tuple[str, int], list[Finding]] = {}
    laws: dict[str, set[str]] = {}
    for finding in findings:
        laws.setdefault(finding.subject, set()).add(finding.law)
        if finding.value:
            groups.setdefault((finding.subject, finding.coordinates), []).append(finding)

    lines = []
    for (subject, _), group in groups.items():
        names = list(dict.fromkeys(finding.law for finding in group))
        of_laws = ""
        if len(names) < len(laws[subject]):
            of_laws = f" for {name_list(names)}"
        largest = max(group, key=lambda finding: finding.value)
        lines.append(
            f"{subject} is unmatched{of_laws}: no switching term rejects it (up to "
            f"{largest.value:.3g}{unit_after(largest.unit)} in z' where no input acts)"
        )
    return lines

"""Cost of exported laws on emulated processors.

``python -m benchmarks.processors`` writes the table of docs/processors.md.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.processor.emulated import emulated_law
from grosmc_mj.export.processor.processors import PROCESSORS
from grosmc_mj.export.samples import compare_at_samples, random_runs
from grosmc_mj.output.results.markdown import replace_marked
from grosmc_mj.output.results.tables import numbers, table, words

_STATES = 300
_ON = ("cortex-m4", "cortex-m7")
_SWITCHING = ("sign", "implicit", "boundary-layer", "super-twisting", "adaptive")
_LAWS: Mapping[str, tuple[str, ...]] = {
    "servo/case1": ("lqr",),
    "cart_pendulum/case2": ("lqr", "fl-lqr"),
    "arm/case1": ("lqr",),
    "two_link_arm/case1": ("lqr",),
    "rivals/servo": ("lqi", "adrc"),
    "rivals/two_link_arm": ("lqi", "adrc"),
    "jaco/eight": ("lqr", "grosmc"),
}


class Cost(NamedTuple):
    """Cost of a call.

    Attributes:
        mean: Mean of the instructions.
        most: Most of them.
        code: Code and constants [bytes].
        stack: Depth of the stack [bytes].
        different: Random states, of ``_STATES`` and some with extreme numbers, with another bit.
    """

    mean: float
    most: float
    code: int
    stack: int
    different: int


def cost(law: LawInC, experiment: Experiment, name: str) -> Cost:
    """Measure the cost of a law at random states on a processor."""
    with (
        tempfile.TemporaryDirectory() as folder,
        emulated_law(law, PROCESSORS[name], Path(folder)) as emulated,
    ):
        compared = compare_at_samples(law, emulated, random_runs(experiment.x0, _STATES))
        instructions = emulated.instructions[:_STATES]
        size = emulated.size
        mean = float(np.mean(instructions))
        return Cost(mean, max(instructions), size.code, emulated.stack, compared.different)


def _laws() -> Iterator[tuple[str, Experiment, LawInC]]:
    """Yield the laws of the table, with their names and cases."""
    for target, names in _LAWS.items():
        experiment = Experiment.load(target)
        for name in names:
            yield f"{target} {name}", experiment, _exported(experiment, name)
        if target in ("servo/case1", "cart_pendulum/case2", "arm/case1", "two_link_arm/case1"):
            for switching in _SWITCHING:
                switched = experiment.changed(switching=switching)
                yield f"{target} grosmc, {switching}", switched, _exported(switched, "grosmc")


def _exported(experiment: Experiment, name: str) -> LawInC:
    """Return a law of a case as C."""
    controller = experiment.law(experiment.nominal.truest, name)
    period = experiment.settings.control_period
    return LawInC(controller, "law", experiment.nominal.system, period)


def processor_table() -> str:
    """Return the table of docs/processors.md, in Markdown."""
    columns = [*words("law")]
    for name in _ON:
        title = PROCESSORS[name].title
        columns += numbers(f"{title}: instructions, most", "code", "stack", "other bits")
    rows = []
    for label, experiment, law in _laws():
        cells = [label]
        for name in _ON:
            found = cost(law, experiment, name)
            bits = f"{found.different}" if found.different else "none"
            cells += [
                f"{found.mean:.0f}, {found.most:.0f}",
                f"{found.code}",
                f"{found.stack}",
                bits,
            ]
        rows.append(cells)
    return "\n".join(table("", columns, rows).markdown())


if __name__ == "__main__":
    replace_marked(Path("docs/processors.md"), "processors", processor_table)

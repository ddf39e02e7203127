"""Case file of tuned laws, and what is required of laws whichever ones a file names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.experiments.file.shipped import name_for_people
from grosmc_mj.experiments.file.text import text_of
from grosmc_mj.experiments.requirement_tables import kinds_in
from grosmc_mj.studies.tune.numbers import TunableLaw


def case_text(
    experiment: Experiment,
    laws: Sequence[TunableLaw],
    values: Mapping[str, Mapping[str, float]],
    comments: Iterable[str],
) -> str:
    """Return the case file that extends a case with tuned laws, which alone it runs.

    Args:
        experiment: The case.
        laws: The laws.
        values: Numbers of each by its name, themselves by their names.
        comments: Lines that the file begins with.
    """
    content: Content = {
        "extends": name_for_people(experiment.path),
        "title": f"{experiment.title}: tuned laws",
        "laws": {law.base: _table(law, values[law.name]) for law in laws},
        "controller": [{"name": law.name, "law": law.base} for law in laws],
    }
    for law in laws:
        _write_of_case(content, experiment, law, values[law.name])
    content["requirement"] = list(_requirements(experiment, laws))
    # The claims of the file are about its own laws.
    if experiment.file.content.get("claim"):
        content["claim"] = []
    lines = [f"# {line}.\n" for line in comments]
    return "".join(lines) + text_of(content)


def with_requirements_of(experiment: Experiment, case: Experiment, law: TunableLaw) -> Experiment:
    """Return an experiment of one law, of which is asked what a case requires of any law.

    Args:
        experiment: Experiment with the law as its only controller.
        case: The case.
        law: The law.
    """
    content = {**experiment.file.content, "requirement": list(_requirements(case, [law]))}
    content["claim"] = []
    return replace(experiment, file=case_file_of(content, experiment.path))


def _table(law: TunableLaw, values: Mapping[str, float]) -> Content:
    """Table of a tuned law."""
    return law.with_numbers(values).file.content["laws"][law.base]


def _write_of_case(
    content: Content, experiment: Experiment, law: TunableLaw, values: Mapping[str, float]
) -> None:
    """Write the numbers of the case that were tuned with a law."""
    for tuned in law.numbers:
        if tuned.number.of_file:
            continue
        owner = tuned.number.place.owner
        if owner not in content:
            # An array of tables is the file's own.
            content[owner] = deepcopy(experiment.file.content.get(owner, []))
        tuned.number.write(content, values[tuned.name])


def _requirements(experiment: Experiment, laws: Sequence[TunableLaw]) -> Iterator[Content]:
    """Yield the tables of requirements, asked of the tuned laws whichever laws the file names."""
    names = [law.name for law in laws]
    file = experiment.file
    for required, written in zip(file.requirement, file.content["requirement"], strict=True):
        kinds = kinds_in(required)
        # Names of the laws by what can be asked of them.
        of_laws: dict[tuple[str, ...], list[str]] = {}
        for law in laws:
            controller = law.law.controller
            asked = tuple(
                kind.key
                for kind in kinds
                if kind.can_be_asked_of(controller, getattr(required, kind.key))
            )
            of_laws.setdefault(asked, []).append(law.name)

        for asked, of in of_laws.items():
            left_out = {kind.key for kind in kinds} - {*asked} | {"of"}
            content = {key: value for key, value in written.items() if key not in left_out}
            if asked:
                yield content if of == names else {"of": of, **content}

"""Why a run ended early, in one line."""

from __future__ import annotations

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import System
from grosmc_mj.simulation.trajectory import Status


def why_ended(status: Status, system: System, controller: Controller, time: float, x: Array) -> str:
    """One line for a run that could not go on; empty for one that could.

    Args:
        status: How it ended.
        system: The plant's.
        controller: Whose law it was.
        time: Up to which the run is valid [s].
        x: State there, (n,).
    """
    where = f"{system.name} under {controller.name} at t = {time:g} s"
    if status is Status.COMPLETED:
        return ""
    if status is Status.DIVERGED:
        return f"{where}: the state grew without bound; try a smaller control period or timestep"
    if status is Status.SINGULAR_PLANT:
        return f"{where}: the plant is singular at {system.singularity}"
    at = ", ".join(f"{value:.4g}" for value in x)
    if status is Status.UNDEFINED_INPUT:
        return f"{where}: the law returned no finite number at x = ({at})"
    if not (controller.linearizing and system.linearizable(x)):
        return f"{where}: the law is undefined outside {system.region}"
    return (
        f"{where}: the law is undefined at x = ({at}): the decoupling matrix E(x) of eq. (21) is "
        "singular there"
    )

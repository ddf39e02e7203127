"""A controller of a law of the package, or of the user's own."""

from __future__ import annotations

from dataclasses import replace

from grosmc_mj.experiments.file.user_code import is_named
from grosmc_mj.experiments.laws.own import own_controller
from grosmc_mj.experiments.laws.packaged import packaged_controller
from grosmc_mj.experiments.laws.request import LawRequest
from grosmc_mj.theory.control.controller import Controller


def design(request: LawRequest) -> Controller:
    """Design a controller for the nominal plant, sampled as printed.

    Raises:
        GrosmcError: If there is no such law, a number does not fit, or the design fails.
    """
    if is_named(request.table.law):
        controller = own_controller(request)
    else:
        controller = packaged_controller(request)
    return replace(controller, name=request.table.called)

"""Kinds of laws: a class each, with its numbers as fields, in a file of its own.

``kind`` has the base class. A further kind is a class in a new file here, and stands in ``KINDS``.
"""

from __future__ import annotations

from grosmc_mj.theory.control.kinds.adaptive import Adaptive, LinearAdaptive
from grosmc_mj.theory.control.kinds.adrc import Adrc, LinearAdrc
from grosmc_mj.theory.control.kinds.cart import CartIsm, CartLqr, CartPfl
from grosmc_mj.theory.control.kinds.fl_lqr import FlLqr
from grosmc_mj.theory.control.kinds.fl_pid import FlPid, LinearPid
from grosmc_mj.theory.control.kinds.grosmc import Grosmc
from grosmc_mj.theory.control.kinds.kind import LawKind
from grosmc_mj.theory.control.kinds.linear_grosmc import (
    LinearGrosmc,
    StateGrosmc,
    UnderactuatedGrosmc,
)
from grosmc_mj.theory.control.kinds.lqi import LinearLqi, Lqi
from grosmc_mj.theory.control.kinds.lqr import ComputedTorqueLqr, Lqr
from grosmc_mj.theory.control.kinds.pd import Pd
from grosmc_mj.theory.control.kinds.pid import Pid
from grosmc_mj.theory.control.kinds.regulating_grosmc import RegulatingGrosmc

# All kinds, in the order in which they are listed. On one plant there is one of a key.
KINDS: tuple[type[LawKind], ...] = (
    Lqr,
    ComputedTorqueLqr,
    FlLqr,
    Pd,
    Grosmc,
    UnderactuatedGrosmc,
    LinearGrosmc,
    StateGrosmc,
    RegulatingGrosmc,
    Pid,
    Lqi,
    FlPid,
    Adrc,
    Adaptive,
    LinearLqi,
    LinearPid,
    LinearAdrc,
    LinearAdaptive,
    CartLqr,
    CartIsm,
    CartPfl,
)

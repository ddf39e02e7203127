"""The Brunovsky form that feedback linearization leads to, eqs. (24) and (45)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array


@dataclass(frozen=True, eq=False)
class Chains:
    """z_i^(r_i) = v_i: a chain of integrators for each output, z' = A z + B v.

    Attributes:
        relative_degree: r_1 ... r_m: how often each output is differentiated until an input
            appears.
    """

    relative_degree: tuple[int, ...]

    @cached_property
    def last_rows(self) -> tuple[int, ...]:
        """Rows of z' in which the inputs appear."""
        return tuple((np.cumsum(self.relative_degree) - 1).tolist())

    @cached_property
    def first_rows(self) -> tuple[int, ...]:
        """Entries of z that are outputs."""
        return tuple(r - d + 1 for r, d in zip(self.last_rows, self.relative_degree, strict=True))

    @cached_property
    def A(self) -> Array:
        """State matrix, (sum r, sum r)."""
        return np.asarray(
            scipy.linalg.block_diag(*(np.eye(r, k=1) for r in self.relative_degree)), float
        )

    @cached_property
    def B(self) -> Array:
        """Input matrix, (sum r, m)."""
        matrix = np.zeros((sum(self.relative_degree), len(self.relative_degree)))
        matrix[self.last_rows, range(len(self.relative_degree))] = 1.0
        return matrix

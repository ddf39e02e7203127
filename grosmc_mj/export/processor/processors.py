"""Processors of controllers that an exported law can be run on, by the names of their cores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Processor:
    """A core of Arm and a board with it that QEMU emulates.

    Attributes:
        title: Name for people.
        about: What it computes in hardware.
        flags: Options of the compiler.
        board: Name of the board in QEMU.
        clock: Clock of its timer [Hz].
        code: Address of its program memory.
        data: Address of its data memory.
    """

    title: str
    about: str
    flags: tuple[str, ...]
    board: str
    clock: float
    code: str
    data: str


PROCESSORS: Mapping[str, Processor] = {
    "cortex-m4": Processor(
        title="Cortex-M4F",
        about="doubles in software",
        flags=("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"),
        board="mps2-an386",
        clock=25e6,
        code="0x00000000",
        data="0x20000000",
    ),
    "cortex-m7": Processor(
        title="Cortex-M7",
        about="doubles in hardware",
        flags=("-mcpu=cortex-m7", "-mfpu=fpv5-d16"),
        board="mps2-an500",
        clock=25e6,
        code="0x00000000",
        data="0x20000000",
    ),
    "cortex-m33": Processor(
        title="Cortex-M33",
        about="doubles in software",
        flags=("-mcpu=cortex-m33", "-mfpu=fpv5-sp-d16"),
        board="mps2-an505",
        clock=20e6,
        code="0x10000000",
        data="0x38000000",
    ),
}

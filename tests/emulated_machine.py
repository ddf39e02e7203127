"""Run a command as on an older machine: its vector instructions, BLAS kernels and libm.

    python tests/emulated_machine.py nehalem python -m pytest ...

The libraries read these variables when they are loaded, so the command is a process of its own.
What the variables bring about is looked at first. MuJoCo's own code stays as it is.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

# NUMBA_CPU_FEATURES must be there and empty: without it numba adds the host's to the named CPU's.
MACHINES = {
    # 2008: SSE4.2, neither AVX nor fused multiply-add.
    "nehalem": {
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "nehalem",
        "NUMBA_CPU_FEATURES": "",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA",
    },
    # 2013: AVX2 and fused multiply-add, no AVX-512, of which libm makes no use.
    "haswell": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4",
    },
}
# Nehalem's libraries beside laws compiled for this machine: nothing is compiled anew for it.
MACHINES["nehalem-libraries"] = {
    name: value for name, value in MACHINES["nehalem"].items() if not name.startswith("NUMBA")
}
# What NumPy says that it computes exp with, by OpenBLAS's kernels.
LEVELS = {"Nehalem": "baseline(X86_V2)", "Haswell": "X86_V3"}


def main(arguments: list[str]) -> NoReturn:
    """Check that the machine is what it is called, then become the command."""
    if len(arguments) < 2 or arguments[0] not in MACHINES:
        sys.exit(f"usage: emulated_machine.py {{{','.join(MACHINES)}}} COMMAND ...")
    name, *command = arguments
    machine = MACHINES[name]
    found, here = seen(machine), seen({})
    core = machine["OPENBLAS_CORETYPE"]
    wanted = {
        "OpenBLAS": [core, core],
        "NumPy": LEVELS[core],
        "numba": machine.get("NUMBA_CPU_NAME", here["numba"]),
    }
    wrong = [f"{what} is {found[what]}, not {each}" for what, each in wanted.items()
             if found[what] != each]  # fmt: skip
    if "GLIBC_TUNABLES" in machine and here["fused"] and found["libm"] == here["libm"]:
        wrong.append("libm rounds as it does here")
    if wrong:
        sys.exit(f"{name} cannot be emulated: {'; '.join(wrong)}")
    sys.stderr.write(f"As on {name}; this machine: {here}\n")
    os.execvpe(command[0], command, {**os.environ, **machine})


def seen(machine: dict[str, str]) -> dict[str, Any]:
    """What the libraries of a process under these variables say of themselves."""
    own = {variable for each in MACHINES.values() for variable in each}
    clean = {name: value for name, value in os.environ.items() if name not in own}
    done = subprocess.run(
        [sys.executable, __file__, "--report"],
        env={**clean, **machine},
        stdout=subprocess.PIPE,
        check=True,
    )
    return json.loads(done.stdout)


def report() -> dict[str, Any]:
    """What the libraries of this process say of themselves; of libm, some digits."""
    import ctypes

    import numpy as np
    import scipy
    from numba.core.registry import cpu_target
    from numpy._core._multiarray_umath import __cpu_features__

    cores = []
    for package, suffix in ((np, "64_"), (scipy, "")):
        home = Path(str(package.__file__)).parent
        (library,) = home.with_name(f"{home.name}.libs").glob("libscipy_openblas*")
        corename = getattr(ctypes.CDLL(str(library)), f"scipy_openblas_get_corename{suffix}")
        corename.restype = ctypes.c_char_p
        cores.append(corename().decode())
    target: Any = cpu_target.target_context
    (exp,) = np.lib.introspect.opt_func_info(func_name="^exp$", signature="d")["exp"].values()
    digits = "".join(math.sin(1e-3 * k).hex() for k in range(10_000))
    return {
        "OpenBLAS": cores,
        "NumPy": exp["current"],
        "numba": target.codegen().magic_tuple()[1],
        "libm": hashlib.sha256(digits.encode()).hexdigest()[:8],
        "fused": bool(__cpu_features__["FMA3"]),
    }


if __name__ == "__main__":
    if sys.argv[1:] == ["--report"]:
        sys.stdout.write(json.dumps(report()))
    else:
        main(sys.argv[1:])

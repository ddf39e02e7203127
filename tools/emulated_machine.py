"""Run a command as on another machine: its vector instructions, BLAS kernels and libm.

    python tools/emulated_machine.py nehalem python -m pytest ...

The libraries read these variables when they are loaded, so the command is a process of its own.
What the variables bring about is looked at first. MuJoCo's own code stays as it is.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

# 2008: SSE4.2, neither AVX nor fused multiply-add. 2013: both, no AVX-512, which libm doesn't use.
# NUMBA_CPU_FEATURES must be there and empty: without it numba adds the host's to the named CPU's.
NEHALEM = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA",
}
HASWELL = {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V4"}
MACHINES = {
    "nehalem": {**NEHALEM, "NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": ""},
    "haswell": {**HASWELL, "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""},
    # Beside laws compiled for this machine: nothing is compiled anew. The kernel may be this
    # machine's, or agree with it by chance: linear algebra has other last digits as well.
    "other-libraries": {**NEHALEM, "LAST_DIGITS": "1"},
}
# What NumPy says that it computes exp with, by OpenBLAS's kernels.
LEVELS = {"Nehalem": "baseline(X86_V2)", "Haswell": "X86_V3"}


def main(name: str, *command: str) -> None:
    """Check that the machine is what it is called, then become the command."""
    machine = MACHINES[name]
    there, here, core = seen(machine), seen({}), machine["OPENBLAS_CORETYPE"]
    expected = {
        "OpenBLAS": [core, core],
        "NumPy": LEVELS[core],
        "numba": machine.get("NUMBA_CPU_NAME", here["numba"]),
    }
    wrong = [
        f"{library} is {there[library]}"
        for library in expected
        if there[library] != expected[library]
    ]
    if "GLIBC_TUNABLES" in machine and here["fused"] and there["libm"] == here["libm"]:
        wrong.append("libm rounds as it does here")
    if wrong:
        sys.exit(f"{name} cannot be emulated: {'; '.join(wrong)}")
    sys.stderr.write(f"As on {name}; this machine: {here}\n")
    os.execvpe(command[0], command, {**os.environ, **machine})


def seen(machine: dict[str, str]) -> dict[str, Any]:
    """What the libraries of a process under these variables say of themselves."""
    own = {variable for variables in MACHINES.values() for variable in variables}
    clean = {name: value for name, value in os.environ.items() if name not in own}
    return json.loads(subprocess.check_output([sys.executable, __file__], env={**clean, **machine}))


def report() -> dict[str, Any]:
    """What the libraries of this process say of themselves; of libm, some digits."""
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
    if not sys.argv[1:]:
        sys.stdout.write(json.dumps(report()))
    elif sys.argv[1] not in MACHINES or not sys.argv[2:]:
        sys.exit(f"usage: emulated_machine.py {{{','.join(MACHINES)}}} COMMAND ...")
    else:
        main(*sys.argv[1:])

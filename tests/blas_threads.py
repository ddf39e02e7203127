"""One thread for a BLAS, from before NumPy is imported: matrices of ten rows gain nothing by more.

A process a core runs tests; threads that wait for each other take hundreds of times as long there.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

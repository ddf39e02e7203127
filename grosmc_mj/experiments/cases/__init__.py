"""The shipped cases: data, and beside them Python that one case alone needs."""

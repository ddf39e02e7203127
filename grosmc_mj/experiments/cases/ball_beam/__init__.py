"""A ball on a beam: as equations that laws simplify (sine), and as an MJCF (balance, heavier)."""

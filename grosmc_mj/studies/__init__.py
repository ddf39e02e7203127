"""Questions that go beyond one case, a folder each: ``measure``, ``figure``, ``report``."""

"""Robots that come with other packages."""

"""Recorded runs as films: the scene with its marks and camera, the curves, the encoder."""

"""Magnetic levitation, as an example of a plant that rests away from zero."""

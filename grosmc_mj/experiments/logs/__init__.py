"""Logs of a machine: read from files, cleaned, in the units of its inputs and states."""

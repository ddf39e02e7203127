"""Closed loops on equations and in MuJoCo: ``simulate`` is the one entry.

``mujoco_plant``, ``edits`` and ``disturbances`` say what is simulated, ``trajectory`` what comes
back; ``engines`` step it, ``robots`` are models of several joints without equations in symbols.
"""

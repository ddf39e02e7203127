"""The names that Gymnasium knows the cases by.

Importing this module registers them where Gymnasium is installed. Gymnasium 1.0 asks no installed
package for its environments any more; it imports the module that an id names:
``gymnasium.make("grosmc_mj.environments.gymnasium_ids:grosmc_mj/Servo-v0")``.
"""

from __future__ import annotations

from importlib.util import find_spec

from grosmc_mj.ground.errors import SetupError

IDS = {
    "grosmc_mj/Servo-v0": "servo",
    "grosmc_mj/CartPendulum-v0": "cart_pendulum",
    "grosmc_mj/Arm-v0": "arm",
    "grosmc_mj/TwoLinkArm-v0": "two_link_arm",
}
_FACE = "grosmc_mj.environments.gymnasium_face:CaseEnv"


def register() -> tuple[str, ...]:
    """Make the environments known to ``gymnasium.make``; a second call changes nothing.

    Returns:
        Their ids. ``make`` passes on ``task``, ``control_period``, ``timestep`` and ``spread``.

    Raises:
        SetupError: If Gymnasium is not installed.
    """
    try:
        import gymnasium
    except ImportError as error:
        raise SetupError(
            "Gymnasium is not installed: pip install 'grosmc_mj[gymnasium]'"
        ) from error
    for name, system in IDS.items():
        if name not in gymnasium.registry:
            # No order-keeping or checking wrapper would change a number; they stay as they are.
            gymnasium.register(name, _FACE, kwargs={"system": system})
    return tuple(IDS)


if find_spec("gymnasium") is not None:
    register()

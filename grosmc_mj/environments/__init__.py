"""The plants as environments of dm_control and Gymnasium, and their policies as controllers.

It offers ``load``, ``register`` and ``CaseEnv``; ``law_policy`` is a law as a policy, and
``policy_controller`` a policy as a law, which a case's requirements judge like any other. The names
load on first use: neither dm_control nor Gymnasium is needed for what doesn't use it. It imports
output, experiments and below.
"""

import lazy_loader

# No module has the name of a function: importing it would take the function's place.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
